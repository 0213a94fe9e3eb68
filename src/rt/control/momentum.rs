//! Does the motor move as its current makes it (fault 20)? An encoder that stands still, a coupling that slips
//! and an axis that is blocked all look like a loop that pushes and gets no answer; a following error tells
//! them only once the axis should have been elsewhere, which is late where it should be slow.
//!
//! ```text
//!   g  =  g + T h / J - (v - v_before)      what the torque should have added to the speed, and did not
//!   g  =  0 within ± T_free h / J of it     forces that nobody measures explain so much
//!   w  =  w + g h                           way that the axis may have gone beside the encoder
//! ```
//!
//! with the measured current's torque `T` and the control's own idea of the inertia `J`, both in travel of
//! the axis. `T_free` is the break-away torque half as much again and a fifth of the current limit. While
//! the axis is as fast as the position loop expects nothing is missing, however hard the loop must push:
//! `g` and `w` are zero. It does not answer when, braked by friction from now on, it would come to rest
//! further off than the following-error limit: `|w| + g² / (2 a) > limit`, in three steps running, so that
//! the noise of an encoder is no motion.
//! Invariant: an axis that does as it is told is never stopped by this, whatever force it takes.

use super::limits::Limits;
use crate::base::sample::Sample;
use crate::base::units::{Acceleration, Position, Torque, Velocity};
use crate::plant::Parameters;

/// Of the break-away torque: friction may be half above its model.
const FRICTION_FACTOR: f64 = 1.5;
/// Of the torque at the current limit: load, cutting and weight are not in the model.
const FREE_SHARE: f64 = 0.2;
/// Of the same: an axis with less friction than this would be taken to coast for ever.
const BRAKE_SHARE: f64 = 0.1;
/// Steps in which it must be so.
const STEPS_MIN: u32 = 3;

/// What the current should have done and did not.
#[derive(Clone, Copy, Debug)]
pub struct Momentum {
    /// Acceleration of the axis per torque, m/s² per N m.
    acceleration_per_nm: f64,
    /// Acceleration that nobody measures, m/s².
    free_m_per_s2: f64,
    /// Deceleration by friction alone, m/s².
    brake_m_per_s2: f64,
    standstill: Velocity,
    limit: Position,
    before: Option<Velocity>,
    missing_m_per_s: f64,
    way_m: f64,
    steps: u32,
}

impl Momentum {
    /// Of an axis as the control knows it.
    pub fn new(axis: &Parameters, limits: &Limits) -> Self {
        let mechanics = &axis.mechanics;
        let per_unit = mechanics.torque_for_acceleration(Acceleration::m_per_s2(1.0)).as_nm();
        let acceleration = |torque: Torque| torque.as_nm() / per_unit;
        let strongest = axis.actuator.torque(limits.current);
        let breakaway = mechanics.torque_for_force(axis.friction.breakaway) * FRICTION_FACTOR;
        let sliding = mechanics.torque_for_force(axis.friction.sliding);
        Self {
            acceleration_per_nm: per_unit.recip(),
            free_m_per_s2: acceleration(breakaway + strongest * FREE_SHARE),
            brake_m_per_s2: acceleration(sliding).max(acceleration(strongest * BRAKE_SHARE)),
            standstill: limits.standstill,
            limit: limits.following_error,
            before: None,
            missing_m_per_s: 0.0,
            way_m: 0.0,
            steps: 0,
        }
    }

    /// The axis has no current, or begins to have some.
    pub const fn reset(&mut self) {
        self.before = None;
        self.settle();
    }

    /// Nothing is missing.
    const fn settle(&mut self) {
        self.missing_m_per_s = 0.0;
        self.way_m = 0.0;
        self.steps = 0;
    }

    /// A fresh sample, `since_s` after the one before, of an axis that its position loop expects to be so
    /// fast. `torque` is that of the measured current.
    pub fn step(&mut self, sample: &Sample, torque: Torque, expected: Velocity, since_s: f64) {
        let before = self.before.replace(sample.velocity).unwrap_or(sample.velocity);
        if (expected - sample.velocity).abs() <= self.standstill {
            return self.settle();
        }
        let gained_m_per_s = (sample.velocity - before).as_m_per_s();
        let made_m_per_s = torque.as_nm() * self.acceleration_per_nm * since_s;
        let missing_m_per_s = self.missing_m_per_s + made_m_per_s - gained_m_per_s;
        let explained_m_per_s = missing_m_per_s.abs().min(self.free_m_per_s2 * since_s);
        let left_m_per_s = missing_m_per_s - explained_m_per_s.copysign(missing_m_per_s);
        if left_m_per_s * self.missing_m_per_s <= 0.0 {
            // It is made up for, or something else is missing now.
            self.settle();
        }
        self.missing_m_per_s = left_m_per_s;
        self.way_m += left_m_per_s * since_s;
        self.steps = if self.unseen_way() > self.limit { self.steps.saturating_add(1) } else { 0 };
    }

