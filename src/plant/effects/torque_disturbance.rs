//! Disturbance of the torque at a frequency of its own: pumps, fans, the mains; or of the force on the table, where
//! what shakes stands beside it.
//!
//! Keeps its frequency at every feed, which what comes from an angle does not.
//! Invariant: a function of time alone, in phase with the start.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Force, Instant, Memory, Pace};
use super::parameter::Parameter;
use super::swing::Swing;

const FREQUENCY: Parameter = Parameter::new("frequency-hz", "Hz", [0.1, 500.0], 25.0, 15.0).in_time();

pub(super) const ENTRY: Entry = Entry {
    name: "torque-disturbance",
    summary: "a torque that swings with time",
    equation: "T = ... + A sin(2π f t + φ)",
    parameters: &[Parameter::new("torque-nm", "N m", [0.0, 100.0], 0.05, 0.05), FREQUENCY, Parameter::PHASE],
    coordinate: Coordinate::Time,
    experiment: Experiment::Circles,
    aliases: &[],
    law_of: None,
    action: Action::Force(|values, axis| {
        Box::new(Torque(Swing::new(
            values[0] * axis.mechanics.force_per_torque(),
            values[1].recip(),
            values[2],
        )))
    }),
};

#[derive(Debug)]
struct Torque(Swing);

impl Force for Torque {
    fn pace(&self, _motor_m_per_s: f64) -> Pace {
        self.0.pace(1.0)
    }

    fn on_motor_n(&self, at: &Instant, _memory: &Memory) -> f64 {
        self.0.at(at.time_s)
    }
}

pub(super) const PUSH: Entry = Entry {
    name: "torque-disturbance-push",
    summary: "a force on the table that swings with time",
    equation: "F = ... + A sin(2π f t + φ)",
    parameters: &[Parameter::new("force-n", "N", [0.0, 10_000.0], 20.0, 20.0), FREQUENCY, Parameter::PHASE],
    law_of: Some("torque-disturbance"),
    action: Action::Force(|values, _| Box::new(Push(Swing::new(values[0], values[1].recip(), values[2])))),
    ..ENTRY
};

#[derive(Debug)]
struct Push(Swing);

impl Force for Push {
    fn pace(&self, _motor_m_per_s: f64) -> Pace {
        self.0.pace(1.0)
    }

    fn on_table_n(&self, at: &Instant, _memory: &Memory) -> f64 {
        self.0.at(at.time_s)
    }
}
