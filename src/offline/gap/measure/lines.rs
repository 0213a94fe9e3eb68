//! What keeps its frequency in all that passes differ by: a pump, a fan, the mains. It is no noise, though it comes at another phase in
//! each pass.
//!
//! ```text
//!   differences of passes ──► one spectrum of all ──► lines that most of them have ──► taken off, second by second
//! ```
//!
//! Taken for noise, a force of 19 Hz would be whitened away: nothing of it would be left to be found.
//! Units: Hz, s. Invariant: of noise with a smooth spectrum nothing is taken off.

use std::f64::consts::TAU;

use super::power::{ABOVE, power, tops};

/// Most lines.
const LINES: usize = 3;
/// Frequencies that are looked at, Hz: what is slower may be how a table creeps.
const HZ: [f64; 2] = [5.0, 400.0];
/// Least ratio to the lines about it in the spectrum of all, and in that of each: of noise the loudest of a hundred thousand lines is 17 times their
/// median.
const LOUD: [f64; 2] = [50.0, 25.0];
/// Share of the rows in whose spectrum it must be.
const SHARE: f64 = 0.5;
/// Lines are one frequency where they are nearer, in lines of the shorter spectrum.
const SAME: f64 = 4.0;
/// They are taken off by as much as they are there in so much time, s: while an axis sticks, they hardly are.
const WINDOW_S: f64 = 1.0;

/// Frequencies that stand out of the differences of most passes, Hz, the loudest first.
pub(in crate::offline::gap) fn lines(differences: &[Vec<f64>], period_s: f64) -> Vec<f64> {
    let found = |all: &[&[f64]], least: f64| -> (f64, Vec<f64>) {
        let Some(power) = power(all) else { return (0.0, Vec::new()) };
        let step_hz = 1.0 / (period_s * (2 * power.len()) as f64);
        let mut tops = tops(&power, step_hz, HZ, ABOVE);
        tops.retain(|(_, ratio)| *ratio > least);
        tops.sort_by(|a, b| b.1.total_cmp(&a.1));
        let line = |hz: f64| between(&power, (hz / step_hz).round() as usize) * step_hz;
        (step_hz, tops.into_iter().map(|(hz, _)| line(hz)).collect())
    };
    // Each counts as loud as it is long.
    let scaled: Vec<Vec<f64>> = differences.iter().map(|values| scaled(values)).collect();
    let all: Vec<&[f64]> = scaled.iter().map(Vec::as_slice).collect();
    let each: Vec<(f64, Vec<f64>)> = all.iter().map(|one| found(&[one], LOUD[1])).collect();
    let rows: usize = all.iter().map(|one| one.len()).sum();
    let is_in_most = |hz: f64| {
        let has =
            |(step_hz, lines): &(f64, Vec<f64>)| lines.iter().any(|line| (line - hz).abs() < SAME * step_hz);
        let with_it: usize =
            all.iter().zip(&each).filter(|(_, one)| has(one)).map(|(one, _)| one.len()).sum();
        with_it as f64 >= SHARE * rows as f64
    };
    let mut lines: Vec<f64> = Vec::new();
    for hz in found(&all, LOUD[0]).1 {
        // What is nearer goes with it.
        let is_new = lines.iter().all(|other| (other - hz).abs() > 1.0 / WINDOW_S);
        if lines.len() < LINES && is_new && is_in_most(hz) {
            lines.push(hz);
        }
    }
    lines
}

/// Where a top of a spectrum is between its lines: that of a parabola through the logarithms about it.
fn between(power: &[f64], line: usize) -> f64 {
    let [before, top, after] = [line - 1, line, line + 1].map(|line| power[line].max(f64::MIN_POSITIVE).ln());
    let bend = before - 2.0 * top + after;
    let off = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
    line as f64 + off.clamp(-0.5, 0.5)
}

/// The same values with a mean square of one.
fn scaled(values: &[f64]) -> Vec<f64> {
    let power = values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64;
    let by = power.max(f64::MIN_POSITIVE).sqrt().recip();
    values.iter().map(|value| by * value).collect()
}

/// The values without these frequencies.
pub(in crate::offline::gap) fn without(mut values: Vec<f64>, lines: &[f64], period_s: f64) -> Vec<f64> {
    let rows = ((WINDOW_S / period_s) as usize).max(1);
    for hz in lines {
        for window in values.chunks_mut(rows) {
            take_off(window, hz * period_s);
        }
    }
    values
}

/// Takes off of values what swings so often in a row.
fn take_off(values: &mut [f64], per_row: f64) {
    let waves = |row: usize| (TAU * per_row * row as f64).sin_cos();
    let mut sums = [0.0; 5];
    for (row, value) in values.iter().enumerate() {
        let (sine, cosine) = waves(row);
        let of = [sine * sine, sine * cosine, cosine * cosine, sine * value, cosine * value];
        sums.iter_mut().zip(of).for_each(|(sum, of)| *sum += of);
    }
    let [ss, sc, cc, s, c] = sums;
    let determinant = ss * cc - sc * sc;
    // Less than a period tells no wave from a slope.
    if per_row * (values.len() as f64) < 1.0 || determinant <= 0.0 {
        return;
    }
    let [of_sine, of_cosine] = [(cc * s - sc * c) / determinant, (ss * c - sc * s) / determinant];
    for (row, value) in values.iter_mut().enumerate() {
        let (sine, cosine) = waves(row);
        *value -= of_sine * sine + of_cosine * cosine;
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const PERIOD_S: f64 = 5e-4;

    /// Differences of passes of noise that remembers, with a wave in some of them.
    fn passes(size: f64, hz: f64, has: impl Fn(usize) -> bool) -> Vec<Vec<f64>> {
        let mut random = Pcg64Mcg::seed_from_u64(8);
        let mut pass = |number: usize| {
            let mut last = 0.0;
            let rows = 6_000 + 2_500 * number;
            let size = if has(number) { size } else { 0.0 };
            let mut value = |row: usize| {
                let drawn: f64 = StandardNormal.sample(&mut random);
                last = 0.9 * last + drawn;
                last + size * (TAU * hz * row as f64 * PERIOD_S + 1.3 * number as f64).sin()
            };
            (0..rows).map(&mut value).collect()
        };
        (0..6).map(&mut pass).collect()
    }

    #[test]
    fn what_most_passes_have_at_one_frequency_is_a_line() {
        let found = lines(&passes(2.0, 19.34, |_| true), PERIOD_S);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!((found[0] - 19.34).abs() < 0.01, "{found:?}");
        // A comb of one run, and noise.
        assert!(lines(&passes(2.0, 19.34, |number| number == 5), PERIOD_S).is_empty());
        assert!(lines(&passes(0.0, 19.34, |_| true), PERIOD_S).is_empty());
    }

    #[test]
    fn it_is_taken_off_and_leaves_the_noise() {
        let power =
            |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64;
        let (noise, both) = (passes(0.0, 19.34, |_| true), passes(3.0, 19.34, |_| true));
        for (noise, both) in noise.iter().zip(both) {
            let left = without(both.clone(), &[19.35], PERIOD_S);
            assert!(power(&both) > 1.7 * power(noise));
            assert!((power(&left) / power(noise) - 1.0).abs() < 0.03, "{} of {}", power(&left), power(noise));
        }
    }
}
