//! The whole chunks of a file, wherever they are, and an account of all that lies between them.
//!
//! Invariant: a chunk is whole when its checksum holds and every message in it is a record of this
//! version; the bytes of everything else that should have held records are counted.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

use mcap::MAGIC;
use mcap::records::{Record, op};

use crate::base::input::Input;
use crate::base::record::CycleRecord;

use super::chunk::{self, SIGNATURE, SIGNATURE_AT};
use super::frame::{BODY_BYTES_MAX, HEAD_BYTES, le_u64};
use super::reader::Message;
use super::{input, schema};

/// A chunk up to its compressed contents, whose length is the last thing before them.
const CHUNK_HEAD_BYTES: usize = SIGNATURE_AT + SIGNATURE.len() + 8;
/// How much of the file is searched at a time.
const SEARCH_BYTES: usize = 64 << 10;

/// A whole chunk.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// Its records, at least one.
    pub(super) records: Vec<CycleRecord>,
    /// What its cycles were told.
    pub(super) inputs: Vec<Input>,
    /// Wall clock of the first, nanoseconds since 1970.
    pub(super) wall_ns: u64,
    first_sequence: u32,
}

impl Found {
    /// Axes of its records.
    pub(super) fn axes(&self) -> usize {
        self.records.first().map_or(0, |record| record.axes.count())
    }
}

/// Walks a file from chunk to chunk.
#[derive(Debug)]
pub(super) struct Salvage {
    source: File,
    total: u64,
    /// Everything before is accounted for.
    at: u64,
    sequence: u32,
    records: u64,
    records_skipped: u64,
    records_in_statistics: u64,
    bytes_lost: u64,
}

impl Salvage {
    pub(super) fn new(source: File) -> io::Result<Self> {
        let total = source.metadata()?.len();
        Ok(Self {
            source,
            total,
            at: 0,
            sequence: 0,
            records: 0,
            records_skipped: 0,
            records_in_statistics: 0,
            bytes_lost: 0,
        })
    }

    /// Length of the file in bytes.
    pub(super) const fn total(&self) -> u64 {
        self.total
    }

    /// Bytes without use in all that was walked.
    pub(super) const fn bytes_lost(&self) -> u64 {
        self.bytes_lost
    }

    /// Records known to be missing: skipped in the numbering, or counted by the statistics at the
    /// end of the file.
    pub(super) fn records_lost(&self) -> u64 {
        self.records_skipped.max(self.records_in_statistics.saturating_sub(self.records))
    }

    /// The next whole chunk; `None` when the rest of the file has none.
    pub(super) fn next_chunk(&mut self) -> io::Result<Option<Found>> {
        let mut from = self.at;
        while let Some(signature) = self.find(from)? {
            from = signature + 1;
            let Some(start) = signature.checked_sub(SIGNATURE_AT as u64).filter(|start| *start >= self.at)
            else {
                continue;
            };
            let Some((found, end)) = self.open(start)? else { continue };
            self.account(start)?;
            self.at = end;
            let Some(last) = u32::try_from(found.records.len()).ok().filter(|count| *count > 0) else {
                from = end;
                continue;
            };
            let skipped = found.first_sequence.wrapping_sub(self.sequence);
            // Numbers that run backwards come from a file that was pieced together; they tell nothing.
            self.records_skipped += if skipped < u32::MAX / 2 { u64::from(skipped) } else { 0 };
            self.sequence = found.first_sequence.wrapping_add(last);
            self.records += u64::from(last);
            return Ok(Some(found));
        }
        self.account(self.total)?;
        self.at = self.total;
        Ok(None)
    }

    /// Where the next signature at or after `from` starts.
    fn find(&mut self, mut from: u64) -> io::Result<Option<u64>> {
        let mut block = Vec::with_capacity(SEARCH_BYTES);
        loop {
            block.clear();
            self.source.seek(SeekFrom::Start(from))?;
            self.source.by_ref().take(SEARCH_BYTES as u64).read_to_end(&mut block)?;
            if let Some(place) = block.windows(SIGNATURE.len()).position(|bytes| bytes == SIGNATURE) {
                return Ok(Some(from + place as u64));
            }
            if block.len() < SEARCH_BYTES {
                return Ok(None);
            }
            from += (SEARCH_BYTES - SIGNATURE.len() + 1) as u64;
        }
    }

