//! The noise floor from repeats: what two passes of the same command differ by is noise, whatever the model is.
//!
//! ```text
//!   setpoints ──► where a run repeats itself, or another run ──► pairs of rows ──► differences / √2 ──► rms, whitening
//! ```
//!
//! A lap need not be a whole number of rows: each row is held against the nearest of the other pass, moved by how much the column
//! rises there over several rows. Rows taken between two would be smoother than any, and noise that a loop differentiates
//! comes and goes from row to row. Differences of laps lose what drifts slowly with them, so that a slow drift is
//! no noise. Nor is what keeps its frequency (`lines`). Noise is not everywhere the same: an axis at speed shows the jitter of its latch, one that sticks follows
//! what shakes it. So each row also has a [`Loudness`]: what passes differ by about it, against the quiet rows. Without
//! any repeat the floor is the noise of single rows, from their second differences: a lower bound
//! that knows nothing of slow noise, and is called so.
//! Units: those of the signal. Invariant: no model takes part.

use std::ops::Range;

use super::forward::Signals;
use super::lines::{lines, without};
use super::process::{BLOCK_S, autocovariances, left_of, levinson};
use crate::base::axis::AxisId;
use crate::offline::gap::runs::Run;
use crate::offline::gap::runs::repeat::Repeat;
use crate::offline::median::median;

/// At least so many blocks that are as fast tell how loud it is there, and of the same run fewer; slower than this is rest, m/s.
const AS_FAST: usize = 5;
const OWN: usize = 2;
const STILL_M_S: f64 = 1e-5;
/// Variance of the fourth differences of white noise of variance 1.
const ROUGH: f64 = 70.0;
/// Rows to both sides over which a column rises.
const RISES: usize = 4;
/// Order of the whitening filter: rows after one that does not count do so no more until it is forgotten.
pub(in crate::offline::gap) const ORDER: usize = 12;
/// Rows that are whitened together.
const STRETCH: usize = 256;

/// Noise of one signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// Of a row.
    pub rms: f64,
    /// Whether it comes from repeats; otherwise it is a lower bound.
    pub is_from_repeats: bool,
    /// Whitening filter: what is taken of the rows before, newest first.
    pub memory: Vec<f64>,
    /// Rms of what the filter leaves of quiet rows.
    pub left: f64,
    /// How many times louder than those the usual rows are.
    pub usual: f64,
    /// Frequencies of what passes differ by that are none of it, Hz.
    pub lines: Vec<f64>,
    /// Share of what no encoder resolves that passes hide, as a power.
    pub hides: f64,
    /// Power of all that they hide in the whitened signal.
    pub hidden: f64,
}

/// What passes may hide of a signal.
#[derive(Clone, Debug, Default)]
pub struct Hidden {
    /// What no encoder or drive resolves, as a standard deviation.
    pub least: f64,
    /// Autocovariances of what passes do hide of what the loops make of it; none where that is nothing.
    pub answered: Vec<f64>,
}

/// Which signal of [`Signals`].
pub type Pick = fn(&Signals) -> &[f64];

