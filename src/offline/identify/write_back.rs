//! What was found, into the machine file: values by their keys, with their intervals and where they come from in a
//! note above the section.
//!
//! The parameters of an identification hold together with what it took as known. A file that has another lead,
//! efficiency or torque constant than the logs gets nothing, nor one with another mass where the mass was not found.
//! Which values go together is decided in [`super::axis`].
//! Invariant: only keys that were found change, and the file is replaced as a whole or not at all.

use std::path::{Path, PathBuf};

use super::axis::IdentifiedAxis;
use super::logs::Logs;
use super::{AxisFindings, Estimate, Finding};
use crate::base::axis::AxisId;
use crate::config::Machine;
use crate::config::edit::{EditError, MachineFile};
use crate::config::machine::Axis;
use crate::log::header::rfc3339;
use crate::plant::friction::Variant;

/// What notes are known by.
const MARK: &str = "identified";

/// Findings and the keys that take them, by section.
const KEYS: [(&str, &[(&str, &str)]); 4] = [
    ("board", &[("feedback_latency", "feedback-latency-us")]),
    ("drive", &[("current_loop", "current-loop-hz"), ("dead_time", "dead-time-us")]),
    (
        "mechanics",
        &[
            ("mass", "mass-kg"),
            ("stiffness", "stiffness-n-per-um"),
            ("damping", "damping-n-s-per-mm"),
            ("motor_inertia", "motor-inertia-kg-m2"),
        ],
    ),
    (
        "friction",
        &[
            ("breakaway", "breakaway-n"),
            ("sliding", "sliding-n"),
            ("fall_end", "fall-end-mm-per-s"),
            ("fall_start", "fall-start-mm-per-s"),
            ("viscous", "viscous-n-s-per-mm"),
        ],
    ),
];
/// Keys with this unit are whole numbers.
const WHOLE: &str = "-us";

/// Why nothing is written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// Axes that the file does not have, or more.
    #[error("{} has {got} axes, the machine of the logs has {expected}; nothing was written", file.display())]
    Axes {
        /// Which file.
        file: PathBuf,
        /// Its axes.
        got: usize,
        /// Those of the logs.
        expected: usize,
    },
    /// What the identification took as known is another in the file.
    #[error(
        "{}: axis.{axis}.{key} is {got}, in the machine file of the logs it was {expected}, and what was \
         identified holds with that only; nothing was written",
        file.display()
    )]
    Known {
        /// Which file.
        file: PathBuf,
        /// Which axis.
        axis: String,
        /// Which key.
        key: &'static str,
        /// In the file, in the unit of the key.
        got: f64,
        /// In the logs.
        expected: f64,
    },
    /// Nothing was found.
    #[error("nothing was found that has a key in a machine file; nothing was written")]
    Nothing,
}

/// Where values come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Their names.
    pub logs: String,
    /// When the first of them began.
    pub date: String,
    /// Of the program that made it.
    pub commit: String,
}

impl Origin {
    /// These logs.
    pub fn of(logs: &Logs) -> Self {
        Self { logs: logs.names(), date: rfc3339(logs.wall_at_zero_ns), commit: logs.commit.clone() }
    }
}

/// A machine file that shall take what is found in logs.
#[derive(Debug)]
pub struct Target {
    path: PathBuf,
    file: MachineFile,
    machine: Machine,
    logged: Machine,
    origin: Origin,
}

impl Target {
    /// The machine file at `path`, for what is found in these logs.
    ///
    /// # Errors
    /// When the file is no sound machine, or one of another machine than that of the logs.
    pub fn open(path: &Path, logs: &Logs) -> Result<Self, WriteError> {
        let file = MachineFile::open(path)?;
        let machine = file.machine()?;
        is_same(path, &machine, &logs.machine)?;
        let (path, logged) = (path.to_owned(), logs.machine.clone());
        Ok(Self { path, file, machine, logged, origin: Origin::of(logs) })
    }

