//! The records of an MCAP file, one after the other: `opcode (1 byte), length (8 bytes), body`
//! between two magic words. Knows nothing of what is in them.
//!
//! A file that simply stops was killed: that is an end, and is told. A file that goes on wrongly is
//! damaged: that is an error with its place. The checksums of the data section and of the index are
//! verified on the way, so that in a complete file no changed byte stays unseen.
//!
//! Invariant: memory is bounded by [`BODY_BYTES_MAX`], whatever the file claims.

use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::MAGIC;
use mcap::records::op;

use super::error::LogError;

/// Opcode and length.
pub(super) const HEAD_BYTES: usize = 9;
/// Longest record believed; ours are below 1 MiB.
pub(super) const BODY_BYTES_MAX: u64 = 64 << 20;

/// One record as it stands in the file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame<'a> {
    /// Where it starts, in bytes.
    pub(super) offset: u64,
    /// What it is.
    pub(super) opcode: u8,
    /// All of it, head included.
    pub(super) bytes: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Without its head.
    pub(super) fn body(&self) -> &'a [u8] {
        &self.bytes[HEAD_BYTES..]
    }
}

/// Walks a file from its start.
#[derive(Debug)]
pub(super) struct Frames<R> {
    file: PathBuf,
    source: R,
    at: u64,
    total: u64,
    has_end: bool,
    is_over: bool,
    is_truncated: bool,
    section: crc32fast::Hasher,
    record: Vec<u8>,
}

impl<R: Read + Seek> Frames<R> {
    /// `file` is for messages only.
    pub(super) fn new(mut source: R, file: &Path) -> Result<Self, LogError> {
        let (total, first, last) = ends(&mut source).map_err(LogError::io(file, "read"))?;
        if first != MAGIC {
            return Err(LogError::NotALog { file: file.to_owned(), what: "it does not start as MCAP" });
        }
        let mut section = crc32fast::Hasher::new();
        section.update(MAGIC);
        Ok(Self {
            file: file.to_owned(),
            source,
            at: MAGIC.len() as u64,
            total,
            has_end: last == MAGIC && total >= 2 * MAGIC.len() as u64,
            is_over: false,
            is_truncated: false,
            section,
            record: Vec::new(),
        })
    }

    /// The next record; `None` at the end of the file.
    pub(super) fn next(&mut self) -> Result<Option<Frame<'_>>, LogError> {
        if self.is_over {
            return Ok(None);
        }
        let offset = self.at;
        let left = self.total.saturating_sub(offset);
        let Some(space) = left.checked_sub(HEAD_BYTES as u64) else { return self.cut() };
        self.read(0, HEAD_BYTES)?;
        let opcode = self.record[0];
        let body = le_u64(&self.record[1..HEAD_BYTES]);
        if !(op::HEADER..=op::DATA_END).contains(&opcode) {
            return Err(self.damaged(format!("no record has type {opcode:#04x}")));
        }
        if body > BODY_BYTES_MAX {
            return Err(self.damaged(format!("a record claims {body} bytes, more than {BODY_BYTES_MAX}")));
        }
        if body > space {
            return self.cut();
        }
        self.read(HEAD_BYTES, HEAD_BYTES + body as usize)?;
        self.check_section(opcode)?;
        self.at += self.record.len() as u64;
        if opcode == op::FOOTER {
            self.end()?;
        }
        Ok(Some(Frame { offset, opcode, bytes: &self.record }))
    }

    /// Whether the file stopped before its end; known once [`Self::next`] gave `None`.
    pub(super) const fn is_truncated(&self) -> bool {
        self.is_truncated
    }

    /// Length of the file in bytes.
    pub(super) const fn total(&self) -> u64 {
        self.total
    }

    /// For messages.
    pub(super) fn file(&self) -> &Path {
        &self.file
    }

    /// Reads on until the record in memory has `to` bytes.
    fn read(&mut self, from: usize, to: usize) -> Result<(), LogError> {
        self.record.resize(to, 0);
        self.source.read_exact(&mut self.record[from..]).map_err(LogError::io(&self.file, "read"))
    }

    /// The file stops inside a record. When it has an end all the same, a length in it is wrong.
    fn cut(&mut self) -> Result<Option<Frame<'_>>, LogError> {
        if self.has_end {
            return Err(self.damaged("a record reaches past the end of the file".to_owned()));
        }
        self.is_over = true;
        self.is_truncated = true;
        Ok(None)
    }

    /// After the footer comes the magic word and nothing else.
    fn end(&mut self) -> Result<(), LogError> {
        let left = self.total - self.at;
        let magic = MAGIC.len() as u64;
        self.is_over = true;
        self.is_truncated = left < magic;
        if left > magic || (left == magic && !self.has_end) {
            return Err(self.damaged("the footer is not followed by the end of the file".to_owned()));
        }
        Ok(())
    }

    /// Follows the checksum of the section, and compares it where the section ends: the data
    /// section at the record that says so, the index section at the checksum inside the footer.
    fn check_section(&mut self, opcode: u8) -> Result<(), LogError> {
        const SAVED_BYTES: usize = size_of::<u32>();
        let (name, covered, length) = match opcode {
            op::DATA_END => ("data", 0, HEAD_BYTES + SAVED_BYTES),
            op::FOOTER => ("index", HEAD_BYTES + 16, HEAD_BYTES + 16 + SAVED_BYTES),
            _ => {
                self.section.update(&self.record);
                return Ok(());
            }
        };
        if self.record.len() != length {
            return Err(
                self.damaged(format!("the record at the end of the {name} section has a wrong length"))
            );
        }
        let mut section = std::mem::take(&mut self.section);
        section.update(&self.record[..covered]);
        if self.record[length - SAVED_BYTES..] != section.finalize().to_le_bytes() {
            return Err(self.damaged(format!("the checksum of the {name} section does not hold")));
        }
        Ok(())
    }

    fn damaged(&mut self, what: String) -> LogError {
        self.is_over = true;
        LogError::Damaged { file: self.file.clone(), offset: self.at, what }
    }
}

/// Length of the file and its first and last eight bytes; the source is left behind the first.
fn ends(source: &mut (impl Read + Seek)) -> io::Result<(u64, [u8; 8], [u8; 8])> {
    let (mut first, mut last) = ([0; 8], [0; 8]);
    let total = source.seek(SeekFrom::End(0))?;
    if total >= 8 {
        source.seek(SeekFrom::End(-8))?;
        source.read_exact(&mut last)?;
        source.rewind()?;
        source.read_exact(&mut first)?;
    }
    Ok((total, first, last))
}

/// The number in eight bytes.
pub(super) fn le_u64(bytes: &[u8]) -> u64 {
    u64::from_le_bytes(bytes.try_into().expect("the caller cut exactly eight bytes"))
}