/// Noise of a signal of one axis, over all its repeats; `measured` is that axis in each run.
pub fn noise(
    repeats: &[Repeat],
    runs: &[Run],
    measured: &[Option<Signals>],
    pick: Pick,
    hidden: &Hidden,
) -> Option<Noise> {
    let least = hidden.least;
    let all: Vec<Vec<f64>> =
        told(repeats, measured, pick).map(|(repeat, signals)| differences(repeat, runs, signals)).collect();
    // Runs of one analysis have one period.
    let period_s = runs.first().map_or(1.0, |run| run.period_s);
    let lines = lines(&all, period_s);
    let length = ((BLOCK_S / period_s) as usize).max(ORDER + 1);
    let mut blocks: Vec<Vec<f64>> = Vec::new();
    for difference in all {
        let difference = without(difference, &lines, period_s);
        blocks.extend(difference.chunks_exact(length).map(<[f64]>::to_vec));
    }
    let of_passes = autocovariances(&blocks);
    let is_from_repeats = of_passes.is_some();
    let lags = if let Some(lags) = of_passes {
        lags
    } else {
        let (mut sum, mut rows) = (0.0, 0);
        for signal in measured.iter().flatten().map(pick).filter(|signal| signal.len() > 2) {
            // White noise of variance s² has second differences of 6 s². Motion that is not smooth is no noise.
            let count = signal.len() - 2;
            sum += usual_power(second_squares(signal)).unwrap_or(0.0) / 6.0 * count as f64;
            rows += count;
        }
        if rows == 0 {
            return None;
        }
        std::iter::once(sum / rows as f64).chain([0.0; ORDER]).collect()
    };
    // Of what is hidden, passes that differ by more than that show their part.
    let shown2 = if is_from_repeats { levinson(&lags).1 } else { 0.0 };
    let hidden2 = (least * least - shown2).max(0.0);
    let hides = if least > 0.0 { hidden2 / (least * least) } else { 0.0 };
    // Single rows show what the loops answer.
    let answered = if is_from_repeats { hidden.answered.as_slice() } else { &[] };
    let more = |lag: usize| answered.get(lag).copied().unwrap_or(0.0) + if lag == 0 { hidden2 } else { 0.0 };
    let more: Vec<f64> = (0..=ORDER).map(more).collect();
    let lags: Vec<f64> = lags.iter().zip(&more).map(|(of_passes, more)| of_passes + more).collect();
    let (memory, left2) = levinson(&lags);
    let left = left2.sqrt();
    let (rms, usual, hidden) = (lags[0].sqrt(), 1.0, 0.0);
    let mut noise = Noise { rms, is_from_repeats, memory, left, usual, lines, hides, hidden };
    if is_from_repeats {
        let hidden2 = left_of(&noise.memory, &more);
        noise.left = left.min(noise.quiet(&blocks).hypot(hidden2.sqrt())).max(least);
        noise.usual = left / noise.left;
        noise.hidden = hidden2 / noise.left.powi(2);
    }
    Some(noise)
}

/// How many times louder than the quiet rows each row of a run is; at least 1.
pub type Loudness = Vec<f64>;

/// Loudness of each run of an axis, from its passes. Where there is none a row is as loud as most rows of passes that are about as fast,
/// or louder by as much as most of its run is rougher: somebody may have measured it with another sensor. Rows alone may be rough
/// because loops of two periods make steps.
pub fn loudness(
    repeats: &[Repeat],
    runs: &[Run],
    id: AxisId,
    measured: &[Option<Signals>],
    pick: Pick,
    noise: &Noise,
) -> Vec<Loudness> {
    let mut squares: Vec<Vec<[f64; 2]>> = runs.iter().map(|run| vec![[0.0; 2]; run.len()]).collect();
    let mut passed: Vec<Passed> = Vec::new();
    for (repeat, signals) in told(repeats, measured, pick) {
        let (run, period_s) = (&runs[repeat.runs[0]], runs[repeat.runs[0]].period_s);
        let difference = without(differences(repeat, runs, signals), &noise.lines, period_s);
        let white = noise.whitened(&difference);
        let length = ((BLOCK_S / period_s) as usize).max(1);
        for (number, block) in white.chunks(length).enumerate() {
            let shown = block.iter().map(|value| value * value).sum::<f64>() / block.len() as f64;
            let power = shown + noise.hidden;
            let from = repeat.rows[0] + number * length;
            let rows = from..(from + block.len()).min(signals[0].len());
            passed.push(Passed { block: Block::of(run, id, signals[0], rows), power, runs: repeat.runs });
            for (run, shift) in repeat.runs.into_iter().zip([0.0, repeat.shift]) {
                let from = (from as f64 + shift).round() as usize;
                for sum in squares[run].iter_mut().skip(from).take(length) {
                    *sum = [sum[0] + power, sum[1] + 1.0];
                }
            }
        }
    }
    let of = |(run, squares): (usize, Vec<[f64; 2]>)| {
        let Some(signal) = measured[run].as_ref().map(pick).filter(|signal| !signal.is_empty()) else {
            return Vec::new();
        };
        let length = ((BLOCK_S / runs[run].period_s) as usize).max(1);
        let is_passed = |[_, count]: &[f64; 2]| *count > 0.0;
        let beside = |(number, squares): (usize, &[[f64; 2]])| {
            let rows = number * length..number * length + squares.len();
            let is_alone = !squares.iter().all(is_passed);
            is_alone.then(|| Block::of(&runs[run], id, signal, rows).beside(&passed, run))
        };
        let alike: Vec<Option<Alike>> = squares.chunks(length).enumerate().map(beside).collect();
        let rougher = alike.iter().flatten().map(|alike| alike.rougher).collect();
        let more = lower_quartile(rougher).map_or(0.0, |rougher| noise.white_power(rougher.max(0.0) / ROUGH));
        let loud = |(squares, alike): (&[[f64; 2]], Option<Alike>)| -> Vec<f64> {
            let alone = alike.map_or(1.0, |alike| alike.power + more);
            let power = |[sum, count]: &[f64; 2]| if *count > 0.0 { sum / count } else { alone };
            squares.iter().map(|squares| power(squares).max(1.0).sqrt()).collect()
        };
        squares.chunks(length).zip(alike).flat_map(loud).collect()
    };
    squares.into_iter().enumerate().map(of).collect()
}

