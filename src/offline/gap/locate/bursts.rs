//! What comes and goes by itself: a tool that cuts, a cover that catches, a hand. It pushes at other moments in each pass, so that what
//! passes differ by takes it for noise; and it pushes while the axis slides along, where stick and slip differ by nothing.
//!
//! ```text
//!   what is left ──► blocks in which the axis has long been moving ──► their power over that of usual noise ──► runs with such blocks
//! ```
//!
//! Whitened it hardly shows, for it is slow against the noise of single rows: it is looked for as it was measured. A reading that
//! jumps does the same in a single row: an encoder that slips a count, a drive that drops a sample.
//! Invariant: what happened in few of the runs is no property of a machine.

use rayon::prelude::*;

use super::rest::{Rest, Shows};
use crate::offline::gap::model::Model;
use crate::offline::gap::model::problem::{Problem, SIGNALS};
use crate::offline::median::median;

/// A push is shorter than a second, and longer than a few rows. s.
const BLOCK_S: f64 = 0.1;
/// How long an axis has been moving until what happened as it set out is over, s.
const SINCE_S: f64 = 0.5;
/// Power of a block in which something pushes, in units of that of usual noise: where nothing does the loudest of thousands were 2.
const LOUD: f64 = 12.0;
/// A reading is held against the middle of so many rows to either side, and jumps where it is so many standard deviations of single rows
/// away, and so many times as far as noise: where nothing does the furthest of hundreds of thousands was 6.
const ASIDE: usize = 10;
const JUMPS: [f64; 2] = [10.0, 4.0];
/// What follows from it in the loops is over in so many rows; all others are nearer by this factor.
const NEAR: usize = 2;
const ALONE: f64 = 3.0;
/// Share of the runs that have such blocks, and fewest of them: once somebody may have leaned on the table.
const RUNS: (f64, usize) = (0.5, 3);
/// Fewer blocks of a run tell nothing.
const LEAST_BLOCKS: usize = 10;

/// The first signal in which most runs are pushed, or in which readings of most jump.
pub(in crate::offline::gap) fn bursts(problem: &Problem<'_>, model: &Model) -> Option<Rest> {
    let places = (0..problem.data.len()).into_par_iter();
    let told: Vec<[Option<Told>; SIGNALS.len()]> = places.map(|place| told(problem, model, place)).collect();
    let of_most = |signal: usize, is_so: fn(&Told) -> bool| {
        let runs: Vec<bool> = told.iter().filter_map(|run| run[signal].as_ref().map(is_so)).collect();
        let count = runs.iter().filter(|is_so| **is_so).count();
        let is_of_machine = count >= RUNS.1 && count as f64 >= RUNS.0 * runs.len() as f64;
        is_of_machine.then_some([count, runs.len()])
    };
    (0..SIGNALS.len()).find_map(|signal| {
        let pushed = of_most(signal, |told| told.is_pushed).map(Shows::Bursts);
        let shows = pushed.or_else(|| of_most(signal, |told| told.jumps).map(Shows::Jumps))?;
        Some(Rest::In { signal, shows })
    })
}

/// What a signal of a run tells.
struct Told {
    is_pushed: bool,
    jumps: bool,
}

/// Whether something pushes in a run, or readings jump, by signal; nothing where it does not tell.
fn told(problem: &Problem<'_>, model: &Model, place: usize) -> [Option<Told>; SIGNALS.len()] {
    let (data, simulated) = (&problem.data[place], problem.simulated(place, model));
    let part = data.main_part();
    let steady: Vec<bool> = problem
        .has_moved(data, model, SINCE_S)
        .zip(data.rows(part))
        .map(|(moves, counts)| moves && *counts)
        .collect();
    std::array::from_fn(|signal| {
        let noise = problem.noises[signal].as_ref()?;
        let left = problem.left(place, &simulated, signal, part);
        let is_pushed = is_loud(&left, &steady, noise.rms, problem.rows_in(BLOCK_S))?;
        Some(Told { is_pushed, jumps: jumps(&left, &steady, noise.rms) })
    })
}

