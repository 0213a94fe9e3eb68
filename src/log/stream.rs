//! Header and records become the bytes of an MCAP file, in memory: no file, no clock, no error.
//!
//! Chunks are compressed on this thread and complete when they leave (`disable_seeking`): the file
//! never holds a chunk whose length is still open.
//!
//! Invariant: the bytes taken, one after the other, are the file; every offset in the file's
//! index relies on it.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Attachment, Compression, WriteOptions};

use crate::base::input::Input;
use crate::base::record::CycleRecord;

use super::cdr::Encoder;
use super::header::{Header, MACHINE_ATTACHMENT, METADATA};
use super::{input, schema};

/// An MCAP file in the making.
pub(super) struct Stream {
    file: mcap::Writer<NoSeek<Shelf>>,
    shelf: Shelf,
    header: Header,
    cycles: Channel,
    inputs: Channel,
    encoder: Encoder,
    open_records: u64,
    open_bytes: usize,
}

impl Stream {
    /// Starts the file with its header.
    pub(super) fn new(header: Header) -> mcap::McapResult<Self> {
        let shelf = Shelf::default();
        let mut file = WriteOptions::new()
            .profile("quadrant")
            .library(format!("quadrant {}", header.project_version))
            .compression(Some(Compression::Zstd))
            .compression_level(1) // as small as the default of 3 on cycles, at twice the speed
            .compression_threads(0)
            .chunk_size(None)
            .disable_seeking(true)
            .create(NoSeek::new(shelf.clone()))?;
        file.write_metadata(&Metadata { name: METADATA.to_owned(), metadata: header.to_keys() })?;
        file.attach(&Attachment {
            log_time: u64::try_from(header.wall_at_zero_ns).unwrap_or(0),
            create_time: u64::try_from(header.wall_at_zero_ns).unwrap_or(0),
            name: MACHINE_ATTACHMENT.to_owned(),
            media_type: "application/toml".to_owned(),
            data: header.machine_text.as_bytes().into(),
        })?;
        let text = schema::text(&header.axes);
        let mut channel = |name, text: &str, topic| -> mcap::McapResult<Channel> {
            let schema = file.add_schema(name, schema::SCHEMA_ENCODING, text.as_bytes())?;
            let id = file.add_channel(schema, topic, schema::MESSAGE_ENCODING, &BTreeMap::new())?;
            Ok(Channel { id, sequence: 0 })
        };
        let cycles = channel(schema::SCHEMA_NAME, &text, schema::TOPIC)?;
        let inputs = channel(input::SCHEMA_NAME, input::SCHEMA, input::TOPIC)?;
        let encoder = Encoder::default();
        Ok(Self { file, shelf, header, cycles, inputs, encoder, open_records: 0, open_bytes: 0 })
    }

    /// Adds a record to the open chunk, behind what its cycle was told.
    pub(super) fn push(&mut self, record: &CycleRecord, inputs: &[Input]) -> mcap::McapResult<()> {
        let wall_ns = self.header.wall_ns(record.timing.scheduled);
        for told in inputs {
            self.encoder.restart();
            input::put(told, &mut self.encoder);
            self.open_bytes += self.encoder.bytes().len();
            self.file.write_to_known_channel(&self.inputs.envelope(wall_ns), self.encoder.bytes())?;
        }
        self.encoder.restart();
        schema::put(record, &mut self.encoder);
        self.file.write_to_known_channel(&self.cycles.envelope(wall_ns), self.encoder.bytes())?;
        self.open_records += 1;
        self.open_bytes += self.encoder.bytes().len();
        Ok(())
    }

    /// Length of the open chunk before compression, in bytes of messages.
    pub(super) const fn open_bytes(&self) -> usize {
        self.open_bytes
    }

    /// Completes the open chunk and says how many records are in it. A chunk without records stays
    /// open: its times would be zero, and viewers would start the file in 1970.
    pub(super) fn end_chunk(&mut self) -> mcap::McapResult<u64> {
        if self.open_records > 0 {
            self.file.flush()?;
        }
        self.open_bytes = 0;
        Ok(std::mem::take(&mut self.open_records))
    }

    /// Completes the file with its index.
    pub(super) fn finish(&mut self) -> mcap::McapResult<()> {
        self.file.finish().map(drop)
    }

    /// Moves what is complete to the end of `bytes`.
    pub(super) fn take(&mut self, bytes: &mut Vec<u8>) {
        bytes.append(&mut self.shelf.bytes());
    }
}

/// One topic of the file.
struct Channel {
    id: u16,
    sequence: u32,
}

impl Channel {
    /// Of its next message.
    fn envelope(&mut self, wall_ns: u64) -> MessageHeader {
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        MessageHeader { channel_id: self.id, sequence, log_time: wall_ns, publish_time: wall_ns }
    }
}

/// Where the MCAP writer puts bytes and the stream takes them away. Both are on one thread at a
/// time, so the lock is never waited for.
#[derive(Clone, Debug, Default)]
struct Shelf(Arc<Mutex<Vec<u8>>>);

impl Shelf {
    fn bytes(&self) -> MutexGuard<'_, Vec<u8>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for Shelf {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.bytes().extend_from_slice(bytes);
        Ok(bytes.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
