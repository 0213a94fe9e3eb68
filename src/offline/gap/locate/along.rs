//! How much louder than its neighbours each period along the way of what is left is, stretch after stretch: a wiper that sticks and lets
//! go or a bearing that knocks keeps its way, whatever the speed, and no phase.
//!
//! ```text
//!   what is left ──► windows of so much way, one way ──► power of each line ──► over the mean of the lines on its louder side
//! ```
//!
//! Units: mm; what is left is whitened, so that a line of noise has a mean of 2 in a window; what is more is a gain, as of a tone.
//! Invariant: noise has no gain on average, or a loss, however fast the axis is.

use std::f64::consts::TAU;
use std::ops::Range;

use super::tones::gain;

/// Windows, mm: a circle has at least one of the first each way.
const WINDOWS_MM: [f64; 2] = [8.0, 16.0];
/// Lines in half periods per window: what a window keeps apart is four of them away, and what is slow is no neighbour.
const LINES: Range<usize> = 10..64;
/// Lines on either side, from the nearest to the furthest, that are a neighbourhood.
const ABOUT: [usize; 2] = [4, 8];

/// Rows that are turned at once.
const SIDE_BY_SIDE: usize = 8;

/// Share of what windows gain that windows twice as long gain at least where a period is kept.
const KEPT: f64 = 0.5;

/// A row that counts: where it is, which way it goes, and what is left of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) place_mm: f64,
    pub(in crate::offline::gap) way: f64,
    pub(in crate::offline::gap) left: f64,
}

/// Periods, mm, with the gain of each window of all runs. What keeps its period is as loud in all windows that are twice as long, or
/// louder; what is loud over a band of periods, as a loop that is driven by noise, is not, and is none.
pub(in crate::offline::gap) fn periods(runs: &[Vec<Row>]) -> Vec<(f64, Vec<f64>)> {
    let [short, long] = WINDOWS_MM.map(|window_mm| of_windows(runs, window_mm));
    let all = |gains: &[f64]| gains.iter().sum::<f64>();
    let keeps = |line: usize, gains: &[f64]| {
        let alike = (2 * line - 1..=2 * line + 1).filter(|line| LINES.contains(line));
        let loudest = alike.map(|line| &long[line - LINES.start].1).filter(|gains| !gains.is_empty());
        loudest.map(|gains| all(gains)).reduce(f64::max).is_none_or(|longer| longer >= KEPT * all(gains))
    };
    let kept = LINES.zip(short).filter(|(line, (_, gains))| keeps(*line, gains)).map(|(_, period)| period);
    let mut periods: Vec<(f64, Vec<f64>)> = kept.collect();
    periods.extend(long);
    periods
}

fn of_windows(runs: &[Vec<Row>], window_mm: f64) -> Vec<(f64, Vec<f64>)> {
    let mut lines: Vec<(f64, Vec<f64>)> =
        LINES.map(|line| (2.0 * window_mm / line as f64, Vec::new())).collect();
    for window in runs.iter().flat_map(|run| windows(run, window_mm)) {
        let power = powers(window, window_mm);
        for (line, (_, gains)) in LINES.zip(&mut lines) {
            gains.push(gain(&power, line, ABOUT));
        }
    }
    lines
}

/// Stretches of so much way in one direction.
fn windows(run: &[Row], window_mm: f64) -> Vec<&[Row]> {
    let (mut found, mut from) = (Vec::new(), 0);
    for (at, row) in run.iter().enumerate() {
        if row.way == 0.0 || row.way != run[from].way {
            from = at;
        } else if (row.place_mm - run[from].place_mm).abs() >= window_mm {
            found.push(&run[from..at]);
            from = at;
        }
    }
    found
}

