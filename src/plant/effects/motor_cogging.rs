//! Cogging: the teeth of the motor's iron pull its magnets, with current or without.
//!
//! ```text
//!   T = ... + A sin(n θ + φ)
//! ```
//!
//! `n` periods in a turn: pole pairs, slots, or their least common multiple. A second harmonic has values of
//! its own.
//! Invariant: a function of the angle alone, so conservative.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Force, Instant, Memory, Pace};
use super::parameter::Parameter;
use super::swing::Swing;

pub(super) const ENTRY: Entry = Entry {
    name: "motor-cogging",
    summary: "a torque that swings with the angle of the motor",
    equation: "T = ... + A sin(n θ + φ)",
    parameters: &[
        Parameter::new("torque-nm", "N m", [0.0, 100.0], 0.1, 0.1),
        Parameter::new("periods-per-turn", "", [1.0, 1_000.0], 12.0, 12.0).whole().per_turn(),
        Parameter::PHASE,
    ],
    coordinate: Coordinate::Angle,
    experiment: Experiment::Sweep,
    aliases: &[],
    law_of: None,
    action: Action::Force(|values, axis| {
        let period_m = axis.mechanics.lead_m / values[1];
        Box::new(Cogging(Swing::new(values[0] * axis.mechanics.force_per_torque(), period_m, values[2])))
    }),
};

pub(super) const HARMONIC: Entry = Entry {
    name: "motor-cogging-harmonic",
    summary: "another torque that swings with the angle of the motor",
    law_of: Some("motor-cogging"),
    ..ENTRY
};

/// Of a force, N.
#[derive(Debug)]
struct Cogging(Swing);

impl Force for Cogging {
    fn pace(&self, motor_m_per_s: f64) -> Pace {
        self.0.pace(motor_m_per_s)
    }

    fn on_motor_n(&self, at: &Instant, _memory: &Memory) -> f64 {
        self.0.at(at.motor_m)
    }
}