    /// The file with what was found of each axis.
    ///
    /// # Errors
    /// When nothing was found, or the file would be no sound machine with it.
    pub fn with(mut self, axes: &[IdentifiedAxis]) -> Result<Change, WriteError> {
        let before = self.file.text();
        for (id, axis) in self.machine.axes.axes().zip(axes) {
            if axis.findings.get("mass").is_none_or(|mass| mass.estimate().is_none()) {
                is_known(&self.path, id, MASS, &self.machine.axes[id], &self.logged.axes[id])?;
            }
        }
        let Taken { values, .. } = put(&mut self.file, &self.machine, axes, &self.origin)?;
        if values == 0 {
            return Err(WriteError::Nothing);
        }
        self.file.machine()?;
        Ok(Change { file: self.file, before })
    }
}

/// A machine file with what was found, not yet written.
#[derive(Debug)]
pub struct Change {
    file: MachineFile,
    before: String,
}

impl Change {
    /// Lines that go and lines that come, in order.
    pub fn difference(&self) -> String {
        difference(&self.before, &self.file.text())
    }

    /// Replaces the file.
    ///
    /// # Errors
    /// When it was changed meanwhile or cannot be written; it is then as it was.
    pub fn write(self) -> Result<Machine, WriteError> {
        Ok(self.file.replace()?)
    }
}

/// A key whose value the identification took as known.
type Known = (&'static str, fn(&Axis) -> f64);

/// Known, whatever is in the logs.
const KNOWN: [Known; 3] = [
    ("mechanics.lead-mm", |axis| 1e3 * axis.plant.mechanics.lead_m),
    ("mechanics.efficiency", |axis| axis.plant.mechanics.efficiency),
    ("drive.torque-constant-nm-per-a", |axis| axis.plant.actuator.torque_constant_nm_per_a),
];
/// Known, unless a frequency response told it.
const MASS: Known = ("mechanics.mass-kg", |axis| axis.plant.mechanics.mass_kg);

/// Whether what was taken as known is the same in both.
fn is_same(file: &Path, here: &Machine, logged: &Machine) -> Result<(), WriteError> {
    let (got, expected) = (here.axes.count(), logged.axes.count());
    if got != expected {
        return Err(WriteError::Axes { file: file.to_owned(), got, expected });
    }
    for (id, axis) in here.axes.iter() {
        for known in KNOWN {
            is_known(file, id, known, axis, &logged.axes[id])?;
        }
    }
    Ok(())
}

fn is_known(file: &Path, id: AxisId, (key, of): Known, here: &Axis, logged: &Axis) -> Result<(), WriteError> {
    let (got, expected) = (of(here), of(logged));
    if got == expected {
        return Ok(());
    }
    Err(WriteError::Known { file: file.to_owned(), axis: id.to_string(), key, got, expected })
}

/// What became of the keys of a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    /// How many were set.
    pub values: usize,
    /// Those that nothing told, and what would: their values stay as they are.
    pub kept: Vec<String>,
}

/// Sets all that was found of the axes of a machine.
///
/// # Errors
/// When the text has no room for a key.
pub fn put(
    file: &mut MachineFile,
    machine: &Machine,
    axes: &[IdentifiedAxis],
    origin: &Origin,
) -> Result<Taken, EditError> {
    let mut taken = Taken::default();
    for ((_, before), axis) in machine.axes.iter().zip(axes) {
        let model = axis.model(before, machine.cycle.period);
        for (section, keys) in KEYS {
            let path = format!("axis.{}.{section}", axis.name);
            let mut lines = put_section(file, &path, keys, &model, &mut taken.kept)?;
            if section == "friction"
                && let Some(variant) = axis.logged.variant
            {
                let named = match variant {
                    Variant::Linear => "linear",
                    Variant::Nonlinear => "nonlinear",
                };
                file.set(&format!("{path}.variant"), named)?;
                lines.push(format!("variant {named}: leaves less of reversals that it was not fitted to"));
            }
            if !lines.is_empty() {
                taken.values += lines.len();
                let head = format!("from {} of {}, made by {}", origin.logs, origin.date, origin.commit);
                file.note(&path, MARK, &format!("{head}\n{}", lines.join("\n")))?;
            }
        }
    }
    Ok(taken)
}

