//! Spring load: a force that grows along the travel, of a cover, a cable chain or a counterweight on a spring.
//!
//! Invariant: conservative.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Force, Instant, Memory, Pace};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "spring-load",
    summary: "a force on the table that grows along the travel",
    equation: "M v_t' = ... - k (x_t - x_0)",
    parameters: &[
        Parameter::new("stiffness-n-per-mm", "N/mm", [0.0, 1_000.0], 1.0, 1.0),
        Parameter::new("neutral-mm", "mm", [-10_000.0, 10_000.0], 0.0, 100.0),
    ],
    coordinate: Coordinate::Position,
    experiment: Experiment::Sweep,
    aliases: &[],
    law_of: None,
    action: Action::Force(|values, _| {
        Box::new(Spring { n_per_m: 1e3 * values[0], neutral_m: 1e-3 * values[1] })
    }),
};

/// Where a spring of so many N/mm whose neutral point is known pulls with no force once a constant force pulls with it, mm:
/// `-k (x_t - x_0) + F = -k (x_t - x_0 - F / k)`. No log tells the two from one spring.
pub fn neutral_with_force_mm([n_per_mm, neutral_mm]: [f64; 2], force_n: f64) -> f64 {
    neutral_mm + force_n / n_per_mm
}

#[derive(Debug)]
struct Spring {
    n_per_m: f64,
    neutral_m: f64,
}

impl Force for Spring {
    fn on_table_n(&self, at: &Instant, _memory: &Memory) -> f64 {
        -self.n_per_m * (at.table_m - self.neutral_m)
    }
    fn pace(&self, _motor_m_per_s: f64) -> Pace {
        Pace::Slow
    }
}
