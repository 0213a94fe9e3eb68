//! What was found, into the machine file: values by their keys, with their intervals and where they come from in a
//! note above the section.
//!
//! The parameters of an identification hold together with what it took as known. A file that has another lead,
//! efficiency, torque constant or mass than the logs gets nothing. Motor and table move as one, so of their sum
//! the motor gets what the mass of the file leaves.
//! Invariant: only keys that were found change, and the file is replaced as a whole or not at all.

use std::path::{Path, PathBuf};

use super::logged::LoggedAxis;
use super::logs::Logs;
use super::{AxisFindings, Estimate};
use crate::base::axis::AxisId;
use crate::config::Machine;
use crate::config::edit::{EditError, MachineFile};
use crate::log::header::rfc3339;
use crate::plant::friction::Variant;

/// What notes are known by.
const MARK: &str = "identified";

/// Findings and the keys that take them, by section.
const KEYS: [(&str, &[(&str, &str)]); 3] = [
    ("mechanics", &[("stiffness", "stiffness-n-per-um")]),
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
    ("drive", &[("current_loop", "current-loop-hz")]),
];

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
struct Origin {
    logs: String,
    /// When the first of them began.
    date: String,
    /// Of the program that made it.
    commit: String,
}

impl Origin {
    fn of(logs: &Logs) -> Self {
        Self { logs: logs.names(), date: rfc3339(logs.wall_at_zero_ns), commit: logs.commit.clone() }
    }
}

/// A machine file that shall take what is found in logs.
#[derive(Debug)]
pub struct Target {
    file: MachineFile,
    machine: Machine,
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
        Ok(Self { file, machine, origin: Origin::of(logs) })
    }

    /// The file with what was found of each axis.
    ///
    /// # Errors
    /// When nothing was found, or the file would be no sound machine with it.
    pub fn with(mut self, axes: &[(String, LoggedAxis)]) -> Result<Change, WriteError> {
        let before = self.file.text();
        let mut count = 0;
        for (index, (name, axis)) in axes.iter().enumerate() {
            count += put(&mut self.file, name, &self.machine, AxisId::new(index), axis, &self.origin)?;
        }
        if count == 0 {
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

/// Whether what was taken as known is the same in both.
fn is_same(file: &Path, here: &Machine, logged: &Machine) -> Result<(), WriteError> {
    let (got, expected) = (here.axes.count(), logged.axes.count());
    if got != expected {
        return Err(WriteError::Axes { file: file.to_owned(), got, expected });
    }
    for (id, axis) in here.axes.iter() {
        let known = |axis: &crate::config::machine::Axis| {
            let (mechanics, actuator) = (axis.plant.mechanics, axis.plant.actuator);
            [
                ("mechanics.lead-mm", 1e3 * mechanics.lead_m),
                ("mechanics.efficiency", mechanics.efficiency),
                ("mechanics.mass-kg", mechanics.mass_kg),
                ("drive.torque-constant-nm-per-a", actuator.torque_constant_nm_per_a),
            ]
        };
        for ((key, got), (_, expected)) in known(axis).into_iter().zip(known(&logged.axes[id])) {
            if got != expected {
                return Err(WriteError::Known {
                    file: file.to_owned(),
                    axis: id.to_string(),
                    key,
                    got,
                    expected,
                });
            }
        }
    }
    Ok(())
}

/// Sets all that was found of an axis; how many keys.
fn put(
    file: &mut MachineFile,
    name: &str,
    machine: &Machine,
    id: AxisId,
    axis: &LoggedAxis,
    origin: &Origin,
) -> Result<usize, EditError> {
    let mut count = 0;
    for (section, keys) in KEYS {
        let path = format!("axis.{name}.{section}");
        let mut lines = Vec::new();
        for (finding, key) in keys {
            if let Some(estimate) = axis.findings.get(*finding).and_then(|finding| finding.estimate()) {
                // None of these can be negative; an interval around zero may say so.
                let value = rounded(estimate.value.max(0.0), estimate);
                file.set(&format!("{path}.{key}"), value)?;
                lines.push(line(key, value, estimate));
            }
        }
        if section == "mechanics"
            && let Some((value, estimate)) = motor_inertia(machine, id, &axis.findings)
        {
            file.set(&format!("{path}.motor-inertia-kg-m2"), value)?;
            lines.push(line("motor-inertia-kg-m2", value, &estimate) + ", less the mass of this file");
        }
        if section == "friction"
            && let Some(variant) = axis.variant
        {
            let named = match variant {
                Variant::Linear => "linear",
                Variant::Nonlinear => "nonlinear",
            };
            file.set(&format!("{path}.variant"), named)?;
            lines.push(format!("variant {named}: leaves less of reversals that it was not fitted to"));
        }
        if !lines.is_empty() {
            count += lines.len();
            let head = format!("from {} of {}, made by {}", origin.logs, origin.date, origin.commit);
            file.note(&path, MARK, &format!("{head}\n{}", lines.join("\n")))?;
        }
    }
    Ok(count)
}

/// What the mass in the file leaves of all that turns.
fn motor_inertia(machine: &Machine, id: AxisId, findings: &AxisFindings) -> Option<(f64, Estimate)> {
    let total = findings.get("total_inertia")?.estimate()?;
    let mechanics = &machine.axes[id].plant.mechanics;
    let table = mechanics.total_inertia_kg_m2() - mechanics.inertia_kg_m2;
    let less = |value: f64| value - table;
    let motor = Estimate { value: less(total.value), ci95: total.ci95.map(less), ..total.clone() };
    // A mass in the file that is more than all that moves is not put right by a motor that weighs nothing.
    (motor.value > 0.0).then(|| (rounded(motor.value, &motor), motor))
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