    /// How far off the axis may be by the time friction has stopped it.
    fn unseen_way(&self) -> Position {
        let coast_m = self.missing_m_per_s * self.missing_m_per_s / (2.0 * self.brake_m_per_s2);
        Position::m(self.way_m.abs() + coast_m)
    }

    /// Whether the axis does not answer to its current.
    pub const fn is_unanswered(&self) -> bool {
        self.steps >= STEPS_MIN
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::base::sample::Freshness;
    use crate::base::units::Current;
    use crate::plant::Plant;
    use crate::plant::tests::paper_axis;

    const TICK_S: f64 = 500e-6;
    pub(in crate::rt::control) const LIMITS: Limits = Limits {
        travel_min: Position::mm(-100.0),
        travel_max: Position::mm(100.0),
        travel_margin: Position::mm(2.0),
        velocity: Velocity::mm_per_s(250.0),
        acceleration: Acceleration::m_per_s2(5.0),
        current: Current::a(20.0),
        following_error: Position::mm(1.0),
        standstill: Velocity::mm_per_s(0.5),
    };

    pub(in crate::rt::control) fn axis() -> Parameters {
        let mut axis = paper_axis();
        axis.actuator.peak_current = Current::a(25.0);
        axis
    }

    fn at(mm_per_s: f64) -> Sample {
        let velocity = Velocity::mm_per_s(mm_per_s);
        Sample { freshness: Freshness::Fresh, velocity, ..Sample::default() }
    }

    /// Steps until an axis that shows these speeds under this torque counts as not answering.
    fn unanswered_after(torque_nm: f64, expected: f64, speed: impl Fn(u32) -> f64) -> Option<u32> {
        let mut momentum = Momentum::new(&axis(), &LIMITS);
        (0..2_000).find(|step| {
            let expected = Velocity::mm_per_s(expected);
            momentum.step(&at(speed(*step)), Torque::nm(torque_nm), expected, TICK_S);
            momentum.is_unanswered()
        })
    }

    #[test]
    fn an_encoder_that_stops_at_speed_is_seen_at_once() {
        let frozen = |step: u32| if step < 10 { 50.0 } else { 0.0 };
        assert_eq!(unanswered_after(1.7, 50.0, frozen), Some(12));
    }

    #[test]
    fn an_encoder_that_stands_under_full_current_is_seen_within_milliseconds() {
        // 20 N m make 2.8 m/s^2 beyond what goes free: 27 mm/s coast for most of a millimetre.
        let steps = unanswered_after(20.0, 2.0, |_| 0.0).map_or(0, |steps| steps + 1);
        assert!((18..=24).contains(&steps), "{steps} steps of 0.5 ms");
        // The wrong way round: what is made is missing twice.
        let reversed =
            unanswered_after(20.0, 2.0, |step| -2.0 * f64::from(step)).map_or(0, |steps| steps + 1);
        assert!(reversed < steps, "{reversed} steps with the encoder against the motor");
    }

    #[test]
    fn forces_that_friction_can_have_are_no_silence() {
        // Break-away of the model is 2.0 N m; half as much again and 4 N m beside are free.
        for torque_nm in [-6.9, -2.0, 2.0, 6.9] {
            assert_eq!(unanswered_after(torque_nm, 5.0, |_| 0.0), None, "{torque_nm} N m on a blocked axis");
        }
    }

    #[test]
    fn an_axis_as_fast_as_expected_takes_any_force() {
        assert_eq!(unanswered_after(20.0, 30.0, |step| 30.0 + 0.4 * f64::from(step % 2)), None);
    }

    #[test]
    fn a_single_reading_that_is_off_is_no_motion() {
        // One count of 50 um, for one step in ten.
        let noisy = |step: u32| match step % 10 {
            5 => 130.0,
            6 => -70.0,
            _ => 30.0,
        };
        assert_eq!(unanswered_after(1.7, 30.0, noisy), None);
    }

    #[test]
    fn the_axis_of_the_model_answers_even_if_it_is_heavier_and_rougher() {
        let mut real = axis();
        real.mechanics.mass_kg *= 2.0;
        real.friction = real.friction.scaled(2.0);
        let mut plant = Plant::new(&real, crate::base::time::Span::us(500));
        let mut momentum = Momentum::new(&axis(), &LIMITS);
        for tick in 0..4_000 {
            // To and fro with all the current there is: the loops cannot ask for more.
            let command = Current::a(if tick / 300 % 2 == 0 { 20.0 } else { -20.0 });
            plant.step(command);
            let state = plant.state();
            let sample = at(state.motor_velocity.as_mm_per_s());
            momentum.step(&sample, Torque::nm(state.current.as_a()), Velocity::mm_per_s(9e3), TICK_S);
            assert!(!momentum.is_unanswered(), "tick {tick}: {momentum:?}");
        }
    }
}
