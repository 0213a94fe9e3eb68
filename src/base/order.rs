//! What the cycle can be told from outside: orders, and the motions among them.
//!
//! Invariant: an order says everything about what is wanted; nothing of it is looked up later.

use super::axis::{AxisId, PerAxis};
use super::motion::Circle;
use super::time::Span;
use super::units::{Acceleration, Position, Velocity};

/// A circle with what leads into it and out of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CircleMotion {
    /// The path to be evaluated.
    pub circle: Circle,
    /// At full feed before the evaluated part, s.
    pub run_in_s: f64,
    /// At full feed after it, s.
    pub run_out_s: f64,
    /// Along the path while the speed rises and falls.
    pub acceleration: Acceleration,
}

/// A straight move with all axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineMotion {
    /// Where to.
    pub target: PerAxis<Position>,
    /// Along the path.
    pub feed: Velocity,
    /// Along the path.
    pub acceleration: Acceleration,
}

/// A sum of sines for the velocity command of one axis, periodic; `rt/control/excitation` says which.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Excitation {
    /// Which axis.
    pub axis: AxisId,
    /// Of each line.
    pub amplitude: Velocity,
    /// After which it repeats: a whole number of periods of the cycle.
    pub period: Span,
    /// Lowest line, as a multiple of the frequency of the period.
    pub harmonic_min: u32,
    /// Highest line, likewise.
    pub harmonic_max: u32,
    /// How many lines.
    pub lines: u8,
    /// How often the period is repeated for the evaluation.
    pub repeats: u32,
}

/// A straight move in whose steady part one axis is excited.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExcitedMotion {
    /// The move.
    pub line: LineMotion,
    /// What is added to it.
    pub excitation: Excitation,
}

/// What the cycle can be told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    /// Current on, bumpless.
    Enable,
    /// Come to rest, current off.
    Disable,
    /// Come to rest along the path.
    Stop,
    /// Forget faults whose cause is gone.
    ClearFaults,
    /// Use this gain set on every axis, without a bump.
    UseGains(u8),
    /// Move straight.
    Line(LineMotion),
    /// Move in a circle.
    Circle(CircleMotion),
    /// Move straight with an excitation.
    Excited(ExcitedMotion),
}
