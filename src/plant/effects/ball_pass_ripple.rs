//! Ball-pass ripple: friction that swings as the balls of the nut come into the load one by one.
//!
//! The periods in a turn are those of the cage times the balls of a turn, and no whole number; above two, where those of
//! `screw_ripple` end. It acts as
//! `screw_ripple` does, at another order.
//! Invariant: the factor is positive.

use std::f64::consts::TAU;

use super::catalogue::{Coordinate, Entry, Experiment, Parameter};
use super::hooks::{Action, Friction, Instant};

pub(super) const ENTRY: Entry = Entry {
    name: "ball-pass-ripple",
    summary: "friction that swings with the balls of the nut",
    equation: "F(v) (1 + a sin(2π n x / lead + φ))",
    parameters: &[
        Parameter::new("share-percent", "%", [0.0, 50.0], 2.0, 1.5),
        Parameter::new("periods-per-turn", "", [2.1, 100.0], 7.3, 3.0),
        Parameter::PHASE,
    ],
    coordinate: Coordinate::Angle,
    experiment: Experiment::Sweep,
    aliases: &[],
    action: Action::Friction(|values, axis| {
        Box::new(BallPass {
            share: 1e-2 * values[0],
            rad_per_m: values[1] * TAU / axis.mechanics.lead_m,
            phase_rad: values[2].to_radians(),
        })
    }),
};

#[derive(Debug)]
struct BallPass {
    share: f64,
    rad_per_m: f64,
    phase_rad: f64,
}

impl Friction for BallPass {
    fn factor(&self, at: &Instant) -> f64 {
        1.0 + self.share * libm::sin(at.table_m * self.rad_per_m + self.phase_rad)
    }
}
