//! Power of several signals by frequency, and the lines that stand out of it.
//!
//! Each signal goes through the Fourier transform filled up with zeros, so that a peak is found between its lines as well.
//! Invariant: a line that stands out is so many times the median of those about it.

use nalgebra::Complex;
use rustfft::FftPlanner;

use crate::offline::median::median;

/// Least ratio of a peak to the median of the lines about it, in a spectrum of one run.
pub(in crate::offline::gap) const ABOVE: f64 = 8.0;
/// Lines on either side that are its neighbourhood, as a share of its frequency, and at least and at most so many.
const ABOUT: (f64, [usize; 2]) = (0.3, [40, 300]);

/// Power of all, line by line, up to half of the rate; nothing where there are none.
pub(in crate::offline::gap) fn power(sums: &[&[f64]]) -> Option<Vec<f64>> {
    added(sums, |_| {})
}

/// The same with each made even first, so that a run in which a table sticks, all of it within a few sums, hides no line of
/// another: it is as loud as all others together, at every frequency.
pub(in crate::offline::gap) fn evened(sums: &[&[f64]]) -> Option<Vec<f64>> {
    added(sums, even)
}

fn added(sums: &[&[f64]], prepare: impl Fn(&mut [f64])) -> Option<Vec<f64>> {
    let longest = sums.iter().map(|sums| sums.len()).max()?;
    let length = (2 * longest).next_power_of_two();
    let transform = FftPlanner::new().plan_fft_forward(length);
    let mut all = vec![0.0; length / 2];
    for values in sums {
        let mut lines: Vec<Complex<f64>> = values.iter().map(|value| Complex::new(*value, 0.0)).collect();
        lines.resize(length, Complex::new(0.0, 0.0));
        transform.process(&mut lines);
        let mut power: Vec<f64> = lines[..all.len()].iter().map(Complex::norm_sqr).collect();
        prepare(&mut power);
        for (all, power) in all.iter_mut().zip(power) {
            *all += power;
        }
    }
    Some(all)
}

/// Divides each line by what is usual about it: the median of a stretch of lines, and between the middles of two on a line of
/// logarithms.
fn even(power: &mut [f64]) {
    let mut middles: Vec<(f64, f64)> = Vec::new();
    let mut from = 0;
    while from < power.len() {
        let to = power.len().min(from + 2 * about(from));
        let usual = median(&mut power[from..to].to_vec()).unwrap_or(0.0).max(f64::MIN_POSITIVE);
        middles.push((0.5 * (from + to) as f64, usual.ln()));
        from = to;
    }
    let mut next = 0;
    for (line, power) in power.iter_mut().enumerate() {
        let at = line as f64;
        while next < middles.len() && middles[next].0 <= at {
            next += 1;
        }
        let usual = match (next.checked_sub(1).map(|before| middles[before]), middles.get(next)) {
            (Some((from, low)), Some((to, high))) => low + (high - low) * (at - from) / (to - from),
            (Some((_, usual)), None) | (None, Some(&(_, usual))) => usual,
            (None, None) => 0.0,
        };
        *power /= usual.exp();
    }
}

/// Lines to either side that are the neighbourhood of one.
fn about(line: usize) -> usize {
    ((ABOUT.0 * line as f64) as usize).clamp(ABOUT.1[0], ABOUT.1[1])
}

/// Lines of a spectrum with so much between them that stand out within a range, and how many times the median about them they are, which is
/// more than `above`.
pub(in crate::offline::gap) fn tops(
    power: &[f64],
    step: f64,
    range: [f64; 2],
    above: f64,
) -> Vec<(f64, f64)> {
    // The first and the last are no tops.
    let Some(last) = power.len().checked_sub(2).filter(|last| *last > 0) else { return Vec::new() };
    let [low, high] = range.map(|frequency| ((frequency / step) as usize).clamp(1, last));
    (low..=high)
        .filter(|line| power[*line] > power[line - 1] && power[*line] >= power[line + 1])
        .map(|line| {
            let reach = about(line);
            let mut about = power[line.saturating_sub(reach)..(line + reach).min(power.len())].to_vec();
            let usual = median(&mut about).unwrap_or(0.0);
            (line, power[line] / usual.max(f64::MIN_POSITIVE))
        })
        .filter(|(_, ratio)| *ratio > above)
        .map(|(line, ratio)| (line as f64 * step, ratio))
        .collect()
}
