//! A log, read from its start: the header at once, then record after record.
//!
//! A file that was killed reads up to its last whole chunk and says so ([`Reader::is_truncated`]).
//! Everything else that is not as written ends the reading with an error that names the byte.
//!
//! Invariant: memory holds one chunk at a time; after an error no more records come.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use mcap::records::{Record, op};

use crate::base::input::Input;
use crate::base::record::CycleRecord;

use super::chunk;
use super::error::LogError;
use super::frame::{Frame, Frames, le_u64};
use super::header::{Header, MACHINE_ATTACHMENT, METADATA};
use super::{input, schema};

/// Reads a log.
#[derive(Debug)]
pub struct Reader<R = BufReader<File>> {
    frames: Frames<R>,
    header: Header,
    contents: Contents,
    next: usize,
    inputs_taken: usize,
    is_over: bool,
}

impl Reader {
    /// Opens the log at `path`.
    ///
    /// # Errors
    /// See [`Reader::new`].
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let file = File::open(path).map_err(LogError::io(path, "open"))?;
        Self::new(BufReader::new(file), path)
    }
}

impl<R: Read + Seek> Reader<R> {
    /// Reads the header of a log in `source`; `file` names it in messages.
    ///
    /// # Errors
    /// No log of this project, another format version, a header that is cut off or damaged.
    pub fn new(source: R, file: &Path) -> Result<Self, LogError> {
        let mut frames = Frames::new(source, file)?;
        let header = read_header(&mut frames)?;
        let contents = Contents::new(&header);
        Ok(Self { frames, header, contents, next: 0, inputs_taken: 0, is_over: false })
    }

    /// What the log says about its run.
    pub const fn header(&self) -> &Header {
        &self.header
    }

    /// Whether the file ends without its index, as after a kill. Known once the last record was
    /// read; what came after the last whole chunk is not in it.
    pub const fn is_truncated(&self) -> bool {
        self.frames.is_truncated()
    }

    /// What the cycles up to that of `record` were told, since this was asked last: `record` is the one that
    /// was read last.
    pub fn inputs_until(&mut self, record: &CycleRecord) -> &[Input] {
        let left = self.contents.inputs.get(self.inputs_taken..).unwrap_or(&[]);
        let count = left.iter().take_while(|input| input.cycle <= record.cycle).count();
        self.inputs_taken += count;
        &left[..count]
    }

    /// Reads on to the next chunk that has records; false at the end of the file.
    fn read_chunk(&mut self) -> Result<bool, LogError> {
        (self.next, self.inputs_taken) = (0, 0);
        self.contents.clear();
        while let Some(frame) = self.frames.next()? {
            let offset = frame.offset;
            if frame.opcode != op::CHUNK && chunk::is_chunk(frame.bytes) {
                let what = format!("a chunk says that it is a record of type {:#04x}", frame.opcode);
                return Err(LogError::Damaged { file: self.frames.file().to_owned(), offset, what });
            }
            if frame.opcode == op::CHUNK {
                let opened = self.contents.read(frame);
                opened.map_err(|problem| problem.at(self.frames.file(), offset))?;
                if !self.contents.records.is_empty() {
                    return Ok(true);
                }
            }
        }
        if self.contents.channel.is_none() && !self.frames.is_truncated() {
            return Err(LogError::MissingChannel {
                file: self.frames.file().to_owned(),
                topic: schema::TOPIC,
            });
        }
        Ok(false)
    }
}

impl<R: Read + Seek> Iterator for Reader<R> {
    type Item = Result<CycleRecord, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next >= self.contents.records.len() {
            let more = if self.is_over { Ok(false) } else { self.read_chunk() };
            self.is_over = !matches!(more, Ok(true));
            match more {
                Ok(true) => {}
                Ok(false) => return None,
                Err(error) => {
                    self.contents.clear();
                    return Some(Err(error));
                }
            }
        }
        let record = self.contents.records.get(self.next).copied();
        self.next += 1;
        record.map(Ok)
    }
}

