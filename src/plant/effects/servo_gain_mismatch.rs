//! Servo gain mismatch: loops whose gains are not those that they are said to have.
//!
//! Of the velocity loop's alone no log tells: with all masses, forces and stiffnesses larger by as much, and a current
//! sensor that shows as much too much, each signal is the same.
//! Invariant: of the control; no force.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::Action;
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "servo-gain-mismatch",
    summary: "loops with other gains than the machine file's",
    equation: "K_p (1 + p), V_p (1 + v)",
    parameters: &[
        Parameter::new("position-gain-percent", "%", [-90.0, 200.0], 10.0, 10.0),
        Parameter::new("velocity-gain-percent", "%", [-90.0, 200.0], 0.0, 10.0).amplitude().of_base(),
    ],
    coordinate: Coordinate::Velocity,
    experiment: Experiment::Circles,
    aliases: &[],
    law_of: None,
    action: Action::Control(|values, otherwise| {
        otherwise.position_gain = 1.0 + 1e-2 * values[0];
        otherwise.velocity_gain = 1.0 + 1e-2 * values[1];
    }),
};
