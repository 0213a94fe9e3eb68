//! What we tell one drive, how it came about, and which limits shaped it.
//!
//! Invariant: a value that a limit changed names that limit.

use super::units::{Current, Position, Torque, Velocity};

/// The limits that acted on a command in this cycle: a set, logged as bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limits(u8);

impl Limits {
    /// No limit acted.
    pub const NONE: Self = Self(0);
    /// The setpoint was held inside the travel.
    pub const TRAVEL: Self = Self(1);
    /// The velocity command was held.
    pub const VELOCITY: Self = Self(2);
    /// The change of the velocity command was held.
    pub const ACCELERATION: Self = Self(4);
    /// The current was held.
    pub const CURRENT: Self = Self(8);
    /// The drive says that it could not make the current it was asked for.
    pub const DRIVE: Self = Self(16);

    /// Each limit with its name, in order of the bits.
    pub const NAMES: [(Self, &'static str); 5] = [
        (Self::TRAVEL, "travel"),
        (Self::VELOCITY, "velocity"),
        (Self::ACCELERATION, "acceleration"),
        (Self::CURRENT, "current"),
        (Self::DRIVE, "drive"),
    ];

    /// As logged.
    pub const fn bits(self) -> u8 {
        self.0
    }
    /// From a log; unknown bits are dropped.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & 31)
    }
    /// Both sets.
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
    /// `limit` if it acted.
    pub const fn when(acted: bool, limit: Self) -> Self {
        if acted { limit } else { Self::NONE }
    }
    /// Whether all of `other` acted.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
    /// Names of the limits that acted.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMES.into_iter().filter(move |(limit, _)| self.contains(*limit)).map(|(_, name)| name)
    }
}

/// The terms of one command: what the loop computed on its way, in order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Terms {
    /// Setpoint minus measured position.
    pub following_error: Position,
    /// Where the axis would be without friction: the position loop's own response to the setpoint, and the
    /// excitation.
    pub expected_position: Position,
    /// Velocity of that response, without the excitation; the feed-forwards look at it.
    pub expected_velocity: Velocity,
    /// Output of the position loop, held between its ticks.
    pub velocity_command: Velocity,
    /// Added to it at each tick.
    pub excitation: Velocity,
    /// Proportional part of the velocity loop.
    pub proportional: Torque,
    /// Integral part, or the lag of Eq. (5).
    pub integral: Torque,
    /// Feed-forward of the friction law.
    pub friction: Torque,
    /// Feed-forward of the moved inertia.
    pub inertia: Torque,
}

/// One axis, commanded.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// Current asked of the drive.
    pub current: Current,
    /// CiA 402 control word (object 6040h).
    pub control_word: u16,
    /// How the current came about.
    pub terms: Terms,
    /// Which limits shaped it.
    pub limits: Limits,
}
