//! Clocks of runs: files that each begin at zero say nothing of when they were recorded.
//!
//! ```text
//!   what the base leaves ──► its loudest frequency in time ──► phase of each run ──► what its clock is behind that of the others
//! ```
//!
//! What swings with time keeps its phase through a session. Where runs have no common clock, or lie so far apart that nothing
//! swings as evenly from one to the next, theirs are set so that the loudest of it does: by less than a period of it, so that what
//! is slower is not told, and not lost. What grows tells of files that each begin at zero whether each is a session of its own, or
//! one began where the one before it ended, in the order in which they were given.
//! Invariant: runs of one session on one clock keep it.

use std::f64::consts::TAU;

use nalgebra::Complex;
use rayon::prelude::*;

use super::gain_of;
use super::spectrum::Peaks;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::linear::Linear;
use crate::offline::gap::model::problem::{Problem, Residual};
use crate::offline::gap::runs::{Run, session_s};

/// Runs of one clock are not at it at the same time for longer than this, s.
const OVERLAP_S: f64 = 0.1;
/// Runs lie so many times as long as they last from the begin of the first to the end of the last at most, or they are of no one
/// session: a pump keeps its frequency to a thousandth, not its phase for half an hour.
const APART: f64 = 5.0;
/// How closely a frequency is looked for: so many steps to either side, in lines of the longest run. A peak is up to two of them
/// off, for it was looked for as if the clocks were one.
const STEPS: i32 = 384;
const LINES_PER_STEP: f64 = 1.0 / 128.0;

/// Effects that grow with time.
const GROWING: [&str; 2] = ["friction-warm-up", "thermal-growth"];

/// Whether no two runs take place at the same time.
pub fn have_one(runs: &[Run]) -> bool {
    is_one(spans_s(runs))
}

/// When each run begins and ends by its own clock, s.
fn spans_s(runs: &[Run]) -> Vec<[f64; 2]> {
    runs.iter().map(|run| [run.start_s, run.start_s + run.duration_s()]).collect()
}

fn is_one(mut spans_s: Vec<[f64; 2]>) -> bool {
    spans_s.sort_by(|a, b| a[0].total_cmp(&b[0]));
    spans_s.windows(2).all(|pair| pair[1][0] > pair[0][1] - OVERLAP_S)
}

/// Where time begins, s: at zero, if the clock was there no longer before the first run than all runs take; else with the first run.
/// What swings, grows or gets warm began with the clock and not with the first file that is there.
pub(in crate::offline::gap) fn origin_s(runs: &[Run]) -> f64 {
    let spans_s = spans_s(runs);
    let first_s = spans_s.iter().map(|[begin_s, _]| *begin_s).fold(f64::INFINITY, f64::min);
    if (0.0..=session_s(&spans_s)).contains(&first_s) { 0.0 } else { first_s }
}

/// Whether runs lie no further apart than those of one session.
fn is_one_session(spans_s: &[[f64; 2]]) -> bool {
    session_s(spans_s) <= APART * spans_s.iter().map(|[begin_s, end_s]| end_s - begin_s).sum::<f64>()
}

/// What the clock of each run is behind, s; nothing where they have one, or nothing swings or grows.
pub(in crate::offline::gap) fn behind_s(problem: &Problem<'_>, model: &Model) -> Option<Vec<f64>> {
    let spans_s = problem.spans_s();
    let is_one = is_one(spans_s.clone());
    if is_one && is_one_session(&spans_s) {
        return None;
    }
    let growing_s = if is_one { None } else { growing_s(problem, model, &spans_s) };
    let swinging_s = match &growing_s {
        Some(behind_s) => swinging_s(&problem.with_clocks(behind_s), model),
        None => swinging_s(problem, model),
    };
    match (growing_s, swinging_s) {
        (Some(growing), Some(swinging)) => Some(growing.iter().zip(swinging).map(|(a, b)| a + b).collect()),
        (growing, swinging) => growing.or(swinging),
    }
}

/// By how much runs began later where one began as the one before it ended; nothing where what grows explains as much without it.
fn growing_s(problem: &Problem<'_>, model: &Model, spans_s: &[[f64; 2]]) -> Option<Vec<f64>> {
    let later_s = one_after_the_other_s(spans_s);
    let once = problem.first_passes();
    let here = Linear::widest(&once, model);
    let [alone, together] = [&once, &once.with_clocks(&later_s)].map(|once| gain_of(once, &here, &GROWING));
    (together > alone).then_some(later_s)
}

/// By how much runs began later where each file began as the one before it ended: where times go back there is another file.
fn one_after_the_other_s(spans_s: &[[f64; 2]]) -> Vec<f64> {
    let mut last_s = f64::NEG_INFINITY;
    let (mut later_s, mut ended_s) = (0.0, 0.0);
    let of = |[begin_s, end_s]: &[f64; 2]| {
        if *begin_s < last_s - OVERLAP_S {
            later_s = ended_s - begin_s;
        }
        (last_s, ended_s) = (*end_s, later_s + end_s);
        later_s
    };
    spans_s.iter().map(of).collect()
}

/// What the clock of each run is behind by what swings, s; nothing where nothing does.
fn swinging_s(problem: &Problem<'_>, model: &Model) -> Option<Vec<f64>> {
    let (period_s, spans_s) = (problem.period_s(), problem.spans_s());
    let near_hz = Peaks::new(problem, model).loudest_hz()?;
    let left: Vec<Residual> = (0..problem.data.len())
        .into_par_iter()
        .map(|place| problem.residual(place, model, problem.data[place].main_part()))
        .collect();
    let longest_s = problem.data.iter().map(|data| data.fit.len()).max()? as f64 * period_s;
    // Each run by itself: what it shows is as loud whatever its clock says.
    let loudness = |hz: f64| -> f64 {
        left.iter().flat_map(|run| lines(run, hz, period_s)).map(|line| line.norm_sqr()).sum()
    };
    let hz = loudest_near(near_hz, longest_s, loudness)?;
    Some(
        phases(&left, hz, period_s)
            .iter()
            .zip(&spans_s)
            .map(|(phase, [begins_s, _])| {
                // What the clock says already is no part of it.
                let behind = (phase / TAU - hz * begins_s).rem_euclid(1.0);
                behind / hz
            })
            .collect(),
    )
}

