//! Velocity of the motor from its positions: what the velocity loop sees. `x0` is the newest
//! position, `x1` and `x2` the ones before it, `T` the period.
//!
//! | estimate | formula | delay | noise gain |
//! |---|---|---|---|
//! | [`Difference`](VelocityEstimate::Difference) | `(x0 - x1) / T` | `T / 2` | `√2 / T` = 1.41 / T |
//! | [`SecondOrder`](VelocityEstimate::SecondOrder) | `(3 x0 - 4 x1 + x2) / (2 T)` | none to second order | `√26 / (2 T)` = 2.55 / T |
//! | [`Mean`](VelocityEstimate::Mean) | `(x0 - x2) / (2 T)` | `T` | `1 / (√2 T)` = 0.71 / T |
//!
//! The delay is that of the answer to a slow motion: a steady acceleration `a` leaves the first
//! behind by `a T / 2`, the last by `a T`, and the second not at all; its error is `T²/3` times the jerk. Noise gain is
//! the rms of the velocity per rms of white position noise; one count of quantisation in a
//! position shows as up to `1/T` and `2/T` counts per second.
//!
//! After a gap of `n` periods, or when a SYNC was late, the same formulas run on uneven spacing, so a
//! steady motion shows no jump.
//! Invariant: a steady velocity is estimated exactly, over every gap.

use nalgebra::Complex;

use crate::base::time::Span;
use crate::base::units::{Position, Velocity};

/// How velocity comes from positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum VelocityEstimate {
    /// Backward difference of two positions: half a period late, least noise.
    #[default]
    Difference,
    /// Second order backward difference of three positions: no delay to second order, more noise.
    SecondOrder,
    /// Mean of the last two differences: a period late, half the noise of one.
    Mean,
}

impl VelocityEstimate {
    /// Each with its name in machine files.
    pub const NAMED: [(&str, Self); 3] =
        [("difference", Self::Difference), ("second-order", Self::SecondOrder), ("mean", Self::Mean)];

    /// Its name in machine files.
    pub fn name(self) -> &'static str {
        Self::NAMED.iter().find(|(_, estimate)| *estimate == self).map_or("", |(name, _)| name)
    }

    /// Frequency response from the true velocity to the estimate. For loop margins
    /// (`offline/margins`).
    pub fn response(self, period: Span, omega_rad_per_s: f64) -> Complex<f64> {
        let turn_rad = omega_rad_per_s * period.as_s();
        let back = |periods: f64| Complex::from_polar(1.0, -periods * turn_rad);
        let step = match self {
            Self::Difference => -back(1.0) + 1.0,
            Self::SecondOrder => (back(2.0) - back(1.0) * 4.0 + 3.0) * 0.5,
            Self::Mean => (-back(2.0) + 1.0) * 0.5,
        };
        // Per true velocity: the position is its integral, 1/s.
        step / Complex::new(0.0, turn_rad)
    }
}

/// Estimates the velocity of one axis.
#[derive(Clone, Copy, Debug)]
pub struct VelocityEstimator {
    estimate: VelocityEstimate,
    period_s: f64,
    rate_hz: f64,
    last_m: Option<f64>,
    /// The step before the last position: its velocity, and how long it was. `None` before there
    /// are two positions.
    last_step: Option<(f64, f64)>,
    /// The last estimate.
    velocity: Velocity,
    /// Time since the last position that was used.
    held_s: f64,
}

impl VelocityEstimator {
    /// For positions that are one `period` apart.
    pub fn new(estimate: VelocityEstimate, period: Span) -> Self {
        let period_s = period.as_s();
        Self {
            estimate,
            period_s,
            rate_hz: period_s.recip(),
            last_m: None,
            last_step: None,
            velocity: Velocity::ZERO,
            held_s: 0.0,
        }
    }
    /// Forgets the positions: the next one starts at zero velocity.
    pub const fn reset(&mut self) {
        self.last_m = None;
        self.last_step = None;
        self.velocity = Velocity::ZERO;
        self.held_s = 0.0;
    }

