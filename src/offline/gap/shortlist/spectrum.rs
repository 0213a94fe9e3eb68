//! Frequencies at which what is left of the signals has its peaks: in time, in Hz, and along the screw, per turn.
//!
//! Looked at are whitened signals, so that a peak stands above noise and not above what is large. Along the screw the rows
//! are summed up by where the motor was, whichever way it went; so what depends on the angle alone is summed and the
//! rest is not. Friction turns its sign with the way, and goes to nothing in that sum: so they are summed with the sign of the way as
//! well. All spectra go through the Fourier transform of evenly spaced sums, filled up with zeros, so that a peak
//! is found between the lines as well.
//! Invariant: a peak is far above its neighbourhood, or it is none.

use std::f64::consts::TAU;

use nalgebra::Complex;
use rayon::prelude::*;

use super::spots;
use crate::offline::gap::measure::forward::{DEFLECTION, Signals};
use crate::offline::gap::measure::power::{ABOVE, evened, tops};
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::runs::session_s;
use crate::plant::effects::Parameter;

/// Peaks that are tried.
const PEAKS: usize = 4;
/// In one of many runs, which scatters less, noise is above its mean by so many standard deviations of a normal distribution in one line of
/// a hundred thousand.
const DEVIATIONS: f64 = 4.26;
/// Nearer peaks, as a share of their frequency, are one.
const SAME: f64 = 0.02;
/// Frequencies that are looked at, Hz and per turn.
const HZ: [f64; 2] = [2.0, 400.0];
/// Per turn: what screw and motor do, and beyond that lines of encoders.
const PER_TURN: [f64; 2] = [0.3, 40.0];
const LINES_PER_TURN: [f64; 2] = [40.0, 1_500.0];
/// Sums per turn.
const BINS_PER_TURN: f64 = 4_096.0;

/// Rows that are summed up where a frequency is looked for more closely, s, and how many lines are looked at in as much as
/// a session tells apart.
const IN_STEP_S: f64 = 0.1;
const LINES_APART: f64 = 8.0;

/// What is bent or runs out; poles and slots of motors, and what they make together; lines of their encoders, and periods of scales, um.
const OF_SCREWS: [f64; 2] = [1.0, 2.0];
const OF_MOTORS: [f64; 8] = [4.0, 6.0, 8.0, 10.0, 12.0, 18.0, 24.0, 36.0];
const USUAL_LINES: [f64; 6] = [64.0, 128.0, 256.0, 512.0, 1_024.0, 2_048.0];
const USUAL_PERIODS_UM: [f64; 2] = [4.0, 20.0];
/// Of what is usual this share is tried: what most is left at. An effect that is small makes no peak, but leaves more than nothing.
const TRIED: f64 = 0.5;

/// What a model leaves of a run.
struct Left {
    /// Whitened, by signal.
    in_time: Vec<Vec<f64>>,
    /// The same summed up by where the motor was: whichever way it went, and with the sign of the way.
    by_place: [Vec<Vec<f64>>; 2],
    /// The deflection, summed up by where the table was: it is behind the motor by more than a line of its scale.
    by_table: Vec<Vec<f64>>,
    /// Of its current, with the sign of the way.
    by_way: Vec<[f64; 2]>,
}

/// What a model leaves of all runs, in time and along the screw, looked through once.
#[derive(Debug)]
pub struct Peaks {
    hz: Vec<f64>,
    /// Of these the one that stands out most, where it does so by as much as in one run.
    loudest_hz: Option<f64>,
    per_turn: Vec<f64>,
    /// Of what turns its sign with the way.
    per_turn_by_way: Vec<f64>,
    /// Lines of a scale of the table, and of an encoder of the motor.
    lines_per_turn: [Vec<f64>; 2],
    /// Of what is usual for motors and for encoders, where most is left.
    of_motors: Vec<f64>,
    usual_lines: Vec<f64>,
    lead_m: f64,
    /// Where friction is not what it is about there.
    spots_mm: Vec<f64>,
    /// Between which places the axis went, m.
    span_m: [f64; 2],
    /// From the first row of all runs to the last, s.
    session_s: f64,
}

