//! Lag of the current loop: it follows slower than is known, or a filter of the drive stands before it.
//!
//! A loop that is slower is still one lag of first order; a filter before it makes two, one behind the other.
//! Invariant: adds to the lags of the actuator, so that the margins of the loops know it as well.

use std::f64::consts::TAU;

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::Action;
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "current-loop-lag",
    summary: "a current that follows its command slower",
    equation: "i = i_c / (1 + s (τ + T))",
    parameters: &[Parameter::new("lag-us", "us", [0.0, 10_000.0], 300.0, 300.0)],
    coordinate: Coordinate::Frequency,
    experiment: Experiment::Excitation,
    aliases: &[],
    law_of: None,
    action: Action::Parameter(|values, axis| {
        axis.actuator.current_loop_hz = 1.0 / (TAU * (axis.actuator.lag_s() + 1e-6 * values[0]));
    }),
};

pub(super) const FILTER: Entry = Entry {
    name: "current-loop-lag-filter",
    summary: "a filter of the drive before its current loop",
    equation: "i = i_c / ((1 + s τ) (1 + s T))",
    law_of: Some("current-loop-lag"),
    action: Action::Parameter(|values, axis| axis.actuator.filter_s += 1e-6 * values[0]),
    ..ENTRY
};
