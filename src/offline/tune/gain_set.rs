//! What was found, as a gain set of a machine file.
//!
//! Invariant: a machine file gets a whole set on each of its axes, or nothing.

use std::path::Path;

use super::space::Choice;
use crate::config::Machine;
use crate::config::edit::{EditError, MachineFile};
use crate::rt::control::GAIN_SETS_MAX;

/// Mark of the note above a set.
const MARK: &str = "tuned";

/// Why a set was not written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file is of another machine.
    #[error(
        "{file} is not the machine that was tuned ({tuned}); tune it with --machine {file}, or write to a new file"
    )]
    OtherMachine {
        /// Which file.
        file: String,
        /// What was tuned.
        tuned: String,
    },
    /// There is no room.
    #[error(
        "{machine} has {GAIN_SETS_MAX} gain sets, the most there may be; name one of them with --name: {known}"
    )]
    Full {
        /// What was tuned.
        machine: String,
        /// There are.
        known: String,
    },
    /// The file cannot be changed.
    #[error(transparent)]
    Edit(#[from] EditError),
}

/// Writes a set of a name into the file of a machine, or into a new file with its text; `source` says where the
/// numbers come from. Returns the machine as it is then.
///
/// # Errors
/// When the file is of another machine or cannot be changed. It is then as it was.
pub fn write(
    file: &Path,
    machine: &Machine,
    name: &str,
    choice: &Choice,
    source: &str,
) -> Result<Machine, WriteError> {
    let mut edited =
        if file.exists() { MachineFile::open(file)? } else { MachineFile::create(file, machine)? };
    if edited.text() != machine.text {
        let [file, tuned] = [file.display().to_string(), machine.source.clone()];
        return Err(WriteError::OtherMachine { file, tuned });
    }
    if machine.gain_set(name).is_none() && machine.gain_sets.len() >= GAIN_SETS_MAX {
        return Err(WriteError::Full { machine: machine.name.clone(), known: machine.gain_sets.join(", ") });
    }
    for axis in machine.axis_names() {
        let section = format!("axis.{axis}.gains.{name}");
        for (key, value) in choice.entries() {
            edited.set(&format!("{section}.{key}"), value)?;
        }
        edited.note(&section, MARK, source)?;
    }
    Ok(edited.replace()?)
}
