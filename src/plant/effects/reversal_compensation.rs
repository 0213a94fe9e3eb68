//! Reversal compensation: a drive that pushes by itself once the motor has turned back, as many do against the
//! quadrant glitch, and nobody told.
//!
//! ```text
//!   i_c = ... + A sign(v_m) exp(-t / T)
//! ```
//!
//! `t` is the time since the motor turned back; it counts from 0.05 mm/s on, so that a motor that only trembles
//! at rest is not pushed, and not again before the last pulse is over. The pulse passes the current loop, and the measured current shows it.
//! Invariant: nothing before the first reversal.

use super::catalogue::{Coordinate, Entry, Experiment, Parameter};
use super::hooks::{Action, Force, Instant, Memory, Pace};

/// A pulse with this share left is over.
const OVER: f64 = 0.05;
/// From here on the motor goes the other way.
const TURNED_M_PER_S: f64 = 5e-5;

pub(super) const ENTRY: Entry = Entry {
    name: "reversal-compensation",
    summary: "a drive that pushes by itself after a reversal",
    equation: "i_c + A sign(v_m) exp(-t / T)",
    parameters: &[
        Parameter::new("current-a", "A", [-100.0, 100.0], 0.5, 0.5),
        Parameter::new("decay-ms", "ms", [1.0, 1_000.0], 20.0, 20.0),
    ],
    coordinate: Coordinate::TimeSinceReversal,
    experiment: Experiment::Circles,
    aliases: &[],
    action: Action::Force(|values, axis| {
        let n_per_a = axis.actuator.torque_constant_nm_per_a * axis.mechanics.force_per_torque();
        Box::new(Pulse { start_n: values[0] * n_per_a, per_s: 1e3 / values[1] })
    }),
};

/// It remembers the way of the motor, the share of the pulse that is left, and how long it was owed, s: between
/// the moment of the turn and the end of the step in which it was.
#[derive(Debug)]
struct Pulse {
    start_n: f64,
    per_s: f64,
}

impl Pulse {
    /// Integral of the share from 1 on, over a time, s.
    fn area_s(&self, time_s: f64) -> f64 {
        -libm::expm1(-time_s * self.per_s) / self.per_s
    }
}

impl Force for Pulse {
    fn pace(&self) -> Pace {
        Pace::Even
    }

    fn on_command_n(&self, memory: &Memory, step_s: f64) -> f64 {
        let [side, left, owed_s] = *memory;
        self.start_n * side * (left * self.area_s(step_s) + owed_s) / step_s
    }

    fn memory(&self, velocity_m_per_s: f64) -> Option<Memory> {
        let side = if velocity_m_per_s == 0.0 { 0.0 } else { velocity_m_per_s.signum() };
        Some([side, 0.0, 0.0])
    }

    fn advance(&self, memory: &mut Memory, from: &Instant, to: &Instant, step_s: f64) {
        let [side, left, owed_s] = memory;
        *left *= libm::exp(-step_s * self.per_s);
        *owed_s = 0.0;
        let way = to.motor_m_per_s.signum();
        let [before, after] = [from, to].map(|at| at.motor_m_per_s * way);
        if after > TURNED_M_PER_S && way != *side && *left < OVER {
            if *side != 0.0 {
                let since_s = step_s * ((after - TURNED_M_PER_S) / (after - before)).clamp(0.0, 1.0);
                (*left, *owed_s) = (libm::exp(-since_s * self.per_s), self.area_s(since_s));
            }
            *side = way;
        }
    }
}
