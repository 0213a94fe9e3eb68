//! Stribeck: friction that falls as a film of oil builds up, further out than the fall of Eq. (1).
//!
//! ```text
//!   F(v) + S exp(-(v / v_s)²)
//! ```
//!
//! A standing table resists by `S` more. The fall of the law itself, `F_max` to `F_low`, is a parameter of the
//! base model.
//! Invariant: against the way.

use super::catalogue::{Coordinate, Entry, Experiment, Parameter};
use super::hooks::{Action, Friction, Instant};

pub(super) const ENTRY: Entry = Entry {
    name: "stribeck",
    summary: "friction that falls with the speed",
    equation: "F(v) + S exp(-(v / v_s)²)",
    parameters: &[
        Parameter::new("extra-n", "N", [0.0, 1e5], 100.0, 100.0),
        Parameter::new("velocity-mm-per-s", "mm/s", [0.05, 200.0], 5.0, 5.0),
    ],
    coordinate: Coordinate::Velocity,
    experiment: Experiment::Sweep,
    aliases: &[],
    law_of: None,
    action: Action::Friction(|values, _| Box::new(Fall { extra_n: values[0], s_per_m: 1e3 / values[1] })),
};

#[derive(Debug)]
struct Fall {
    extra_n: f64,
    s_per_m: f64,
}

impl Friction for Fall {
    fn added_n(&self, at: &Instant) -> f64 {
        let share = at.speed_m_per_s * self.s_per_m;
        self.extra_n * libm::exp(-share * share)
    }
}
