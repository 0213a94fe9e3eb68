//! What a listener on the bus cannot know, as it stands in a record.
//!
//! Invariant: what is not known can be told from every value that is.

use crate::base::command::{Command, Limits, Terms};
use crate::base::record::{AxisRecord, ModeTag, Refusal};
use crate::base::setpoint::Setpoint;
use crate::base::units::{Acceleration, Current, Position, Torque, Velocity};

/// An axis of which nothing is known.
pub(super) fn axis() -> AxisRecord {
    AxisRecord {
        mode: ModeTag::Unknown,
        gain_set: u8::MAX,
        setpoint: Setpoint {
            position: Position::m(f64::NAN),
            velocity: Velocity::m_per_s(f64::NAN),
            acceleration: Acceleration::m_per_s2(f64::NAN),
        },
        command: command(),
        refusal: Refusal::Unknown,
        ..AxisRecord::default()
    }
}

/// A command that nobody saw.
pub(super) fn command() -> Command {
    let (length, speed, torque) = (Position::m(f64::NAN), Velocity::m_per_s(f64::NAN), Torque::nm(f64::NAN));
    let terms = Terms {
        following_error: length,
        expected_position: length,
        expected_velocity: speed,
        velocity_command: speed,
        excitation: speed,
        proportional: torque,
        integral: torque,
        friction: torque,
        inertia: torque,
    };
    Command { current: Current::a(f64::NAN), control_word: 0, terms, limits: Limits::NONE }
}
