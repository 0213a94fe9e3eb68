//! The five steps in order, over all runs of a machine.
//!
//! Invariant: the same runs give the same verdict, to the bit.

use std::ops::Range;
use std::time::Instant;

use thiserror::Error;

use super::behind::{self, Behind};
use super::bursts::bursts;
use super::clocks::origin_s;
use super::consequence::{Consequence, consequence};
use super::contour::{Contour, contours};
use super::controller::{Match, OTHER, by_the_current, explained, left_of, phase_of, resting_a};
use super::counted;
use super::counts;
use super::floor::{self, Hidden};
use super::forward::{CURRENT, Course, DEFLECTION, FOLLOWING_ERROR, Signals};
use super::held::{groups, held_groups};
use super::locate::{self, Located, RunLeft};
use super::model::Model;
use super::motions::{busy, part_of};
use super::name::name;
use super::named::Named;
use super::problem::{AxisData, Problem, SIGNALS};
use super::refit::is_noise;
use super::repeat::{Repeat, first_pass};
use super::repeats::repeats;
use super::rest::Rest;
use super::runs::{AxisRun, Run};
use super::sparse::cycles;
use super::verdict::{SignalGap, Verdict, closes_little, explains_too_little, gaps, shape, verdict};
use super::zeros::Zeros;
use crate::base::axis::AxisId;
use crate::config::Machine;
use crate::rt::drive::velocity::VelocityEstimate;
use crate::rt::wire::scaling::TravelCounts;

/// What no encoder or drive resolves: m, m, A. Below it two formulations of the same physics differ.
const LEAST: [f64; SIGNALS.len()] = [2e-9, 2e-9, 2e-3];
/// A column is written down more coarsely than an encoder counts where its steps are so many counts.
const COARSER: f64 = 1.5;
/// A run of laps is judged by its last, by this share of its rows where it has none.
const HELD_SHARE: f64 = 0.3;

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

/// What is asked.
#[derive(Clone, Debug)]
pub struct Request {
    /// Gain set of the runs; that whose loops explain the current where it is not known.
    pub gains: Option<String>,
    /// Axes to look at; all that the runs have if empty.
    pub axes: Vec<AxisId>,
}

/// An axis with its answer.
pub struct AxisGap<'m> {
    /// Which axis.
    pub id: AxisId,
    /// Its runs.
    pub problem: Problem<'m>,
    /// How well the loops alone explain the current.
    pub controller: Option<Match>,
    /// What it lacks.
    pub named: Named,
    /// In a word.
    pub verdict: Verdict,
    /// What is left without a name and is something real.
    pub rest: Option<Rest>,
    /// Where it lives: over which coordinates what the base leaves has a shape.
    pub located: Vec<Located>,
    /// And in which runs.
    pub runs_left: Vec<RunLeft>,
    /// The gap in rms, by signal: before, after, floor; on the rows that were not fitted.
    pub gap: Vec<SignalGap>,
    /// What follows from each effect that was named, in their order.
    pub consequences: Vec<Option<Consequence>>,
}

impl Problem<'_> {
    /// The same with clocks set as it was found.
    fn as_clocked(&self, named: &Named) -> Self {
        match &named.clocks_behind_s {
            Some(behind_s) => self.with_clocks(behind_s),
            None => self.with_data(self.data.clone()),
        }
    }
}

impl AxisGap<'_> {
    /// It leaves something real.
    fn leaves(&mut self, rest: Rest) {
        self.rest = Some(rest);
        self.verdict = verdict(&self.named, &self.gap, true, self.problem.is_noise_told());
    }

    /// How its loops see the velocity, where that is not as the machine file says.
    pub fn other_estimate(&self) -> Option<VelocityEstimate> {
        let filed = self.problem.machine.axes[self.id].velocity_estimate;
        self.controller.map(|found| found.velocity_estimate).filter(|seen| *seen != filed)
    }
}

/// Everything that was found.
pub struct Analysis<'m> {
    /// Gain set of the runs.
    pub gains: String,
    /// The repeats that tell the noise.
    pub repeats: Vec<Repeat>,
    /// The axes.
    pub axes: Vec<AxisGap<'m>>,
    /// Circles among the runs.
    pub contours: Vec<Contour>,
    /// How long it took, s.
    pub seconds: f64,
}

