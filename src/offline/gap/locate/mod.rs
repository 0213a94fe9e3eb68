//! Where the gap lives: the coordinate over which what a model leaves has a shape, and the runs in which it is large.
//!
//! ```text
//!   rows ──► bins of a coordinate ──► means of what is left ──► share of its variance that the means explain
//!                                 └──► the same with what is left shifted along its run: what chance explains
//! ```
//!
//! Runs repeat themselves, and what is left remembers itself; shifted along its run it keeps that and loses the
//! coordinate.
//! Invariant: a coordinate that is told explains more than any of the shifts.

mod along;
pub mod behind;
pub(super) mod bursts;
pub(super) mod foretold;
pub mod rest;
mod tones;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use crate::offline::gap::measure::forward::Signals;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::Loss;
use crate::offline::gap::model::problem::{Problem, SIGNALS};
use crate::plant::effects::Coordinate;

/// Bins of a coordinate.
const BINS: usize = 24;
/// Shifts that stand for chance.
const SHIFTS: usize = 20;
/// Below this share of the variance a shape is none that tells anything.
const LEAST: f64 = 0.02;
/// Slower than this is standing, m/s.
const STANDING_M_PER_S: f64 = 1e-6;

/// A coordinate over which a signal has a shape.
#[derive(Clone, Debug)]
pub struct Located {
    /// Place of the signal in [`SIGNALS`].
    pub signal: usize,
    /// Over what.
    pub coordinate: Coordinate,
    /// Share of the variance of what the base leaves that its means explain, beyond chance.
    pub share: f64,
    /// How many standard deviations of chance that is.
    pub deviations: f64,
    /// Middle of each bin in the unit of the coordinate, and what base and named model leave there on average.
    pub profile: Vec<[f64; 3]>,
}

/// How much is left of a signal of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunLeft {
    /// Which run.
    pub run: usize,
    /// Place of the signal in [`SIGNALS`].
    pub signal: usize,
    /// Cost per row of the base and of the named model; noise is 1.
    pub per_row: [f64; 2],
}

/// Coordinates that tell something, with their unit.
const COORDINATES: [(Coordinate, &str); 9] = [
    (Coordinate::Position, "mm"),
    (Coordinate::Velocity, "mm/s"),
    (Coordinate::Direction, ""),
    (Coordinate::Angle, "turns"),
    (Coordinate::WaySinceReversal, "mm"),
    (Coordinate::TimeSinceReversal, "s"),
    (Coordinate::Acceleration, "m/s2"),
    (Coordinate::Current, "A"),
    (Coordinate::Time, "s"),
];

/// The unit of a profile.
pub fn unit(coordinate: Coordinate) -> &'static str {
    COORDINATES.iter().find(|(own, _)| *own == coordinate).map_or("", |(_, unit)| unit)
}

/// What base and named model make of all runs, in their order.
pub type Both = Vec<[Signals; 2]>;

/// Simulates all runs with both.
pub fn both(problem: &Problem<'_>, base: &Model, named: &Model) -> Both {
    let of = |place: usize| [base, named].map(|model| problem.simulated(place, model));
    (0..problem.data.len()).into_par_iter().map(of).collect()
}

/// The coordinates over which what the base leaves has a shape, that with the most first; the named model is shown
/// beside it.
pub fn located(problem: &Problem<'_>, both: &Both) -> Vec<Located> {
    let rows = (0..problem.data.len()).into_par_iter();
    let rows: Vec<Rows> = rows.map(|place| Rows::new(problem, &both[place], place)).collect();
    let all = (0..SIGNALS.len()).flat_map(|signal| (0..COORDINATES.len()).map(move |over| (signal, over)));
    let all: Vec<(usize, usize)> = all.collect();
    let mut found: Vec<Located> =
        all.into_par_iter().filter_map(|(signal, over)| shape(&rows, signal, over)).collect();
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    found
}

