//! The log of a run: where the online half of the project meets the offline half. The cycle's
//! records come here through a ring, go to disk as MCAP, and every analysis reads them back.
//!
//! ```text
//! rt ring ─► writer ─► stream (records → MCAP bytes) ─► backlog (bytes → disk, never an error)
//!                         schema + cdr + header                 │ file
//! csv, summary, offline ◄─ reader ◄─ chunk ◄─ frame ◄───────────┤
//!                          recover + salvage (damaged → valid) ◄┘
//! ```
//!
//! What a log promises:
//! * It explains itself: the schema names every field with unit and meaning, the header carries the
//!   machine file, commit, seed and clock relation. Foxglove, PlotJuggler and the Python `mcap`
//!   packages open it.
//! * Killed at any moment it reads without repair and lacks at most the last 250 ms.
//! * A full disk never stops the run: what cannot be written is counted.
//! * Every damaged byte is found: records are only handed out after their chunk's checksum held.
//! * A file of another format version or of another program is refused by name.
//!
//! Invariant: imports only `base`; a record read is bit for bit the record written.

mod backlog;
mod cdr;
mod chunk;
pub mod csv;
mod error;
mod frame;
pub mod header;
pub mod input;
pub mod reader;
pub mod recover;
mod salvage;
pub mod schema;
pub mod size_limit;
mod stream;
pub mod summary;
pub mod timing;
pub mod writer;

pub use error::LogError;
pub use header::{Header, Pace};
pub use reader::Reader;
pub use recover::{Recovery, recover};
pub use summary::Summary;
pub use writer::{WriteOutcome, Writer};