/// Power of each line, from none to the last with its neighbours. Rows go side by side: each turn of one waits for the one before it.
fn powers(window: &[Row], window_mm: f64) -> Vec<f64> {
    let mut sums = vec![[[0.0; SIDE_BY_SIDE]; 2]; LINES.end + ABOUT[1]];
    for rows in window.chunks(SIDE_BY_SIDE) {
        let (mut by, mut turn) = ([[0.0; SIDE_BY_SIDE]; 2], [[0.0; SIDE_BY_SIDE]; 2]);
        for (lane, row) in rows.iter().enumerate() {
            let through = (row.place_mm - window[0].place_mm).abs() / window_mm;
            let (sin, cos) = (0.5 * TAU * through).sin_cos();
            (turn[0][lane], turn[1][lane]) = (cos, sin);
            by[0][lane] = row.left * (1.0 - (TAU * through).cos());
        }
        for sum in &mut sums {
            for lane in 0..SIDE_BY_SIDE {
                let [re, im] = [by[0][lane], by[1][lane]];
                sum[0][lane] += re;
                sum[1][lane] += im;
                by[0][lane] = re * turn[0][lane] - im * turn[1][lane];
                by[1][lane] = re * turn[1][lane] + im * turn[0][lane];
            }
        }
    }
    let power =
        |sum: &[[f64; SIDE_BY_SIDE]; 2]| sum.iter().map(|part| part.iter().sum::<f64>().powi(2)).sum();
    sums.iter().map(power).collect()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const LAPS: usize = 30;

    /// Thirty laps of one axis of a circle, with noise and a swing of so many mm that begins anew at each reversal.
    fn laps(amplitude: f64, period_mm: f64) -> Vec<Row> {
        let mut random = Pcg64Mcg::seed_from_u64(8);
        let (lap, radius_mm) = (3_000, 15.0);
        let row = |row: usize| {
            let at = TAU * row as f64 / lap as f64;
            let phase = (row / (lap / 2)) as f64;
            let place_mm = -radius_mm * at.cos();
            let swing = amplitude * (TAU * place_mm / period_mm + phase).sin();
            let noise = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            Row { place_mm, way: at.sin().signum(), left: swing + noise }
        };
        (0..LAPS * lap).map(row).collect()
    }

    fn loudest(amplitude: f64) -> (f64, f64) {
        let mean = |(period_mm, gains): &(f64, Vec<f64>)| {
            (*period_mm, gains.iter().sum::<f64>() / gains.len() as f64)
        };
        let lines: Vec<(f64, f64)> = periods(&[laps(amplitude, 0.7)]).iter().map(mean).collect();
        lines.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("lines")
    }

    #[test]
    fn a_swing_along_the_way_is_louder_than_what_is_about_it_at_its_period_whatever_the_speed() {
        let (_, of_noise) = loudest(0.0);
        assert!(of_noise < 2.0, "{of_noise}");
        let (period_mm, gain) = loudest(0.3);
        assert!((period_mm - 0.7).abs() < 0.03 && gain > 5.0, "{period_mm} mm, {gain}");
    }

    #[test]
    fn what_is_loud_over_a_band_of_periods_is_no_period() {
        let mut random = Pcg64Mcg::seed_from_u64(9);
        // A swing of 1.6 mm that begins anew every three millimetres keeps no period.
        let mut phase = 0.0;
        let mut run = laps(0.0, 1.0);
        let mut since_mm = run[0].place_mm;
        for row in &mut run {
            if (row.place_mm - since_mm).abs() > 3.0 {
                (phase, since_mm) = (random.random_range(0.0..TAU), row.place_mm);
            }
            row.left += 0.5 * (TAU * row.place_mm / 1.6 + phase).sin();
        }
        let sum = |lines: &[(f64, Vec<f64>)]| {
            lines.iter().map(|(_, gains)| gains.iter().sum::<f64>()).fold(0.0, f64::max)
        };
        let short = sum(&of_windows(&[run.clone()], WINDOWS_MM[0]));
        let kept = sum(&periods(&[run]));
        assert!(short > 300.0 && kept < 0.5 * short, "{kept} of {short}");
    }

    #[test]
    fn windows_end_at_reversals() {
        let run = laps(0.0, 1.0);
        let found = windows(&run, 8.0);
        // Three of 8 mm fit into each half lap of 30 mm.
        assert_eq!(found.len(), LAPS * 2 * 3);
        for window in found {
            assert!(window.iter().all(|row| row.way == window[0].way));
        }
    }
}
