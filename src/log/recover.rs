//! A new, valid log from what is readable of a damaged one.
//!
//! Chunks are found by their signature, not by walking from record to record: the name of the
//! compression stands at a fixed place of a chunk, and the chunk says its own length there. So a
//! wrong length, a stretch of zeros or a missing piece costs only the chunks it touches. A chunk
//! counts only when its checksum holds, and so do the two parts of the header; nothing is guessed.
//!
//! Invariant: a record in the new log stood in the old one, bit for bit, in the same order.

use std::fs::File;
use std::io::{self, BufReader, Write};
use std::path::{Path, PathBuf};

use mcap::records::{Record, op};

use crate::base::axis::AxisId;
use crate::base::time::Span;

use super::error::LogError;
use super::frame::Frames;
use super::header::{Header, MACHINE_ATTACHMENT, METADATA, Pace};
use super::reader::attachment;
use super::salvage::{Found, Salvage};
use super::stream::Stream;
use super::writer::{CHUNK_BYTES, create};

/// What could be kept.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Recovery {
    /// The new log.
    pub path: PathBuf,
    /// Records in it.
    pub records: u64,
    /// Records known to be missing, by their numbering and by the old log's statistics. How many
    /// were in a piece cut off at the end, nobody knows.
    pub records_lost: u64,
    /// Bytes of the old log that are of no use any more.
    pub bytes_lost: u64,
    /// A part of the old header was unreadable, and the new one says so under `extra.recovered`.
    pub is_header_lost: bool,
}

/// Writes what is readable of the log `from` into the new log `to`.
///
/// # Errors
/// `from` cannot be read, is of another format version or has neither a whole header nor a whole
/// chunk; `to` exists or cannot be written.
pub fn recover(from: &Path, to: &Path) -> Result<Recovery, LogError> {
    let source = File::open(from).map_err(LogError::io(from, "open"))?;
    let mut salvage = Salvage::new(source).map_err(LogError::io(from, "read"))?;
    let mut next = || salvage.next_chunk().map_err(LogError::io(from, "read"));
    let parts = Parts::read(from)?;
    let first = next()?;
    let Some((header, is_header_lost)) = parts.header(from, first.as_ref()) else {
        return Err(LogError::NothingToRecover { file: from.to_owned(), bytes: salvage.total() });
    };
    let mut output = Output::create(to, header)?;
    let axes = first.as_ref().map(Found::axes);
    let mut records = 0;
    let mut found = first;
    while let Some(chunk) = found {
        // A stray chunk of another machine cannot stand in this log.
        if Some(chunk.axes()) == axes {
            output.write(&chunk)?;
            records += chunk.records.len() as u64;
        }
        found = next()?;
    }
    output.finish()?;
    let (records_lost, bytes_lost) = (salvage.records_lost(), salvage.bytes_lost());
    Ok(Recovery { path: to.to_owned(), records, records_lost, bytes_lost, is_header_lost })
}

/// The two parts of a header, each if its checksum holds.
#[derive(Debug, Default)]
struct Parts {
    header: Option<Header>,
    machine_text: Option<String>,
}

impl Parts {
    /// What cannot be read is left out, but a whole header of another version is no damage: the
    /// records of such a log are not ours to read.
    fn read(from: &Path) -> Result<Self, LogError> {
        let mut parts = Self::default();
        let Ok(file) = File::open(from) else { return Ok(parts) };
        let Ok(mut frames) = Frames::new(BufReader::new(file), from) else { return Ok(parts) };
        while let Ok(Some(frame)) = frames.next() {
            match frame.opcode {
                op::METADATA => {
                    let Ok(Record::Metadata(record)) = mcap::parse_record(frame.opcode, frame.body()) else {
                        continue;
                    };
                    if record.name == METADATA {
                        let header = Header::from_keys(&record.metadata, String::new(), from, frame.offset);
                        parts.header = match header {
                            Err(error @ LogError::Version { .. }) => return Err(error),
                            header => header.ok(),
                        };
                    }
                }
                op::ATTACHMENT => {
                    if let Some((MACHINE_ATTACHMENT, text)) = attachment(frame.body()) {
                        parts.machine_text = String::from_utf8(text.to_vec()).ok();
                    }
                }
                op::CHUNK | op::DATA_END => break,
                _ => {}
            }
        }
        Ok(parts)
    }

