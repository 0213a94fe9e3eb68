//! What swings along a way or with time, with its divisions done.
//!
//! ```text
//!   A sin(2π x / p + φ)
//! ```
//!
//! Invariant: no formula of an effect; each says of what it is a swing, and along what.

use std::f64::consts::TAU;

use super::hooks::{Pace, Reading};

/// A swing, in the unit of its amplitude.
#[derive(Debug)]
pub(super) struct Swing {
    amplitude: f64,
    turns_per_unit: f64,
    phase_turns: f64,
}

impl Swing {
    /// That comes again after a period, m or s, of a phase in degrees at zero.
    pub(super) fn new(amplitude: f64, period: f64, phase_deg: f64) -> Self {
        Self { amplitude, turns_per_unit: period.recip(), phase_turns: phase_deg / 360.0 }
    }

    /// At a place or a time.
    pub(super) fn at(&self, along: f64) -> f64 {
        self.amplitude * sine_of_turns(along * self.turns_per_unit + self.phase_turns)
    }

    /// How fast it changes at a speed, as a force; of what swings with time, at 1.
    pub(super) fn pace(&self, speed: f64) -> Pace {
        Pace::of_force(self.turns_per_unit * speed.abs())
    }
}

/// Terms of the sine of up to a quarter of a turn by its Taylor series: what they leave is less than 6e-8.
const TERMS: [f64; 6] = {
    let mut terms = [TAU; 6];
    let mut order = 1;
    while order < 6 {
        let over = (2 * order * (2 * order + 1)) as f64;
        terms[order] = -terms[order - 1] * TAU * TAU / over;
        order += 1;
    }
    terms
};

/// Sine of an angle in turns, off by less than 1e-7: that of a library, right to the last bit, is a quarter of what the steps of an axis
/// take that swings.
#[inline]
fn sine_of_turns(turns: f64) -> f64 {
    // Added to it, a number loses what is behind its point.
    const NEAREST: f64 = 1.5 * (1_u64 << 52) as f64;
    let within = turns - ((turns + NEAREST) - NEAREST);
    let quarter = (0.25 - (within.abs() - 0.25).abs()).copysign(within);
    let square = quarter * quarter;
    let [first, third, fifth, seventh, ninth, eleventh] = TERMS;
    let fourth = square * square;
    let sum = (first + third * square)
        + fourth * ((fifth + seventh * square) + fourth * (ninth + eleventh * square));
    quarter * sum
}

/// Of a sensor, m.
impl Reading for Swing {
    fn error_m(&self, place_m: f64, _time_s: f64) -> f64 {
        self.at(place_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_a_sine_at_any_angle() {
        for step in -40_000..40_000 {
            for turns in [f64::from(step) * 1.3e-4, f64::from(step) * 23.7 + 0.1] {
                let asked = libm::sin(TAU * turns.fract());
                let found = sine_of_turns(turns);
                assert!((found - asked).abs() < 1e-7, "{found} at {turns} turns, not {asked}");
            }
        }
        for (turns, asked) in [(0.0, 0.0), (0.5, 0.0), (-1.0, 0.0), (0.25, 1.0), (-0.25, -1.0), (17.25, 1.0)]
        {
            assert!((sine_of_turns(turns) - asked).abs() < 1e-7, "at {turns} turns");
        }
    }
}
