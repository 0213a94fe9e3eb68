//! Limits of one axis: the bounds that hold a command back, each saying so, and the bounds whose
//! violation is a fault. All are checked in every cycle.
//!
//! | limit | holds back | faults |
//! |---|---|---|
//! | travel | the setpoint | position outside by more than the margin |
//! | velocity | the velocity command | measured speed above 1.2 times; above 5 times the encoder jumped |
//! | peak current of the drive | | acceleration above 2.5 times what it makes of the bare motor: the encoder jumped |
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
/// A measured speed this many times the limit is no motion: the encoder jumped.
pub const JUMP_FACTOR: f64 = 5.0;
/// So much faster than peak current accelerates the bare motor is no motion either. Torque constant and
/// inertia are known to a tenth or two; the rest is for the screw and a brake, which push as well. The screw
/// pushes most when the table comes through its backlash: under peak current, 1.5 times with 200 um of it,
/// 2.4 times with three times the mass besides (`tests/cycle/encoder_jumps.rs`, machine `reference`).
pub const ACCELERATION_FACTOR: f64 = 2.5;

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
    /// The travel, widened to a place where the axis stands outside of it: enabling it there must not
    /// move it, only the way back in is open.
    pub fn reach_from(&self, place: Position) -> (Position, Position) {
        let low = if place < self.travel_min { place } else { self.travel_min };
        let high = if place > self.travel_max { place } else { self.travel_max };
        (low, high)
    }

    /// The setpoint held inside a reach, and whether it had to be.
    pub fn hold_setpoint((low, high): (Position, Position), setpoint: &Setpoint) -> (Setpoint, bool) {
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
        let change = within - before;
        // Asked of the change: what is left of it after an addition may differ in the last digit.
        (before + change.clamp_abs(reach), within != wanted, change.abs() > reach)
    }

    /// Whether a fresh sample moved further than the axis can, with or without current.
    pub fn is_jump(&self, sample: &Sample) -> bool {
        sample.freshness == Freshness::Fresh && sample.velocity.abs() > self.velocity * JUMP_FACTOR
    }

    /// What is wrong with a fresh sample of an enabled axis, the worst first. `expected` is where the
    /// axis should be, `reach` the travel with the place where it was enabled.
    pub fn violation(
        &self,
        sample: &Sample,
        expected: Position,
        (low, high): (Position, Position),
    ) -> Option<Fault> {
        if sample.freshness != Freshness::Fresh {
            return None;
        }
        let outside = (sample.position - high).as_m().max((low - sample.position).as_m());
        let values = [sample.position.as_m(), sample.velocity.as_m_per_s(), sample.current.as_a()];
        if !(values.into_iter().all(f64::is_finite) && expected.is_finite()) {
            Some(Fault::NotANumber)
        } else if self.is_jump(sample) {
            Some(Fault::EncoderJump)
        } else if sample.velocity.abs() > self.velocity * FAULT_FACTOR {
            Some(Fault::Overspeed)
        } else if sample.current.abs() > self.current * FAULT_FACTOR {
            Some(Fault::Overcurrent)
        } else if (sample.position - expected).abs() > self.following_error {
            Some(Fault::FollowingError)
        } else if outside > self.travel_margin.as_m() {
            // Ramped out under control, so it comes after all that leaves no control.
            Some(Fault::Travel)
        } else {
            None
        }
    }

    /// Whether the axis stands.
    pub fn is_standing(&self, velocity: Velocity) -> bool {
        velocity.abs() <= self.standstill
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits {
        travel_min: Position::mm(-100.0),
        travel_max: Position::mm(100.0),
        travel_margin: Position::mm(2.0),
        velocity: Velocity::mm_per_s(200.0),
        acceleration: Acceleration::m_per_s2(5.0),
        current: Current::a(20.0),
        following_error: Position::mm(1.0),
        standstill: Velocity::mm_per_s(0.5),
    };

    fn sample(position_mm: f64, velocity_mm_per_s: f64, current_a: f64) -> Sample {
        Sample {
            freshness: Freshness::Fresh,
            position: Position::mm(position_mm),
            velocity: Velocity::mm_per_s(velocity_mm_per_s),
            current: Current::a(current_a),
            ..Sample::default()
        }
    }

    #[test]
    fn each_violation_has_its_fault() {
        let expected = Position::mm(50.0);
        let judge = |sample: &Sample| LIMITS.violation(sample, expected, LIMITS.reach_from(Position::ZERO));
        assert_eq!(judge(&sample(50.9, 239.0, -23.9)), None);
        assert_eq!(judge(&sample(51.1, 0.0, 0.0)), Some(Fault::FollowingError));
        assert_eq!(judge(&sample(48.9, 0.0, 0.0)), Some(Fault::FollowingError));
        assert_eq!(judge(&sample(102.1, 0.0, 0.0)), Some(Fault::FollowingError), "travel does not hide it");
        let reach = LIMITS.reach_from(Position::ZERO);
        for place_mm in [102.1, -102.1] {
            let outside = LIMITS.violation(&sample(place_mm, 0.0, 0.0), Position::mm(place_mm), reach);
            assert_eq!(outside, Some(Fault::Travel));
        }
        assert_eq!(judge(&sample(50.0, -241.0, 0.0)), Some(Fault::Overspeed));
        assert_eq!(judge(&sample(50.0, 1001.0, 0.0)), Some(Fault::EncoderJump));
        assert_eq!(judge(&sample(50.0, 0.0, 24.1)), Some(Fault::Overcurrent));
        assert_eq!(judge(&sample(50.0, f64::NAN, 0.0)), Some(Fault::NotANumber));
        let lost =
            LIMITS.violation(&sample(0.0, 0.0, 0.0), Position::m(f64::NAN), LIMITS.reach_from(expected));
        assert_eq!(lost, Some(Fault::NotANumber), "no distance can be told to nowhere");
        let stale = Sample { freshness: Freshness::Stale, ..sample(102.1, 0.0, 0.0) };
        assert_eq!(judge(&stale), None, "old data are judged by their age");
    }

    #[test]
    fn an_axis_outside_its_travel_is_held_there_and_may_only_come_back() {
        let reach = LIMITS.reach_from(Position::mm(101.5));
        let hold = |mm: f64| Limits::hold_setpoint(reach, &Setpoint::at_rest(Position::mm(mm)));
        assert_eq!(hold(101.5), (Setpoint::at_rest(Position::mm(101.5)), false));
        assert_eq!(hold(101.6), (Setpoint::at_rest(Position::mm(101.5)), true));
        assert_eq!(hold(-100.1), (Setpoint::at_rest(Position::mm(-100.0)), true));
        let judge = |mm: f64| {
            LIMITS.violation(&sample(mm, 0.0, 0.0), Position::mm(mm), LIMITS.reach_from(Position::mm(105.0)))
        };
        assert_eq!((judge(105.0), judge(106.9)), (None, None), "it may stand where it was enabled");
        assert_eq!((judge(107.1), judge(-102.1)), (Some(Fault::Travel), Some(Fault::Travel)));
    }

    #[test]
    fn velocity_and_acceleration_say_which_of_them_acted() {
        let hold = |wanted: f64, before: f64| {
            let [wanted, before] = [wanted, before].map(Velocity::mm_per_s);
            let (held, by_velocity, by_acceleration) = LIMITS.hold_velocity(wanted, before, 2e-3);
            ((held.as_mm_per_s() * 1e6).round() * 1e-6, by_velocity, by_acceleration)
        };
        assert_eq!(hold(150.0, 145.0), (150.0, false, false));
        assert_eq!(hold(250.0, 195.0), (200.0, true, false));
        assert_eq!(hold(-250.0, 195.0), (185.0, true, true));
        // 0.9 + (0.1 - 0.9) is not 0.1 to the last digit.
        assert!(matches!(hold(0.1, 0.9), (_, false, false)));
    }
}
