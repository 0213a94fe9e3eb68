//! How sharply the positions of an axis bend: the least acceleration with which three fresh samples in a row
//! are a motion. Every sample passes here; `rt/control` knows which acceleration no motor has.
//!
//! ```text
//!   v  =  (x1 - x0) / s                        speed before, over the time s
//!   d  =  x2 - x1 - v h                        off the straight line, h after x1
//!   a  =  (|d| - doubt) / (h (s + h) / 2)      no weaker acceleration reaches so far
//!   doubt  =  (r + |v| t) (1 + h / s)          r: resolution of a position; t: of the time it was latched at
//! ```
//!
//! The times are those of the board's clock, so neither a late SYNC nor a lost sample is a bend.
//! Invariant: whatever the times are, a motion that stays below an acceleration shows no greater one.

use crate::base::units::{Acceleration, Position, Velocity};

/// The board tells its time in whole microseconds: a latch is up to one from what it says.
const LATCH_S: f64 = 1e-6;

/// How far a position may be from where the axis was at the time that comes with it.
pub fn doubt(resolution: Position, speed: Velocity) -> Position {
    resolution + Position::m(speed.as_m_per_s().abs() * LATCH_S)
}

/// The last positions of an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bend {
    resolution: Position,
    last_m: Option<f64>,
    /// From the position before the last to the last: speed and time.
    last_step: Option<(f64, f64)>,
}

impl Bend {
    /// Of positions with this resolution.
    pub(super) const fn new(resolution: Position) -> Self {
        Self { resolution, last_m: None, last_step: None }
    }

    /// The time to the next position is not known: begin anew.
    pub(super) const fn reset(&mut self) {
        self.last_m = None;
        self.last_step = None;
    }

    /// The least acceleration that leads from the positions before to this one, `since_s` after the last.
    pub(super) fn advance(&mut self, position: Position, since_s: f64) -> Acceleration {
        let now_m = position.as_m();
        let Some(last_m) = self.last_m.replace(now_m) else { return Acceleration::ZERO };
        let speed_m_per_s = (now_m - last_m) / since_s;
        let Some((before_m_per_s, before_s)) = self.last_step.replace((speed_m_per_s, since_s)) else {
            return Acceleration::ZERO;
        };
        let off_m = ((speed_m_per_s - before_m_per_s) * since_s).abs();
        let fastest_m_per_s = speed_m_per_s.abs().max(before_m_per_s.abs());
        let doubt = doubt(self.resolution, Velocity::m_per_s(fastest_m_per_s)) * (1.0 + since_s / before_s);
        let reach_s2 = 0.5 * since_s * (before_s + since_s);
        Acceleration::m_per_s2((off_m - doubt.as_m()).max(0.0) / reach_s2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RESOLUTION_M: f64 = 1e-6;

    fn least_m_per_s2(x: impl Fn(f64) -> f64, spans_us: &[u32]) -> f64 {
        let mut bend = Bend::new(Position::m(RESOLUTION_M));
        let mut now_us = 0;
        bend.advance(Position::m(x(0.0)), 500e-6);
        let seen = spans_us.iter().map(|span_us| {
            now_us += span_us;
            bend.advance(Position::m(x(f64::from(now_us) * 1e-6)), f64::from(*span_us) * 1e-6).as_m_per_s2()
        });
        seen.fold(0.0, f64::max)
    }

    const SPANS_US: [&[u32]; 4] =
        [&[500; 9], &[500, 1_500, 500, 500], &[530, 470, 20, 980, 500], &[3_000, 100, 400, 500]];

    #[test]
    fn no_motion_shows_more_than_its_acceleration() {
        for spans_us in SPANS_US {
            // Resolution and whole microseconds are part of it: counts at or below, times too.
            let counted = |x_m: f64| (x_m / RESOLUTION_M).floor() * RESOLUTION_M;
            for a in [0.0, 3.0, -12.0] {
                let least = least_m_per_s2(|t| counted(0.2 * t + 0.5 * a * (t + 0.7e-6).powi(2)), spans_us);
                assert!(least <= a.abs(), "{least} m/s^2 seen, {a} m/s^2 made, over {spans_us:?} us");
            }
            let to_and_fro = |t: f64| 0.1 * t + 2e-6 * (500.0 * t).sin();
            let least = least_m_per_s2(|t| counted(to_and_fro(t)), spans_us);
            assert!(least <= 0.5, "{least} m/s^2 seen, 0.5 m/s^2 made, over {spans_us:?} us");
        }
    }

    #[test]
    fn a_jump_shows_what_acceleration_it_would_take() {
        for spans_us in SPANS_US {
            let whole_us: u32 = spans_us.iter().sum();
            let at_s = f64::from(whole_us) * 1e-6;
            let jumping = |t: f64| if t < at_s { 0.1 * t } else { 0.1 * t + 50e-6 };
            let (h, s) = (spans_us[spans_us.len() - 1], spans_us[spans_us.len() - 2]);
            let (h_s, s_s) = (f64::from(h) * 1e-6, f64::from(s) * 1e-6);
            let doubt_m = (RESOLUTION_M + (0.1 + 50e-6 / h_s) * LATCH_S) * (1.0 + h_s / s_s);
            let wanted = (50e-6 - doubt_m) / (0.5 * h_s * (h_s + s_s));
            let least = least_m_per_s2(jumping, spans_us);
            assert!((least - wanted).abs() < 1e-6 * wanted, "{least} m/s^2, wanted {wanted} m/s^2");
        }
    }

    #[test]
    fn a_reset_forgets() {
        let mut bend = Bend::new(Position::m(RESOLUTION_M));
        for place_mm in [0.0, 0.01, 0.02] {
            assert_eq!(bend.advance(Position::mm(place_mm), 500e-6), Acceleration::ZERO);
        }
        bend.reset();
        for place_mm in [7.0, 8.0] {
            assert_eq!(bend.advance(Position::mm(place_mm), 500e-6), Acceleration::ZERO);
        }
        assert!(bend.advance(Position::mm(8.0), 500e-6) > Acceleration::m_per_s2(3_000.0));
    }
}
