//! An axis that is asked what it lacks: its runs, their noise, whether the loops are those of the machine file, and its base.
//!
//! Units: those of the signals, m and A.
//! Invariant: an axis is asked only by gains that explain its current.

use std::ops::Range;

use thiserror::Error;

use super::measure::controller::{Match, OTHER, left_of, resting_a};
use super::measure::counted;
use super::measure::counts;
use super::measure::floor::{self, Hidden};
use super::measure::forward::{CURRENT, Course, DEFLECTION, FOLLOWING_ERROR, Signals};
use super::model::Model;
use super::model::data::AxisData;
use super::model::problem::{Problem, SIGNALS};
use super::name::base::Base;
use super::runs::held::{groups, held_groups};
use super::runs::motions::{busy, part_of};
use super::runs::repeat::{Repeat, first_pass};
use super::runs::sparse::cycles;
use super::runs::{AxisRun, Run};
use super::shortlist::clocks::origin_s;
use crate::base::axis::AxisId;
use crate::config::Machine;
use crate::rt::wire::scaling::TravelCounts;

/// Why there is no analysis.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum GapError {
    /// The gain set is none of the machine's.
    #[error("the machine has no gain set \"{name}\"; it has {known}")]
    NoGains {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// The data were made with other gains.
    #[error(
        "axis {axis}: the current is that of gain set \"{found}\" and not of \"{asked}\" (what they leave of it: {found_percent:.1} % and {asked_percent:.1} %); give --gains {found}"
    )]
    OtherGains {
        /// Which axis.
        axis: String,
        /// What was asked for.
        asked: String,
        /// What fits.
        found: String,
        /// What the one leaves of the current.
        found_percent: f64,
        /// And the other.
        asked_percent: f64,
    },
}

/// What no encoder or drive resolves: m, m, A. Below it two formulations of the same physics differ.
const LEAST: [f64; SIGNALS.len()] = [2e-9, 2e-9, 2e-3];
/// A column is written down more coarsely than an encoder counts where its steps are so many counts.
const COARSER: f64 = 1.5;
/// A run of laps is judged by its last, by this share of its rows where it has none.
const HELD_SHARE: f64 = 0.3;

/// An axis with its base, before what it lacks is asked for.
pub(super) struct Asked<'m> {
    pub(super) id: AxisId,
    pub(super) problem: Problem<'m>,
    pub(super) controller: Option<Match>,
    pub(super) start: Model,
    pub(super) base: Base<'m>,
}

impl<'m> Asked<'m> {
    pub(super) fn of(
        machine: &'m Machine,
        runs: &[Run],
        repeats: &[Repeat],
        id: AxisId,
        (gain_set, is_named, matches): (u8, bool, &[Vec<Match>]),
        phases: &[usize],
        progress: &(dyn Fn(&str) + Sync),
    ) -> Result<Self, GapError> {
        let axis_name = &machine.axis_names()[id.index()];
        let controller = loops(machine, matches, (gain_set, is_named), axis_name)?;
        let mut problem = problem_of(machine, runs, repeats, id, gain_set, phases);
        if let Some(found) = &controller {
            problem = problem.seeing(found.velocity_estimate);
        }
        let start = Model::new(machine.axes[id].plant);
        let base = Base::of(&problem, &start, &|what| progress(&format!("axis {axis_name}: {what}")));
        Ok(Self { id, problem, controller, start, base })
    }
}