fn lower_quartile(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 4).copied()
}

/// What rows of passes that are about as fast say of others.
#[derive(Clone, Copy, Debug)]
struct Alike {
    power: f64,
    /// By how much those others are rougher.
    rougher: f64,
}

/// Rows that came again.
struct Passed {
    block: Block,
    /// Of what both passes differ by, whitened.
    power: f64,
    runs: [usize; 2],
}

/// Some rows of a run.
#[derive(Clone, Copy, Debug)]
struct Block {
    /// Mean speed of the setpoint, in octaves of m/s.
    octave: f64,
    /// Mean square of fourth differences, to which motion is smooth.
    roughness: f64,
}

impl Block {
    /// These rows of a run.
    fn of(run: &Run, id: AxisId, signal: &[f64], rows: Range<usize>) -> Self {
        let setpoint_m = run.axes.get(&id).map_or(&[][..], |axis| &axis.setpoint_m[rows.clone()]);
        let way_m: f64 = setpoint_m.windows(2).map(|rows| (rows[1] - rows[0]).abs()).sum();
        let speed_m_s = way_m / (setpoint_m.len().max(2) - 1) as f64 / run.period_s;
        let fourth = |rows: &[f64]| rows[0] - 4.0 * rows[1] + 6.0 * rows[2] - 4.0 * rows[3] + rows[4];
        let squares = signal[rows].windows(5).map(|rows| fourth(rows).powi(2)).collect();
        let roughness = usual_power(squares).unwrap_or(0.0);
        Self { octave: speed_m_s.max(STILL_M_S).log2(), roughness }
    }

    /// What those say of these rows that passed about as fast: in the same run, if there are enough, or in any.
    fn beside(&self, passed: &[Passed], run: usize) -> Alike {
        let apart = |one: &Passed| (one.block.octave - self.octave).abs();
        let mut near: Vec<&Passed> = passed.iter().collect();
        near.sort_by(|a, b| apart(a).total_cmp(&apart(b)));
        let as_fast = near.partition_point(|one| apart(one) <= 1.0);
        let own: Vec<_> = near[..as_fast].iter().copied().filter(|one| one.runs.contains(&run)).collect();
        if own.len() >= OWN {
            near = own;
        } else {
            near.truncate(as_fast.max(AS_FAST));
        }
        let of =
            |value: fn(&Passed) -> f64| median(&mut near.iter().map(|one| value(one)).collect::<Vec<_>>());
        Alike {
            power: of(|one| one.power).unwrap_or(1.0),
            rougher: of(|one| one.block.roughness).map_or(0.0, |roughness| self.roughness - roughness),
        }
    }
}

fn second_squares(signal: &[f64]) -> Vec<f64> {
    signal.windows(3).map(|rows| (rows[0] - 2.0 * rows[1] + rows[2]).powi(2)).collect()
}

/// Power of most rows, by their squares: single jumps are none of it.
fn usual_power(mut squares: Vec<f64>) -> Option<f64> {
    // That of a squared normal is 0.455.
    median(&mut squares).map(|median| median / 0.455)
}

/// Repeats of which both passes have a signal, with it.
fn told<'a>(
    repeats: &'a [Repeat],
    measured: &'a [Option<Signals>],
    pick: Pick,
) -> impl Iterator<Item = (&'a Repeat, [&'a [f64]; 2])> {
    repeats.iter().filter_map(move |repeat| {
        let [earlier, later] = repeat.runs.map(|run| measured[run].as_ref().map(pick));
        let both = [earlier?, later?];
        both.iter().all(|signal| !signal.is_empty()).then_some((repeat, both))
    })
}

