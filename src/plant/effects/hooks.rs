//! How an effect takes part in an axis: what it is given, and what it may answer.
//!
//! All in SI units, in travel; positions are places of the machine, zero where the axis stood at its start.
//! Invariant: an answer is a pure function of the effect's values, the instant and its memory.

use std::fmt::Debug;

use super::super::params::Parameters;
use super::Values;
use super::control::Otherwise;
use crate::base::units::{Force as Newtons, Position};

/// The axis at one instant of a step.
#[derive(Clone, Copy, Debug)]
pub(in crate::plant) struct Instant {
    pub(in crate::plant) motor_m: f64,
    pub(in crate::plant) table_m: f64,
    pub(in crate::plant) table_m_per_s: f64,
    /// Of the screw, beyond the flank that touches.
    pub(in crate::plant) deflection_m: f64,
    /// Of the motor, as its current makes it.
    pub(in crate::plant) drive_n: f64,
    /// Of the screw on the table.
    pub(in crate::plant) screw_n: f64,
    /// At which the table rubs, not negative.
    pub(in crate::plant) speed_m_per_s: f64,
    /// The way that it slides or is pulled, 1 or -1.
    pub(in crate::plant) side: f64,
    /// Since the start.
    pub(in crate::plant) time_s: f64,
}

/// What a force remembers from one step to the next; zeros at first.
pub(in crate::plant) type Memory = [f64; 2];

/// A friction beside that of the law.
pub(in crate::plant) trait Friction: Debug + Send + Sync {
    /// Added to the law, N.
    fn added_n(&self, _at: &Instant) -> f64 {
        0.0
    }
    /// By which law and all that is added are multiplied.
    fn factor(&self, _at: &Instant) -> f64 {
        1.0
    }
    /// By how much it falls with the speed where it falls most, N s/m.
    fn steepest_fall_n_s_per_m(&self) -> f64 {
        0.0
    }
    /// Both, in one call.
    fn both(&self, at: &Instant) -> [f64; 2] {
        [self.added_n(at), self.factor(at)]
    }
}

/// How fast forces change while the table runs, and so how long a step may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::plant) enum Pace {
    /// A step may span the tick.
    Slow,
    /// As a spring beside that of the screw does: a step may span half of it.
    Even,
    /// As a stiff spring does: a step may span a fifth of it.
    Brisk,
    /// With a frequency or a stiffness of its own: fine steps.
    Fast,
}

impl Pace {
    /// Of what swings with this frequency. A step of 0.25 ms or of 0.1 ms is off by `(2π f h)² / 12` in it: 0.8 % at the limits.
    pub(in crate::plant) fn of_swing(frequency_hz: f64) -> Self {
        const EVEN_UP_TO_HZ: f64 = 200.0;
        const BRISK_UP_TO_HZ: f64 = 500.0;
        match frequency_hz {
            even if even <= EVEN_UP_TO_HZ => Self::Even,
            brisk if brisk <= BRISK_UP_TO_HZ => Self::Brisk,
            _ => Self::Fast,
        }
    }

    /// Of what grows by itself at a rate, as a table does where its friction falls with its speed: what a step is off by grows with it.
    pub(in crate::plant) fn of_growth(per_s: f64) -> Self {
        const SLOW_UP_TO_PER_S: f64 = 100.0;
        const EVEN_UP_TO_PER_S: f64 = 250.0;
        const BRISK_UP_TO_PER_S: f64 = 800.0;
        match per_s {
            slow if slow <= SLOW_UP_TO_PER_S => Self::Slow,
            even if even <= EVEN_UP_TO_PER_S => Self::Even,
            brisk if brisk <= BRISK_UP_TO_PER_S => Self::Brisk,
            _ => Self::Fast,
        }
    }

    /// Of a force that comes from an angle or the time at this frequency, whatever it does to the axis. A step of 0.5 ms is off by
    /// `(2π f h)² / 12` in it: 0.3 % at the limit.
    pub(in crate::plant) fn of_force(frequency_hz: f64) -> Self {
        const SLOW_UP_TO_HZ: f64 = 60.0;
        if frequency_hz <= SLOW_UP_TO_HZ { Self::Slow } else { Self::Even }
    }
}

