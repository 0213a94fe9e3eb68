//! What can go wrong with a log before it runs and after it was written. While it is written there
//! are no errors, only losses that are counted (`writer`).
//!
//! Invariant: every message names the file, and the byte or key where one is known.

use std::io;
use std::path::{Path, PathBuf};

/// Why a log could not be started or read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The operating system refused.
    #[error("{}: cannot {doing}: {cause}", file.display())]
    Io {
        /// The log or export.
        file: PathBuf,
        /// What was tried.
        doing: &'static str,
        /// What the system said.
        cause: io::Error,
    },
    /// There is something at the place of a new log.
    #[error("{}: exists already, {bytes} bytes; a log is never overwritten", file.display())]
    Exists {
        /// The place of the new log.
        file: PathBuf,
        /// What is there.
        bytes: u64,
    },
    /// A header that no log can start with.
    #[error("log header: {key} is {value}, expected {expected}")]
    Header {
        /// Field of the header.
        key: &'static str,
        /// What it is.
        value: String,
        /// What it may be.
        expected: &'static str,
    },
    /// Another program's file, or no MCAP at all.
    #[error("{}: not a log of this project: {what}", file.display())]
    NotALog {
        /// The file.
        file: PathBuf,
        /// What is missing.
        what: &'static str,
    },
    /// Written by another generation of this project.
    #[error("{}: log format version {found}, this program reads version {known} only", file.display())]
    Version {
        /// The file.
        file: PathBuf,
        /// Version of the file.
        found: u32,
        /// Version this program writes and reads.
        known: u32,
    },
    /// Ends inside its header, so nothing was recorded.
    #[error("{}: ends at byte {bytes} inside its header; it holds no records", file.display())]
    HeaderCut {
        /// The file.
        file: PathBuf,
        /// Its length.
        bytes: u64,
    },
    /// A key of the header is missing or says something impossible.
    #[error("{}: header key `{key}` is {found}, expected {expected}", file.display())]
    HeaderKey {
        /// The file.
        file: PathBuf,
        /// Which key.
        key: String,
        /// Its text, or that it is missing.
        found: String,
        /// What it should be.
        expected: &'static str,
    },
    /// Bytes that are not what was written.
    #[error("{}: damaged at byte {offset}: {what}; `quadrant log --recover` keeps what is readable", file.display())]
    Damaged {
        /// The file.
        file: PathBuf,
        /// Where the record that holds the damage starts.
        offset: u64,
        /// What did not hold.
        what: String,
    },
    /// A channel or schema that this version does not know.
    #[error("{}: byte {offset}: {found}, expected {expected}", file.display())]
    Foreign {
        /// The file.
        file: PathBuf,
        /// Where the chunk that holds it starts.
        offset: u64,
        /// What stands there.
        found: String,
        /// What this version knows.
        expected: String,
    },
    /// A finished file without the channel of the cycles.
    #[error("{}: no channel `{topic}`", file.display())]
    MissingChannel {
        /// The file.
        file: PathBuf,
        /// The channel every log has.
        topic: &'static str,
    },
    /// Nothing in the file can be kept.
    #[error("{}: nothing to recover: none of its {bytes} bytes belongs to a readable chunk", file.display())]
    NothingToRecover {
        /// The file.
        file: PathBuf,
        /// Its length.
        bytes: u64,
    },
}

impl LogError {
    /// For `map_err`: the system refused `doing` something with `file`.
    pub(super) fn io(file: &Path, doing: &'static str) -> impl FnOnce(io::Error) -> Self {
        let file = file.to_owned();
        move |cause| Self::Io { file, doing, cause }
    }
}
