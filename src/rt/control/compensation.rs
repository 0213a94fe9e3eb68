//! Torque fed forward: what friction and inertia will ask for, from the plant's own formulas.
//!
//! Both look at the expected response of the position loop, not at the setpoint: at K_p = 8.55 1/s the
//! axis reverses 117 ms after the setpoint, and a force flipped with the setpoint makes a protrusion of
//! its own. The friction is the sliding law at the expected velocity, its sign flipped at the expected
//! reversal (the simple form: it knows nothing of displacement since the reversal).
//! Invariant: an axis that is expected to stand still gets no friction feed-forward.

use crate::base::units::{Torque, Velocity};
use crate::plant::{Parameters, friction::Law};

use super::position::PositionLoop;

/// Shares of the modelled torques that are fed forward; 0 switches one off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gains {
    /// Share of the friction law, 0 to 1.5.
    pub friction: f64,
    /// Share of the moved inertia, 0 to 1.5.
    pub inertia: f64,
}

/// The model behind the feed-forwards.
#[derive(Clone, Copy, Debug)]
pub struct Model {
    law: Law,
    standstill: Velocity,
    axis: Parameters,
}

/// The torques fed forward.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FeedForward {
    /// Against friction.
    pub friction: Torque,
    /// For acceleration.
    pub inertia: Torque,
}

impl Model {
    /// From the control's own idea of the axis. Below `standstill` an expected velocity has no direction.
    pub fn new(axis: &Parameters, standstill: Velocity) -> Self {
        Self { law: Law::new(axis.friction), standstill, axis: *axis }
    }

    /// What to add to the velocity loop's torque.
    pub fn feed_forward(&self, gains: &Gains, expected: &PositionLoop) -> FeedForward {
        let mut torques = FeedForward::default();
        if gains.friction != 0.0 && expected.expected_velocity().abs() > self.standstill {
            let force = self.law.sliding(expected.expected_velocity());
            torques.friction = self.axis.mechanics.torque_for_force(force) * gains.friction;
        }
        if gains.inertia != 0.0 {
            let torque = self.axis.mechanics.torque_for_acceleration(expected.expected_acceleration());
            torques.inertia = torque * gains.inertia;
        }
        torques
    }
}
