//! How close a loop is to swinging: figures of an open loop, from its frequency response alone.
//!
//! ```text
//!   crossover        |L| = 1          phase margin   180 deg + arg L there
//!   gain margin      1 / |L| where arg L = -180 deg
//!   sensitivity      Ms = max |1 / (1 + L)|
//!   bandwidth        first |L / (1 + L)| = 1 / sqrt 2
//! ```
//!
//! Crossings are bracketed on a dense logarithmic grid up to half the sampling rate and refined by
//! bisection. A loop with several crossings (a resonance) is judged by its worst.
//! Used by [`super::loops`]. Invariant: knows nothing of axes; pure functions of `L(jω)`.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use nalgebra::Complex;
use serde::Serialize;

/// Lowest frequency looked at, Hz.
const LOWEST_HZ: f64 = 0.01;
/// Grid points in a decade of frequency.
const POINTS_PER_DECADE: f64 = 400.0;
/// Halvings of a bracket: from a grid step to the last digit of an f64.
const BISECTIONS: usize = 50;
/// A resonance is looked at from a quarter of its frequency away down to 2^-24 of it, so that even a
/// peak without damping is not stepped over.
const CLOSEST_OCTAVE: i32 = 24;

/// Figures of a loop. `None` where there is no such crossing below half the sampling rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Margins {
    /// Crossover with the smallest phase margin, Hz.
    pub crossover_hz: Option<f64>,
    /// Smallest phase margin, degrees; negative in an unstable loop.
    pub phase_margin_deg: Option<f64>,
    /// Smallest gain margin, dB; negative in an unstable loop.
    pub gain_margin_db: Option<f64>,
    /// Largest amplification of a disturbance, `Ms`.
    pub sensitivity_max: f64,
    /// First frequency at which the closed loop has lost 3 dB, Hz.
    pub bandwidth_hz: Option<f64>,
}

impl Margins {
    /// Margins of the open loop `L(jω)`, ω in rad/s, sampled at `rate_hz`, with a resonance at
    /// `resonance_hz`.
    pub fn of(open: impl Fn(f64) -> Complex<f64>, rate_hz: f64, resonance_hz: f64) -> Self {
        let grid = grid(rate_hz, resonance_hz);
        let responses: Vec<Complex<f64>> = grid.iter().map(|&omega| open(omega)).collect();
        Self::on(&grid, &responses, open)
    }

    /// The same of responses that are known on a [`grid`].
    pub fn on(grid: &[f64], responses: &[Complex<f64>], open: impl Fn(f64) -> Complex<f64>) -> Self {
        let crossings = |value: fn(Complex<f64>) -> f64| crossings(grid, responses, &open, value);
        let crossovers = crossings(|response| response.norm() - 1.0);
        let phase_margin_deg = |omega: f64| (-open(omega)).arg().to_degrees();
        let worst =
            crossovers.into_iter().min_by(|a, b| phase_margin_deg(*a).total_cmp(&phase_margin_deg(*b)));
        let gain_margin_db = crossings(|response| response.im)
            .into_iter()
            .map(&open)
            .filter(|response| response.re < 0.0)
            .map(|response| -20.0 * response.norm().log10())
            .min_by(f64::total_cmp);
        let sensitivity =
            |response: &Complex<f64>| (Complex::new(1.0, 0.0) / (response + Complex::new(1.0, 0.0))).norm();
        let bandwidth =
            crossings(|response| (response / (response + Complex::new(1.0, 0.0))).norm() - FRAC_1_SQRT_2);
        Self {
            crossover_hz: worst.map(|omega| omega / TAU),
            phase_margin_deg: worst.map(phase_margin_deg),
            gain_margin_db,
            sensitivity_max: responses.iter().map(sensitivity).fold(1.0, f64::max),
            bandwidth_hz: bandwidth.first().map(|omega| omega / TAU),
        }
    }

    /// Whether no crossing speaks against stability: it is inside the unit circle at -180 deg, and
    /// there is a crossover with phase left.
    pub fn is_stable(&self) -> bool {
        self.phase_margin_deg.is_some_and(|margin| margin > 0.0)
            && self.gain_margin_db.is_none_or(|margin| margin > 0.0)
    }
}

/// Angular frequencies to look at in a loop that is sampled at `rate_hz` and has a resonance, rad/s, rising.
pub fn grid(rate_hz: f64, resonance_hz: f64) -> Vec<f64> {
    let highest_hz = 0.5 * rate_hz;
    let points = ((highest_hz / LOWEST_HZ).log10() * POINTS_PER_DECADE).ceil().max(1.0);
    let even = (0..=points as usize).map(|n| LOWEST_HZ * (highest_hz / LOWEST_HZ).powf(n as f64 / points));
    let around = (2..=CLOSEST_OCTAVE).flat_map(|octave| {
        let away = 0.5_f64.powi(octave);
        [resonance_hz * (1.0 - away), resonance_hz * (1.0 + away)]
    });
    let mut grid: Vec<f64> = even.chain(around).filter(|hz| *hz <= highest_hz).map(|hz| TAU * hz).collect();
    grid.sort_by(f64::total_cmp);
    grid
}

