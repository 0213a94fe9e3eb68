//! Lag of the current loop: it follows slower than is known, or a filter of the drive stands before it.
//!
//! Two lags of first order one behind the other are taken for one with the sum of their times, which holds far
//! below their bandwidths.
//! Invariant: adds to the lag of the actuator, so that the margins of the loops know it as well.

use std::f64::consts::TAU;

use super::catalogue::{Coordinate, Entry, Experiment, Parameter};
use super::hooks::Action;

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
