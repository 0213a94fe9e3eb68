//! The five steps in order, over all runs of a machine.
//!
//! Invariant: the same runs give the same verdict, to the bit.

use std::time::Instant;

use rayon::prelude::*;

use super::asked::{Asked, GapError};
use super::fit::refit::is_noise;
use super::locate;
use super::locate::behind::{self, Behind};
use super::locate::bursts::bursts;
use super::locate::rest::Rest;
use super::measure::controller::{Match, by_the_current, explained, phase_of};
use super::model::problem::Problem;
use super::model::zeros::Zeros;
use super::name::base::Base;
use super::name::name;
use super::name::named::Named;
use super::runs::Run;
use super::runs::repeat::Repeat;
use super::runs::repeats::repeats;
use super::show::answer::AxisGap;
use super::show::consequence::consequence;
use super::show::contour::{Contour, contours};
use super::show::verdict::{closes_little, explains_too_little, gaps, shape, verdict, widens};
use crate::base::axis::AxisId;
use crate::config::Machine;

/// What is asked.
#[derive(Clone, Debug)]
pub struct Request {
    /// Gain set of the runs; that whose loops explain the current where it is not known.
    pub gains: Option<String>,
    /// Axes to look at; all that the runs have if empty.
    pub axes: Vec<AxisId>,
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
    let of_all = |runs: &[Run]| -> Result<Vec<Asked<'m>>, GapError> {
        let of = |(id, matches): (&AxisId, &Vec<Vec<Match>>)| {
            let gains = (gain_set, request.gains.is_some(), matches.as_slice());
            Asked::of(machine, runs, &repeats, *id, gains, &phases, progress)
        };
        ids.par_iter().zip(&explained).map(of).collect()
    };
    let named = |all: Vec<Asked<'m>>| all.into_par_iter().map(|one| axis(machine, one, progress)).collect();
    let again = |behind: &[Behind]| {
        progress("somebody turned the feed: again without what was there");
        of_all(&Behind::without(behind, runs))
    };
    let mut asked = of_all(runs)?;
    // What it does is far from any effect, and what explains it takes long to find. What is less shows beside what is named.
    let mut late =
        behind::behind(&asked.iter().map(|one| (&one.problem, &one.base.coarse.model)).collect::<Vec<_>>());
    if !late.is_empty() {
        asked = again(&late)?;
    }
    let mut axes: Vec<AxisGap<'m>> = named(asked);
    if late.is_empty() {
        late = behind::behind(
            &axes.iter().map(|axis| (&axis.problem, &axis.named.model.model)).collect::<Vec<_>>(),
        );
        if !late.is_empty() {
            axes = named(again(&late)?);
        }
    }
    if let Some(rest) = behind::rest(&late) {
        axes.iter_mut().for_each(|axis| axis.leaves(rest));
    }
    progress("circles, before and after");
    let contours = contours(runs, &axes);
    let gains = machine.gain_sets[usize::from(gain_set)].clone();
    Ok(Analysis { gains, repeats, axes, contours, seconds: began.elapsed().as_secs_f64() })
}

fn axis<'m>(
    machine: &'m Machine,
    Asked { id, mut problem, controller, start, base }: Asked<'m>,
    progress: &(dyn Fn(&str) + Sync),
) -> AxisGap<'m> {
    let axis_name = machine.axis_names()[id.index()].clone();
    let say = |what: &str| progress(&format!("axis {axis_name}: {what}"));
    let (mut named, mut weighed) = name(&problem, base, &say);
    // Zeros that are apart leave more than noise, whatever was named.
    let are_apart = || problem.as_clocked(&named).zeros_are_apart(&start, &named.model.model);
    if !is_noise(&weighed, &named.model) && are_apart() {
        say("runs with a zero of the table scale each");
        problem = problem.with_zeros(Zeros::OfEachRun);
        (named, weighed) = name(&problem, Base::of(&problem, &start, &say), &say);
    }
    problem = problem.as_clocked(&named).with_means_about(&named.model.model);
    let mut gap = gaps(&weighed, &start, &named);
    let shape = shape(&problem, &named);
    let is_little = || {
        let is_pushed = || bursts(&problem, &named.model.model).is_some();
        explains_too_little(&weighed, &named, &gap) || widens(&gap) || (closes_little(&gap) && is_pushed())
    };
    // Beside a floor that is a lower bound, much is left whatever is named.
    let is_told = problem.is_noise_told();
    // What swings of an axis without a table scale is hardly told from its motor.
    let is_told_apart = problem.has_table() && !named.effects.is_empty();
    let strained = Rest::strained(&named.model.model).filter(|_| is_told_apart);
    let is_denied = strained.is_some() || is_told && (shape.is_some() || is_little());
    if !named.effects.is_empty() && is_denied {
        named.withdraw();
        gap.iter_mut().for_each(|signal| signal.after = signal.before);
    }
    let both = locate::both(&problem, &named.base.model, &named.model.model);
    let (located, runs_left) = (locate::located(&problem, &both), locate::runs_left(&problem, &both));
    let is_of_passes =
        |signal: usize| problem.noises[signal].as_ref().is_some_and(|noise| noise.is_from_repeats);
    let of_base = || {
        Rest::everywhere(&runs_left, is_of_passes)
            .or_else(|| Rest::shaped(&located))
            .or_else(|| Rest::strained(&named.base.model))
    };
    let of_base = || named.effects.is_empty().then(of_base).flatten();
    let rest = shape.or(strained).or_else(|| bursts(&problem, &named.model.model)).or_else(of_base);
    let verdict = verdict(&named, &gap, rest.is_some(), is_told);
    let of = |place| consequence(&problem, &named.model.model, place);
    let consequences = (0..named.effects.len()).map(of).collect();
    say("done");
    AxisGap { id, problem, controller, named, verdict, rest, located, runs_left, gap, consequences }
}
