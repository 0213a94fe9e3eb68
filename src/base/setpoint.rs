//! What we want of one axis at this instant.
//!
//! Invariant: velocity and acceleration are the derivatives of the position, not independent wishes.

use super::units::{Acceleration, Position, Velocity};

/// The motion profile's answer for one axis and one cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint {
    /// Where the axis should be.
    pub position: Position,
    /// How fast it should move there.
    pub velocity: Velocity,
    /// How its speed should change.
    pub acceleration: Acceleration,
}

impl Setpoint {
    /// Standing at a place.
    pub const fn at_rest(position: Position) -> Self {
        Self { position, velocity: Velocity::ZERO, acceleration: Acceleration::ZERO }
    }
    /// Every part is a number.
    pub const fn is_finite(&self) -> bool {
        self.position.is_finite() && self.velocity.is_finite() && self.acceleration.is_finite()
    }
}
