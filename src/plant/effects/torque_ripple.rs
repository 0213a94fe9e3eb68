//! Torque ripple: a torque constant that swings with the angle, of windings and current sensors that are not alike.
//!
//! ```text
//!   T = K_t i (1 + a sin(n θ + φ))
//! ```
//!
//! Grows with the current, which cogging does not. A further harmonic has values of its own.
//! Invariant: nothing without current.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Force, Instant, Memory, Pace};
use super::parameter::Parameter;
use super::swing::Swing;

pub(super) const ENTRY: Entry = Entry {
    name: "torque-ripple",
    summary: "a torque constant that swings with the angle of the motor",
    equation: "T = K_t i (1 + a sin(n θ + φ))",
    parameters: &[
        Parameter::new("share-percent", "%", [0.0, 50.0], 2.0, 2.0),
        Parameter::new("periods-per-turn", "", [1.0, 1_000.0], 12.0, 12.0).whole().per_turn(),
        Parameter::PHASE,
    ],
    coordinate: Coordinate::Angle,
    experiment: Experiment::Accelerations,
    aliases: &[],
    law_of: None,
    action: Action::Force(|values, axis| {
        let period_m = axis.mechanics.lead_m / values[1];
        Box::new(TorqueRipple(Swing::new(1e-2 * values[0], period_m, values[2])))
    }),
};

pub(super) const HARMONIC: Entry = Entry {
    name: "torque-ripple-harmonic",
    summary: "another swing of the torque constant with the angle of the motor",
    law_of: Some("torque-ripple"),
    ..ENTRY
};

/// Of a share of the force of the drive.
#[derive(Debug)]
struct TorqueRipple(Swing);

impl Force for TorqueRipple {
    fn pace(&self, motor_m_per_s: f64) -> Pace {
        self.0.pace(motor_m_per_s)
    }

    fn on_motor_n(&self, at: &Instant, _memory: &Memory) -> f64 {
        at.drive_n * self.0.at(at.motor_m)
    }
}