/// A force that the base model lacks.
pub(in crate::plant) trait Force: Debug + Send + Sync {
    /// On the motor, N.
    fn on_motor_n(&self, _at: &Instant, _memory: &Memory) -> f64 {
        0.0
    }
    /// On the table, N.
    fn on_table_n(&self, _at: &Instant, _memory: &Memory) -> f64 {
        0.0
    }
    /// What the screw seems to be deflected more, m: times its stiffness it pulls the table on and the motor back.
    fn stretch_m(&self, _at: &Instant) -> f64 {
        0.0
    }
    /// All three, in one call.
    fn all(&self, at: &Instant, memory: &Memory) -> [f64; 3] {
        [self.on_motor_n(at, memory), self.on_table_n(at, memory), self.stretch_m(at)]
    }
    /// How fast it changes while the motor turns at a speed and the table runs.
    fn pace(&self, _motor_m_per_s: f64) -> Pace {
        Pace::Fast
    }
    /// What it remembers when the axis moves steadily at a velocity; nothing for most.
    fn memory(&self, _velocity_m_per_s: f64) -> Option<Memory> {
        None
    }
    /// A step is over, for what it remembers.
    fn advance(&self, _memory: &mut Memory, _from: &Instant, _to: &Instant, _step_s: f64) {}
    /// What it makes of the parameters that the base model is computed with.
    fn prepare(&self, _axis: &mut Parameters) {}
}

/// What a sensor shows beside what is.
pub(in crate::plant) trait Reading: Debug + Send + Sync {
    /// Error at a place of the machine and a time since the start, m.
    fn error_m(&self, place_m: f64, time_s: f64) -> f64;
}

/// What another axis does to this one.
pub(in crate::plant) trait Crossing: Debug + Send + Sync {
    /// What the table scale shows too much, m.
    fn error_m(&self, _other: &Neighbour) -> f64 {
        0.0
    }
    /// Force on the table, N.
    fn on_table_n(&self, _other: &Neighbour) -> f64 {
        0.0
    }
}

/// What an axis does to the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Where its table is.
    pub table: Position,
    /// Force of its screw on the table.
    pub force: Newtons,
    /// What of it accelerates that table: friction holds the rest.
    pub accelerating: Newtons,
}

/// Most bristles between a table and its guide.
pub(in crate::plant) const BRISTLES: usize = 8;

/// Bristles between table and guide: friction that is a spring until they slip.
#[derive(Clone, Copy, Debug)]
pub(in crate::plant) struct Bristles {
    pub(in crate::plant) stiffnesses_n_per_m: [f64; BRISTLES],
    /// How many there are: one bends until it slips, of many each slips at once.
    pub(in crate::plant) count: usize,
    /// How fast their force changes while they bend.
    pub(in crate::plant) pace: Pace,
}

/// Made from the values of an effect and the axis it is in.
type Made<T> = fn(&Values, &Parameters) -> T;

/// How an effect takes part.
#[derive(Clone, Copy, Debug)]
pub(in crate::plant) enum Action {
    /// As another value of a parameter that the base model has.
    Parameter(fn(&Values, &mut Parameters)),
    /// As a force on the table that is always the same, N: a step of the base model has room for it.
    Push(fn(&Values) -> f64),
    /// As friction.
    Friction(Made<Box<dyn Friction>>),
    /// As friction with a spring before it.
    Bristles(Made<Bristles>),
    /// As a force.
    Force(Made<Box<dyn Force>>),
    /// In what the motor encoder shows.
    MotorEncoder(Made<Box<dyn Reading>>),
    /// In what the table scale shows.
    TableScale(Made<Box<dyn Reading>>),
    /// In what the next axis does to this one.
    NextAxis(Made<Box<dyn Crossing>>),
    /// In what the control does that moves the axis.
    Control(fn(&Values, &mut Otherwise)),
}
