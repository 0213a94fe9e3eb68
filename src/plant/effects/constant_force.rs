//! Constant force on the table: weight, a counterweight that is not right, a pulling hose.
//!
//! Positive in the direction of the axis. The zero of a current measurement looks the same in the current, but
//! moves nothing when a drive without brake is let go.
//! Nearly every axis has some: a step of the base model knows it, at no cost.
//! Invariant: conservative.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::Action;
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "constant-force",
    summary: "a force on the table that is always there",
    equation: "M v_t' = ... + F_0",
    parameters: &[Parameter::new("force-n", "N", [-20_000.0, 20_000.0], 50.0, 100.0)],
    coordinate: Coordinate::Direction,
    experiment: Experiment::Sweep,
    aliases: &["direction-asymmetry"],
    law_of: None,
    action: Action::Push(|values| values[0]),
};