/// The loudest frequency near another, where the longest run lasts so long.
fn loudest_near(hz: f64, longest_s: f64, loudness: impl Fn(f64) -> f64 + Sync) -> Option<f64> {
    let at = |step: i32| {
        let hz = hz + f64::from(step) * LINES_PER_STEP / longest_s;
        (hz, loudness(hz))
    };
    let all = (-STEPS..=STEPS).into_par_iter().map(at);
    all.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(hz, _)| hz)
}

/// The line of a frequency in each signal of a run, from its own begin.
fn lines(run: &Residual, hz: f64, period_s: f64) -> Vec<Complex<f64>> {
    let turn = Complex::from_polar(1.0, -TAU * hz * period_s);
    let line = |signal: &Vec<f64>| {
        // Backwards, as a polynomial in the turn of a row.
        signal.iter().rev().fold(Complex::new(0.0, 0.0), |sum, value| sum * turn + value)
    };
    run.iter().map(line).collect()
}

/// The phase of each run against the loudest, rad.
fn phases(left: &[Residual], hz: f64, period_s: f64) -> Vec<f64> {
    let all: Vec<Vec<Complex<f64>>> = left.iter().map(|run| lines(run, hz, period_s)).collect();
    let power = |run: &Vec<Complex<f64>>| run.iter().map(Complex::norm_sqr).sum::<f64>();
    let Some(loudest) = all.iter().max_by(|a, b| power(a).total_cmp(&power(b))) else { return Vec::new() };
    let against = |run: &Vec<Complex<f64>>| -> f64 {
        run.iter().zip(loudest).map(|(line, other)| line * other.conj()).sum::<Complex<f64>>().arg()
    };
    all.iter().map(against).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;

    const PERIOD_S: f64 = 5e-4;

    #[test]
    fn runs_at_the_same_time_have_no_common_clock() {
        assert!(is_one(vec![[10.0, 15.0], [0.0, 9.0], [15.0, 16.0]]));
        assert!(!is_one(vec![[0.0, 5.0], [0.0, 6.0]]));
        assert!(is_one(Vec::new()));
    }

    #[test]
    fn time_begins_with_the_clock_where_that_was_set_for_these_runs() {
        let run =
            |start_s: f64| Run { start_s, ..Run::of_setpoints(PERIOD_S, [(AxisId::X, vec![0.0; 20_000])]) };
        let origin_s = |starts_s: &[f64]| origin_s(&starts_s.iter().copied().map(run).collect::<Vec<_>>());
        assert_eq!(origin_s(&[31.0, 12.0, 50.0]), 0.0, "the first file is left out");
        assert_eq!(origin_s(&[1.7e9, 1.7e9 + 12.0]), 1.7e9, "since 1970");
        assert_eq!(origin_s(&[-3.0, 12.0]), -3.0);
    }

    #[test]
    fn files_that_begin_at_zero_are_put_one_after_the_other() {
        let later_s = one_after_the_other_s(&[[0.5, 9.0], [10.0, 12.0], [0.0, 6.0], [1.0, 5.0], [6.0, 7.0]]);
        assert_eq!(later_s, [0.0, 0.0, 12.0, 17.0, 17.0]);
    }

    #[test]
    fn runs_of_half_an_hour_with_a_minute_of_motion_are_of_no_one_session() {
        assert!(is_one_session(&[[10.0, 15.0], [40.0, 50.0], [80.0, 81.0]]));
        assert!(!is_one_session(&[[24.0, 34.0], [933.0, 943.0], [1_778.0, 1_788.0]]));
    }

    #[test]
    fn a_peak_that_is_two_lines_off_is_found() {
        let (near_hz, longest_s) = (33.144, 40.0);
        for lines in [-1.9, 0.3, 1.9] {
            let hz = near_hz + lines / longest_s;
            let found = loudest_near(near_hz, longest_s, |at| -(at - hz).abs()).expect("a frequency");
            assert!((found - hz).abs() < LINES_PER_STEP / longest_s, "{found} Hz, {hz}");
        }
    }

    #[test]
    fn what_swings_has_in_each_run_the_phase_of_its_begin() {
        let (hz, rows) = (40.3, [8_000, 11_000, 5_000]);
        let begins_s = [0.0, 31.237, 60.004];
        let run = |(rows, begin_s): (usize, f64)| -> Residual {
            let swing = |row: usize, by: f64| (TAU * hz * (begin_s + row as f64 * PERIOD_S) + by).cos();
            vec![
                (0..rows).map(|row| swing(row, 0.3)).collect(),
                (0..rows).map(|row| 0.2 * swing(row, 1.9)).collect(),
            ]
        };
        let left: Vec<Residual> = rows.into_iter().zip(begins_s).map(run).collect();
        let phases = phases(&left, hz, PERIOD_S);
        for (phase, begin_s) in phases.iter().zip(begins_s) {
            // The second is the loudest.
            let off = (phase / TAU - hz * (begin_s - begins_s[1])).rem_euclid(1.0);
            assert!(off.min(1.0 - off) < 2e-3, "{phase} rad, {off} turns off");
        }
    }
}
