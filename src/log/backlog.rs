//! Bytes on their way to disk. Nothing here fails: what the disk refuses stays in memory up to a
//! bound and is tried again, from the very byte at which the disk stopped.
//!
//! A refused write therefore leaves no hole: when space comes back the file goes on as if nothing
//! had happened, and until then it ends like that of a killed run.
//!
//! Invariant: the file is always a prefix of the bytes that were added.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{ErrorKind, Write};

/// Most bytes that wait for the disk: at 2 kHz and two axes about a quarter of a minute.
const WAITING_BYTES_MAX: usize = 8 << 20;

/// A stretch of the file that is of use only as a whole: the header, a chunk, the index.
#[derive(Clone, Copy, Debug)]
struct Piece {
    ends_at: u64,
    records: u64,
}

/// The file and what waits for it.
#[derive(Debug)]
pub(super) struct Backlog {
    file: File,
    waiting: Vec<u8>,
    pieces: VecDeque<Piece>,
    added_bytes: u64,
    whole_bytes: u64,
    records_written: u64,
    first_error: Option<std::io::Error>,
}

impl Backlog {
    /// In front of an empty file.
    pub(super) fn new(file: File) -> Self {
        Self {
            file,
            waiting: Vec::new(),
            pieces: VecDeque::new(),
            added_bytes: 0,
            whole_bytes: 0,
            records_written: 0,
            first_error: None,
        }
    }

    /// Adds the piece of `records` records that `fill` appends to what waits.
    pub(super) fn add(&mut self, records: u64, fill: impl FnOnce(&mut Vec<u8>)) {
        let waiting_before = self.waiting.len();
        fill(&mut self.waiting);
        self.added_bytes += (self.waiting.len() - waiting_before) as u64;
        self.pieces.push_back(Piece { ends_at: self.added_bytes, records });
    }

    /// Hands all that waits to the system, with one call as long as the system takes it whole.
    pub(super) fn push(&mut self) {
        let mut taken = 0;
        while taken < self.waiting.len() {
            let refusal = match self.file.write(&self.waiting[taken..]) {
                Ok(0) => ErrorKind::WriteZero.into(),
                Ok(bytes) => {
                    taken += bytes;
                    continue;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(error) => error,
            };
            self.remember(refusal);
            break;
        }
        self.waiting.drain(..taken);
        let on_disk = self.added_bytes - self.waiting.len() as u64;
        while let Some(piece) = self.pieces.front().filter(|piece| piece.ends_at <= on_disk) {
            self.whole_bytes = piece.ends_at;
            self.records_written += piece.records;
            self.pieces.pop_front();
        }
    }

    /// No more should be added before some of it could be written.
    pub(super) fn is_full(&self) -> bool {
        self.waiting.len() >= WAITING_BYTES_MAX
    }

    /// Everything added is in the file.
    pub(super) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Keeps the first error for the report.
    pub(super) fn remember(&mut self, error: std::io::Error) {
        self.first_error.get_or_insert(error);
    }

    /// Gives up what still waits, cuts a piece that is only half in the file, and says how many
    /// records are in the file and what went wrong first.
    pub(super) fn close(mut self) -> (u64, Option<std::io::Error>) {
        if !self.is_empty() && self.file.metadata().is_ok_and(|metadata| metadata.is_file()) {
            let cut = self.file.set_len(self.whole_bytes);
            cut.unwrap_or_else(|error| self.remember(error));
        }
        if self.whole_bytes > 0 {
            self.file.sync_all().unwrap_or_else(|error| self.remember(error));
        }
        (self.records_written, self.first_error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Seek};

    #[test]
    fn a_refused_write_goes_on_where_it_stopped() {
        let mut disk = tempfile::tempfile().unwrap();
        let full = File::options().write(true).open("/dev/full").unwrap();
        let mut backlog = Backlog::new(full);
        backlog.add(2, |bytes| bytes.extend(*b"two records,"));
        backlog.push();
        assert!(!backlog.is_empty());
        backlog.file = disk.try_clone().unwrap(); // the disk has space again
        backlog.add(1, |bytes| bytes.extend(*b"one more"));
        backlog.push();
        assert!(backlog.is_empty());
        let (written, error) = backlog.close();
        assert_eq!((written, error.unwrap().kind()), (3, ErrorKind::StorageFull));
        let mut text = String::new();
        disk.rewind().unwrap();
        disk.read_to_string(&mut text).unwrap();
        assert_eq!(text, "two records,one more");
    }
}
