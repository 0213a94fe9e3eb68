//! Soft zone: a nut that has lost its preload is softer while little force goes through it.
//!
//! ```text
//!   F_screw = K (d - s clamp(d, -h, h)) + C d'
//! ```
//!
//! The stiffness is `(1 - s) K` up to a deflection of `h`, and `K` beyond. A zone wider than screws bend is another
//! stiffness and no zone, and one that is softer than a seventh is play.
//! Invariant: a function of the deflection alone, so conservative.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Force, Instant, Pace};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "soft-zone",
    summary: "a screw that is softer under little force",
    equation: "F_screw = K (d - s clamp(d, -h, h)) + C d'",
    parameters: &[
        // Preload that is lost halves a stiffness. Where friction acts on the screw and not on the table alone, the drive bends a few per cent
        // more up to where friction bends it.
        Parameter::new("softness-percent", "%", [0.0, 85.0], 60.0, 30.0).at_least(10.0),
        Parameter::new("half-width-um", "um", [0.1, 30.0], 2.0, 2.0),
    ],
    coordinate: Coordinate::ScrewForce,
    experiment: Experiment::SmallReversals,
    aliases: &[],
    law_of: None,
    action: Action::Force(|values, _| {
        Box::new(SoftZone { softness: 1e-2 * values[0], half_m: 1e-6 * values[1] })
    }),
};

#[derive(Debug)]
struct SoftZone {
    softness: f64,
    half_m: f64,
}

impl Force for SoftZone {
    fn pace(&self, _motor_m_per_s: f64) -> Pace {
        Pace::Even
    }

    fn stretch_m(&self, at: &Instant) -> f64 {
        -self.softness * at.deflection_m.clamp(-self.half_m, self.half_m)
    }
}