/// What is left of each signal of each run.
pub fn runs_left(problem: &Problem<'_>, both: &Both) -> Vec<RunLeft> {
    let of = |place: usize| {
        let simulated = &both[place];
        let per_row = |signal: usize| {
            let noise = problem.noises[signal].as_ref()?;
            let data = &problem.data[place];
            let per_row = simulated.each_ref().map(|simulated| {
                let (mut sum, mut count) = (0.0, 0usize);
                for part in [Part::Fit, Part::Held].into_iter().filter(|part| data.has(*part)) {
                    let white = noise.whitened(&problem.left(place, simulated, signal, part));
                    for ((value, counts), loud) in
                        white.iter().zip(data.rows(part)).zip(&data.loudness[signal])
                    {
                        if *counts {
                            sum += Loss::LAST.of(*value / loud);
                            count += 1;
                        }
                    }
                }
                sum / count as f64
            });
            per_row[0].is_finite().then_some(RunLeft { run: data.run, signal, per_row })
        };
        (0..SIGNALS.len()).filter_map(per_row).collect::<Vec<_>>()
    };
    (0..problem.data.len()).into_par_iter().flat_map_iter(of).collect()
}

/// Coordinates of a row, in the order of [`COORDINATES`].
pub(super) type Coordinates = [f64; COORDINATES.len()];

/// Where in [`COORDINATES`] one stands.
pub(super) fn place_of(coordinate: Coordinate) -> usize {
    COORDINATES.iter().position(|(own, _)| *own == coordinate).unwrap_or_default()
}

/// The coordinates of each row of a run.
pub(super) fn coordinates(problem: &Problem<'_>, place: usize) -> Vec<Coordinates> {
    let data = &problem.data[place];
    let period_s = problem.period_s();
    let lead_m = problem.machine.axes[problem.id].plant.mechanics.lead_m;
    let setpoints_m: Vec<f64> = data.course.setpoints_m().collect();
    let start_s = data.course.begins().as_s();
    let (mut way_m, mut since_s, mut side) = (0.0, 0.0, 0.0);
    let mut coordinates = Vec::with_capacity(setpoints_m.len());
    for row in 0..setpoints_m.len() {
        let at = |row: usize| setpoints_m[row.min(setpoints_m.len() - 1)];
        let velocity = (at(row + 1) - at(row.saturating_sub(1))) / (2.0 * period_s);
        let later = (at(row + 9) - at(row + 7)) / (2.0 * period_s);
        let is_moving = velocity.abs() > STANDING_M_PER_S;
        if is_moving && velocity.signum() != side {
            (way_m, since_s, side) = (0.0, 0.0, velocity.signum());
        }
        way_m += velocity.abs() * period_s;
        since_s += period_s;
        let position_m = setpoints_m[row] - data.measured.following_error_m[row];
        coordinates.push([
            1e3 * position_m,
            1e3 * velocity,
            if is_moving { side } else { 0.0 },
            (position_m / lead_m).rem_euclid(1.0),
            1e3 * way_m,
            since_s,
            (later - velocity) / (8.0 * period_s),
            data.measured.current_a[row].abs(),
            start_s + row as f64 * period_s,
        ]);
    }
    coordinates
}

/// The rows of a run that count, with their coordinates.
struct Rows {
    coordinates: Vec<Coordinates>,
    /// By signal: what base and named model leave.
    left: [Vec<[f64; 2]>; SIGNALS.len()],
}

impl Rows {
    fn new(problem: &Problem<'_>, simulated: &[Signals; 2], place: usize) -> Self {
        let data = &problem.data[place];
        let coordinates = coordinates(problem, place);
        let counts = |row: &usize| data.fit[*row] || data.held[*row];
        let part = data.main_part();
        let left = std::array::from_fn(|signal| {
            let [before, after] =
                simulated.each_ref().map(|simulated| problem.left(place, simulated, signal, part));
            (0..before.len()).filter(counts).map(|row| [before[row], after[row]]).collect()
        });
        let coordinates = (0..coordinates.len()).filter(counts).map(|row| coordinates[row]).collect();
        Self { coordinates, left }
    }
}

