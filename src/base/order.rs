//! What the cycle can be told from outside: orders, and the motions among them.
//!
//! Invariant: an order says everything about what is wanted; nothing of it is looked up later.

use super::axis::PerAxis;
use super::motion::Circle;
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
}