impl Peaks {
    /// Of a model.
    pub fn new(problem: &Problem<'_>, model: &Model) -> Self {
        let lead_m = model.nominal.mechanics.lead_m;
        let before_it = problem.noises[..DEFLECTION].iter().flatten().count();
        let of_run = |place: usize| {
            let simulated = problem.simulated(place, model);
            let in_time = problem.whitened(place, &simulated, Part::Fit);
            let positions = positions(&simulated, problem.data[place].course.setpoints_m());
            let by_place = |sign: &dyn Fn(f64) -> f64| -> Vec<Vec<f64>> {
                in_time.iter().map(|signal| by_bins(signal, &positions, sign, lead_m)).collect()
            };
            let by_place = [by_place(&|_| 1.0), by_place(&f64::signum)];
            let by_way = spots::by_way(problem, place, &simulated, &positions);
            let tables: Vec<f64> =
                positions.iter().zip(&simulated.deflection_m).map(|(motor, behind)| motor - behind).collect();
            let with_table = problem.has_table().then(|| &in_time[before_it]);
            let by_table = with_table.map(|values| by_bins(values, &tables, &|_| 1.0, lead_m));
            Left { in_time, by_place, by_table: by_table.into_iter().collect(), by_way }
        };
        let runs: Vec<Left> = problem.places(Part::Fit).into_par_iter().map(of_run).collect();
        let period_s = problem.period_s();
        let places = problem.places(Part::Fit).into_iter();
        let span_m = places
            .flat_map(|place| problem.data[place].course.setpoints_m())
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)]);
        let spans_s = problem.spans_s();
        let session_s = session_s(&spans_s);
        let begins_s = problem.places(Part::Fit).into_iter().map(|place| spans_s[place][0]);
        let timed: Vec<(f64, &Vec<Vec<f64>>)> = begins_s.zip(runs.iter().map(|run| &run.in_time)).collect();
        let frequencies = |peaks: Vec<(f64, f64)>| peaks.into_iter().map(|(at, _)| at).collect();
        let hz = Spectra::of(&runs, 1.0 / period_s, |run| &run.in_time).peaks(HZ);
        let is_loud = hz.first().is_some_and(|(_, ratio)| *ratio > ABOVE);
        let hz = hz.into_par_iter().map(|(hz, _)| in_step(hz, &timed, period_s, session_s));
        let hz: Vec<f64> = hz.collect();
        let whichever_way = Spectra::of(&runs, BINS_PER_TURN, |run| &run.by_place[0]);
        let by_way = Spectra::of(&runs, BINS_PER_TURN, |run| &run.by_place[1]);
        let of_table = Spectra::of(&runs, BINS_PER_TURN, |run| &run.by_table);
        let per_turn_of = |period_um: f64| 1e6 * lead_m / period_um;
        let lines = USUAL_LINES.into_iter().chain(USUAL_PERIODS_UM.map(per_turn_of)).collect();
        Self {
            session_s,
            loudest_hz: hz.first().copied().filter(|_| is_loud),
            hz,
            of_motors: loudest(OF_MOTORS.to_vec(), &[&whichever_way, &by_way]),
            usual_lines: loudest(lines, &[&whichever_way, &of_table]),
            per_turn: frequencies(whichever_way.peaks(PER_TURN)),
            per_turn_by_way: frequencies(by_way.peaks(PER_TURN)),
            lines_per_turn: [of_table, whichever_way].map(|of| frequencies(of.peaks(LINES_PER_TURN))),
            lead_m,
            spots_mm: spots::furthest_mm(&runs.iter().map(|run| run.by_way.as_slice()).collect::<Vec<_>>()),
            span_m,
        }
    }

    /// Values of a parameter that they suggest, with those that are usual for motors, along a screw, a way and a session:
    /// what is small makes no peak. Nothing for other keys.
    pub fn of(&self, parameter: &Parameter) -> Vec<f64> {
        let all_per_turn = || self.per_turn.iter().chain(&self.per_turn_by_way);
        match parameter.key {
            "frequency-hz" => self.hz.clone(),
            "periods-per-turn" if parameter.is_whole => {
                all_per_turn().chain(&OF_SCREWS).chain(&self.of_motors).copied().collect()
            }
            // Of balls that roll, which is friction.
            "periods-per-turn" => self.per_turn_by_way.iter().copied().chain([parameter.nominal]).collect(),
            "period-mm" => all_per_turn()
                .map(|per_turn| 1e3 * self.lead_m / per_turn)
                .chain([1.0, 0.5, 6.0].map(|share| 1e3 * share * self.lead_m))
                .chain([1.0, 0.67, 0.4].map(|share| 1e3 * share * (self.span_m[1] - self.span_m[0])))
                .collect(),
            "time-constant-s" => [0.15, 0.5, 1.5].map(|share| share * self.session_s).to_vec(),
            "centre-mm" => self.spots_mm.clone(),
            "period-um" => {
                let [of_table, of_motor] = &self.lines_per_turn;
                let per_turn = of_table.iter().chain(&self.per_turn).chain(of_motor).chain(&self.usual_lines);
                per_turn.map(|per_turn| 1e6 * self.lead_m / per_turn).collect()
            }
            _ => Vec::new(),
        }
    }
}