/// Looks for what a machine file lacks.
///
/// # Errors
/// When the runs were not made with the gains that are named.
pub fn analyse<'m>(
    machine: &'m Machine,
    runs: &[Run],
    request: &Request,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Analysis<'m>, GapError> {
    let began = Instant::now();
    progress("looking for repeats");
    let repeats = repeats(runs);
    let ids: Vec<AxisId> = machine
        .axes
        .axes()
        .filter(|id| request.axes.is_empty() || request.axes.contains(id))
        .filter(|id| runs.iter().any(|run| run.axes.contains_key(id)))
        .collect();
    progress("the controller alone");
    let explained = explained(machine, &ids, runs);
    let gain_set =
        match &request.gains {
            Some(name) => machine.gain_sets.iter().position(|known| known == name).ok_or_else(|| {
                GapError::NoGains { name: name.clone(), known: machine.gain_sets.join(", ") }
            })? as u8,
            None => by_the_current(&explained),
        };
    let phases: Vec<usize> = (0..runs.len())
        .map(|run| phase_of(explained.iter().map(|of_axis| of_axis[run].as_slice()), gain_set))
        .collect();
    let of_all = |runs: &[Run]| -> Result<Vec<AxisGap<'m>>, GapError> {
        let of = |(id, matches): (&AxisId, &Vec<Vec<Match>>)| {
            axis(
                machine,
                runs,
                &repeats,
                *id,
                (gain_set, request.gains.is_some(), matches),
                &phases,
                progress,
            )
        };
        ids.iter().zip(&explained).map(of).collect()
    };
    let mut axes = of_all(runs)?;
    let behind = behind::behind(&axes);
    if let Some(rest) = behind::rest(&behind) {
        progress("somebody turned the feed: again without what was there");
        axes = of_all(&Behind::without(&behind, runs))?;
        axes.iter_mut().for_each(|axis| axis.leaves(rest));
    }
    progress("circles, before and after");
    let contours = contours(runs, &axes);
    let gains = machine.gain_sets[usize::from(gain_set)].clone();
    Ok(Analysis { gains, repeats, axes, contours, seconds: began.elapsed().as_secs_f64() })
}

fn axis<'m>(
    machine: &'m Machine,
    runs: &[Run],
    repeats: &[Repeat],
    id: AxisId,
    (gain_set, is_named, matches): (u8, bool, &[Vec<Match>]),
    phases: &[usize],
    progress: &(dyn Fn(&str) + Sync),
) -> Result<AxisGap<'m>, GapError> {
    let axis_name = machine.axis_names()[id.index()].clone();
    let say = |what: &str| progress(&format!("axis {axis_name}: {what}"));
    let controller = loops(machine, matches, (gain_set, is_named), &axis_name)?;
    let mut problem = problem_of(machine, runs, repeats, id, gain_set, phases);
    if let Some(found) = &controller {
        problem = problem.seeing(found.velocity_estimate);
    }
    let start = Model::new(machine.axes[id].plant);
    let (mut named, mut weighed) = name(&problem, &start, &say);
    // Zeros that are apart leave more than noise, whatever was named.
    let are_apart = || problem.as_clocked(&named).zeros_are_apart(&start, &named.model.model);
    if !is_noise(&weighed, &named.model) && are_apart() {
        say("runs with a zero of the table scale each");
        problem = problem.with_zeros(Zeros::OfEachRun);
        (named, weighed) = name(&problem, &start, &say);
    }
    problem = problem.as_clocked(&named).with_means_about(&named.model.model);
    let mut gap = gaps(&weighed, &start, &named);
    let shape = shape(&problem, &named);
    let is_little = || {
        let is_pushed = || bursts(&problem, &named.model.model).is_some();
        explains_too_little(&weighed, &named) || (closes_little(&gap) && is_pushed())
    };
    // Beside a floor that is a lower bound, much is left whatever is named.
    let is_told = problem.is_noise_told();
    if !named.effects.is_empty() && is_told && (shape.is_some() || is_little()) {
        named.withdraw();
        gap.iter_mut().for_each(|signal| signal.after = signal.before);
    }
    let both = locate::both(&problem, &named.base.model, &named.model.model);
    let (located, runs_left) = (locate::located(&problem, &both), locate::runs_left(&problem, &both));
    let is_of_passes =
        |signal: usize| problem.noises[signal].as_ref().is_some_and(|noise| noise.is_from_repeats);
    let of_base = || Rest::everywhere(&runs_left, is_of_passes).or_else(|| Rest::strained(&named.base.model));
    let of_base = || named.effects.is_empty().then(of_base).flatten();
    let rest = shape.or_else(|| bursts(&problem, &named.model.model)).or_else(of_base);
    let verdict = verdict(&named, &gap, rest.is_some(), is_told);
    let of = |place| consequence(&problem, &named.model.model, place);
    let consequences = (0..named.effects.len()).map(of).collect();
    Ok(AxisGap { id, problem, controller, named, verdict, rest, located, runs_left, gap, consequences })
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
