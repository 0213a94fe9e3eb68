//! Records from the ring to disk, on a thread of their own beside the cycle.
//!
//! Every `POLL` the ring is emptied; every `CHUNK_SPAN` or `CHUNK_BYTES` the open chunk is
//! completed and handed to the system in one write. A killed run therefore lacks at most
//! `CHUNK_SPAN + POLL` and the time of one write: 250 ms are promised. For a power failure a second
//! thread forces the file to the disk every `SYNC_SPAN`; a slow disk stalls that thread only.
//!
//! When the disk refuses, chunks wait in memory (`backlog`) and are tried again every
//! `CHUNK_SPAN`; when that is full, records are dropped and counted. The file never has a hole
//! and no second file is ever started.
//!
//! Invariant: the ring is drained until its producer is gone, whatever the disk does; every record
//! taken from the ring is either in the file or counted as lost.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crossbeam::channel::{Sender, bounded};

use crate::base::input::Input;
use crate::base::record::CycleRecord;

use super::backlog::Backlog;
use super::error::LogError;
use super::header::Header;
use super::stream::Stream;

/// How long the ring is left alone when it is empty.
const POLL: Duration = Duration::from_millis(2);
/// Longest a chunk stays open: well inside the promised 250 ms, so that a busy machine keeps it.
const CHUNK_SPAN: Duration = Duration::from_millis(100);
/// Largest a chunk becomes, in bytes of messages.
pub(super) const CHUNK_BYTES: usize = 256 << 10;
/// Most records taken between two looks at the clock.
const BATCH: usize = 256;
/// Shortest time between two calls that force the file to the disk.
const SYNC_SPAN: Duration = Duration::from_millis(200);

/// A log being written.
#[derive(Debug)]
pub struct Writer {
    thread: JoinHandle<WriteOutcome>,
}

/// What became of the records.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WriteOutcome {
    /// The log.
    pub path: PathBuf,
    /// Records in it.
    pub written: u64,
    /// Records taken from the ring that could not be written.
    pub lost: u64,
    /// Whether the log has its index; without, it reads like that of a killed run.
    pub is_complete: bool,
    /// What the system said first, with the file.
    pub first_error: Option<String>,
}

impl Writer {
    /// Starts a log at `path`, with `header` already in it when this returns, and a thread that
    /// drains `records` until their producer is dropped. What cannot be written is added to `lost`.
    ///
    /// # Errors
    /// A path that cannot be opened or holds a log already, a header that no log can start with.
    /// A full disk is no error here: it is counted.
    pub fn start(
        path: &Path,
        header: Header,
        records: rtrb::Consumer<CycleRecord>,
        inputs: rtrb::Consumer<Input>,
        lost: Arc<AtomicU64>,
    ) -> Result<Self, LogError> {
        header.check()?;
        let file = create(path)?;
        let syncer = Syncer::start(&file).map_err(LogError::io(path, "start a thread for"))?;
        let mut task = Task {
            path: path.to_owned(),
            stream: Stream::new(header).map_err(io::Error::other).map_err(LogError::io(path, "build"))?,
            backlog: Backlog::new(file),
            syncer,
            records,
            inputs,
            told: Vec::new(),
            lost,
            taken: 0,
            refused: 0,
            settled: Instant::now(),
        };
        task.add_piece(0);
        task.backlog.push();
        let thread = thread::Builder::new().name("log".to_owned()).spawn(move || task.run());
        Ok(Self { thread: thread.map_err(LogError::io(path, "start a thread for"))? })
    }

