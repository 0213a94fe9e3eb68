//! Saturation of the torque: the iron of the motor fills up, and more current makes less and less torque.
//!
//! ```text
//!   T = K_t i (1 - k |i|)
//! ```
//!
//! Valid up to `|i| = 1 / 2k`, where the torque is at its most; from there on it stays. A motor of 1 A may lose as much in each as one
//! of 10 A in all.
//! Invariant: the torque never falls while the current rises.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Force, Instant, Memory, Pace};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "torque-saturation",
    summary: "torque that falls behind the current",
    equation: "T = K_t i (1 - k |i|)",
    parameters: &[Parameter::new("loss-percent-per-a", "%/A", [0.0, 50.0], 1.0, 1.0)],
    coordinate: Coordinate::Current,
    experiment: Experiment::Accelerations,
    aliases: &[],
    law_of: None,
    action: Action::Force(|values, axis| {
        let n_per_a = axis.actuator.torque_constant_nm_per_a * axis.mechanics.force_per_torque();
        Box::new(Saturation { per_n: 1e-2 * values[0] / n_per_a })
    }),
};

#[derive(Debug)]
struct Saturation {
    per_n: f64,
}

impl Force for Saturation {
    fn pace(&self, _motor_m_per_s: f64) -> Pace {
        Pace::Even
    }

    fn on_motor_n(&self, at: &Instant, _memory: &Memory) -> f64 {
        let magnitude_n = at.drive_n.abs();
        let made_n = if magnitude_n * self.per_n < 0.5 {
            magnitude_n * (1.0 - magnitude_n * self.per_n)
        } else {
            0.25 / self.per_n
        };
        (made_n - magnitude_n) * at.drive_n.signum()
    }
}