/// Whether any reading of a steady row jumps. What a model leaves moves slowly: the middle of the rows about a row knows it, and where
/// something rings they are as far from it.
fn jumps(left: &[f64], steady: &[bool], noise: f64) -> bool {
    let whole = left.windows(2 * ASIDE + 1).zip(steady.windows(2 * ASIDE + 1));
    let aside = whole.filter(|(_, steady)| !steady.contains(&false)).filter_map(|(rows, _)| {
        let middle = median(&mut rows.to_vec())?;
        let about = rows[..ASIDE - NEAR].iter().chain(&rows[ASIDE + NEAR + 1..]);
        let furthest = about.fold(0.0, |far: f64, value| far.max((value - middle).abs()));
        Some(((rows[ASIDE] - middle).abs(), furthest))
    });
    let aside: Vec<(f64, f64)> = aside.collect();
    // Half of what is normal is within 0.6745 standard deviations.
    let mut all: Vec<f64> = aside.iter().map(|(aside, _)| *aside).collect();
    let deviation = median(&mut all).unwrap_or_default() / 0.6745;
    let least = (JUMPS[0] * deviation).max(JUMPS[1] * noise);
    aside.iter().any(|(aside, furthest)| *aside > least.max(ALONE * furthest))
}

/// Whether any block of so many rows that all are steady is loud; nothing where there are too few.
fn is_loud(left: &[f64], steady: &[bool], noise: f64, length: usize) -> Option<bool> {
    let blocks = left.chunks_exact(length).zip(steady.chunks_exact(length));
    let power = |block: &[f64]| block.iter().map(|value| (value / noise).powi(2)).sum::<f64>();
    let loud = blocks.filter(|(_, steady)| !steady.contains(&false)).map(|(left, _)| power(left));
    let loud: Vec<bool> = loud.map(|power| power > LOUD * length as f64).collect();
    (loud.len() >= LEAST_BLOCKS).then(|| loud.contains(&true))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_push_is_loud_while_an_axis_slides_along_and_tells_nothing_else() {
        const LENGTH: usize = 10;
        let noise = |row: usize| if row.is_multiple_of(2) { 1.0 } else { -1.0 };
        let left = |push: std::ops::Range<usize>| -> Vec<f64> {
            (0..200).map(|row| noise(row) + if push.contains(&row) { 6.0 } else { 0.0 }).collect()
        };
        let steady: Vec<bool> = (0..200).map(|row| row >= 60).collect();
        for (push, is_pushed) in [(100..108, true), (20..40, false), (100..102, false), (0..0, false)] {
            assert_eq!(is_loud(&left(push.clone()), &steady, 1.0, LENGTH), Some(is_pushed), "{push:?}");
        }
        assert_eq!(is_loud(&left(100..108)[..120], &steady, 1.0, LENGTH), None, "six blocks");
        assert_eq!(is_loud(&[], &steady, 1.0, LENGTH), None, "a signal that was not measured");
    }

    #[test]
    fn a_single_reading_jumps_and_a_slope_or_a_step_does_not() {
        // Noise of a standard deviation of about 1, on what a model leaves.
        let noise = |row: usize| ((row * 7919 % 101) as f64 / 50.0 - 1.0) * 1.7;
        let jumps = |left: &dyn Fn(usize) -> f64, steady: &dyn Fn(usize) -> bool| {
            let left: Vec<f64> = (0..400).map(|row| noise(row) + left(row)).collect();
            jumps(&left, &(0..400).map(steady).collect::<Vec<_>>(), 1.0)
        };
        let one = |row: usize| if row == 200 { 20.0 } else { 0.0 };
        assert!(jumps(&one, &|_| true));
        assert!(!jumps(&one, &|row| row > 205), "the axis has just set out");
        assert!(!jumps(&|row| 0.5 * row as f64, &|_| true));
        assert!(!jumps(&|row| if row < 200 { 0.0 } else { 30.0 }, &|_| true), "it slipped, and stays");
        let ringing = |row: usize| if row < 200 { 0.0 } else { 60.0 * (0.4 * (row - 200) as f64).sin() };
        assert!(!jumps(&ringing, &|_| true), "it rings for a while");
        // A coarse count, in which most rows are alike.
        let counts: Vec<f64> = (0..400).map(|row| if row % 37 == 0 { 1.0 } else { 0.0 }).collect();
        assert!(!super::jumps(&counts, &[true; 400], 0.29));
    }
}
