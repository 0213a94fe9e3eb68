//! From a position to the counts of an encoder: resolution, offset, wrap-around, latency.
//!
//! The latch is `latency` older than the SYNC that asks for it; the position in between is the cubic
//! through position and velocity at both ends of the last tick (error of the fourth order in the tick).
//! Invariant: the count is the floor of position / resolution, so it never rattles at rest.

use crate::base::time::Span;
use crate::base::units::{Position, Velocity};

/// One encoder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Counts per metre of travel.
    pub counts_per_m: f64,
    /// Age of the latched position at the SYNC; at most one tick.
    pub latency: Span,
}

/// Position and velocity at one end of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knot {
    /// Where.
    pub position: Position,
    /// How fast.
    pub velocity: Velocity,
}

/// An encoder that has seen the last tick.
#[derive(Clone, Copy, Debug)]
pub struct Encoder {
    counts_per_m: f64,
    /// Latency as a part of the tick, 0 to 1.
    age: f64,
    tick_s: f64,
    offset: u32,
    previous: Knot,
}

impl Encoder {
    /// An encoder that shows `offset` counts at position zero.
    ///
    /// # Panics
    /// When the latency is longer than the tick (checked by `config`).
    pub fn new(parameters: Parameters, tick: Span, offset: u32) -> Self {
        assert!(parameters.latency <= tick, "encoder latency above one tick");
        Self {
            counts_per_m: parameters.counts_per_m,
            age: parameters.latency.as_s() / tick.as_s(),
            tick_s: tick.as_s(),
            offset,
            previous: Knot { position: Position::ZERO, velocity: Velocity::ZERO },
        }
    }

    /// Counts latched for the SYNC at the end of a tick, `now` being the state at that instant.
    pub fn latch(&mut self, now: Knot) -> u32 {
        let from = std::mem::replace(&mut self.previous, now);
        let position = if self.age == 0.0 { now.position } else { self.between(from, now) };
        // Wraps like the counter: through i64, whose low 32 bits are the count.
        let counts = (position.as_m() * self.counts_per_m).floor() as i64;
        self.offset.wrapping_add(counts as u32)
    }

    fn between(&self, from: Knot, to: Knot) -> Position {
        let s = 1.0 - self.age;
        let (s2, s3) = (s * s, s * s * s);
        let travel = to.position - from.position;
        from.position
            + travel * (3.0 * s2 - 2.0 * s3)
            + Position::m(from.velocity.as_m_per_s() * self.tick_s) * (s3 - 2.0 * s2 + s)
            + Position::m(to.velocity.as_m_per_s() * self.tick_s) * (s3 - s2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: Span = Span::us(500);

    fn knot(t_s: f64) -> Knot {
        Knot {
            position: Position::m(0.02 * t_s + 3.0 * t_s * t_s),
            velocity: Velocity::m_per_s(0.02 + 6.0 * t_s),
        }
    }

    #[test]
    fn counts_wrap_and_go_on() {
        let parameters = Parameters { counts_per_m: 1e8, latency: Span::ZERO };
        let mut encoder = Encoder::new(parameters, TICK, u32::MAX);
        let counts = encoder.latch(Knot { position: Position::um(1.005), velocity: Velocity::ZERO });
        assert_eq!(counts, 99);
        let counts = encoder.latch(Knot { position: Position::um(-0.005), velocity: Velocity::ZERO });
        assert_eq!(counts, u32::MAX - 1, "half a count below zero is the count below");
    }

    #[test]
    fn latency_shows_where_the_axis_was() {
        let parameters = Parameters { counts_per_m: 1e12, latency: Span::us(125) };
        let mut encoder = Encoder::new(parameters, TICK, 0);
        encoder.latch(knot(0.0));
        let counts = encoder.latch(knot(500e-6));
        let expected = knot(375e-6).position.as_m() * 1e12;
        assert!((f64::from(counts) - expected).abs() <= 1.0, "{counts} counts, expected {expected}");
    }
}
