//! Resonance of what stands on the table, or of what it stands on: part of its mass on a spring of its own.
//!
//! ```text
//!   m v_3' = -k q - c q'      q' = v_3 - v_t      F = k q + c q' on the table
//!   m = s M                   k = m (2π f)²       c = 2 ζ m 2π f
//! ```
//!
//! `q` is the way of that part against the table, which is lighter by it. Its step is the implicit rule of the middle,
//! stable at any frequency and off by `(2π f h)² / 12` in it: 0.2 % at 500 Hz and a step of 50 us, or at 100 Hz and one of
//! 250 us.
//! Invariant: the mass of all is that of the base model.

use std::f64::consts::TAU;

use super::super::params::Parameters;
use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Force, Instant, Memory, Pace};
use super::parameter::Parameter;

/// What stands on a machine is damped by some hundredths of critical, and a tenth at its joints: more is a guide that gives way before it
/// slides, and swings no more.
const DAMPED_MOST: f64 = 20.0;

pub(super) const ENTRY: Entry = Entry {
    name: "resonance",
    summary: "part of the table's mass on a spring of its own",
    equation: "m v_3' = -k q - c q', q' = v_3 - v_t",
    parameters: &[
        Parameter::new("mass-percent", "%", [0.0, 80.0], 10.0, 10.0),
        Parameter::new("frequency-hz", "Hz", [2.0, 500.0], 60.0, 30.0),
        Parameter::new("damping-percent", "%", [0.0, DAMPED_MOST], 3.0, 3.0),
    ],
    coordinate: Coordinate::Frequency,
    experiment: Experiment::Excitation,
    aliases: &[],
    law_of: None,
    action: Action::Force(|values, axis| Box::new(Mode::new(values, axis))),
};

/// The part on its spring; it remembers `q`, m, and `v_3`, m/s.
#[derive(Debug)]
struct Mode {
    share: f64,
    mass_kg: f64,
    /// `k / m`, 1/s².
    spring_per_s2: f64,
    /// `c / m`, 1/s.
    damper_per_s: f64,
}

impl Mode {
    fn new(values: &[f64; 3], axis: &Parameters) -> Self {
        let (share, natural, damping) = (1e-2 * values[0], TAU * values[1], 1e-2 * values[2]);
        Self {
            share,
            mass_kg: share * axis.mechanics.mass_kg,
            spring_per_s2: natural * natural,
            damper_per_s: 2.0 * damping * natural,
        }
    }
}

impl Force for Mode {
    fn pace(&self, _motor_m_per_s: f64) -> Pace {
        Pace::of_swing(self.spring_per_s2.sqrt() / TAU)
    }

    fn on_table_n(&self, at: &Instant, memory: &Memory) -> f64 {
        let relative_m_per_s = memory[1] - at.table_m_per_s;
        self.mass_kg * (self.spring_per_s2 * memory[0] + self.damper_per_s * relative_m_per_s)
    }

    fn memory(&self, velocity_m_per_s: f64) -> Option<Memory> {
        Some([0.0, velocity_m_per_s])
    }

    fn advance(&self, memory: &mut Memory, from: &Instant, to: &Instant, step_s: f64) {
        let table_m_per_s = 0.5 * (from.table_m_per_s + to.table_m_per_s);
        let [way_m, relative_m_per_s] = [memory[0], memory[1] - table_m_per_s];
        let half_s = 0.5 * step_s;
        let middle_m_per_s = (relative_m_per_s - half_s * self.spring_per_s2 * way_m)
            / (1.0 + half_s * (self.damper_per_s + half_s * self.spring_per_s2));
        *memory = [way_m + step_s * middle_m_per_s, table_m_per_s + 2.0 * middle_m_per_s - relative_m_per_s];
    }

    fn prepare(&self, axis: &mut Parameters) {
        axis.mechanics.mass_kg *= 1.0 - self.share;
    }
}
