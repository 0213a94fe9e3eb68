//! Load-dependent friction: nut and thrust bearing rub the more the harder the screw pushes.
//!
//! ```text
//!   F(v) + μ |K d + C d'|
//! ```
//!
//! At constant velocity it is a larger friction, so accelerations tell it.
//! Invariant: against the way.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Friction, Instant};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "load-dependent-friction",
    summary: "friction that rises with the force of the screw",
    equation: "F(v) + μ |F_screw|",
    parameters: &[Parameter::new("share-percent", "%", [0.0, 50.0], 3.0, 2.0)],
    coordinate: Coordinate::ScrewForce,
    experiment: Experiment::Accelerations,
    aliases: &[],
    law_of: None,
    action: Action::Friction(|values, _| Box::new(Loaded { share: 1e-2 * values[0] })),
};

#[derive(Debug)]
struct Loaded {
    share: f64,
}

impl Friction for Loaded {
    fn added_n(&self, at: &Instant) -> f64 {
        self.share * at.screw_n.abs()
    }
}