/// The shape of a signal over a coordinate, if it has one.
fn shape(runs: &[Rows], signal: usize, over: usize) -> Option<Located> {
    let of = |run: &Rows| run.coordinates.iter().map(|row| row[over]).collect::<Vec<f64>>();
    let runs: Vec<(Vec<f64>, &[[f64; 2]])> = runs
        .iter()
        .map(|run| (of(run), run.left[signal].as_slice()))
        .filter(|(_, left)| !left.is_empty())
        .collect();
    let mut sorted: Vec<f64> = runs.iter().flat_map(|(values, _)| values.iter().copied()).collect();
    if sorted.is_empty() {
        return None;
    }
    sorted.sort_by(f64::total_cmp);
    // As many rows in each; values that are the same stay together.
    let mut ends: Vec<f64> = (1..BINS).map(|bin| sorted[bin * sorted.len() / BINS]).collect();
    ends.dedup();
    let binned: Vec<(Vec<usize>, &[[f64; 2]])> = runs
        .iter()
        .map(|(values, left)| {
            (values.iter().map(|value| ends.partition_point(|end| end <= value)).collect(), *left)
        })
        .collect();
    let bins = ends.len() + 1;
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let found = explained(&binned, bins, |_| 0);
    let chance: Vec<f64> = (0..SHIFTS)
        .map(|_| explained(&binned, bins, |rows| random.random_range(rows / 8..rows - rows / 8)))
        .collect();
    let usual = chance.iter().sum::<f64>() / SHIFTS as f64;
    if chance.iter().any(|chance| *chance >= found) || found - usual < LEAST {
        return None;
    }
    let variance = chance.iter().map(|chance| (chance - usual).powi(2)).sum::<f64>() / (SHIFTS - 1) as f64;
    let mut sums = vec![[0.0; 4]; bins];
    for ((bins, left), (values, _)) in binned.iter().zip(&runs) {
        for ((bin, [before, after]), value) in bins.iter().zip(*left).zip(values) {
            let sum = &mut sums[*bin];
            *sum = [sum[0] + value, sum[1] + before, sum[2] + after, sum[3] + 1.0];
        }
    }
    let profile = sums.into_iter().filter(|sum| sum[3] > 0.0).map(|[x, a, b, n]| [x / n, a / n, b / n]);
    Some(Located {
        signal,
        coordinate: COORDINATES[over].0,
        share: found - usual,
        deviations: (found - usual) / variance.sqrt().max(f64::MIN_POSITIVE),
        profile: profile.collect(),
    })
}

/// Share of the variance that the means of bins explain, with what is left shifted along its run by so many rows.
fn explained(runs: &[(Vec<usize>, &[[f64; 2]])], bins: usize, mut by: impl FnMut(usize) -> usize) -> f64 {
    let (mut sums, mut whole) = (vec![[0.0; 2]; bins], 0.0);
    for (bins, left) in runs {
        let shift = by(left.len().max(8));
        for (row, bin) in bins.iter().enumerate() {
            let [value, _] = left[(row + shift) % left.len()];
            sums[*bin] = [sums[*bin][0] + value, sums[*bin][1] + 1.0];
            whole += value * value;
        }
    }
    let means = sums.iter().filter(|sum| sum[1] > 0.0).map(|[sum, count]| sum * sum / count);
    means.sum::<f64>() / f64::max(whole, f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    const ROWS: usize = 8_000;

    /// A run that goes back and forth, with what is left by its place and noise.
    fn run(seed: u64, left: impl Fn(f64, f64) -> f64, forgets: f64) -> Rows {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut noise = 0.0;
        let (mut coordinates, mut of_first) = (Vec::new(), Vec::new());
        for row in 0..ROWS {
            let at = row as f64;
            let place = (0.005_71 * at).sin() + 0.3 * (0.002_13 * at).sin();
            let white: f64 = StandardNormal.sample(&mut random);
            noise += (white - noise) * forgets;
            let mut of_row = [0.0; COORDINATES.len()];
            of_row[place_of(Coordinate::Position)] = place;
            coordinates.push(of_row);
            of_first.push([left(place, noise), 0.0]);
        }
        Rows { coordinates, left: [of_first, Vec::new(), Vec::new()] }
    }

    fn found(run: Rows) -> Option<Located> {
        shape(&[run], 0, place_of(Coordinate::Position))
    }

    #[test]
    fn a_shape_is_many_deviations_of_chance_and_noise_that_is_slow_is_few() {
        let shape = found(run(1, |place, noise| 0.5 * (TAU * place).sin() + noise, 1.0)).expect("a shape");
        assert!((0.08..0.14).contains(&shape.share) && shape.deviations > 7.0, "{shape:?}");
        let slow: Vec<Located> =
            (0..40).filter_map(|seed| found(run(seed, |_, noise| noise, 1e-2))).collect();
        let most = slow.iter().map(|slow| slow.share).fold(0.0, f64::max);
        assert!(most > shape.share, "a share of {most} by chance");
        assert!(slow.iter().all(|slow| slow.deviations < 7.0), "{slow:?}");
    }
}
