//! Frequencies at which what is left of the current has its peaks: in time, in Hz, and along the screw, per turn.
//!
//! Along the screw the rows are summed up by where the motor was, whichever way it went; so what depends on the angle
//! alone is summed and the rest is not. Both spectra go through the Fourier transform of evenly spaced sums, filled up
//! with zeros, so that a peak is found between the lines as well.
//! Invariant: a peak is far above its neighbourhood, or it is none.

use nalgebra::Complex;
use rustfft::FftPlanner;

use super::forward::Signals;
use super::model::Model;
use super::problem::{Part, Problem, SIGNALS};

/// Peaks that are tried.
const PEAKS: usize = 3;
/// Least ratio of a peak to the median of the lines about it.
const ABOVE: f64 = 12.0;
/// Lines on either side that are its neighbourhood, as a share of its frequency, and at least so many.
const ABOUT: (f64, usize) = (0.3, 40);
/// Frequencies that are looked at, Hz and per turn.
const HZ: [f64; 2] = [2.0, 400.0];
const PER_TURN: [f64; 2] = [0.6, 60.0];
/// Sums per turn.
const BINS_PER_TURN: f64 = 256.0;

/// What a model leaves of the current of all runs, in time and along the screw, looked through once.
#[derive(Debug)]
pub struct Peaks {
    hz: Vec<f64>,
    per_turn: Vec<f64>,
}

impl Peaks {
    /// Of a model.
    pub fn new(problem: &Problem<'_>, model: &Model) -> Self {
        let lead_m = model.nominal.mechanics.lead_m;
        let (mut in_time, mut by_place) = (Vec::new(), Vec::new());
        for place in problem.places(Part::Fit) {
            let data = &problem.data[place];
            let simulated = problem.simulated(place, model);
            let left = problem.left(place, &simulated, SIGNALS[2].2, Part::Fit);
            let kept: Vec<f64> = left
                .iter()
                .zip(&data.fit)
                .map(|(value, counts)| if *counts { *value } else { 0.0 })
                .collect();
            by_place.push(by_bins(&kept, &positions(&simulated, data.course.setpoints_m()), lead_m));
            in_time.push(kept);
        }
        let period_s = problem.machine.cycle.period.as_s();
        Self { hz: peaks(in_time, 1.0 / period_s, HZ), per_turn: peaks(by_place, BINS_PER_TURN, PER_TURN) }
    }

    /// Values of a parameter that they suggest, by the unit in its key; nothing for other keys.
    pub fn of(&self, key: &str) -> Vec<f64> {
        if key.ends_with("-hz") {
            self.hz.clone()
        } else if key.ends_with("-per-turn") {
            self.per_turn.clone()
        } else {
            Vec::new()
        }
    }
}

/// Peaks of the power of all, each of so many values per unit.
fn peaks(sums: Vec<Vec<f64>>, per_unit: f64, range: [f64; 2]) -> Vec<f64> {
    let Some(longest) = sums.iter().map(Vec::len).max() else { return Vec::new() };
    let length = (2 * longest).next_power_of_two();
    let transform = FftPlanner::new().plan_fft_forward(length);
    let mut power = vec![0.0; length / 2];
    for values in sums {
        let mut lines: Vec<Complex<f64>> = values.into_iter().map(|value| Complex::new(value, 0.0)).collect();
        lines.resize(length, Complex::new(0.0, 0.0));
        transform.process(&mut lines);
        for (power, line) in power.iter_mut().zip(&lines) {
            *power += line.norm_sqr();
        }
    }
    tops(&power, per_unit / length as f64, range)
}

fn tops(power: &[f64], step: f64, range: [f64; 2]) -> Vec<f64> {
    let last = power.len() - 2;
    let [low, high] = range.map(|frequency| ((frequency / step) as usize).clamp(1, last));
    let mut tops: Vec<(usize, f64)> = (low..=high)
        .filter(|line| power[*line] > power[line - 1] && power[*line] >= power[line + 1])
        .map(|line| {
            let reach = ((ABOUT.0 * line as f64) as usize).max(ABOUT.1);
            let mut about = power[line.saturating_sub(reach)..(line + reach).min(power.len())].to_vec();
            let middle = about.len() / 2;
            let median = *about.select_nth_unstable_by(middle, f64::total_cmp).1;
            (line, power[line] / median.max(f64::MIN_POSITIVE))
        })
        .filter(|(_, ratio)| *ratio > ABOVE)
        .collect();
    tops.sort_by(|a, b| power[b.0].total_cmp(&power[a.0]));
    tops.into_iter().take(PEAKS).map(|(line, _)| line as f64 * step).collect()
}

/// Sums of the rows by where they were.
fn by_bins(values: &[f64], positions_m: &[f64], lead_m: f64) -> Vec<f64> {
    let bin = |position_m: f64| (position_m / lead_m * BINS_PER_TURN).floor();
    let [low, high] = positions_m
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(bin(*at)), high.max(bin(*at))]);
    let mut sums = vec![0.0; (high - low) as usize + 1];
    for (value, at) in values.iter().zip(positions_m) {
        sums[(bin(*at) - low) as usize] += value;
    }
    sums
}

fn positions(simulated: &Signals, setpoints_m: impl Iterator<Item = f64>) -> Vec<f64> {
    setpoints_m.zip(&simulated.following_error_m).map(|(setpoint, error)| setpoint - error).collect()
}
