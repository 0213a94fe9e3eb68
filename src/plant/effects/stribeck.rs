//! Stribeck: friction that falls as a film of oil builds up, further out than the fall of Eq. (1).
//!
//! ```text
//!   F(v) + S exp(-(v / v_s)^n)
//! ```
//!
//! A standing table resists by `S` more. Of the laws in use, that of Tustin has an exponent of 1 and the Gaussian one of 2 (Armstrong-Hélouvry,
//! Dupont and Canudas de Wit 1994); held against the other one, the same friction comes out a third off. The fall of the law itself,
//! `F_max` to `F_low`, is a parameter of the base model.
//! Invariant: against the way.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Friction, Instant};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "stribeck",
    summary: "friction that falls with the speed",
    equation: "F(v) + S exp(-(v / v_s)^n)",
    parameters: &[
        Parameter::new("extra-n", "N", [0.0, 1e5], 100.0, 100.0),
        Parameter::new("velocity-mm-per-s", "mm/s", [0.05, 200.0], 5.0, 5.0),
        Parameter::new("exponent", "", [1.0, 4.0], 2.0, 1.0),
    ],
    coordinate: Coordinate::Velocity,
    experiment: Experiment::Sweep,
    aliases: &[],
    law_of: None,
    action: Action::Friction(|values, _| {
        let [extra_n, velocity_mm_per_s, exponent] = *values;
        let s_per_m = 1e3 / velocity_mm_per_s;
        let lost_m_per_s = libm::pow(LOST, exponent.recip()) / s_per_m;
        Box::new(Fall { extra_n, s_per_m, exponent, lost_m_per_s })
    }),
};

/// From this power of the speed on nothing is left of it: `exp(-LOST)` is less than what 1 resolves.
const LOST: f64 = 40.0;

#[derive(Debug)]
struct Fall {
    extra_n: f64,
    s_per_m: f64,
    exponent: f64,
    lost_m_per_s: f64,
}

impl Friction for Fall {
    fn added_n(&self, at: &Instant) -> f64 {
        if at.speed_m_per_s > self.lost_m_per_s {
            return 0.0;
        }
        self.extra_n * libm::exp(-libm::pow(at.speed_m_per_s * self.s_per_m, self.exponent))
    }
}
