//! Position-dependent stiffness: the free length of the screw, and with it its compliance, grows with the way
//! between nut and bearing.
//!
//! ```text
//!   F_screw = K d / (1 + b x) + C d'
//! ```
//!
//! Nominal where the axis stood at its start. The force that `K'(x) d² / 2` takes along the travel is left out: it is below
//! 1 mN.
//! Invariant: the stiffness stays above a tenth of nominal and below ten times.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Force, Instant, Pace};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "position-dependent-stiffness",
    summary: "a screw that gets softer along the travel",
    equation: "F_screw = K d / (1 + b x) + C d'",
    parameters: &[Parameter::new("slope-percent-per-m", "%/m", [-3_000.0, 3_000.0], 100.0, 100.0)],
    coordinate: Coordinate::Position,
    experiment: Experiment::Accelerations,
    aliases: &[],
    law_of: None,
    action: Action::Force(|values, _| Box::new(Softening { share_per_m: 1e-2 * values[0] })),
};

#[derive(Debug)]
struct Softening {
    share_per_m: f64,
}

impl Force for Softening {
    fn pace(&self, _motor_m_per_s: f64) -> Pace {
        Pace::Even
    }

    fn stretch_m(&self, at: &Instant) -> f64 {
        at.deflection_m * (1.0 / (1.0 + self.share_per_m * at.table_m).clamp(0.1, 10.0) - 1.0)
    }
}
