//! The noise floor from repeats: what two passes of the same command differ by is noise, whatever the model is.
//!
//! ```text
//!   setpoints ──► where a run repeats itself, or another run ──► pairs of rows ──► differences / √2 ──► rms, whitening
//! ```
//!
//! A lap need not be a whole number of rows: between rows the measured columns are taken as straight, and what that
//! smooths of the noise is put back. Differences of laps lose what drifts slowly with them, so that a slow drift is
//! no noise. Without any repeat the floor is the noise of single rows, from their second differences: a lower bound
//! that knows nothing of slow noise, and is called so.
//! Units: those of the signal. Invariant: no model takes part.

use super::forward::Signals;
use super::runs::{Run, span};

/// Shortest lap, s.
const LAP_MIN_S: f64 = 0.5;
/// Two passes of a command are the same within this share of its span.
const SAME_SHARE: f64 = 2e-4;
/// What was different before a repeat fades for so long, s, and it must then go on for so long to tell the noise.
const FADE_S: f64 = 1.0;
const REPEAT_MIN_S: f64 = 0.5;
/// Stick and slip come at other moments in each pass. Blocks of this length whose power is so many times the usual
/// hold such an event and are no noise. s.
const BLOCK_S: f64 = 0.2;
const EVENT: f64 = 4.0;
/// Order of the whitening filter: rows after one that does not count do so no more until it is forgotten.
pub(super) const ORDER: usize = 12;

/// Rows of a run that were commanded like rows of it, or of another run, before: `later = earlier + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repeat {
    /// Index of the run of the earlier pass, and of the later.
    pub runs: [usize; 2],
    /// Distance in rows; not whole for most laps.
    pub shift: f64,
    /// First and last row of the earlier pass that has a later one.
    pub rows: [usize; 2],
}

/// The repeats in and between runs.
pub fn repeats(runs: &[Run]) -> Vec<Repeat> {
    let mut found = Vec::new();
    for (index, run) in runs.iter().enumerate() {
        found.extend(laps(index, run));
        for (other, twin) in runs.iter().enumerate().skip(index + 1) {
            if is_same_command(run, twin) {
                let rows = [(FADE_S / run.period_s) as usize, run.len().min(twin.len()) - 1];
                if rows[1] <= rows[0] {
                    continue;
                }
                found.push(Repeat { runs: [index, other], shift: 0.0, rows });
            }
        }
    }
    found
}

fn is_same_command(run: &Run, twin: &Run) -> bool {
    let rows = run.len().min(twin.len());
    let is_long = run.len().abs_diff(twin.len()) * 50 < rows;
    let span_m = span_m(run);
    is_long
        && run.axes.iter().all(|(id, axis)| {
            twin.axes.get(id).is_some_and(|other| {
                (0..rows)
                    .all(|row| (axis.setpoint_m[row] - other.setpoint_m[row]).abs() <= SAME_SHARE * span_m)
            })
        })
}

fn span_m(run: &Run) -> f64 {
    run.axes.values().map(|axis| span(&axis.setpoint_m)).fold(0.0, f64::max)
}