/// The metadata and the machine file stand before the first chunk.
fn read_header<R: Read + Seek>(frames: &mut Frames<R>) -> Result<Header, LogError> {
    let file = frames.file().to_owned();
    let damaged = |offset, what: String| LogError::Damaged { file: file.clone(), offset, what };
    let mut keys: Option<(BTreeMap<String, String>, u64)> = None;
    while let Some(frame) = frames.next()? {
        match frame.opcode {
            op::METADATA => match mcap::parse_record(frame.opcode, frame.body()) {
                Ok(Record::Metadata(metadata)) if metadata.name == METADATA => {
                    keys = Some((metadata.metadata, frame.offset));
                }
                Ok(_) => {}
                Err(error) => {
                    return Err(damaged(frame.offset, format!("the header cannot be read: {error}")));
                }
            },
            op::ATTACHMENT => {
                let Some((name, contents)) = attachment(frame.body()) else {
                    return Err(damaged(
                        frame.offset,
                        "the checksum of an attachment does not hold".to_owned(),
                    ));
                };
                if let (MACHINE_ATTACHMENT, Some((keys, offset))) = (name, &keys) {
                    let text = String::from_utf8(contents.to_vec())
                        .map_err(|_| damaged(frame.offset, format!("{MACHINE_ATTACHMENT} is not UTF-8")))?;
                    return Header::from_keys(keys, text, &file, *offset);
                }
            }
            op::CHUNK | op::DATA_END => {
                let what = "it has no `quadrant` metadata and machine file before its first chunk";
                return Err(LogError::NotALog { file, what });
            }
            _ => {}
        }
    }
    Err(LogError::HeaderCut { bytes: frames.total(), file })
}

/// Name and contents of an attachment whose checksum holds. Layout: two times of 8 bytes, name and
/// media type after lengths of 4, contents after a length of 8, checksum of all before.
pub(super) fn attachment(body: &[u8]) -> Option<(&str, &[u8])> {
    let (covered, checksum) = body.split_last_chunk()?;
    if crc32fast::hash(covered) != u32::from_le_bytes(*checksum) {
        return None;
    }
    let (name, rest) = short(covered.get(16..)?)?;
    let (_media_type, rest) = short(rest)?;
    let (length, contents) = rest.split_first_chunk::<8>()?;
    (u64::from_le_bytes(*length) == contents.len() as u64)
        .then_some((std::str::from_utf8(name).ok()?, contents))
}

/// Splits off what follows a length of 4 bytes.
fn short(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(u32::from_le_bytes(*length) as usize)
}

/// Why a chunk is not taken.
#[derive(Debug)]
pub(super) enum Problem {
    /// Not the bytes that were written.
    Damage(String),
    /// Whole, but not of this version.
    Foreign {
        /// What stands there.
        found: String,
        /// What this version knows.
        expected: String,
    },
}

impl From<String> for Problem {
    fn from(what: String) -> Self {
        Self::Damage(what)
    }
}

impl Problem {
    /// With its place.
    pub(super) fn at(self, file: &Path, offset: u64) -> LogError {
        let file = file.to_owned();
        match self {
            Self::Damage(what) => LogError::Damaged { file, offset, what },
            Self::Foreign { found, expected } => LogError::Foreign { file, offset, found, expected },
        }
    }
}

/// Records and inputs of one chunk, and what was said so far about the channels they are on.
#[derive(Debug)]
struct Contents {
    axes: usize,
    schema_text: String,
    schema: Option<u16>,
    channel: Option<u16>,
    input_schema: Option<u16>,
    input_channel: Option<u16>,
    records: Vec<CycleRecord>,
    inputs: Vec<Input>,
}

impl Contents {
    fn new(header: &Header) -> Self {
        let schema_text = schema::text(&header.axes);
        Self {
            axes: header.axes.len(),
            schema_text,
            schema: None,
            channel: None,
            input_schema: None,
            input_channel: None,
            records: Vec::new(),
            inputs: Vec::new(),
        }
    }

    fn clear(&mut self) {
        self.records.clear();
        self.inputs.clear();
    }

