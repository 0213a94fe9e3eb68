//! Runs: rows a whole number of cycles apart, in SI units, with a mark on each row that holds what somebody measured; and why data
//! are none.
//!
//! Units: m, A, s. Invariant: a row that was filled in is marked and takes part in no comparison.

use std::collections::BTreeMap;

use thiserror::Error;

use super::grid::REPAIRED_SHARE_MAX;
use super::intake::SHORTEST_S;
use super::motions::taken_apart;
use crate::base::axis::AxisId;

/// Why a run cannot be used.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RunError {
    /// Data of another machine.
    #[error("{run}: axis {axis} is none of the machine's ({known})")]
    Axis {
        /// Which run.
        run: String,
        /// What it calls the axis.
        axis: String,
        /// What the machine has.
        known: String,
    },
    /// Nothing says where the axis should have been.
    #[error("{run}, axis {axis}: no setpoint; the model is driven by it")]
    NoSetpoint {
        /// Which run.
        run: String,
        /// Which axis.
        axis: String,
    },
    /// Another rate than that of the cycle.
    #[error(
        "{run}: rows are {found_us:.1} us apart, the machine's cycle takes {wanted_us:.1} us; log every cycle, or one in two, three or four"
    )]
    Period {
        /// Which run.
        run: String,
        /// Distance of its rows.
        found_us: f64,
        /// Period of the machine.
        wanted_us: f64,
    },
    /// Too much is missing or repeated.
    #[error("{run}: {count} of {rows} rows are {what}; more than {} % is not repaired", 100.0 * REPAIRED_SHARE_MAX)]
    Broken {
        /// Which run.
        run: String,
        /// How many rows.
        count: usize,
        /// Of how many.
        rows: usize,
        /// What is wrong with them.
        what: &'static str,
    },
    /// It ends before it tells anything.
    #[error("{run}: {length_s:.2} s in one piece, at least {SHORTEST_S} s are needed")]
    TooShort {
        /// Which run.
        run: String,
        /// Its longest piece.
        length_s: f64,
    },
    /// Nothing was asked to move.
    #[error("{run}: no axis was asked to move")]
    Standing {
        /// Which run.
        run: String,
    },
    /// A channel that shows nothing.
    #[error(
        "{run}, axis {axis}: {channel} stands still from {from_s:.3} s to {to_s:.3} s while the setpoint goes {way_mm:.1} mm: frozen"
    )]
    Frozen {
        /// Which run.
        run: String,
        /// Which axis.
        axis: String,
        /// Which column.
        channel: &'static str,
        /// From when.
        from_s: f64,
        /// To when.
        to_s: f64,
        /// How far the setpoint went.
        way_mm: f64,
    },
    /// A unit or a sense that cannot be.
    #[error("{run}, axis {axis}: {channel} moves {slope:.4} times as far as the setpoint; {hint}")]
    Unit {
        /// Which run.
        run: String,
        /// Which axis.
        axis: String,
        /// Which column.
        channel: &'static str,
        /// Its slope over the setpoint.
        slope: f64,
        /// What it may be.
        hint: &'static str,
    },
}

/// One axis of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisRun {
    /// Where it should have been, m.
    pub setpoint_m: Vec<f64>,
    /// Where the motor was, m of travel.
    pub position_m: Vec<f64>,
    /// Where the table was, m, if it has a scale of its own.
    pub table_m: Option<Vec<f64>>,
    /// Motor current, A.
    pub current_a: Vec<f64>,
}

impl AxisRun {
    /// The same with something made of each column.
    #[must_use]
    pub(super) fn by_columns(&self, of: impl Fn(&[f64]) -> Vec<f64>) -> Self {
        Self {
            setpoint_m: of(&self.setpoint_m),
            position_m: of(&self.position_m),
            table_m: self.table_m.as_deref().map(&of),
            current_a: of(&self.current_a),
        }
    }
}

#[cfg(test)]
impl Run {
    /// One whose axes are where they should be and draw no current.
    pub(super) fn of_setpoints(
        period_s: f64,
        setpoints_m: impl IntoIterator<Item = (AxisId, Vec<f64>)>,
    ) -> Self {
        let axis = |(id, setpoint_m): (AxisId, Vec<f64>)| {
            let current_a = vec![0.0; setpoint_m.len()];
            (id, AxisRun { position_m: setpoint_m.clone(), table_m: None, current_a, setpoint_m })
        };
        let axes: BTreeMap<AxisId, AxisRun> = setpoints_m.into_iter().map(axis).collect();
        let rows = axes.values().map(|axis| axis.setpoint_m.len()).max().unwrap_or(0);
        Self { name: "all".to_owned(), start_s: 0.0, period_s, axes, is_sound: vec![true; rows] }
    }
}

/// From the least value of a column to its greatest.
pub(super) fn span(column: &[f64]) -> f64 {
    let [low, high] = column
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(*value), high.max(*value)]);
    high - low
}

/// Rows a whole number of cycles apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// File, and piece of it.
    pub name: String,
    /// Time of its first row, on the clock that all runs of a session share, s.
    pub start_s: f64,
    /// From row to row, s.
    pub period_s: f64,
    /// Its axes.
    pub axes: BTreeMap<AxisId, AxisRun>,
    /// Whether all of a row was measured.
    pub is_sound: Vec<bool>,
}

impl Run {
    /// The same as far as one axis is concerned.
    pub(super) fn of_axis(&self, id: AxisId) -> Self {
        let axes = self.axes.get(&id).map(|axis| (id, axis.clone())).into_iter().collect();
        Self { name: self.name.clone(), axes, is_sound: self.is_sound.clone(), ..*self }
    }

    /// How many rows.
    pub fn len(&self) -> usize {
        self.is_sound.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.is_sound.is_empty()
    }

    /// How long it is, s.
    pub fn duration_s(&self) -> f64 {
        self.len() as f64 * self.period_s
    }
}

/// Runs of a file with what was repaired in it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Intake {
    /// The pieces that are whole, in order.
    pub runs: Vec<Run>,
    /// What was repaired, in words.
    pub repaired: Vec<String>,
}

impl Intake {
    /// Takes in those of another file.
    pub fn extend(&mut self, more: Self) {
        self.runs.extend(more.runs);
        self.repaired.extend(more.repaired);
    }

    /// With a run for each motion that comes again by itself.
    #[must_use]
    pub(super) fn taken_apart(self) -> Self {
        Self { runs: self.runs.into_iter().flat_map(taken_apart).collect(), ..self }
    }
}
