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

/// The file of a machine, or a new one with its text.
///
/// # Errors
/// When the file is of another machine or cannot be read.
pub fn opened(file: &Path, machine: &Machine) -> Result<MachineFile, WriteError> {
    let edited = if file.exists() { MachineFile::open(file)? } else { MachineFile::create(file, machine)? };
    if edited.text() != machine.text {
        let [file, tuned] = [file.display().to_string(), machine.source.clone()];
        return Err(WriteError::OtherMachine { file, tuned });
    }
    Ok(edited)
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
    let mut edited = opened(file, machine)?;
    put(&mut edited, machine, name, choice)?;
    note(&mut edited, machine, name, source)?;
    Ok(edited.replace()?)
}

/// Whether a set of a name has room in a machine.
///
/// # Errors
/// When it has none.
pub fn has_room(machine: &Machine, name: &str) -> Result<(), WriteError> {
    if machine.gain_set(name).is_none() && machine.gain_sets.len() >= GAIN_SETS_MAX {
        return Err(WriteError::Full { machine: machine.name.clone(), known: machine.gain_sets.join(", ") });
    }
    Ok(())
}

/// Sets the numbers of a set on each axis.
///
/// # Errors
/// When there is no room for the set.
pub fn put(file: &mut MachineFile, machine: &Machine, name: &str, choice: &Choice) -> Result<(), WriteError> {
    has_room(machine, name)?;
    for axis in machine.axis_names() {
        for (key, value) in choice.entries() {
            file.set(&format!("axis.{axis}.gains.{name}.{key}"), value)?;
        }
    }
    Ok(())
}

/// Says above a set on each axis where its numbers come from.
///
/// # Errors
/// When there is no such set.
pub fn note(file: &mut MachineFile, machine: &Machine, name: &str, source: &str) -> Result<(), WriteError> {
    for axis in machine.axis_names() {
        file.note(&format!("axis.{axis}.gains.{name}"), MARK, source)?;
    }
    Ok(())
}