/// The first lag at which all setpoints of a run come again, with the longest stretch of rows for which they do.
fn laps(index: usize, run: &Run) -> Option<Repeat> {
    let rows = run.len();
    let least = (LAP_MIN_S / run.period_s) as usize;
    let fade = (FADE_S / run.period_s) as usize;
    let repeat_min = fade + (REPEAT_MIN_S / run.period_s) as usize;
    let span_m = span_m(run);
    if rows <= least + repeat_min || span_m == 0.0 {
        return None;
    }
    // Where the setpoint of the middle comes again, coarsely; then how well, and for how long.
    let columns: Vec<&[f64]> = run.axes.values().map(|axis| axis.setpoint_m.as_slice()).collect();
    let off = |row: usize, shift: f64| {
        columns.iter().map(|column| (at(column, row as f64 + shift) - column[row]).abs()).fold(0.0, f64::max)
    };
    let probes = |lag: usize| -> f64 {
        let last = rows - lag;
        let count = 24.min(last);
        let from = |probe: usize| (probe * last) / count;
        let mut offs: Vec<f64> = (0..count).map(|probe| off(from(probe), lag as f64)).collect();
        offs.sort_by(f64::total_cmp);
        // Most of the probes: run-in and run-out do not repeat.
        offs[(count * 6) / 10]
    };
    let step = 4;
    let lags: Vec<(usize, f64)> =
        (least..rows - repeat_min).step_by(step).map(|lag| (lag, probes(lag))).collect();
    let is_low = |place: usize| {
        let here = lags[place].1;
        here < 0.01 * span_m
            && (place == 0 || lags[place - 1].1 >= here)
            && (place + 1 == lags.len() || lags[place + 1].1 >= here)
    };
    for place in (0..lags.len()).filter(|place| is_low(*place)) {
        let shift = refined(lags[place].0 as f64, step as f64, |shift| {
            let last = (rows as f64 - shift) as usize;
            let mut offs: Vec<f64> =
                (0..last).step_by((last / 200).max(1)).map(|row| off(row, shift)).collect();
            offs.sort_by(f64::total_cmp);
            offs[(offs.len() * 6) / 10]
        });
        let Some(stretch) =
            longest(rows - shift.ceil() as usize, |row| off(row, shift) <= SAME_SHARE * span_m)
        else {
            continue;
        };
        if stretch[1] - stretch[0] >= repeat_min {
            let moves = columns.iter().any(|column| {
                let part = &column[stretch[0]..stretch[1]];
                part.iter().any(|value| (value - part[0]).abs() > 0.01 * span_m)
            });
            if moves {
                return Some(Repeat { runs: [index, index], shift, rows: [stretch[0] + fade, stretch[1]] });
            }
        }
    }
    None
}

/// The lag near `from` at which `off` is least, by golden section.
fn refined(from: f64, reach: f64, off: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (from - reach, from + reach);
    let ratio = 0.618_033_988_749_894_9;
    while high - low > 1e-4 {
        let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
        if off(a) < off(b) { high = b } else { low = a }
    }
    let lag = 0.5 * (low + high);
    // A lap of whole rows is one of whole rows.
    if (lag - lag.round()).abs() < 2e-3 && off(lag.round()) <= off(lag) * 1.01 { lag.round() } else { lag }
}

fn longest(rows: usize, is_same: impl Fn(usize) -> bool) -> Option<[usize; 2]> {
    let (mut best, mut from): (Option<[usize; 2]>, Option<usize>) = (None, None);
    for row in 0..=rows {
        let same = row < rows && is_same(row);
        match (same, from) {
            (true, None) => from = Some(row),
            (false, Some(begin)) => {
                if best.is_none_or(|[low, high]| row - begin > high - low) {
                    best = Some([begin, row]);
                }
                from = None;
            }
            (true, Some(_)) | (false, None) => {}
        }
    }
    best
}

/// A column between its rows.
fn at(column: &[f64], row: f64) -> f64 {
    let low = row.floor() as usize;
    let share = row - low as f64;
    match (column.get(low), column.get(low + 1)) {
        (Some(a), Some(b)) => a + share * (b - a),
        (Some(a), None) => *a,
        (None, _) => f64::NAN,
    }
}

/// Noise of one signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// Of a row.
    pub rms: f64,
    /// Whether it comes from repeats; otherwise it is a lower bound.
    pub is_from_repeats: bool,
    /// Whitening filter: what is taken of the rows before, newest first.
    pub memory: Vec<f64>,
    /// Rms of what the filter leaves.
    pub left: f64,
}

/// Which signal of [`Signals`].
pub type Pick = fn(&Signals) -> &[f64];