    /// The chunk that starts at `start` and where it ends, if it is whole. Its own account of its
    /// length counts, not that of the record around it.
    fn open(&mut self, start: u64) -> io::Result<Option<(Found, u64)>> {
        let mut chunk = vec![0; CHUNK_HEAD_BYTES];
        if !self.read(start, &mut chunk)? {
            return Ok(None);
        }
        let contents = le_u64(&chunk[CHUNK_HEAD_BYTES - 8..]);
        let left = self.total - start - CHUNK_HEAD_BYTES as u64;
        if contents > left.min(BODY_BYTES_MAX) {
            return Ok(None);
        }
        let length = CHUNK_HEAD_BYTES + contents as usize;
        chunk.resize(length, 0);
        self.read(start, &mut chunk)?;
        chunk[0] = op::CHUNK;
        chunk[1..HEAD_BYTES].copy_from_slice(&((length - HEAD_BYTES) as u64).to_le_bytes());
        Ok(records(&chunk).map(|found| (found, start + length as u64)))
    }

    /// Fills `bytes` from `start`; false when the file ends before.
    fn read(&mut self, start: u64, bytes: &mut [u8]) -> io::Result<bool> {
        if start.checked_add(bytes.len() as u64).is_none_or(|end| end > self.total) {
            return Ok(false);
        }
        self.source.seek(SeekFrom::Start(start))?;
        self.source.read_exact(bytes).map(|()| true)
    }

    /// Counts what is of no use from where the account stands to `to`: chunks that did not open, and
    /// everything behind the first byte that is no record any more.
    fn account(&mut self, to: u64) -> io::Result<()> {
        let mut at = self.at;
        let mut word = [0; MAGIC.len()];
        if at == 0 && self.read(0, &mut word)? && word == MAGIC {
            at = MAGIC.len() as u64;
        }
        let is_end = |word: &[u8], at: u64, total: u64| word == MAGIC && at + MAGIC.len() as u64 == total;
        while at < to && !(self.read(at, &mut word)? && is_end(&word, at, self.total)) {
            let Some((opcode, length)) = self.record_at(at, to)? else {
                self.bytes_lost += to - at;
                return Ok(());
            };
            match opcode {
                op::CHUNK => self.bytes_lost += length,
                op::STATISTICS => self.records_in_statistics = self.statistics(at, length)?,
                _ => {}
            }
            at += length;
        }
        Ok(())
    }

    /// Type and whole length of the record at `at`, if there is one that ends before `to`.
    fn record_at(&mut self, at: u64, to: u64) -> io::Result<Option<(u8, u64)>> {
        let mut head = [0; HEAD_BYTES];
        if !self.read(at, &mut head)? || !(op::HEADER..=op::DATA_END).contains(&head[0]) {
            return Ok(None);
        }
        let length = le_u64(&head[1..]).saturating_add(HEAD_BYTES as u64);
        Ok((length <= to - at).then_some((head[0], length)))
    }

    /// How many records the statistics count; 0 when they contradict themselves.
    fn statistics(&mut self, at: u64, length: u64) -> io::Result<u64> {
        let mut record = vec![0; length.min(BODY_BYTES_MAX) as usize];
        self.read(at, &mut record)?;
        let Ok(Record::Statistics(statistics)) = mcap::parse_record(op::STATISTICS, &record[HEAD_BYTES..])
        else {
            return Ok(0);
        };
        let counts = &statistics.channel_message_counts;
        let by_channel = counts.values().try_fold(0_u64, |sum, count| sum.checked_add(*count));
        // The cycles are on the first channel of a log.
        let cycles = counts.first_key_value().map_or(0, |(_, count)| *count);
        Ok(if by_channel == Some(statistics.message_count) { cycles } else { 0 })
    }
}

/// The records of a chunk, if it is whole.
fn records(chunk: &[u8]) -> Option<Found> {
    let mut found = Found::default();
    let mut axes = None;
    let opened = chunk::open(chunk, |opcode, body| {
        if opcode == op::MESSAGE {
            let message = Message::parse(body)?;
            // The declarations of the channels may be lost; the length tells them apart.
            if message.payload.len() == input::MESSAGE_BYTES {
                found.inputs.push(input::decode(message.payload).map_err(|error| error.to_string())?);
                return Ok(());
            }
            let axes = *axes.get_or_insert_with(|| schema::axes_of(message.payload.len()).unwrap_or(0));
            let record = schema::decode(message.payload, axes).map_err(|error| error.to_string())?;
            if found.records.is_empty() {
                (found.first_sequence, found.wall_ns) = (message.sequence, message.wall_ns);
            }
            found.records.push(record);
        }
        Ok::<_, String>(())
    });
    opened.is_ok().then_some(found)
}
