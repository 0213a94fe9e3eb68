//! Text in, checked settings out.
//!
//! A machine file is read section by section (`reader.rs`, `machine_file.rs`), its values are held
//! against each other (`rules.rs`), every problem is noted at its place (`problem.rs`), and what comes
//! out is a [`Machine`] that the rest trusts. Some machines are embedded. A [`scenario`] is read the same way.
//! What analysis finds goes into a machine file by `edit`.
//! Invariant: nothing that moves has a silent default; a text with a problem gives no machine.

mod assemble;
pub mod bus_load;
#[cfg(feature = "offline")]
pub mod edit;
pub mod machine;
mod machine_file;
pub mod plan;
pub mod problem;
mod reader;
mod rules;
pub mod scenario;
mod sheet_file;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub use machine::Machine;
use problem::FileProblems;
use sheet_file::Shelf;

/// Machines that need no file, by name.
pub const EMBEDDED: [(&str, &str); 3] = [
    ("reference", include_str!("../../firmware-config/machines/reference.toml")),
    ("paper", include_str!("../../firmware-config/machines/paper.toml")),
    ("classic", include_str!("../../firmware-config/machines/classic.toml")),
];

/// Why there is no machine.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file cannot be read.
    #[error("machine file {path}: {cause} (or name an embedded machine: reference, paper, classic)")]
    Unreadable {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// A scenario cannot be read.
    #[error("scenario {path}: {cause}")]
    NoScenario {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The file says what cannot be.
    #[error(transparent)]
    Problems(#[from] Box<FileProblems>),
}

/// What a machine is wanted for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Its cycle is run, so all of its frames must have time on the bus.
    Bus,
    /// Its runs are files, whoever recorded them and over whatever bus.
    Files,
}

/// The machine of a file, or an embedded one by its name, to run its cycle.
pub fn load(name_or_path: &str) -> Result<Machine, LoadError> {
    load_for(Purpose::Bus, name_or_path)
}

/// The same for a purpose.
pub fn load_for(purpose: Purpose, name_or_path: &str) -> Result<Machine, LoadError> {
    let none = BTreeMap::new();
    let read = |source: &str, text: &str, folder: Option<&Path>| {
        machine_file::read(purpose, source, text, Shelf::new(&none, folder)).map_err(Box::new)
    };
    if let Some((name, text)) = EMBEDDED.into_iter().find(|(name, _)| *name == name_or_path) {
        return Ok(read(&format!("{name} (embedded)"), text, None)?);
    }
    let path = Path::new(name_or_path);
    let text = std::fs::read_to_string(path)
        .map_err(|cause| LoadError::Unreadable { path: path.to_owned(), cause })?;
    Ok(read(name_or_path, &text, path.parent())?)
}

/// A machine from its text and the texts of its board sheets, as a log carries them.
pub fn from_texts(
    source: &str,
    text: &str,
    sheets: &BTreeMap<String, String>,
) -> Result<Machine, Box<FileProblems>> {
    machine_file::read(Purpose::Bus, source, text, Shelf::new(sheets, None)).map_err(Box::new)
}
