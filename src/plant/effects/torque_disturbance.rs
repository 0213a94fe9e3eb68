//! Disturbance of the torque at a frequency of its own: pumps, fans, the mains; or of the force on the table, where
//! what shakes stands beside it.
//!
//! Keeps its frequency at every feed, which what comes from an angle does not.
//! Invariant: a function of time alone, in phase with the start.

use std::f64::consts::TAU;

use super::catalogue::{Coordinate, Entry, Experiment, Parameter};
use super::hooks::{Action, Force, Instant, Memory, Pace};

pub(super) const ENTRY: Entry = Entry {
    name: "torque-disturbance",
    summary: "a torque that swings with time",
    equation: "T = ... + A sin(2π f t + φ)",
    parameters: &[
        Parameter::new("torque-nm", "N m", [0.0, 100.0], 0.05, 0.05),
        Parameter::new("frequency-hz", "Hz", [0.1, 500.0], 25.0, 15.0).in_time(),
        Parameter::PHASE,
    ],
    coordinate: Coordinate::Time,
    experiment: Experiment::Circles,
    aliases: &[],
    law_of: None,
    action: Action::Force(|values, axis| {
        Box::new(Disturbance {
            amplitude_n: values[0] * axis.mechanics.force_per_torque(),
            rad_per_s: TAU * values[1],
            phase_rad: values[2].to_radians(),
        })
    }),
};

#[derive(Debug)]
struct Disturbance {
    amplitude_n: f64,
    rad_per_s: f64,
    phase_rad: f64,
}

impl Force for Disturbance {
    fn pace(&self) -> Pace {
        Pace::Even
    }

    fn on_motor_n(&self, at: &Instant, _memory: &Memory) -> f64 {
        self.amplitude_n * libm::sin(at.time_s * self.rad_per_s + self.phase_rad)
    }
}

pub(super) const PUSH: Entry = Entry {
    name: "torque-disturbance-push",
    summary: "a force on the table that swings with time",
    equation: "F = ... + A sin(2π f t + φ)",
    parameters: &[
        Parameter::new("force-n", "N", [0.0, 10_000.0], 20.0, 20.0),
        Parameter::new("frequency-hz", "Hz", [0.1, 500.0], 25.0, 15.0).in_time(),
        Parameter::PHASE,
    ],
    law_of: Some("torque-disturbance"),
    action: Action::Force(|values, _| {
        Box::new(Push(Disturbance {
            amplitude_n: values[0],
            rad_per_s: TAU * values[1],
            phase_rad: values[2].to_radians(),
        }))
    }),
    ..ENTRY
};

#[derive(Debug)]
struct Push(Disturbance);

impl Force for Push {
    fn pace(&self) -> Pace {
        Pace::Even
    }

    fn on_table_n(&self, at: &Instant, memory: &Memory) -> f64 {
        self.0.on_motor_n(at, memory)
    }
}