/// Noise of a signal of one axis, over all its repeats; `measured` is that axis in each run, `least` what no encoder
/// or drive resolves.
pub fn noise(
    repeats: &[Repeat],
    runs: &[Run],
    measured: &[Option<Signals>],
    pick: Pick,
    least: f64,
) -> Option<Noise> {
    let mut lags = vec![0.0; ORDER + 1];
    let (mut rows, mut is_from_repeats) = (0usize, true);
    let mut blocks: Vec<Vec<f64>> = Vec::new();
    for repeat in repeats {
        let [Some(earlier), Some(later)] = repeat.runs.map(|run| measured[run].as_ref().map(pick)) else {
            continue;
        };
        if earlier.is_empty() || later.is_empty() {
            continue;
        }
        let difference = differences(repeat, runs, earlier, later);
        let length = ((BLOCK_S / runs[repeat.runs[0]].period_s) as usize).max(ORDER + 1);
        blocks.extend(difference.chunks_exact(length).map(<[f64]>::to_vec));
    }
    let power = |block: &Vec<f64>| block.iter().map(|value| value * value).sum::<f64>() / block.len() as f64;
    let mut powers: Vec<f64> = blocks.iter().map(power).collect();
    powers.sort_by(f64::total_cmp);
    let usual = powers.get(powers.len() / 2).copied().unwrap_or(0.0);
    for block in blocks.iter().filter(|block| power(block) <= EVENT * usual) {
        add_lags(block, &mut lags);
        rows += block.len();
    }
    if rows < 200 {
        is_from_repeats = false;
        lags = vec![0.0; ORDER + 1];
        rows = 0;
        for signal in measured.iter().flatten().map(pick).filter(|signal| signal.len() > 2) {
            // White noise of variance s² has second differences of 6 s².
            let mut squares: Vec<f64> =
                signal.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).powi(2) / 6.0).collect();
            squares.sort_by(f64::total_cmp);
            // The lower part: motion that is not smooth is no noise. The median of a squared normal is 0.455.
            lags[0] += squares[squares.len() / 2] / 0.455 * squares.len() as f64;
            rows += squares.len();
        }
        if rows == 0 {
            return None;
        }
    }
    let lags: Vec<f64> = lags.iter().map(|sum| sum / rows as f64).collect();
    let least2 = least * least;
    let lags: Vec<f64> = std::iter::once(lags[0] + least2).chain(lags[1..].iter().copied()).collect();
    let (memory, left2) = levinson(&lags);
    Some(Noise { rms: lags[0].sqrt(), is_from_repeats, memory, left: left2.sqrt() })
}

/// What two passes differ by, as the noise of one: mean and slope over the stretch are drift.
fn differences(repeat: &Repeat, runs: &[Run], earlier: &[f64], later: &[f64]) -> Vec<f64> {
    let share = repeat.shift - repeat.shift.floor();
    let scale = (1.0 + share * share + (1.0 - share) * (1.0 - share)).sqrt().recip();
    let sound = repeat.runs.map(|run| &runs[run].is_sound);
    let [from, to] = repeat.rows;
    let mut values = Vec::with_capacity(to - from);
    for row in from..to {
        let other = row as f64 + repeat.shift;
        let low = other.floor() as usize;
        let is_sound = sound[0][row]
            && sound[1].get(low).copied().unwrap_or(false)
            && sound[1].get(low + 1).copied().unwrap_or(share == 0.0);
        if is_sound {
            values.push((at(later, other) - earlier[row]) * scale);
        }
    }
    let rows = values.len() as f64;
    let mean = values.iter().sum::<f64>() / rows;
    let middle = 0.5 * (rows - 1.0);
    let slope = values.iter().enumerate().map(|(row, value)| (row as f64 - middle) * value).sum::<f64>()
        / (rows * (rows * rows - 1.0) / 12.0);
    values.iter().enumerate().map(|(row, value)| value - mean - slope * (row as f64 - middle)).collect()
}

