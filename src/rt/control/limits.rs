//! Limits of one axis: the bounds that hold a command back, each saying so, and the bounds whose
//! violation is a fault. All are checked in every cycle.
//!
//! | limit | holds back | faults |
//! |---|---|---|
//! | travel | the setpoint | position outside by more than the margin |
//! | velocity | the velocity command | measured speed above 1.2 times |
//! | acceleration | the change of the velocity command | |
//! | current | the current command | measured current above 1.2 times |
//! | following error | | distance from the expected response |
//!
//! Invariant: a value that is not a number is never passed on; it is a fault.

use crate::base::fault::Fault;
use crate::base::sample::{Freshness, Sample};
use crate::base::setpoint::Setpoint;
use crate::base::units::{Acceleration, Current, Position, Velocity};

/// A measured speed or current may pass the limit of its command by this factor before it is a fault:
/// the loop overshoots, the measurement is noisy.
pub const FAULT_FACTOR: f64 = 1.2;

/// Bounds of one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Lower end of the travel.
    pub travel_min: Position,
    /// Upper end of the travel.
    pub travel_max: Position,
    /// How far outside the travel a measured position is a fault.
    pub travel_margin: Position,
    /// Fastest command.
    pub velocity: Velocity,
    /// Steepest change of the command.
    pub acceleration: Acceleration,
    /// Largest current asked of the drive.
    pub current: Current,
    /// Largest distance from the expected response.
    pub following_error: Position,
    /// Speed below which the axis counts as standing.
    pub standstill: Velocity,
}

impl Limits {
    /// The setpoint held inside the travel, and whether it had to be.
    pub fn hold_setpoint(&self, setpoint: &Setpoint) -> (Setpoint, bool) {
        let (low, high) = (self.travel_min, self.travel_max);
        if setpoint.position < low {
            (Setpoint::at_rest(low), true)
        } else if setpoint.position > high {
            (Setpoint::at_rest(high), true)
        } else {
            (*setpoint, false)
        }
    }

    /// The velocity command held within the velocity limit and near enough to the one before.
    /// Returns what remains and which of velocity and acceleration limit acted.
    pub fn hold_velocity(&self, wanted: Velocity, before: Velocity, since_s: f64) -> (Velocity, bool, bool) {
        let within = wanted.clamp_abs(self.velocity);
        let reach = Velocity::m_per_s(self.acceleration.as_m_per_s2() * since_s);
        let held = before + (within - before).clamp_abs(reach);
        (held, within != wanted, held != within)
    }

    /// What is wrong with a fresh sample of an enabled axis, the worst first. `expected` is where the
    /// axis should be.
    pub fn violation(&self, sample: &Sample, expected: Position) -> Option<Fault> {
        if sample.freshness != Freshness::Fresh {
            return None;
        }
        let outside =
            (sample.position - self.travel_max).as_m().max((self.travel_min - sample.position).as_m());
        if !(sample.position.is_finite() && sample.velocity.is_finite() && sample.current.is_finite()) {
            Some(Fault::NotANumber)
        } else if sample.velocity.abs() > self.velocity * FAULT_FACTOR {
            Some(Fault::Overspeed)
        } else if sample.current.abs() > self.current * FAULT_FACTOR {
            Some(Fault::Overcurrent)
        } else if outside > self.travel_margin.as_m() {
            Some(Fault::Travel)
        } else if (sample.position - expected).abs() > self.following_error {
            Some(Fault::FollowingError)
        } else {
            None
        }
    }

    /// Whether the axis stands.
    pub fn is_standing(&self, velocity: Velocity) -> bool {
        velocity.abs() <= self.standstill
    }
}