/// An axis with its runs and their noise, under gains; `phases` are the rows in which its position loop acts first.
pub fn problem_of<'m>(
    machine: &'m Machine,
    runs: &[Run],
    repeats: &[Repeat],
    id: AxisId,
    gain_set: u8,
    phases: &[usize],
) -> Problem<'m> {
    let repeats: Vec<Repeat> = repeats.iter().filter(|repeat| repeat.is_of(id)).copied().collect();
    let repeats = repeats.as_slice();
    let measured: Vec<Option<Signals>> =
        runs.iter().map(|run| run.axes.get(&id).map(Signals::measured)).collect();
    // A count is as wide for each pass of a command: what it hides may not show in their difference. A column may be written down more
    // coarsely than the encoder counts.
    let scale = &machine.axes[id].scale;
    let of_runs = |column: fn(&AxisRun) -> Option<&Vec<f64>>| {
        let steps = runs.iter().filter_map(|run| Some(counts::step(column(run.axes.get(&id)?)?)));
        steps.fold(0.0, f64::max)
    };
    let hidden_m = |count_m: f64, written_m: f64| written_m.max(count_m) / 12_f64.sqrt();
    let (resolution_m, step_m) = (scale.motor_resolution().as_m(), of_runs(|axis| Some(&axis.position_m)));
    let count_m = hidden_m(resolution_m, step_m);
    let table_m = hidden_m(
        scale.table_position(TravelCounts::counts(1)).as_m().abs(),
        of_runs(|axis| axis.table_m.as_ref()),
    );
    let least = [LEAST[0].hypot(count_m), LEAST[1].hypot(count_m).hypot(table_m), LEAST[2]];
    let mut data = data(machine, runs, repeats, (id, gain_set), phases);
    let noise = |signal: usize, answered: Vec<f64>| {
        let (_, _, pick) = SIGNALS[signal];
        let has = measured.iter().flatten().any(|signals| !pick(signals).is_empty());
        let hidden = Hidden { least: least[signal], answered };
        if has { floor::noise(repeats, runs, &measured, pick, &hidden) } else { None }
    };
    let following_error = noise(FOLLOWING_ERROR, Vec::new());
    // Passes over the same counts hide what the loops make of them too.
    let hides = following_error.as_ref().map_or(0.0, |noise| noise.hides);
    let longest = data.iter().filter(|_| hides > 0.0).max_by_key(|data| data.fit.len());
    let answered = longest.and_then(|data| counted::in_current(machine, id, gain_set, &data.course));
    let answered = answered.into_iter().flatten().map(|lag| hides * lag).collect();
    let noises = [following_error, noise(DEFLECTION, Vec::new()), noise(CURRENT, answered)];
    for (signal, noise) in noises.iter().enumerate() {
        let Some(noise) = noise else { continue };
        let loudness = floor::loudness(repeats, runs, id, &measured, SIGNALS[signal].2, noise);
        for data in &mut data {
            let rows = data.from..loudness[data.run].len().min(data.from + data.fit.len());
            data.loudness[signal] = loudness[data.run].get(rows).unwrap_or_default().to_vec();
        }
    }
    let is_coarser = step_m > COARSER * resolution_m;
    let written_m = if is_coarser { step_m } else { 0.0 };
    let problem = Problem::new(machine, id, gain_set, data, noises);
    problem
        .written_in(written_m)
        .hiding(count_m.hypot(table_m))
        .shaken(&Model::new(machine.axes[id].plant), least)
}

/// How well the loops explain the current; gains that somebody named must be those of the data.
fn loops(
    machine: &Machine,
    all: &[Vec<Match>],
    (gain_set, is_named): (u8, bool),
    axis: &str,
) -> Result<Option<Match>, GapError> {
    let own = |matches: &[Match]| matches.iter().find(|found| found.gain_set == gain_set).copied();
    let left = left_of(all, gain_set);
    for other in (0..machine.gain_sets.len() as u8).filter(|other| is_named && *other != gain_set) {
        let other_left = left_of(all, other);
        if other_left < OTHER * left && other_left < 0.1 {
            return Err(GapError::OtherGains {
                axis: axis.to_owned(),
                asked: machine.gain_sets[usize::from(gain_set)].clone(),
                found: machine.gain_sets[usize::from(other)].clone(),
                found_percent: 100.0 * other_left,
                asked_percent: 100.0 * left,
            });
        }
    }
    let first = all.iter().find_map(|matches| own(matches));
    Ok(first.map(|found| Match { left_share: left, ..found }))
}

/// The runs of an axis, with the rows that judge.
fn data(
    machine: &Machine,
    runs: &[Run],
    repeats: &[Repeat],
    (id, gain_set): (AxisId, u8),
    phases: &[usize],
) -> Vec<AxisData> {
    let groups = groups(runs, repeats);
    let held_groups = held_groups(runs, &groups);
    let origin_s = origin_s(runs);
    let mut all = Vec::new();
    let busy: Vec<Option<Range<usize>>> =
        runs.iter().map(|run| busy(run.axes.get(&id)?, run.period_s)).collect();
    let every = machine.cycle.position_every as usize;
    let moves = busy.iter().flatten().next().is_some();
    for (index, run) in runs.iter().enumerate() {
        let Some(of_run) = (if moves { busy[index].clone() } else { Some(0..run.len()) }) else { continue };
        let (from, part) = (of_run.start, part_of(run, &of_run, String::new()));
        let phase = (phases[index] + every - from * cycles(run, machine) % every) % every;
        let Some((course, axis)) = Course::new(&part, machine, id, phase, origin_s).zip(part.axes.get(&id))
        else {
            continue;
        };
        let course = course.resting_at(resting_a(machine, id, gain_set, &part, phase));
        let counts = Problem::counting(&part, floor::ORDER);
        let rows = part.len();
        let is_held = |row: usize| match &held_groups {
            Some(held) => held.contains(&groups[index]),
            None => row >= ((1.0 - HELD_SHARE) * rows as f64) as usize,
        };
        let held: Vec<bool> =
            counts.iter().enumerate().map(|(row, counts)| *counts && is_held(row)).collect();
        let fit = counts.iter().zip(&held).map(|(counts, held)| *counts && !held).collect();
        let (loudness, bend, moved) = Default::default();
        let first_pass = first_pass(index, run.len(), repeats).saturating_sub(from).min(rows);
        all.push(AxisData {
            run: index,
            from,
            course,
            measured: Signals::measured(axis),
            loudness,
            bend,
            moved,
            fit,
            held,
            first_pass,
            command: groups[index],
        });
    }
    all
}
