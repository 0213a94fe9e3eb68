//! Position-dependent friction: guides that are tighter towards one end, tight again and again, or at one place.
//!
//! ```text
//!   F(v) (1 + a x)      F(v) (1 + a sin(2π x / p + φ))      F(v) (1 + a exp(-(x - c)² / 2 w²))
//! ```
//!
//! The slope is nominal where the axis stood at its start. What swings with the turn of the screw is its ripple.
//! Invariant: the friction is never negative.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Friction, Instant};
use super::parameter::Parameter;
use super::swing::Swing;

pub(super) const ENTRY: Entry = Entry {
    name: "position-dependent-friction",
    summary: "friction that changes along the travel",
    equation: "F(v) (1 + a x)",
    parameters: &[Parameter::new("slope-percent-per-m", "%/m", [-3_000.0, 3_000.0], 50.0, 50.0)],
    coordinate: Coordinate::Position,
    experiment: Experiment::Sweep,
    aliases: &[],
    law_of: None,
    action: Action::Friction(|values, _| Box::new(Slope { share_per_m: 1e-2 * values[0] })),
};

pub(super) const WAVE: Entry = Entry {
    name: "position-dependent-friction-wave",
    summary: "friction that swings along the travel",
    equation: "F(v) (1 + a sin(2π x / p + φ))",
    parameters: &[
        Parameter::new("wave-percent", "%", [0.0, 90.0], 5.0, 5.0),
        Parameter::new("period-mm", "mm", [12.0, 2_000.0], 50.0, 50.0).along(1e-3),
        Parameter::PHASE,
    ],
    law_of: Some("position-dependent-friction"),
    action: Action::Friction(|values, _| {
        Box::new(Wave(Swing::new(1e-2 * values[0], 1e-3 * values[1], values[2])))
    }),
    ..ENTRY
};

pub(super) const TIGHT_SPOT: Entry = Entry {
    name: "position-dependent-friction-spot",
    summary: "friction that is larger about one place",
    equation: "F(v) (1 + a exp(-(x - c)² / 2 w²))",
    parameters: &[
        Parameter::new("spot-percent", "%", [-90.0, 500.0], 10.0, 10.0),
        Parameter::new("centre-mm", "mm", [-10_000.0, 10_000.0], 0.0, 10.0),
        Parameter::new("width-mm", "mm", [0.5, 500.0], 5.0, 5.0),
    ],
    law_of: Some("position-dependent-friction"),
    action: Action::Friction(|values, _| {
        let [percent, centre_mm, width_mm] = *values;
        Box::new(Spot { share: 1e-2 * percent, centre_m: 1e-3 * centre_mm, width_m: 1e-3 * width_mm })
    }),
    ..ENTRY
};

#[derive(Debug)]
struct Slope {
    share_per_m: f64,
}

impl Friction for Slope {
    fn factor(&self, at: &Instant) -> f64 {
        (1.0 + self.share_per_m * at.table_m).max(0.0)
    }
}

#[derive(Debug)]
struct Wave(Swing);

impl Friction for Wave {
    fn factor(&self, at: &Instant) -> f64 {
        1.0 + self.0.at(at.table_m)
    }
}

/// So many widths away from a spot nothing is left of it: `500 % exp(-LOST² / 2)` is less than what 1 resolves.
const LOST: f64 = 9.0;

#[derive(Debug)]
struct Spot {
    share: f64,
    centre_m: f64,
    width_m: f64,
}

impl Friction for Spot {
    fn factor(&self, at: &Instant) -> f64 {
        let away = (at.table_m - self.centre_m) / self.width_m;
        // Further off it is lost beside 1, and an exponential takes as long as all the rest.
        if away.abs() > LOST { 1.0 } else { 1.0 + self.share * libm::exp(-0.5 * away * away) }
    }
}
