//! What comes and goes by itself: a tool that cuts, a cover that catches, a hand. It pushes at other moments in each pass, so that what
//! passes differ by takes it for noise; and it pushes while the axis slides along, where stick and slip differ by nothing.
//!
//! ```text
//!   what is left ──► blocks in which the axis has long been moving ──► their power over that of usual noise ──► runs with such blocks
//! ```
//!
//! Whitened it hardly shows, for it is slow against the noise of single rows: it is looked for as it was measured.
//! Invariant: what happened in few of the runs is no property of a machine.

use rayon::prelude::*;

use super::model::Model;
use super::problem::{Problem, SIGNALS};
use super::rest::{Rest, Shows};

/// A push is shorter than a second, and longer than a few rows. s.
const BLOCK_S: f64 = 0.1;
/// How long an axis has been moving until what happened as it set out is over, s.
const SINCE_S: f64 = 0.5;
/// Power of a block in which something pushes, in units of that of usual noise: where nothing does the loudest of thousands were 2.
const LOUD: f64 = 12.0;
/// Share of the runs that have such blocks, and fewest of them: once somebody may have leaned on the table.
const RUNS: (f64, usize) = (0.5, 3);
/// Fewer blocks of a run tell nothing.
const LEAST_BLOCKS: usize = 10;

/// The first signal in which most runs are pushed.
pub(super) fn bursts(problem: &Problem<'_>, model: &Model) -> Option<Rest> {
    let places = (0..problem.data.len()).into_par_iter();
    let pushed: Vec<[Option<bool>; SIGNALS.len()]> =
        places.map(|place| pushed(problem, model, place)).collect();
    (0..SIGNALS.len()).find_map(|signal| {
        let told: Vec<bool> = pushed.iter().filter_map(|run| run[signal]).collect();
        let count = told.iter().filter(|pushed| **pushed).count();
        let is_of_machine = count >= RUNS.1 && count as f64 >= RUNS.0 * told.len() as f64;
        is_of_machine.then_some(Rest::In { signal, shows: Shows::Bursts([count, told.len()]) })
    })
}

/// Whether something pushes in a run, by signal; nothing where it does not tell.
fn pushed(problem: &Problem<'_>, model: &Model, place: usize) -> [Option<bool>; SIGNALS.len()] {
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
        is_loud(&left, &steady, noise.rms, problem.rows_in(BLOCK_S))
    })
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
}