impl Peaks {
    /// The frequency in time that stands out most, and plainly: clocks are set by it.
    pub(super) fn loudest_hz(&self) -> Option<f64> {
        self.loudest_hz
    }
}

/// Spectra of what is left, of each signal that of all runs, each run as loud as another.
struct Spectra {
    powers: Vec<Vec<f64>>,
    /// Values to a unit.
    per_unit: f64,
    runs: usize,
}

impl Spectra {
    fn of(runs: &[Left], per_unit: f64, of_run: fn(&Left) -> &[Vec<f64>]) -> Self {
        let of_signal = |signal: usize| {
            let sums = runs.iter().map(|run| of_run(run)[signal].as_slice());
            evened(&sums.collect::<Vec<_>>())
        };
        let signals = runs.first().map_or(0, |run| of_run(run).len());
        Self { powers: (0..signals).filter_map(of_signal).collect(), per_unit, runs: runs.len() }
    }

    fn step(&self, power: &[f64]) -> f64 {
        self.per_unit / (2 * power.len()) as f64
    }

    /// Those within a range that stand out most, and how many times what is about them they are.
    fn peaks(&self, range: [f64; 2]) -> Vec<(f64, f64)> {
        let tops = |power: &Vec<f64>| tops(power, self.step(power), range, above(self.runs));
        most_plain(self.powers.iter().flat_map(tops).collect())
    }

    /// Power at a frequency, of the signal that has most of it; that of noise is the same at all.
    fn power(&self, at: f64) -> f64 {
        let of_signal = |power: &Vec<f64>| {
            let line = (at / self.step(power)) as usize;
            let about = line.saturating_sub(1)..=line + 2;
            about.filter_map(|line| power.get(line).copied()).fold(0.0, f64::max)
        };
        self.powers.iter().map(of_signal).fold(0.0, f64::max)
    }
}

/// Those of some frequencies at which spectra have most power.
fn loudest(mut usual: Vec<f64>, spectra: &[&Spectra]) -> Vec<f64> {
    let power = |at: f64| spectra.iter().map(|one| one.power(at)).fold(0.0, f64::max);
    usual.sort_by(|a, b| power(*b).total_cmp(&power(*a)));
    usual.truncate((TRIED * usual.len() as f64).ceil() as usize);
    usual
}

/// The peaks that stand out most, each once, the most plain first.
fn most_plain(mut peaks: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    peaks.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut plain: Vec<(f64, f64)> = Vec::new();
    for peak in peaks {
        if plain.len() < PEAKS && plain.iter().all(|other| (peak.0 / other.0 - 1.0).abs() > SAME) {
            plain.push(peak);
        }
    }
    plain
}