/// What two passes differ by, as the noise of one: mean and slope over the stretch are drift.
fn differences(repeat: &Repeat, runs: &[Run], [earlier, later]: [&[f64]; 2]) -> Vec<f64> {
    let nearest = repeat.shift.round();
    let beyond = (repeat.shift - nearest) / (2 * RISES) as f64;
    let scale = (2.0 + 2.0 * beyond * beyond).sqrt().recip();
    let sound = repeat.runs.map(|run| &runs[run].is_sound);
    let [from, to] = repeat.rows;
    let mut values = Vec::with_capacity(to - from);
    for row in from..to {
        let other = (row as f64 + nearest) as usize;
        let about = [other, other.saturating_sub(RISES), other + RISES];
        if sound[0][row] && about.iter().all(|row| sound[1].get(*row).copied().unwrap_or(false)) {
            let [here, before, after] = about.map(|row| later[row]);
            values.push((repeat.sign() * (here + beyond * (after - before)) - earlier[row]) * scale);
        }
    }
    let rows = values.len() as f64;
    let mean = values.iter().sum::<f64>() / rows;
    let middle = 0.5 * (rows - 1.0);
    let spread = (rows * (rows * rows - 1.0) / 12.0).max(f64::MIN_POSITIVE);
    let slope =
        values.iter().enumerate().map(|(row, value)| (row as f64 - middle) * value).sum::<f64>() / spread;
    values.iter().enumerate().map(|(row, value)| value - mean - slope * (row as f64 - middle)).collect()
}

impl Noise {
    /// What the filter leaves of most rows of blocks: single jumps of stick and slip are none of them.
    fn quiet(&self, blocks: &[Vec<f64>]) -> f64 {
        let rows = blocks.iter().flat_map(|block| self.whitened(block).split_off(ORDER.min(block.len())));
        usual_power(rows.map(|value| value * value).collect())
            .map_or(self.left, |power| self.left * power.sqrt())
    }

    /// Power that white noise of this variance has in the whitened signal.
    fn white_power(&self, variance: f64) -> f64 {
        let gain = 1.0 + self.memory.iter().map(|a| a * a).sum::<f64>();
        variance * gain / (self.left * self.left)
    }

