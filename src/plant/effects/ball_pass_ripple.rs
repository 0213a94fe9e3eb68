//! Ball-pass ripple: friction that swings as the balls of the nut come into the load one by one.
//!
//! The periods in a turn are those of the cage times the balls of a turn, and no whole number; above two, where those of
//! `screw_ripple` end. It acts as that does, at another order.
//! Invariant: the factor is positive.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::Action;
use super::parameter::Parameter;
use super::screw_ripple::ripple;

pub(super) const ENTRY: Entry = Entry {
    name: "ball-pass-ripple",
    summary: "friction that swings with the balls of the nut",
    equation: "F(v) (1 + a sin(n θ + φ))",
    parameters: &[
        Parameter::new("share-percent", "%", [0.0, 50.0], 2.0, 1.5),
        Parameter::new("periods-per-turn", "", [2.1, 100.0], 7.3, 3.0).per_turn(),
        Parameter::PHASE,
    ],
    coordinate: Coordinate::Angle,
    experiment: Experiment::Sweep,
    aliases: &[],
    law_of: None,
    action: Action::Friction(ripple),
};
