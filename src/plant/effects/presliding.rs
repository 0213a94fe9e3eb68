//! Pre-sliding: before it slides, the table moves by micrometres against the bristles of its guides and seals.
//!
//! ```text
//!   df/dx = σ (1 - f sign(dx) / F(v)),   σ = F_low / x_b
//! ```
//!
//! Dahl's model with the sliding force of Eq. (1) as its end, `x_b` the way over which it is reached; for a
//! sliding force held over a step the equation is solved in closed form. The table then never sticks: what holds
//! it is the force of the bristles. Valid for single reversals; of ways back and forth within the band it knows
//! the force but not the turning points before the last.
//! Invariant: passive, what the bristles give back they were given.

use std::f64::consts::TAU;

use super::catalogue::{Coordinate, Entry, Experiment, Parameter};
use super::hooks::{Action, Bristles, Pace};

pub(super) const ENTRY: Entry = Entry {
    name: "presliding",
    summary: "a table that moves by micrometres before it slides",
    equation: "df/dx = σ (1 - f sign(dx) / F(v)), σ = F_low / x_b",
    parameters: &[Parameter::new("way-um", "um", [0.1, 200.0], 10.0, 10.0)],
    coordinate: Coordinate::WaySinceReversal,
    experiment: Experiment::SmallReversals,
    aliases: &[],
    law_of: None,
    action: Action::Bristles(|values, axis| {
        let stiffness_n_per_m = axis.friction.sliding.as_n() / (1e-6 * values[0]);
        let frequency_hz = (stiffness_n_per_m / axis.mechanics.mass_kg).sqrt() / TAU;
        Bristles { stiffness_n_per_m, pace: Pace::of_swing(frequency_hz) }
    }),
};

impl Bristles {
    /// Their force after a way, N, where `sliding_n` is that of sliding.
    pub(super) fn moved(&self, force_n: f64, sliding_n: f64, way_m: f64) -> f64 {
        if sliding_n <= 0.0 {
            return 0.0;
        }
        let end_n = sliding_n.copysign(way_m);
        end_n - (end_n - force_n) * libm::exp(-self.stiffness_n_per_m * way_m.abs() / sliding_n)
    }
}
