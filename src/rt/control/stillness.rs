//! Does the reading move at all? A motor cannot stand to the last count while its current changes: even where
//! the table sticks, the screw winds up. An encoder that repeats a reading is found by it where the axis is
//! slow, long before its momentum tells (`momentum`).
//!
//! ```text
//!   wind-up  =  K_t ΔI η / (r k)        way of the motor against a table that sticks
//!   s        =  a t² / 2                way that it has made after a time, under an acceleration a = K_t ΔI r / J
//! ```
//!
//! The reading must not have changed since the current was another: by the break-away torque, and a tenth of
//! the current limit at least. The other current must last for as long as the motor needs for some counts, for
//! behind a coarse encoder the velocity loop kicks for less; the one before must have been read twice, for one
//! reading may be off. The motor's own bearings, which hold it without any wind-up, are a part of the break-away
//! torque. Where that winds up less than some counts of the encoder, nothing can be told.
//! Invariant: a reading that changes by a single count is never still.

use super::limits::Limits;
use crate::base::sample::Sample;
use crate::base::time::Span;
use crate::base::units::{Current, Position};
use crate::plant::Parameters;

/// Of the current limit: less than this can be noise, or bearings that the model does not know.
const LIMIT_SHARE: f64 = 0.1;
/// Counts that the change of current must wind up, and be given the time for.
const COUNTS_MIN: f64 = 8.0;
/// Steps beside that time: a command takes two to become a current that is measured.
const STEPS_LATE: u32 = 2;

/// How long a reading has stood, and under which current.
#[derive(Clone, Copy, Debug)]
pub struct Stillness {
    /// Change of current that no reading survives; `None`: the encoder is too coarse to tell.
    change: Option<Current>,
    /// The reading, and the current when it came.
    since: Option<(Position, Current)>,
    /// Another reading of the current has agreed with that one.
    is_sure: bool,
    /// Steps running that it has stood under another current, and how many it takes.
    steps: u32,
    steps_min: u32,
}

impl Stillness {
    /// Of an axis as the control knows it, with an encoder of this resolution, sampled each tick.
    pub fn new(axis: &Parameters, limits: &Limits, resolution: Position, tick: Span) -> Self {
        let breakaway = axis.actuator.current(axis.mechanics.torque_for_force(axis.friction.breakaway));
        let least = limits.current * LIMIT_SHARE;
        let change = if breakaway.abs() > least { breakaway.abs() } else { least };
        let torque = axis.actuator.torque(change);
        let wind_up = axis.mechanics.wind_up(axis.mechanics.force_of_torque(torque));
        let way = resolution * COUNTS_MIN;
        let acceleration = axis.mechanics.acceleration_by_torque(torque).as_m_per_s2().abs();
        let needs_s = libm::sqrt(2.0 * way.as_m() / acceleration);
        let steps_min = STEPS_LATE.saturating_add((needs_s / tick.as_s()).ceil() as u32);
        Self { change: (wind_up >= way).then_some(change), since: None, is_sure: false, steps: 0, steps_min }
    }

    /// The axis has no current, or begins to have some.
    pub const fn reset(&mut self) {
        self.since = None;
        self.is_sure = false;
        self.steps = 0;
    }

    /// A fresh sample.
    pub fn step(&mut self, sample: &Sample) {
        let Some(change) = self.change else { return };
        let now = (sample.position, sample.current);
        let Some((_, current)) = self.since.filter(|(position, _)| *position == sample.position) else {
            self.reset();
            self.since = Some(now);
            return;
        };
        if (sample.current - current).abs() <= change {
            self.is_sure = true;
            self.steps = 0;
        } else if self.is_sure {
            self.steps = self.steps.saturating_add(1);
        } else {
            self.reset();
            self.since = Some(now);
        }
    }

    /// Whether the reading stands although the motor cannot.
    pub const fn is_unanswered(&self) -> bool {
        self.steps >= self.steps_min
    }
}

#[cfg(test)]
mod tests {
    use super::super::momentum::tests::{LIMITS, axis};
    use super::*;
    use crate::base::units::Force;
    use crate::plant::Plant;

    const RESOLUTION: Position = Position::um(0.01);

    fn of(resolution: Position) -> Stillness {
        Stillness::new(&axis(), &LIMITS, resolution, Span::us(500))
    }

    /// Steps until these readings count as still.
    fn still_after(reading: impl Fn(u32) -> (f64, f64)) -> Option<u32> {
        let mut stillness = of(RESOLUTION);
        (0..1_000).find(|step| {
            let (um, a) = reading(*step);
            let (position, current) = (Position::um(um), Current::a(a));
            stillness.step(&Sample { position, current, ..Sample::default() });
            stillness.is_unanswered()
        })
    }

    #[test]
    fn a_reading_that_stands_while_the_current_grows_is_found() {
        // A tenth of the limit are 2 A, as much as break-away takes.
        assert_eq!(still_after(|step| (5.0, -1.0 + 0.1 * f64::from(step))), Some(24));
        assert_eq!(still_after(|step| (5.0, 1.9 * f64::from(step % 2))), None, "break-away may hold it");
        assert_eq!(still_after(|step| (5.0 + 0.01 * f64::from(step / 20 % 2), 0.1 * f64::from(step))), None);
        let flickers = |step: u32| (5.0, if (4..6).contains(&(step % 10)) { 9.0 } else { 0.0 });
        assert_eq!(still_after(flickers), None, "two readings of the current are no change");
        let off_at_first = |step: u32| (5.0, if step == 0 { 9.0 } else { 0.0 });
        assert_eq!(still_after(off_at_first), None, "nor is the first, if it was off");
    }

    #[test]
    fn no_axis_that_sticks_is_still() {
        // So much friction that full current does not move the table.
        let mut real = axis();
        real.friction.breakaway = Force::n(20_000.0);
        real.friction.sliding = Force::n(19_000.0);
        let mut plant = Plant::new(&real, Span::us(500));
        let mut stillness = of(RESOLUTION);
        for tick in 0..4_000 {
            let swing_a = 20.0 * (f64::from(tick) * 0.01).sin();
            plant.step(Current::a(swing_a));
            let state = plant.state();
            let counted = (state.motor_position.as_um() / RESOLUTION.as_um()).floor() * RESOLUTION.as_um();
            let (position, current) = (Position::um(counted), state.current);
            stillness.step(&Sample { position, current, ..Sample::default() });
            assert!(!stillness.is_unanswered(), "tick {tick}, {swing_a} A: {stillness:?}");
        }
    }

    #[test]
    fn a_coarse_encoder_tells_later_or_nothing() {
        // 2 A wind the screw up by 7.5 um.
        let can_tell = |um| of(Position::um(um)).change.is_some();
        assert_eq!((can_tell(0.9), can_tell(1.0)), (true, false));
        // They make 0.43 m/s^2 of motor and table: 4 um take 4.3 ms.
        assert_eq!((of(RESOLUTION).steps_min, of(Position::um(0.5)).steps_min), (4, 11));
    }
}