    /// Waits until the producer is gone and everything it left is on disk or counted.
    pub fn join(self) -> WriteOutcome {
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

/// Opens a new log. Something that is there already and not empty is never overwritten.
pub(super) fn create(path: &Path) -> Result<File, LogError> {
    let file = File::options().write(true).create(true).truncate(false).open(path);
    let file = file.map_err(LogError::io(path, "create"))?;
    let bytes = file.metadata().map_err(LogError::io(path, "look at"))?.len();
    if bytes > 0 { Err(LogError::Exists { file: path.to_owned(), bytes }) } else { Ok(file) }
}

/// What the thread owns.
struct Task {
    path: PathBuf,
    stream: Stream,
    backlog: Backlog,
    syncer: Syncer,
    records: rtrb::Consumer<CycleRecord>,
    inputs: rtrb::Consumer<Input>,
    /// Of the record at hand.
    told: Vec<Input>,
    lost: Arc<AtomicU64>,
    taken: u64,
    refused: u64,
    settled: Instant,
}

impl Task {
    fn run(mut self) -> WriteOutcome {
        loop {
            // Asked before draining, so that what the producer left behind is still drained.
            let is_last = self.records.is_abandoned();
            let drained = self.drain();
            if self.settled.elapsed() >= CHUNK_SPAN || self.stream.open_bytes() >= CHUNK_BYTES {
                self.settle();
            }
            match (drained, is_last) {
                (0, true) => return self.finish(),
                (0, false) => thread::sleep(POLL),
                _ => {}
            }
        }
    }

    /// Moves a batch of records from the ring into the open chunk.
    fn drain(&mut self) -> usize {
        let count = self.records.slots().min(BATCH);
        let Ok(batch) = self.records.read_chunk(count) else { return 0 };
        let mut refused = 0;
        for record in batch {
            self.told.clear();
            // Those of a record that was lost go to the next one: each says its cycle itself.
            while self.inputs.peek().is_ok_and(|input| input.cycle <= record.cycle) {
                self.told.extend(self.inputs.pop());
            }
            let is_taken = !self.backlog.is_full() && self.stream.push(&record, &self.told).is_ok();
            refused += u64::from(!is_taken);
        }
        self.taken += count as u64;
        self.refused += refused;
        self.lost.fetch_add(refused, Ordering::Relaxed);
        count
    }

    /// Completes the chunk and hands it to the system, together with what waits.
    fn settle(&mut self) {
        self.settled = Instant::now();
        match self.stream.end_chunk() {
            Ok(0) => {}
            Ok(records) => self.add_piece(records),
            Err(error) => self.backlog.remember(io::Error::other(error)),
        }
        if !self.backlog.is_empty() {
            self.backlog.push();
            self.syncer.ask();
        }
    }

    fn add_piece(&mut self, records: u64) {
        self.backlog.add(records, |bytes| self.stream.take(bytes));
    }

    /// Completes the log, or leaves it as that of a killed run when the disk still refuses.
    fn finish(mut self) -> WriteOutcome {
        self.settle();
        match self.stream.finish() {
            Ok(()) => self.add_piece(0),
            Err(error) => self.backlog.remember(io::Error::other(error)),
        }
        self.backlog.push();
        let is_complete = self.backlog.is_empty();
        self.syncer.stop().unwrap_or_else(|error| self.backlog.remember(error));
        let (written, first_error) = self.backlog.close();
        let lost = self.taken - written;
        self.lost.fetch_add(lost - self.refused, Ordering::Relaxed);
        let first_error = first_error.map(|error| format!("{}: {error}", self.path.display()));
        WriteOutcome { path: self.path, written, lost, is_complete, first_error }
    }
}

/// Forces the file to the disk beside the writer, which never waits for it.
struct Syncer {
    ask: Sender<()>,
    asked: Instant,
    thread: JoinHandle<io::Result<()>>,
}

impl Syncer {
    fn start(file: &File) -> io::Result<Self> {
        let (ask, asked) = bounded(1);
        let file = file.try_clone()?;
        let sync = move || asked.iter().try_for_each(|()| file.sync_data());
        let thread = thread::Builder::new().name("log-sync".to_owned()).spawn(sync)?;
        Ok(Self { ask, asked: Instant::now(), thread })
    }

    /// Asks for it, unless that was done a moment ago.
    fn ask(&mut self) {
        if self.asked.elapsed() >= SYNC_SPAN {
            self.asked = Instant::now();
            // A full channel means that one is still to come, an ended thread that it met an error.
            let _ = self.ask.try_send(());
        }
    }

    /// Waits for what was asked for; the first error, if there was one.
    fn stop(self) -> io::Result<()> {
        drop(self.ask);
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}
