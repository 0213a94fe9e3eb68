//! Command filter: setpoints that reach the loops behind a filter that nobody told of. A control computes it row by row: of a straight line it is
//! then behind by half a row less than its time.
//!
//! Invariant: of the control; no force.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::Action;
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "command-filter",
    summary: "setpoints that reach the loops behind a filter",
    equation: "x_set / (1 + s T)",
    parameters: &[Parameter::new("time-ms", "ms", [0.0, 1_000.0], 5.0, 5.0)],
    coordinate: Coordinate::Acceleration,
    experiment: Experiment::Accelerations,
    aliases: &[],
    law_of: None,
    action: Action::Control(|values, otherwise| otherwise.lag_s = 1e-3 * values[0]),
};

pub(super) const BY_ROWS: Entry = Entry {
    name: "command-filter-by-rows",
    summary: "setpoints of which each row brings the loops a share nearer",
    equation: "x += (1 - exp(-t_row / T)) (x_set - x)",
    law_of: Some("command-filter"),
    action: Action::Control(|values, otherwise| {
        otherwise.lag_s = 1e-3 * values[0];
        otherwise.lags_by_rows = true;
    }),
    ..ENTRY
};