    fn read(&mut self, chunk: Frame<'_>) -> Result<(), Problem> {
        let outcome = chunk::open(chunk.bytes, |opcode, body| match opcode {
            op::MESSAGE => self.read_message(body),
            op::SCHEMA | op::CHANNEL => self.read_declaration(opcode, body),
            _ => Ok(()),
        });
        if outcome.is_err() {
            self.clear();
        }
        outcome
    }

    fn read_message(&mut self, body: &[u8]) -> Result<(), Problem> {
        let message = Message::parse(body)?;
        let of_this_version = |error: schema::DecodeError| foreign(error.to_string(), "of this version");
        if Some(message.channel) == self.channel {
            self.records.push(schema::decode(message.payload, self.axes).map_err(of_this_version)?);
        } else if Some(message.channel) == self.input_channel {
            self.inputs.push(input::decode(message.payload).map_err(of_this_version)?);
        } else {
            return Err(foreign(format!("a message on channel {}", message.channel), TOPICS));
        }
        Ok(())
    }

    /// A schema or channel: ours, or refused.
    fn read_declaration(&mut self, opcode: u8, body: &[u8]) -> Result<(), Problem> {
        match mcap::parse_record(opcode, body).map_err(|error| error.to_string())? {
            Record::Schema { header, data } => {
                let is_known = |name: &str, text: &str| {
                    header.name == name
                        && header.encoding == schema::SCHEMA_ENCODING
                        && *data == *text.as_bytes()
                };
                if is_known(schema::SCHEMA_NAME, &self.schema_text) {
                    self.schema = Some(header.id);
                } else if is_known(input::SCHEMA_NAME, input::SCHEMA) {
                    self.input_schema = Some(header.id);
                } else {
                    let found = format!("schema `{}` ({})", header.name, header.encoding);
                    return Err(foreign(
                        found,
                        "`quadrant/msg/Cycle` and `quadrant/msg/Input` (ros2msg) with the fields of this version",
                    ));
                }
            }
            Record::Channel(channel) => {
                let is_known = |topic: &str, schema: Option<u16>| {
                    channel.topic == topic
                        && channel.message_encoding == schema::MESSAGE_ENCODING
                        && Some(channel.schema_id) == schema
                };
                if is_known(schema::TOPIC, self.schema) {
                    self.channel = Some(channel.id);
                } else if is_known(input::TOPIC, self.input_schema) {
                    self.input_channel = Some(channel.id);
                } else {
                    let found = format!("channel `{}` ({})", channel.topic, channel.message_encoding);
                    return Err(foreign(found, TOPICS));
                }
            }
            _ => {}
        }
        Ok(())
    }
}

/// What a log of this version holds.
const TOPICS: &str = "`/cycle` and `/input` (cdr) alone";

fn foreign(found: String, expected: &str) -> Problem {
    Problem::Foreign { found, expected: expected.to_owned() }
}

/// A message with its envelope taken apart.
#[derive(Clone, Copy, Debug)]
pub(super) struct Message<'a> {
    /// Number of its channel.
    pub(super) channel: u16,
    /// Counts messages, wraps at 2^32.
    pub(super) sequence: u32,
    /// Wall clock of the cycle, nanoseconds since 1970.
    pub(super) wall_ns: u64,
    /// The record.
    pub(super) payload: &'a [u8],
}

impl<'a> Message<'a> {
    /// From the body of a message record: channel, sequence, log time, publish time, payload.
    pub(super) fn parse(body: &'a [u8]) -> Result<Self, String> {
        let (envelope, payload) = body.split_first_chunk::<22>().ok_or("a message ends in its envelope")?;
        let &[channel_0, channel_1, sequence_0, sequence_1, sequence_2, sequence_3, ref times @ ..] =
            envelope;
        Ok(Self {
            channel: u16::from_le_bytes([channel_0, channel_1]),
            sequence: u32::from_le_bytes([sequence_0, sequence_1, sequence_2, sequence_3]),
            wall_ns: le_u64(&times[..8]),
            payload,
        })
    }
}
