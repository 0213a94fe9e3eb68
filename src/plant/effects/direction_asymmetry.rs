//! Direction asymmetry: friction that is not the same both ways, as of a nut with preload on one flank.
//!
//! Where friction is the same at all speeds this is the same as a constant force of `a F`, and no motion tells
//! the two apart; how it grows with the speed does.
//! Invariant: the factor is positive both ways.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Friction, Instant};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "direction-asymmetry",
    summary: "friction that differs by direction",
    equation: "F(v) (1 + a sign v)",
    parameters: &[Parameter::new("asymmetry-percent", "%", [-50.0, 50.0], 5.0, 5.0)],
    coordinate: Coordinate::Direction,
    experiment: Experiment::Sweep,
    aliases: &["constant-force"],
    law_of: None,
    action: Action::Friction(|values, _| Box::new(Sides { share: 1e-2 * values[0] })),
};

#[derive(Debug)]
struct Sides {
    share: f64,
}

impl Friction for Sides {
    fn factor(&self, at: &Instant) -> f64 {
        1.0 + self.share * at.side
    }
}
