//! Quadratic drag: what oil and air resist at high speed.
//!
//! Added to the law of Eq. (1); below a few m/min it is lost in what is viscous.
//! Invariant: against the way, and zero at rest.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Friction, Instant};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "quadratic-drag",
    summary: "friction that rises with the square of the speed",
    equation: "F(v) + q v²",
    parameters: &[Parameter::new("drag-n-s2-per-m2", "N s2/m2", [0.0, 1e5], 5_000.0, 3_000.0)],
    coordinate: Coordinate::Velocity,
    experiment: Experiment::Sweep,
    aliases: &[],
    law_of: None,
    action: Action::Friction(|values, _| Box::new(Drag { n_s2_per_m2: values[0] })),
};

#[derive(Debug)]
struct Drag {
    n_s2_per_m2: f64,
}

impl Friction for Drag {
    fn added_n(&self, at: &Instant) -> f64 {
        self.n_s2_per_m2 * at.speed_m_per_s * at.speed_m_per_s
    }
}