    /// The signal as independent values of variance 1, where it is noise.
    pub fn whitened(&self, signal: &[f64]) -> Vec<f64> {
        let scale = self.left.recip();
        let mut white = Vec::with_capacity(signal.len());
        // Coefficient by coefficient over a stretch: rows do not wait for each other then.
        for from in (0..signal.len()).step_by(STRETCH) {
            let to = (from + STRETCH).min(signal.len());
            let mut rest = [0.0; STRETCH];
            let rest = &mut rest[..to - from];
            rest.copy_from_slice(&signal[from..to]);
            for (back, a) in self.memory.iter().enumerate() {
                let first = from.max(back + 1).min(to);
                let earlier = &signal[first.saturating_sub(back + 1)..];
                rest[first - from..].iter_mut().zip(earlier).for_each(|(rest, before)| *rest -= a * before);
            }
            white.extend(rest.iter().map(|rest| rest * scale));
        }
        white
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::f64::consts::TAU;

    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::base::axis::AxisId;
    use crate::offline::gap::runs::AxisRun;
    use crate::offline::gap::runs::repeat::What;
    use crate::offline::gap::runs::repeats::repeats;

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

    fn measured(runs: &[Run]) -> Vec<Option<Signals>> {
        runs.iter().map(|run| Some(Signals::measured(&run.axes[&AxisId::X]))).collect()
    }

    fn noise_of(run: &Run) -> Noise {
        let runs = std::slice::from_ref(run);
        let measured = measured(runs);
        noise(&repeats(runs), runs, &measured, |signals| &signals.current_a, &Hidden::default())
            .expect("noise")
    }

    #[test]
    fn what_keeps_its_frequency_is_no_noise_and_makes_no_row_louder() {
        let mut run = circle(0.01, 0.5);
        let current_a = &mut run.axes.get_mut(&AxisId::X).expect("an axis").current_a;
        for (row, current_a) in current_a.iter_mut().enumerate() {
            *current_a += 0.05 * (TAU * 19.34 * row as f64 * PERIOD_S).sin();
        }
        let noise = noise_of(&run);
        assert!((noise.rms / 0.01 - 1.0).abs() < 0.1, "{noise:?}");
        let runs = std::slice::from_ref(&run);
        let measured = measured(runs);
        let pick: Pick = |signals| &signals.current_a;
        let loudness = &loudness(&repeats(runs), runs, AxisId::X, &measured, pick, &noise)[0];
        let mean = loudness.iter().sum::<f64>() / loudness.len() as f64;
        assert!(mean < 1.2, "{mean}");
    }

    #[test]
    fn laps_that_are_no_whole_number_of_rows_are_found() {
        let found = repeats(&[circle(0.01, 0.0)]);
        assert_eq!(found.len(), 1);
        assert!((found[0].shift - 2_100.4).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn noise_is_what_laps_differ_by_and_no_drift() {
        for memory in [-0.6, 0.0, 0.9] {
            let found = noise_of(&circle(0.05, memory));
            assert!(found.is_from_repeats);
            assert!((found.rms / 0.05 - 1.0).abs() < 0.15, "{} A with a memory of {memory}", found.rms);
            let first = found.memory[0];
            assert!((first - memory).abs() < 0.08, "{first}, a memory of {memory}");
        }
    }

    #[test]
    fn passes_that_are_hardly_sound_anywhere_tell_no_noise() {
        for sound in [0, 9, 10, 40] {
            let mut run = circle(0.05, 0.0);
            let found = repeats(std::slice::from_ref(&run));
            let [from, _] = found[0].rows;
            // Of both laps, one row after the other.
            let lap = 2_100;
            let is_sound = |row: usize| (from + 10..from + 10 + sound).contains(&(row % lap));
            run.is_sound = (0..run.len()).map(|row| sound > 0 && is_sound(row)).collect();
            let runs = std::slice::from_ref(&run);
            let measured = measured(runs);
            let pick: Pick = |signals| &signals.current_a;
            let noise = noise(&found, runs, &measured, pick, &Hidden::default()).expect("noise");
            assert!(!noise.is_from_repeats && (noise.rms / 0.05 - 1.0).abs() < 0.1, "{sound}: {noise:?}");
            let loudness = loudness(&found, runs, AxisId::X, &measured, pick, &noise);
            assert!(loudness[0].iter().all(|loud| loud.is_finite()), "{sound}");
        }
    }

    #[test]
    fn what_counts_hide_is_noise_once_whether_passes_show_it_or_not() {
        let step_a = 0.03;
        let hidden_a = step_a / 12_f64.sqrt();
        // Passes alike hide it, and noise of half a count shows it all.
        for (noise_a, wanted_a) in [(0.0, hidden_a), (0.015, hidden_a.hypot(0.015))] {
            let mut run = circle(noise_a, 0.0);
            let current_a = &mut run.axes.get_mut(&AxisId::X).expect("an axis").current_a;
            // The same rows in each lap.
            let lap = 2_100;
            for row in 0..current_a.len() {
                let same = if noise_a == 0.0 { current_a[row % lap] } else { current_a[row] };
                current_a[row] = (same / step_a).round() * step_a;
            }
            let runs = std::slice::from_ref(&run);
            let measured = measured(runs);
            let shift = if noise_a == 0.0 { lap as f64 } else { 2_100.4 };
            let repeat = Repeat { what: What::Run, runs: [0, 0], shift, rows: [100, 4_000] };
            let hidden = Hidden { least: hidden_a, answered: Vec::new() };
            let found = noise(&[repeat], runs, &measured, |signals| &signals.current_a, &hidden);
            let rms = found.expect("noise").rms;
            assert!((rms / wanted_a - 1.0).abs() < 0.06, "{rms} A, and not {wanted_a} A");
        }
    }

    #[test]
    fn what_loops_answer_to_counts_is_noise_that_passes_hide() {
        let mut run = circle(0.01, 0.0);
        let mut random = Pcg64Mcg::seed_from_u64(9);
        let mut draw = |rms: f64| -> f64 {
            let drawn: f64 = StandardNormal.sample(&mut random);
            rms * drawn
        };
        // In a fifth of each lap there is twice the noise.
        let current_a = &mut run.axes.get_mut(&AxisId::X).expect("it has one").current_a;
        let is_loud = |row: &usize| (0.5..0.7).contains(&((*row as f64 / 2_100.4) % 1.0));
        (0..current_a.len()).filter(is_loud).for_each(|row| current_a[row] += draw(3_f64.sqrt() * 0.01));
        let runs = std::slice::from_ref(&run);
        let (repeats, measured) = (repeats(runs), measured(runs));
        let pick: Pick = |signals| &signals.current_a;
        // Differences of white noise of 14 mA.
        let mut hidden = Hidden { least: 0.0, answered: vec![4e-4, -2e-4] };
        let found = noise(&repeats, runs, &measured, pick, &hidden).expect("noise");
        let counts: Vec<f64> = (0..20_000).map(|_| draw(2e-4_f64.sqrt())).collect();
        let loud = &loudness(&repeats, runs, AxisId::X, &measured, pick, &found)[0];
        for (noise_a, rows) in [(0.01, 2_300..2_900), (0.02, 3_200..3_500)] {
            let signal: Vec<f64> = counts.windows(2).map(|pair| pair[1] - pair[0] + draw(noise_a)).collect();
            let white = found.whitened(&signal);
            let power = white.iter().map(|value| value * value).sum::<f64>() / white.len() as f64;
            let loud2 = rows.clone().map(|row| loud[row] * loud[row]).sum::<f64>() / rows.len() as f64;
            assert!((power / loud2 - 1.0).abs() < 0.1, "{noise_a} A: {power}, taken for {loud2}");
        }
        hidden.answered.clear();
        let shown = noise(&repeats, runs, &measured, pick, &hidden).expect("noise").rms;
        assert!(
            ((found.rms.powi(2) - shown.powi(2)) / 4e-4 - 1.0).abs() < 1e-6,
            "{} A, {shown} A",
            found.rms
        );
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
    fn rows_about_which_passes_differ_more_are_louder() {
        let mut run = circle(0.01, 0.0);
        let mut random = Pcg64Mcg::seed_from_u64(12);
        let axis = run.axes.get_mut(&AxisId::X).expect("it has one");
        // In a fifth of each lap there is ten times the noise.
        let is_loud = |row: usize| (0.5..0.7).contains(&((row as f64 / 2_100.4) % 1.0));
        for row in (0..axis.current_a.len()).filter(|row| is_loud(*row)) {
            let drawn: f64 = StandardNormal.sample(&mut random);
            axis.current_a[row] += 0.1 * drawn;
        }
        let runs = std::slice::from_ref(&run);
        let measured = measured(runs);
        let pick: Pick = |signals| &signals.current_a;
        let repeats = repeats(runs);
        let noise = noise(&repeats, runs, &measured, pick, &Hidden::default()).expect("noise");
        assert!((noise.left / 0.01 - 1.0).abs() < 0.35, "the quiet rows have 0.01 A, found {}", noise.left);
        let loud = &loudness(&repeats, runs, AxisId::X, &measured, pick, &noise)[0];
        let [far, near] = [2_100 + 1_260, 2_100 + 400].map(|row| loud[row]);
        assert!((6.0..14.0).contains(&far) && near < 1.5, "{far} where it is ten times as loud, {near} else");
    }

    #[test]
    fn noise_is_what_is_not_the_opposite_the_other_way_around() {
        let mut random = Pcg64Mcg::seed_from_u64(20);
        let mut run = |side: f64| {
            let mut run = circle(0.0, 0.0);
            run.axes.retain(|id, _| *id == AxisId::X);
            let axis = run.axes.get_mut(&AxisId::X).expect("it has one");
            for (row, (at, current_a)) in axis.setpoint_m.iter_mut().zip(&mut axis.current_a).enumerate() {
                let drawn: f64 = StandardNormal.sample(&mut random);
                let way = (1e-3 * row as f64).powi(2);
                (*at, *current_a) = (side * 1e-3 * way, side * way + 0.02 * drawn);
            }
            run
        };
        let runs = [run(1.0), run(-1.0)];
        let measured = measured(&runs);
        let repeats = repeats(&runs);
        assert_eq!(repeats[0].what, What::Opposite(AxisId::X));
        let found = noise(&repeats, &runs, &measured, |signals| &signals.current_a, &Hidden::default())
            .expect("noise");
        assert!((found.rms / 0.02 - 1.0).abs() < 0.15, "{} A", found.rms);
    }

    #[test]
    fn where_nothing_repeats_it_is_as_loud_as_what_passed_as_fast() {
        // A command of two speeds that comes twice, three times as loud at the faster, and a line at each that comes once.
        let speeds = [1e-6, 2e-5];
        let mut random = Pcg64Mcg::seed_from_u64(15);
        let mut run = |speed: &dyn Fn(usize) -> f64, noise_a: &dyn Fn(usize) -> f64| {
            let mut run = circle(0.0, 0.0);
            let axis = run.axes.get_mut(&AxisId::X).expect("it has one");
            let mut place = 0.0;
            for (row, (at, current_a)) in axis.setpoint_m.iter_mut().zip(&mut axis.current_a).enumerate() {
                place += speed(row);
                let drawn: f64 = StandardNormal.sample(&mut random);
                (*at, *current_a) = (place, 0.1 + noise_a(row) * drawn);
            }
            run.axes.retain(|id, _| *id == AxisId::X);
            run
        };
        let is_fast = |row: usize| usize::from(row > 4_000);
        let mut twice = || run(&|row| speeds[is_fast(row)], &|row| [0.01, 0.03][is_fast(row)]);
        let [first, second] = [twice(), twice()];
        let [slow, fast] = speeds.map(|speed| run(&move |_| speed, &|_| 0.0));
        let runs = [first, second, slow, fast];
        let measured = measured(&runs);
        let pick: Pick = |signals| &signals.current_a;
        let repeats = repeats(&runs);
        assert!(repeats.iter().all(|repeat| repeat.runs == [0, 1]), "{repeats:?}");
        let noise = noise(&repeats, &runs, &measured, pick, &Hidden::default()).expect("noise");
        let loud = loudness(&repeats, &runs, AxisId::X, &measured, pick, &noise);
        let [slow, fast, passed] = [(2, 3_000), (3, 3_000), (0, 5_000)].map(|(run, row)| loud[run][row]);
        assert!(slow < 1.2 && passed > 1.5, "{slow} and {passed}");
        assert!((fast / passed - 1.0).abs() < 0.15, "{fast}, and {passed} where it passed as fast");
    }

    #[test]
    fn where_nothing_repeats_it_is_as_loud_as_it_is_rough() {
        // Laps of which every second stretch is three times as loud as the rest, and a run without any that is nine times as loud.
        let mut run = circle(0.01, 0.0);
        let mut random = Pcg64Mcg::seed_from_u64(12);
        let mut shaken = |column: &mut [f64], by_a: f64, is_loud: &dyn Fn(usize) -> bool| {
            for (row, value) in column.iter_mut().enumerate().filter(|(row, _)| is_loud(*row)) {
                let drawn: f64 = StandardNormal.sample(&mut random);
                *value += if row > 0 { by_a * drawn } else { 0.0 };
            }
        };
        let mut other = run.clone();
        for axis in other.axes.values_mut() {
            axis.setpoint_m.iter_mut().enumerate().for_each(|(row, at)| *at = 3e-5 * row as f64);
        }
        let of = |run: &mut Run| run.axes.remove(&AxisId::X).expect("it has one");
        let (mut laps, mut line) = (of(&mut run), of(&mut other));
        shaken(&mut laps.current_a, 0.01 * 8.0_f64.sqrt(), &|row| (row as f64 / 2_100.4) % 1.0 > 0.5);
        shaken(&mut line.current_a, 0.01 * 80.0_f64.sqrt(), &|_| true);
        run.axes.insert(AxisId::X, laps);
        other.axes.insert(AxisId::X, line);
        let runs = [run, other];
        let measured = measured(&runs);
        let pick: Pick = |signals| &signals.current_a;
        let repeats = repeats(&runs);
        assert!(repeats.iter().all(|repeat| repeat.runs == [0, 0]), "{repeats:?}");
        let noise = noise(&repeats, &runs, &measured, pick, &Hidden::default()).expect("noise");
        let loud = loudness(&repeats, &runs, AxisId::X, &measured, pick, &noise);
        let quiet = 0.01 / noise.left;
        assert!((loud[1][3_000] / (9.0 * quiet) - 1.0).abs() < 0.25, "{} of {quiet}", loud[1][3_000]);
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
