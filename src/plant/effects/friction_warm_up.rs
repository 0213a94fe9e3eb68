//! Warm-up of friction: grease and preload give way as an axis gets warm.
//!
//! ```text
//!   F(v) (1 - a (1 - exp(-t / T)))
//! ```
//!
//! Time runs from the start of the plant, as cold as its parameters are.
//! Invariant: the factor is positive.

use super::catalogue::{Coordinate, Entry, Experiment, Values};
use super::hooks::{Action, Friction, Instant};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "friction-warm-up",
    summary: "friction that falls as the axis gets warm",
    equation: "F(v) (1 - a (1 - exp(-t / T)))",
    parameters: &[
        // A hundredth is what two laws of friction differ by.
        Parameter::new("drop-percent", "%", [-90.0, 90.0], 25.0, 20.0).at_least(1.0),
        Parameter::new("time-constant-s", "s", [10.0, 36_000.0], 1_800.0, 1_200.0),
    ],
    coordinate: Coordinate::Time,
    experiment: Experiment::Repetition,
    aliases: &[],
    law_of: None,
    action: Action::Friction(|values, _| Box::new(WarmUp { drop: 1e-2 * values[0], per_s: 1.0 / values[1] })),
};

/// By which share friction has changed after a time, of these values.
pub fn warmed_share([drop_percent, time_constant_s, _]: Values, time_s: f64) -> f64 {
    changed(1e-2 * drop_percent, 1.0 / time_constant_s, time_s)
}

fn changed(drop: f64, per_s: f64, time_s: f64) -> f64 {
    drop * libm::expm1(-time_s * per_s)
}

#[derive(Debug)]
struct WarmUp {
    drop: f64,
    per_s: f64,
}

impl Friction for WarmUp {
    fn factor(&self, at: &Instant) -> f64 {
        1.0 + changed(self.drop, self.per_s, at.time_s)
    }
}