fn add_lags(values: &[f64], lags: &mut [f64]) {
    for (lag, sum) in lags.iter_mut().enumerate() {
        *sum += values.iter().zip(values.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>();
    }
}

/// Coefficients of the predictor of a process by its autocovariances, and what it leaves of the variance
/// (Levinson and Durbin).
fn levinson(lags: &[f64]) -> (Vec<f64>, f64) {
    let mut left = lags[0];
    let mut memory: Vec<f64> = Vec::new();
    for order in 1..lags.len() {
        let known: f64 = memory.iter().enumerate().map(|(back, a)| a * lags[order - 1 - back]).sum();
        let reflection = (lags[order] - known) / left;
        // No process has such autocovariances: there are too few rows for this order.
        if reflection.is_nan() || reflection.abs() >= 1.0 {
            break;
        }
        let turned: Vec<f64> = memory.iter().rev().copied().collect();
        for (a, other) in memory.iter_mut().zip(turned) {
            *a -= reflection * other;
        }
        memory.push(reflection);
        left *= 1.0 - reflection * reflection;
    }
    (memory, left)
}

impl Noise {
    /// The signal as independent values of variance 1, where it is noise.
    pub fn whitened(&self, signal: &[f64]) -> Vec<f64> {
        (0..signal.len())
            .map(|row| {
                let known: f64 = self
                    .memory
                    .iter()
                    .enumerate()
                    .map(|(back, a)| if row > back { a * signal[row - 1 - back] } else { 0.0 })
                    .sum();
                (signal[row] - known) / self.left
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::f64::consts::TAU;

    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use super::super::runs::AxisRun;
    use super::*;
    use crate::base::axis::AxisId;

    const PERIOD_S: f64 = 5e-4;

    /// Three laps of a circle, each of 2100.4 rows; the current has noise that remembers, and drifts.
    fn circle(noise_a: f64, memory: f64) -> Run {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let rows = 6_300;
        let column = |shift: f64| -> Vec<f64> {
            (0..rows).map(|row| 0.01 * (TAU * (f64::from(row) / 2_100.4 + shift)).sin()).collect()
        };
        let mut last = 0.0;
        let current_a = (0..rows).map(|row| {
            let drawn: f64 = StandardNormal.sample(&mut random);
            last = memory * last + (1.0 - memory * memory).sqrt() * noise_a * drawn;
            2.0 * (9.0 * (TAU * f64::from(row) / 2_100.4).cos()).tanh() + 1e-5 * f64::from(row) + last
        });
        let current_a: Vec<f64> = current_a.collect();
        let axis = |shift: f64| AxisRun {
            setpoint_m: column(shift),
            position_m: column(shift),
            table_m: None,
            current_a: current_a.clone(),
        };
        let axes = BTreeMap::from([(AxisId::X, axis(0.0)), (AxisId::Y, axis(0.25))]);
        Run {
            name: "circle".to_owned(),
            start_s: 0.0,
            period_s: PERIOD_S,
            axes,
            is_sound: vec![true; rows as usize],
        }
    }

    fn noise_of(run: &Run) -> Noise {
        let runs = std::slice::from_ref(run);
        let measured = vec![Some(Signals::measured(&run.axes[&AxisId::X]))];
        noise(&repeats(runs), runs, &measured, |signals| &signals.current_a, 0.0).expect("noise")
    }

    #[test]
    fn laps_that_are_no_whole_number_of_rows_are_found() {
        let found = repeats(&[circle(0.01, 0.0)]);
        assert_eq!(found.len(), 1);
        assert!((found[0].shift - 2_100.4).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn noise_is_what_laps_differ_by_and_no_drift() {
        for memory in [0.0, 0.9] {
            let found = noise_of(&circle(0.05, memory));
            assert!(found.is_from_repeats);
            assert!((found.rms / 0.05 - 1.0).abs() < 0.15, "{} A with a memory of {memory}", found.rms);
            let first = found.memory[0];
            // Taking rows between rows smooths a little.
            assert!((first - memory).abs() < 0.25, "{first}, a memory of {memory}");
        }
    }

    #[test]
    fn whitened_noise_is_independent_and_of_variance_1() {
        let run = circle(0.05, 0.9);
        let mut random = Pcg64Mcg::seed_from_u64(8);
        let mut last = 0.0;
        let signal: Vec<f64> = (0..20_000)
            .map(|_| {
                let drawn: f64 = StandardNormal.sample(&mut random);
                last = 0.9 * last + (1.0_f64 - 0.81).sqrt() * 0.05 * drawn;
                last
            })
            .collect();
        let white = noise_of(&run).whitened(&signal);
        let product = |lag: usize| {
            white.iter().zip(&white[lag..]).map(|(a, b)| a * b).sum::<f64>() / (white.len() - lag) as f64
        };
        assert!((product(0) - 1.0).abs() < 0.35, "variance {}", product(0));
        assert!((product(1) / product(0)).abs() < 0.25, "neighbours {}", product(1) / product(0));
    }

    #[test]
    fn without_a_repeat_the_floor_says_so() {
        let mut run = circle(0.05, 0.0);
        for axis in run.axes.values_mut() {
            for column in [&mut axis.setpoint_m, &mut axis.position_m, &mut axis.current_a] {
                column.truncate(2_000);
            }
        }
        run.is_sound.truncate(2_000);
        let found = noise_of(&run);
        assert!(!found.is_from_repeats);
        assert!((found.rms / 0.05 - 1.0).abs() < 0.15, "{} A", found.rms);
    }
}
