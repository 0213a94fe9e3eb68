//! The motions an axis pair can be ordered to make, as descriptions; `rt/control/profile` turns one
//! into setpoints and `offline/circle` judges the path that came of it.
//!
//! Invariant: geometry and speed along it; how speed is gained and lost is the profile's.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::units::{Position, Velocity};

/// Sense of a circular path, seen with X to the right and Y up (ISO 230-4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// Clockwise: G02.
    Cw,
    /// Counter-clockwise: G03.
    Ccw,
}

impl Direction {
    /// +1 counter-clockwise, -1 clockwise: the sign of the angular velocity.
    pub const fn sign(self) -> f64 {
        match self {
            Self::Ccw => 1.0,
            Self::Cw => -1.0,
        }
    }
    /// Name on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cw => "cw",
            Self::Ccw => "ccw",
        }
    }
}

impl fmt::Display for Direction {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(self.name())
    }
}

/// A circular test path in the X-Y plane (ISO 230-4), without its run-in and run-out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Centre of the nominal path, X.
    pub centre_x: Position,
    /// Centre of the nominal path, Y.
    pub centre_y: Position,
    /// Nominal radius.
    pub radius: Position,
    /// Speed along the path.
    pub feed: Velocity,
    /// Sense of rotation.
    pub direction: Direction,
    /// Where the evaluated part starts, in radians counter-clockwise from +X.
    pub start_angle_rad: f64,
    /// Whole turns evaluated.
    pub revolutions: u32,
}

impl Circle {
    /// Angular speed along the path in rad/s, positive either way.
    pub fn angular_speed_rad_per_s(&self) -> f64 {
        self.feed.as_m_per_s() / self.radius.as_m()
    }
    /// How long the evaluated part takes, in seconds.
    pub fn duration_s(&self) -> f64 {
        std::f64::consts::TAU * f64::from(self.revolutions) / self.angular_speed_rad_per_s()
    }
}