    /// The velocity at `position`, measured `periods` periods after the position before it.
    pub fn advance(&mut self, position: Position, periods: u32) -> Velocity {
        // The usual period costs no division.
        match periods {
            _ if self.held_s > 0.0 => {
                let step_s = self.held_s + self.period_s * f64::from(periods);
                self.step(position, step_s, step_s.recip())
            }
            0 | 1 => self.step(position, self.period_s, self.rate_hz),
            gap => self.step(position, self.period_s * f64::from(gap), self.rate_hz / f64::from(gap)),
        }
    }

    /// The velocity at `position`, measured `span` after the position before it. Positions closer than half a
    /// period say nothing new: their noise would pass for speed.
    pub fn advance_by(&mut self, position: Position, span: Span) -> Velocity {
        let step_s = self.held_s + span.as_s();
        if step_s < 0.5 * self.period_s {
            self.held_s = step_s;
            return self.velocity;
        }
        self.step(position, step_s, step_s.recip())
    }

    fn step(&mut self, position: Position, step_s: f64, step_rate_hz: f64) -> Velocity {
        let position_m = position.as_m();
        self.held_s = 0.0;
        let Some(last_m) = self.last_m.replace(position_m) else {
            return Velocity::ZERO;
        };
        let step_m_per_s = (position_m - last_m) * step_rate_hz;
        let earlier = self.last_step.replace((step_m_per_s, step_s));
        self.velocity = Velocity::m_per_s(match (self.estimate, earlier) {
            (VelocityEstimate::Difference, _) | (_, None) => step_m_per_s,
            (VelocityEstimate::SecondOrder, Some((earlier_m_per_s, earlier_s))) => {
                // Slope at the newest point of the parabola through three; with even steps this is
                // (3 x0 - 4 x1 + x2) / (2 T).
                let weight = if step_s == earlier_s { 0.5 } else { step_s / (step_s + earlier_s) };
                step_m_per_s + weight * (step_m_per_s - earlier_m_per_s)
            }
            (VelocityEstimate::Mean, Some((earlier_m_per_s, earlier_s))) => {
                (step_m_per_s * step_s + earlier_m_per_s * earlier_s) / (step_s + earlier_s)
            }
        });
        self.velocity
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 0.5e-3;
    const ALL: [VelocityEstimate; 3] =
        [VelocityEstimate::Difference, VelocityEstimate::SecondOrder, VelocityEstimate::Mean];

    fn estimator(estimate: VelocityEstimate) -> VelocityEstimator {
        VelocityEstimator::new(estimate, Span::s(PERIOD_S))
    }

    /// Estimate minus truth at the last of `periods`, moving as `x(t)` with velocity `v(t)`.
    fn error_m_per_s(
        estimate: VelocityEstimate,
        gaps: &[u32],
        x: impl Fn(f64) -> f64,
        v: impl Fn(f64) -> f64,
    ) -> f64 {
        let (mut estimator, mut t, mut got) = (estimator(estimate), 0.0, Velocity::ZERO);
        estimator.advance(Position::m(x(0.0)), 1);
        for &gap in gaps {
            t += f64::from(gap) * PERIOD_S;
            got = estimator.advance(Position::m(x(t)), gap);
        }
        got.as_m_per_s() - v(t)
    }

    #[test]
    fn a_steady_motion_is_exact_over_every_gap() {
        for estimate in ALL {
            for gaps in [&[1, 1, 1][..], &[1, 5, 1, 1], &[3, 2], &[40]] {
                let error = error_m_per_s(estimate, gaps, |t| 0.2 * t, |_| 0.2);
                assert!(error.abs() < 1e-12, "{estimate:?} over {gaps:?}: {error} m/s off, bound 1e-12 m/s");
            }
        }
    }

    #[test]
    fn a_steady_motion_is_exact_at_uneven_times_and_close_ones_are_skipped() {
        for estimate in ALL {
            let (mut estimator, mut t_us) = (estimator(estimate), 0);
            estimator.advance(Position::ZERO, 1);
            for (number, span_us) in [530, 470, 20, 980, 100, 200, 300, 500, 999].into_iter().enumerate() {
                t_us += span_us;
                let position = Position::m(0.2e-6 * t_us as f64);
                let got = estimator.advance_by(position, Span::us(span_us)).as_m_per_s();
                assert!((got - 0.2).abs() < 1e-12, "{estimate:?}, step {number}: {got} m/s, is 0.2 m/s");
            }
            estimator.advance_by(Position::m(0.2e-6 * (t_us + 100) as f64), Span::us(100));
            let got = estimator.advance(Position::m(0.2e-6 * (t_us + 600) as f64), 1).as_m_per_s();
            assert!((got - 0.2).abs() < 1e-12, "{estimate:?}, back on the grid: {got} m/s, is 0.2 m/s");
        }
    }

    #[test]
    fn an_acceleration_shows_the_delay_of_each() {
        let accelerated =
            |estimate, gaps: &[u32]| error_m_per_s(estimate, gaps, |t| 1.5 * t * t, |t| 3.0 * t);
        let half_a_period = accelerated(VelocityEstimate::Difference, &[1; 9]);
        assert!((half_a_period + 3.0 * PERIOD_S / 2.0).abs() < 1e-12, "{half_a_period} m/s");
        let period = accelerated(VelocityEstimate::Mean, &[1; 9]);
        assert!((period + 3.0 * PERIOD_S).abs() < 1e-12, "{period} m/s");
        for gaps in [&[1; 9][..], &[1, 1, 4, 1], &[2, 7]] {
            let none = accelerated(VelocityEstimate::SecondOrder, gaps);
            assert!(none.abs() < 1e-12, "over {gaps:?}: {none} m/s off, bound 1e-12 m/s");
        }
    }

    #[test]
    fn noise_gains_are_as_stated() {
        for (estimate, gain) in ALL.into_iter().zip([2.0_f64.sqrt(), 26.0_f64.sqrt() / 2.0]) {
            // The gain to white noise is the norm of the answer to a single displaced position.
            let mut estimator = estimator(estimate);
            let answer = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
                .map(|x_m| estimator.advance(Position::m(x_m), 1).as_m_per_s() * PERIOD_S);
            let norm = answer.iter().map(|part| part * part).sum::<f64>().sqrt();
            assert!((norm - gain).abs() < 1e-12, "{estimate:?}: {norm} / T, expected {gain} / T");
        }
    }

    #[test]
    fn the_response_is_that_of_the_running_estimator() {
        for estimate in ALL {
            for periods_per_turn in [8_u32, 40, 400] {
                let omega = std::f64::consts::TAU / (f64::from(periods_per_turn) * PERIOD_S);
                let at = |tick: u32| Complex::from_polar(1.0, omega * PERIOD_S * f64::from(tick));
                let (mut estimator, mut sum) = (estimator(estimate), Complex::new(0.0, 0.0));
                for tick in 0..2 * periods_per_turn {
                    let velocity = estimator.advance(Position::m(at(tick).re), 1);
                    if tick >= periods_per_turn {
                        sum += at(tick).conj() * velocity.as_m_per_s() * 2.0 / f64::from(periods_per_turn);
                    }
                }
                // The true velocity of `exp(s t)` is `s` times it.
                let measured = sum / Complex::new(0.0, omega);
                let stated = estimate.response(Span::s(PERIOD_S), omega);
                assert!(
                    (stated - measured).norm() < 1e-9,
                    "{estimate:?}: {stated} stated, {measured} measured"
                );
            }
        }
    }

    #[test]
    fn a_reset_forgets() {
        for estimate in ALL {
            let mut estimator = estimator(estimate);
            estimator.advance(Position::m(0.0), 1);
            estimator.advance(Position::m(1.0), 1);
            estimator.reset();
            assert_eq!(estimator.advance(Position::m(5.0), 1), Velocity::ZERO);
            assert_eq!(estimator.advance(Position::m(5.0), 1), Velocity::ZERO);
        }
    }
}
