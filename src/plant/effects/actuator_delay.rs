//! Actuator delay: a time between a command that takes effect in the drive and its current loop.
//!
//! Invariant: adds to the dead time of the actuator, so that the margins of the loops know it as well.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::Action;
use super::parameter::Parameter;
use crate::base::time::Span;

pub(super) const ENTRY: Entry = Entry {
    name: "actuator-delay",
    summary: "a command that acts later than is known",
    equation: "i(t - T)",
    parameters: &[Parameter::new("delay-us", "us", [0.0, 5_000.0], 250.0, 300.0)],
    coordinate: Coordinate::Frequency,
    experiment: Experiment::Excitation,
    aliases: &[],
    law_of: None,
    action: Action::Parameter(|values, axis| {
        axis.actuator.dead_time = axis.actuator.dead_time + Span::s(1e-6 * values[0])
    }),
};