/// The frequency near a peak at which all runs of a session swing in step: what goes on between them keeps its phase, so it
/// is told from them all as closely as from one run as long as the session.
fn in_step(hz: f64, runs: &[(f64, &Vec<Vec<f64>>)], period_s: f64, session_s: f64) -> f64 {
    let rows = ((IN_STEP_S / period_s) as usize).max(1);
    let turn = |hz: f64, time_s: f64| Complex::from_polar(1.0, -TAU * (hz * time_s).fract());
    let Some(longest) = runs.iter().flat_map(|(_, left)| left.iter().map(Vec::len)).max() else { return hz };
    let signals = runs.first().map_or(0, |(_, left)| left.len());
    // Turned back by the peak what is left swings slowly: sums of rows tell it as well.
    let slow = |signal: usize| {
        let of_run = |(begins_s, left): &(f64, &Vec<Vec<f64>>)| -> Vec<(f64, Complex<f64>)> {
            let by_block = left[signal].chunks(rows).enumerate().map(|(block, values)| {
                let at_s = |row: usize| begins_s + (block * rows + row) as f64 * period_s;
                let sum = values.iter().enumerate().map(|(row, value)| turn(hz, at_s(row)) * *value).sum();
                (at_s(values.len() / 2), sum)
            });
            by_block.collect()
        };
        runs.iter().flat_map(of_run).collect::<Vec<_>>()
    };
    let slow: Vec<Vec<(f64, Complex<f64>)>> = (0..signals).map(slow).collect();
    let power = |off_hz: f64| -> f64 {
        let of_signal = |sums: &Vec<(f64, Complex<f64>)>| {
            sums.iter().map(|(at_s, sum)| sum * turn(off_hz, *at_s)).sum::<Complex<f64>>().norm_sqr()
        };
        slow.iter().map(of_signal).sum()
    };
    let step_hz = 1.0 / (LINES_APART * session_s);
    let reach = (session_s * LINES_APART / (longest as f64 * period_s)).ceil() as i32;
    let offs_hz = (-reach..=reach).map(|line| f64::from(line) * step_hz);
    hz + offs_hz.max_by(|a, b| power(*a).total_cmp(&power(*b))).unwrap_or(0.0)
}

/// Least ratio of a peak where so many spectra are added: a sum of powers, by the cube root of which it is normal (Wilson and Hilferty
/// 1931), as noise has it in one line of a hundred thousand.
fn above(count: usize) -> f64 {
    let variance = 1.0 / (9.0 * count.max(1) as f64);
    let at = |deviations: f64| (1.0 - variance + deviations * variance.sqrt()).powi(3);
    ABOVE.min(at(DEVIATIONS) / at(0.0))
}

/// Sums of the rows by where they were, each with a sign of its way.
fn by_bins(values: &[f64], positions_m: &[f64], sign: &dyn Fn(f64) -> f64, lead_m: f64) -> Vec<f64> {
    let bin = |position_m: f64| (position_m / lead_m * BINS_PER_TURN).floor();
    let [low, high] = positions_m
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(bin(*at)), high.max(bin(*at))]);
    let mut sums = vec![0.0; (high - low) as usize + 1];
    let ways = positions_m.windows(2).map(|pair| sign(pair[1] - pair[0]));
    for ((value, at), sign) in values.iter().zip(positions_m).zip(ways) {
        sums[(bin(*at) - low) as usize] += sign * value;
    }
    sums
}