/// Sets the keys of a section; a line for each that was set.
fn put_section(
    file: &mut MachineFile,
    path: &str,
    keys: &[(&str, &str)],
    model: &AxisFindings,
    kept: &mut Vec<String>,
) -> Result<Vec<String>, EditError> {
    let mut lines = Vec::new();
    for (finding, key) in keys {
        match model.get(*finding) {
            Some(Finding::Found(estimate)) => {
                // None of these can be negative; an interval around zero may say so.
                let value = estimate.value.max(0.0);
                let full = format!("{path}.{key}");
                if key.ends_with(WHOLE) {
                    file.set(&full, value.round() as i64)?;
                    lines.push(line(key, value.round(), estimate));
                } else {
                    file.set(&full, rounded(value, estimate))?;
                    lines.push(line(key, rounded(value, estimate), estimate));
                }
            }
            Some(Finding::Unknown { needs, .. }) => kept.push(format!("{path}.{key}: {needs}")),
            None => kept.push(format!("{path}.{key}: a frequency response")),
        }
    }
    Ok(lines)
}

fn line(key: &str, value: f64, estimate: &Estimate) -> String {
    let [low, high] = estimate.ci95.map(|end| rounded(end, estimate));
    format!("{key} {value} ({low} to {high}) {}: {}", estimate.unit, estimate.source)
}

/// With three digits of its interval: values that go together were found better than their torque constant is known.
fn rounded(value: f64, estimate: &Estimate) -> f64 {
    let width = estimate.ci95[1] - estimate.ci95[0];
    if width <= 0.0 || !width.is_finite() {
        return value;
    }
    let decimals = (2.0 - width.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.decimals$}").parse().unwrap_or(value)
}

/// Lines of one text that the other has not, in order: `-` and `+`.
fn difference(before: &str, after: &str) -> String {
    let (old, new): (Vec<&str>, Vec<&str>) = (before.lines().collect(), after.lines().collect());
    // Longest common lines from each pair of places to the ends.
    let mut common = vec![vec![0_u32; new.len() + 1]; old.len() + 1];
    for i in (0..old.len()).rev() {
        for j in (0..new.len()).rev() {
            common[i][j] = if old[i] == new[j] {
                common[i + 1][j + 1] + 1
            } else {
                common[i + 1][j].max(common[i][j + 1])
            };
        }
    }
    let (mut i, mut j) = (0, 0);
    let mut text = String::new();
    while i < old.len() || j < new.len() {
        if i < old.len() && j < new.len() && old[i] == new[j] {
            (i, j) = (i + 1, j + 1);
        } else if i < old.len() && (j == new.len() || common[i + 1][j] >= common[i][j + 1]) {
            text += &format!("- {}\n", old[i]);
            i += 1;
        } else {
            text += &format!("+ {}\n", new[j]);
            j += 1;
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_shows_what_goes_and_what_comes() {
        let before = "a\nb = 1 # kept\nc\n";
        let after = "a\n# new\nb = 2 # kept\nc\n";
        assert_eq!(difference(before, after), "- b = 1 # kept\n+ # new\n+ b = 2 # kept\n");
        assert_eq!(difference(before, before), "");
    }

    #[test]
    fn a_value_has_the_digits_that_its_interval_justifies() {
        let rounded_of = |value, half| rounded(value, &Estimate::within(value, half, "N", "test"));
        assert_eq!(rounded_of(1128.62584, 10.4), 1128.6);
        assert_eq!(rounded_of(0.48481, 0.04), 0.4848);
        assert_eq!(rounded_of(150.89912, 0.13), 150.899);
        assert_eq!(rounded_of(3.25, 0.0), 3.25);
    }
}