    /// The new log's header, and whether a part of the old one is missing in it. `None` when there
    /// is nothing at all to say.
    fn header(self, from: &Path, first: Option<&Found>) -> Option<(Header, bool)> {
        let facts = self.header.filter(|header| first.is_none_or(|found| found.axes() == header.axes.len()));
        let mut notes = vec![format!("from {}", from.display())];
        if facts.is_none() {
            notes.push("facts of the run lost: commit, seed, pace, motions, gain sets".to_owned());
        }
        if self.machine_text.is_none() {
            notes.push("machine file lost".to_owned());
        }
        let mut header = facts.or_else(|| first.and_then(header_of_records))?;
        header.machine_text = self.machine_text.unwrap_or_default();
        header.extra.insert("recovered".to_owned(), notes.join("; "));
        Some((header, notes.len() > 1))
    }
}

/// What records tell about their run: axes, clock relation and period (1 ns when a single record
/// leaves it open).
fn header_of_records(found: &Found) -> Option<Header> {
    let (first, last) = (found.records.first()?, found.records.last()?);
    let cycles = last.cycle.saturating_sub(first.cycle).max(1);
    let period_ns = (last.timing.scheduled - first.timing.scheduled).as_ns() / i64::try_from(cycles).ok()?;
    let lost = || "lost".to_owned();
    Some(Header {
        project_version: lost(),
        commit: lost(),
        machine_name: lost(),
        machine_text: String::new(),
        sheets: Default::default(),
        seed: 0,
        pace: Pace::Realtime,
        wall_at_zero_ns: i64::try_from(found.wall_ns).ok()?.checked_sub(first.timing.scheduled.as_ns())?,
        axes: (0..found.axes()).map(|axis| AxisId::new(axis).to_string()).collect(),
        period: Span::ns(period_ns.max(1)),
        gain_sets: Vec::new(),
        motions: Default::default(),
        extra: Default::default(),
    })
}

/// The new log. Unlike a run, a recovery has nothing to lose by stopping at an error.
struct Output<'a> {
    path: &'a Path,
    file: File,
    stream: Stream,
    bytes: Vec<u8>,
}

impl<'a> Output<'a> {
    fn create(path: &'a Path, header: Header) -> Result<Self, LogError> {
        let file = create(path)?;
        let stream = Stream::new(header).map_err(io::Error::other).map_err(LogError::io(path, "build"))?;
        Ok(Self { path, file, stream, bytes: Vec::new() })
    }

    fn write(&mut self, chunk: &Found) -> Result<(), LogError> {
        let mut left = chunk.inputs.as_slice();
        for record in &chunk.records {
            let count = left.iter().take_while(|input| input.cycle <= record.cycle).count();
            let (told, later) = left.split_at(count);
            left = later;
            self.stream
                .push(record, told)
                .map_err(io::Error::other)
                .map_err(LogError::io(self.path, "build"))?;
            if self.stream.open_bytes() >= CHUNK_BYTES {
                self.flush()?;
            }
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), LogError> {
        self.stream.end_chunk().map_err(io::Error::other).map_err(LogError::io(self.path, "build"))?;
        self.write_out()
    }

    fn write_out(&mut self) -> Result<(), LogError> {
        self.bytes.clear();
        self.stream.take(&mut self.bytes);
        self.file.write_all(&self.bytes).map_err(LogError::io(self.path, "write"))
    }

    fn finish(mut self) -> Result<(), LogError> {
        self.flush()?;
        self.stream.finish().map_err(io::Error::other).map_err(LogError::io(self.path, "build"))?;
        self.write_out()?;
        self.file.sync_all().map_err(LogError::io(self.path, "write"))
    }
}