fn positions(simulated: &Signals, setpoints_m: impl Iterator<Item = f64>) -> Vec<f64> {
    setpoints_m.zip(&simulated.following_error_m).map(|(setpoint, error)| setpoint - error).collect()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::offline::gap::measure::power::power;

    #[test]
    fn a_loud_run_hides_no_line_of_another() {
        const LINE: usize = 50;
        // Half as loud as what is about it, and a stretch of ten that outweighs all of the others a thousand times.
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut chance = || random.random_range(-1.0..1.0);
        let swing = |row: usize| 0.5 * (TAU * LINE as f64 * row as f64 / 4_096.0).sin();
        let quiet: Vec<f64> = (0..4_096).map(|row| swing(row) + chance()).collect();
        let loud: Vec<f64> = (0..4_096).map(|row| if row < 10 { 1e4 * chance() } else { 0.0 }).collect();
        let step = 4_096.0 / 8_192.0;
        let found =
            |power: Option<Vec<f64>>| most_plain(tops(&power.expect("values"), step, [20.0, 200.0], ABOVE));
        assert!(found(power(&[&quiet, &loud])).is_empty());
        let peaks = found(evened(&[&quiet, &loud]));
        assert!((peaks[0].0 - LINE as f64).abs() < 1.0, "{peaks:?}");
    }

    #[test]
    fn what_every_run_has_a_little_of_is_a_peak() {
        const LINE: usize = 50;
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut runs = |share: f64| -> Vec<Vec<f64>> {
            let mut value = |row: usize| {
                share * (TAU * LINE as f64 * row as f64 / 4_096.0).sin() + random.random_range(-1.0..1.0)
            };
            (0..8).map(|_| (0..4_096).map(&mut value).collect()).collect()
        };
        let found = |runs: &[Vec<f64>], above: f64| -> Vec<(f64, f64)> {
            let power = evened(&runs.iter().map(Vec::as_slice).collect::<Vec<_>>()).expect("values");
            most_plain(tops(&power, 0.5, [20.0, 200.0], above))
        };
        let swinging = runs(0.04);
        assert!(found(&swinging, ABOVE).is_empty());
        assert_eq!(found(&swinging, above(8)).len(), 1);
        assert!((found(&swinging, above(8))[0].0 - LINE as f64).abs() < 1.0);
        assert!(found(&runs(0.0), above(8)).is_empty());
        assert_eq!(above(1), ABOVE);
    }

    #[test]
    fn of_what_is_usual_that_is_tried_at_which_most_is_left() {
        // Too little for a peak: a fiftieth of the noise.
        let runs = |order: f64| {
            let mut random = Pcg64Mcg::seed_from_u64(1);
            let mut value = |bin: usize| {
                (TAU * order * bin as f64 / BINS_PER_TURN).sin() / 90.0 + random.random_range(-1.0..1.0)
            };
            let mut run = |_| Left {
                in_time: Vec::new(),
                by_place: [vec![(0..30_000).map(&mut value).collect()], Vec::new()],
                by_table: Vec::new(),
                by_way: Vec::new(),
            };
            (0..4).map(&mut run).collect::<Vec<_>>()
        };
        for order in [8.0, 36.0] {
            let spectra = Spectra::of(&runs(order), BINS_PER_TURN, |run| &run.by_place[0]);
            assert!(spectra.peaks(PER_TURN).iter().all(|(peak, _)| (peak / order - 1.0).abs() > SAME));
            let tried = loudest(OF_MOTORS.to_vec(), &[&spectra]);
            assert!(tried.len() == 4 && tried.contains(&order), "{order}: {tried:?}");
        }
    }

    #[test]
    fn what_turns_with_the_way_has_its_peak_where_the_way_counts() {
        const LEAD_M: f64 = 0.01;
        let (order, rows) = (6.616, 40_000);
        // Five turns there and back again, four times, and noise twice as loud.
        let turns = |row: usize| 2.5 * (1.0 - (TAU * row as f64 / 10_000.0).cos());
        let positions_m: Vec<f64> = (0..rows).map(|row| LEAD_M * turns(row)).collect();
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let value = |row: usize| {
            let way = (TAU * row as f64 / 10_000.0).sin().signum();
            way * (TAU * order * turns(row)).sin() + random.random_range(-3.5..3.5)
        };
        let values: Vec<f64> = (0..rows).map(value).collect();
        let peaks = |sign: &dyn Fn(f64) -> f64| {
            let power = evened(&[&by_bins(&values, &positions_m, sign, LEAD_M)]).expect("values");
            most_plain(tops(&power, BINS_PER_TURN / (2 * power.len()) as f64, PER_TURN, ABOVE))
        };
        let found = peaks(&f64::signum);
        assert!((found[0].0 / order - 1.0).abs() < SAME, "{found:?}");
        let whichever = peaks(&|_| 1.0);
        assert!(whichever.iter().all(|(other, _)| (other / order - 1.0).abs() > SAME), "{whichever:?}");
    }

    #[test]
    fn runs_of_one_session_tell_a_frequency_together() {
        let (hz, period_s) = (49.16, 5e-4);
        let run = |begins_s: f64| -> Vec<Vec<f64>> {
            let at = |row: i32| (TAU * hz * (begins_s + f64::from(row) * period_s) + 0.7).sin();
            vec![(0..10_000).map(at).collect()]
        };
        let begins_s = [0.0, 13.3, 31.9, 55.0];
        let left: Vec<Vec<Vec<f64>>> = begins_s.map(run).to_vec();
        let timed: Vec<(f64, &Vec<Vec<f64>>)> = begins_s.into_iter().zip(&left).collect();
        let found = in_step(49.2, &timed, period_s, 60.0);
        // One run alone is 5 s long.
        assert!((found - hz).abs() < 2e-3, "{found}");
    }
}
