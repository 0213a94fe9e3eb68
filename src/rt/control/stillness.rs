//! Does the reading move at all? A motor cannot stand to the last count while its current changes: even where
//! the table sticks, the screw winds up. An encoder that repeats a reading is found by it where the axis is
//! slow, long before its momentum tells (`momentum`).
//!
//! ```text
//!   wind-up  =  K_t ΔI η / (r k)        way of the motor against a table that sticks
//! ```
//!
//! The reading must not have changed since the current was another: by the break-away torque, and a tenth of
//! the current limit at least, in three steps running. The motor's own bearings, which hold it without any
//! wind-up, are a part of the break-away torque. Where that winds up less than some counts of the encoder,
//! nothing can be told.
//! Invariant: a reading that changes by a single count is never still.

use super::limits::Limits;
use crate::base::sample::Sample;
use crate::base::units::{Current, Position};
use crate::plant::Parameters;

/// Of the current limit: less than this can be noise, or bearings that the model does not know.
const LIMIT_SHARE: f64 = 0.1;
/// Counts that the change of current must wind up.
const COUNTS_MIN: f64 = 4.0;
/// Steps in which it must be so.
const STEPS_MIN: u32 = 3;

/// How long a reading has stood, and under which current.
#[derive(Clone, Copy, Debug)]
pub struct Stillness {
    /// Change of current that no reading survives; `None`: the encoder is too coarse to tell.
    change: Option<Current>,
    /// The reading, and the current when it came.
    since: Option<(Position, Current)>,
    steps: u32,
}

impl Stillness {
    /// Of an axis as the control knows it, with an encoder of this resolution.
    pub fn new(axis: &Parameters, limits: &Limits, resolution: Position) -> Self {
        let breakaway = axis.actuator.current(axis.mechanics.torque_for_force(axis.friction.breakaway));
        let least = limits.current * LIMIT_SHARE;
        let change = if breakaway.abs() > least { breakaway.abs() } else { least };
        let wind_up = axis.mechanics.wind_up(axis.mechanics.force_of_torque(axis.actuator.torque(change)));
        let is_seen = wind_up >= resolution * COUNTS_MIN;
        Self { change: is_seen.then_some(change), since: None, steps: 0 }
    }

    /// The axis has no current, or begins to have some.
    pub const fn reset(&mut self) {
        self.since = None;
        self.steps = 0;
    }

    /// A fresh sample.
    pub fn step(&mut self, sample: &Sample) {
        let before = self.since.filter(|(position, _)| *position == sample.position);
        let (_, current) = *self.since.insert(before.unwrap_or((sample.position, sample.current)));
        let is_other = self.change.is_some_and(|change| (sample.current - current).abs() > change);
        self.steps = if is_other { self.steps.saturating_add(1) } else { 0 };
    }

    /// Whether the reading stands although the motor cannot.
    pub const fn is_unanswered(&self) -> bool {
        self.steps >= STEPS_MIN
    }
}

#[cfg(test)]
mod tests {
    use super::super::momentum::tests::{LIMITS, axis};
    use super::*;
    use crate::base::time::Span;
    use crate::base::units::Force;
    use crate::plant::Plant;

    const RESOLUTION: Position = Position::um(0.01);

    /// Steps until these readings count as still.
    fn still_after(reading: impl Fn(u32) -> (f64, f64)) -> Option<u32> {
        let mut stillness = Stillness::new(&axis(), &LIMITS, RESOLUTION);
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
        assert_eq!(still_after(|step| (5.0, -1.0 + 0.1 * f64::from(step))), Some(23));
        assert_eq!(still_after(|step| (5.0, 1.9 * f64::from(step % 2))), None, "break-away may hold it");
        assert_eq!(still_after(|step| (5.0 + 0.01 * f64::from(step / 20 % 2), 0.1 * f64::from(step))), None);
        let flickers = |step: u32| (5.0, if step % 10 < 2 { 9.0 } else { 0.0 });
        assert_eq!(still_after(flickers), None, "two readings of the current are no change");
    }

    #[test]
    fn no_axis_that_sticks_is_still() {
        // So much friction that full current does not move the table.
        let mut real = axis();
        real.friction.breakaway = Force::n(20_000.0);
        real.friction.sliding = Force::n(19_000.0);
        let mut plant = Plant::new(&real, Span::us(500));
        let mut stillness = Stillness::new(&axis(), &LIMITS, RESOLUTION);
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
    fn a_coarse_encoder_tells_nothing() {
        // 2 A wind the screw up by 7.5 um.
        let can_tell = |um| Stillness::new(&axis(), &LIMITS, Position::um(um)).change.is_some();
        assert_eq!((can_tell(1.8), can_tell(1.9)), (true, false));
    }
}
