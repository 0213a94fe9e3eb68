//! Torque fed forward: what friction and inertia will ask for, from the plant's own formulas.
//!
//! Both look at the expected response of the position loop, not at the setpoint: at K_p = 8.55 1/s the
//! axis reverses 117 ms after the setpoint, and a force flipped with the setpoint makes a protrusion of
//! its own. The friction is the sliding law at the expected velocity, its sign flipped at the expected
//! reversal (the simple form: it knows nothing of displacement since the reversal). The falling branch
//! of the law is left out: below its end the force of that end is fed, for the peak at break-away is
//! what a sliding axis does not have.
//! Invariant: an axis that is expected to stand still gets no friction feed-forward.

use crate::base::units::{Torque, Velocity};
use crate::plant::{Parameters, friction::Law};

use super::position::PositionLoop;

/// Below this an expected velocity has no direction. The expected response carries no noise, so this
/// can be far below the standstill of a measured velocity: an axis that reverses at 7 mm/s² spends
/// 135 ms within ±0.5 mm/s, in which the feed-forward is wanted most.
const REST: Velocity = Velocity::mm_per_s(1e-3);

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
    fall_end: Velocity,
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
    /// From the control's own idea of the axis.
    pub fn new(axis: &Parameters) -> Self {
        Self { law: Law::new(axis.friction), fall_end: axis.friction.fall_end, axis: *axis }
    }

    /// What to add to the velocity loop's torque.
    pub fn feed_forward(&self, gains: &Gains, expected: &PositionLoop) -> FeedForward {
        let mut torques = FeedForward::default();
        let velocity = expected.expected_velocity();
        if gains.friction != 0.0 && velocity.abs() > REST {
            let is_falling = velocity.abs() < self.fall_end;
            let force = self.law.sliding(if is_falling {
                Velocity::m_per_s(self.fall_end.as_m_per_s().copysign(velocity.as_m_per_s()))
            } else {
                velocity
            });
            torques.friction = self.axis.mechanics.torque_for_force(force) * gains.friction;
        }
        if gains.inertia != 0.0 {
            let torque = self.axis.mechanics.torque_for_acceleration(expected.expected_acceleration());
            torques.inertia = torque * gains.inertia;
        }
        torques
    }
}
