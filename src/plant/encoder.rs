//! Where an axis was when its encoder latched: the SYNC asks for a position that is a little older, and
//! may itself come between two steps of the plant.
//!
//! Between the ends of two steps the position is the cubic through position and velocity at both (error of
//! the fourth order in the step); past the last one it is extrapolated with its velocity, which is off by up
//! to `a t² / 2` at an acceleration `a`. Counts and their scale are the wire's (`rt/wire/scaling`).
//! Every step is fed, whether or not a SYNC ends it.
//! Invariant: at the end of a step, without latency, the position passes through untouched.

use crate::base::time::Span;
use crate::base::units::{Position, Velocity};

/// Position and velocity at one end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knot {
    /// Where.
    pub position: Position,
    /// How fast.
    pub velocity: Velocity,
}

/// Steps that are kept beside those of the latency, for a SYNC that is looked at late.
const LATE_STEPS: usize = 32;

/// A latch that has seen the last steps.
#[derive(Clone, Debug)]
pub struct Latch {
    latency: Span,
    step: Span,
    /// The latency in whole steps and the share of one that is left, for a SYNC that ends a step.
    usual: (usize, f64),
    /// Ends of steps, a ring.
    knots: Box<[Knot]>,
    newest: usize,
}

impl Latch {
    /// The latch of an axis that stands at zero and moves in steps of `step`.
    pub fn new(latency: Span, step: Span) -> Self {
        let rest = Knot { position: Position::ZERO, velocity: Velocity::ZERO };
        let usual = in_steps(latency, step, i64::MAX);
        Self { latency, step, usual, knots: vec![rest; usual.0 + LATE_STEPS + 2].into(), newest: 0 }
    }

    /// Another step is over; `now` is the state at its end.
    pub fn feed(&mut self, now: Knot) {
        // A division takes as long as all the rest.
        self.newest = if self.newest + 1 == self.knots.len() { 0 } else { self.newest + 1 };
        self.knots[self.newest] = now;
    }

    /// The position latched for a SYNC that comes so long after the end of the last step; before it, where
    /// the span is negative, and no longer ago than what is kept.
    pub fn position(&self, after: Span) -> Position {
        let back = self.latency - after;
        if back < Span::ZERO {
            let Knot { position, velocity } = self.knot(0);
            return position + Position::m(velocity.as_m_per_s() * -back.as_s());
        }
        let (steps, age) = if after == Span::ZERO {
            self.usual
        } else {
            in_steps(back, self.step, self.knots.len() as i64 - 2)
        };
        let to = self.knot(steps);
        if age == 0.0 {
            return to.position;
        }
        between(&self.knot(steps + 1), &to, 1.0 - age.min(1.0), self.step)
    }

    /// The end of a step, by how many came after it.
    fn knot(&self, back: usize) -> Knot {
        let around = if back <= self.newest { 0 } else { self.knots.len() };
        self.knots[self.newest + around - back]
    }
}

/// A time in whole steps, at most so many, and the share of one that is left.
fn in_steps(time: Span, step: Span, most: i64) -> (usize, f64) {
    let steps = (time / step).min(most);
    (steps as usize, (time - step * steps).as_s() / step.as_s())
}

/// Within a step: the cubic through position and velocity at both of its ends, at a share of the step from 0 to 1.
pub(super) fn between(from: &Knot, to: &Knot, share: f64, step: Span) -> Position {
    let (s, step_s) = (share, step.as_s());
    let (s2, s3) = (s * s, s * s * s);
    let travel = to.position - from.position;
    from.position
        + travel * (3.0 * s2 - 2.0 * s3)
        + Position::m(from.velocity.as_m_per_s() * step_s) * (s3 - 2.0 * s2 + s)
        + Position::m(to.velocity.as_m_per_s() * step_s) * (s3 - s2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn knot(t_s: f64) -> Knot {
        Knot {
            position: Position::m(0.02 * t_s + 3.0 * t_s * t_s),
            velocity: Velocity::m_per_s(0.02 + 6.0 * t_s),
        }
    }

    /// Steps of 50 us from rest at zero to `end_us`.
    fn moved(latency: Span, end_us: i64) -> Latch {
        let mut latch = Latch::new(latency, Span::us(50));
        for us in (50..=end_us).step_by(50) {
            latch.feed(knot(us as f64 * 1e-6));
        }
        latch
    }

    #[test]
    fn latency_shows_where_the_axis_was() {
        let mut latch = Latch::new(Span::us(125), Span::us(500));
        latch.feed(knot(0.0));
        latch.feed(knot(500e-6));
        let off = latch.position(Span::ZERO) - knot(375e-6).position;
        assert!(off.abs() < Position::um(1e-9), "off by {} um", off.as_um());
    }

    #[test]
    fn a_sync_between_two_steps_is_met_on_either_side_of_the_last() {
        let latch = moved(Span::us(120), 4_000);
        assert_eq!(moved(Span::ZERO, 4_000).position(Span::ZERO), knot(4e-3).position);
        for after_us in [-1_500, -130, -7, 0, 33, 120] {
            let off = latch.position(Span::us(after_us)) - knot((3_880 + after_us) as f64 * 1e-6).position;
            assert!(off.abs() < Position::um(1e-6), "off by {} um at {after_us} us", off.as_um());
        }
        // Past the last step an acceleration of 6 m/s^2 is left out for 40 us: 4.8 nm.
        let off = latch.position(Span::us(160)) - knot(4_040e-6).position;
        assert!((off.as_um() + 0.0048).abs() < 1e-6, "off by {} um past the last step", off.as_um());
    }

    #[test]
    fn nothing_older_than_what_is_kept_is_made_up() {
        for latency_us in [0, 2_500] {
            let latch = moved(Span::us(latency_us), 10_000);
            let oldest_us = 10_000 - latency_us - 50 * (LATE_STEPS as i64 + 1);
            let oldest = latch.position(Span::us(-9_000));
            let off = oldest - knot(oldest_us as f64 * 1e-6).position;
            assert!(off.abs() < Position::um(1e-6), "{} um from the oldest step", off.as_um());
            assert_eq!(latch.position(Span::us(-9_500)), oldest);
        }
    }
}
