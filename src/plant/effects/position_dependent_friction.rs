//! Position-dependent friction: guides that are tighter towards one end.
//!
//! Nominal where the axis stood at its start. Valid for a slope; a tight spot is none.
//! Invariant: the friction is never negative.

use super::catalogue::{Coordinate, Entry, Experiment, Parameter};
use super::hooks::{Action, Friction, Instant};

pub(super) const ENTRY: Entry = Entry {
    name: "position-dependent-friction",
    summary: "friction that changes along the travel",
    equation: "F(v) (1 + a x)",
    parameters: &[Parameter::new("slope-percent-per-m", "%/m", [-3_000.0, 3_000.0], 50.0, 50.0)],
    coordinate: Coordinate::Position,
    experiment: Experiment::Sweep,
    aliases: &[],
    action: Action::Friction(|values, _| Box::new(Slope { share_per_m: 1e-2 * values[0] })),
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
