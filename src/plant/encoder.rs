//! Where an axis was when its encoder latched: the SYNC asks for a position that is a little older.
//!
//! The position inside the last tick is the cubic through position and velocity at both its ends
//! (error of the fourth order in the tick). Counts and their scale are the wire's (`rt/wire/scaling`).
//! A tick is fed whether or not a SYNC ends it: one that skips ticks still asks about the last of them.
//! Invariant: without latency the position passes through untouched.

use crate::base::time::Span;
use crate::base::units::{Position, Velocity};

/// Position and velocity at one end of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knot {
    /// Where.
    pub position: Position,
    /// How fast.
    pub velocity: Velocity,
}

/// A latch that has seen the last tick.
#[derive(Clone, Copy, Debug)]
pub struct Latch {
    /// Latency as a part of the tick, 0 to 1.
    age: f64,
    tick_s: f64,
    /// Both ends of the last tick.
    from: Knot,
    to: Knot,
}

impl Latch {
    /// The latch of an axis that stands at zero.
    ///
    /// # Panics
    /// When the latency is longer than the tick (checked by `config`).
    pub fn new(latency: Span, tick: Span) -> Self {
        assert!(latency <= tick, "encoder latency above one tick");
        let rest = Knot { position: Position::ZERO, velocity: Velocity::ZERO };
        Self { age: latency.as_s() / tick.as_s(), tick_s: tick.as_s(), from: rest, to: rest }
    }

    /// Another tick is over; `now` is the state at its end.
    pub fn feed(&mut self, now: Knot) {
        self.from = std::mem::replace(&mut self.to, now);
    }

    /// The position latched for a SYNC at the end of the last tick.
    pub fn position(&self) -> Position {
        if self.age == 0.0 { self.to.position } else { self.between() }
    }

    fn between(&self) -> Position {
        let Self { from, to, .. } = self;
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

    #[test]
    fn latency_shows_where_the_axis_was() {
        let knot = |t_s: f64| Knot {
            position: Position::m(0.02 * t_s + 3.0 * t_s * t_s),
            velocity: Velocity::m_per_s(0.02 + 6.0 * t_s),
        };
        let mut latch = Latch::new(Span::us(125), Span::us(500));
        latch.feed(knot(0.0));
        latch.feed(knot(500e-6));
        let off = latch.position() - knot(375e-6).position;
        assert!(off.abs() < Position::um(1e-9), "off by {} um", off.as_um());
    }
}