/// Where a function of the response changes its sign, rising; `responses` are those on the grid.
fn crossings(
    grid: &[f64],
    responses: &[Complex<f64>],
    open: impl Fn(f64) -> Complex<f64>,
    value: impl Fn(Complex<f64>) -> f64,
) -> Vec<f64> {
    let is_above: Vec<bool> = responses.iter().map(|&response| value(response) > 0.0).collect();
    grid.windows(2)
        .zip(is_above.windows(2))
        .filter(|(_, sides)| sides[0] != sides[1])
        .map(|(bracket, sides)| {
            let (mut low, mut high) = (bracket[0], bracket[1]);
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (low + high);
                if (value(open(middle)) > 0.0) == sides[0] { low = middle } else { high = middle }
            }
            0.5 * (low + high)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn s(omega: f64) -> Complex<f64> {
        Complex::new(0.0, omega)
    }
    fn near(got: Option<f64>, known: f64, bound: f64, what: &str) {
        let got = got.unwrap_or(f64::NAN);
        assert!((got - known).abs() <= bound, "{what} is {got}, known is {known} within {bound}");
    }

    #[test]
    fn an_integrator_behind_a_delay_has_the_margins_of_the_textbook() {
        // L = k/s exp(-s T): crossover k, phase margin 90 deg - k T, gain margin pi / (2 k T).
        let (k, delay_s) = (TAU * 20.0, 2e-3);
        let open =
            |omega: f64| Complex::from_polar(k / omega, -std::f64::consts::FRAC_PI_2 - delay_s * omega);
        let margins = Margins::of(open, 2000.0, 500.0);
        near(margins.crossover_hz, 20.0, 1e-9, "crossover in Hz");
        near(margins.phase_margin_deg, 90.0 - (k * delay_s).to_degrees(), 1e-9, "phase margin in deg");
        let gain_margin_db = 20.0 * (std::f64::consts::PI / (2.0 * k * delay_s)).log10();
        near(margins.gain_margin_db, gain_margin_db, 1e-9, "gain margin in dB");
        assert!(margins.is_stable());
    }

    #[test]
    fn a_second_order_loop_has_its_closed_form() {
        // L = 1 / (s (s + 2 z)), z = 1/2: Ms and bandwidth of the standard second-order system.
        let margins = Margins::of(|omega| (s(omega) * (s(omega) + 1.0)).inv(), 100.0, 30.0);
        near(margins.bandwidth_hz, ((0.5 + 1.25_f64.sqrt()).sqrt()) / TAU, 1e-9, "bandwidth in Hz");
        near(margins.phase_margin_deg, 51.827_292_372_987_97, 1e-9, "phase margin in deg");
        assert_eq!(margins.gain_margin_db, None, "its phase never reaches -180 deg");
        // |S|^2 = x (x + 1) / (x^2 - x + 1), x = ω^2, is largest at x = (1 + sqrt 3) / 2.
        let x = 0.5 * (1.0 + 3.0_f64.sqrt());
        let known = (x * (x + 1.0) / (x * x - x + 1.0)).sqrt();
        near(Some(margins.sensitivity_max), known, 1e-5, "Ms");
    }

    #[test]
    fn a_narrow_resonance_above_the_crossover_is_the_worst_crossing() {
        // A lag of k/s whose resonance at 100 Hz is damped by 1e-6: its peak is far above one.
        let resonance = TAU * 100.0;
        let open = |omega: f64| {
            let peak = s(omega) * s(omega) / (resonance * resonance) + s(omega) * (2e-6 / resonance) + 1.0;
            Complex::new(TAU * 5.0, 0.0) / (s(omega) * peak)
        };
        let margins = Margins::of(open, 2000.0, 100.0);
        assert!(!margins.is_stable(), "{margins:?}");
        near(margins.crossover_hz, 100.0, 5.0, "worst crossover in Hz");
        // At the resonance the loop is k / (ω 2 z) and turned by -180 deg.
        near(margins.gain_margin_db, -20.0 * (5.0 / 100.0 / 2e-6_f64).log10(), 0.01, "gain margin in dB");
    }

    #[test]
    fn a_loop_without_gain_has_no_crossover() {
        let margins = Margins::of(|_| Complex::new(0.0, 0.0), 2000.0, 100.0);
        assert_eq!((margins.crossover_hz, margins.gain_margin_db), (None, None));
        assert!(!margins.is_stable(), "it holds nothing");
    }
}
