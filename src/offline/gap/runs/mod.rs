//! Runs: rows a whole number of cycles apart, in SI units, with a mark on each row that holds what somebody measured.
//!
//! ```text
//!   CSV ──► intake ──► grid ─┬► runs ──► motions, laps ──► parts: one kind of motion each ──► repeats ──► held: which judge
//!   MCAP ─► logged ──────────┘
//! ```
//!
//! What cannot be a run is `refused`, with what to do; `sparse` fills in what the loops were given where a log has not every
//! cycle; `circles` are found in the setpoints.
//! Units: m, A, s. Invariant: a row that was filled in is marked and takes part in no comparison.

pub(super) mod circles;
mod grid;
pub(super) mod held;
pub mod intake;
mod laps;
pub mod logged;
pub(super) mod motions;
mod parts;
pub mod refused;
pub mod repeat;
pub mod repeats;
pub(super) mod sparse;

use std::collections::BTreeMap;

use crate::base::axis::AxisId;
use crate::base::setpoint::Setpoint;
use crate::base::units::{Acceleration, Position, Velocity};

/// Rows of a run so long are for the start to fade, s.
pub const SETTLE_S: f64 = 0.4;

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

/// From the begin of the first run to the end of the last, s.
pub(super) fn session_s(spans_s: &[[f64; 2]]) -> f64 {
    let begin_s = spans_s.iter().map(|[begin_s, _]| *begin_s).fold(f64::INFINITY, f64::min);
    let end_s = spans_s.iter().map(|[_, end_s]| *end_s).fold(f64::NEG_INFINITY, f64::max);
    end_s - begin_s
}

/// Setpoints that are so far apart, with velocity and acceleration as the differences of both neighbours show them.
pub fn setpoints(setpoint_m: &[f64], period_s: f64) -> Vec<Setpoint> {
    let rows = setpoint_m.len();
    let slope = |column: &[f64], row: usize| {
        let (low, high) = (row.saturating_sub(1), (row + 1).min(rows - 1));
        (column[high] - column[low]) / ((high - low) as f64 * period_s)
    };
    let velocity: Vec<f64> = (0..rows).map(|row| slope(setpoint_m, row)).collect();
    let of = |row: usize| Setpoint {
        position: Position::m(setpoint_m[row]),
        velocity: Velocity::m_per_s(velocity[row]),
        acceleration: Acceleration::m_per_s2(slope(&velocity, row)),
    };
    (0..rows).map(of).collect()
}
