//! Which effects could explain what is left: each is tried once at its usual size, and what of it the other
//! coordinates cannot make up for is held against what is left.
//!
//! ```text
//!   minimise  ‖r + T δ + S a‖² + beliefs      S = residual with the effect less that without
//!   gain = what a brings beyond the best δ alone                                    in the weights of the fit
//! ```
//!
//! Effects with a phase give two such columns, a quarter of a period apart (`turned`). What else is not linear is tried at a few
//! values, frequencies where the spectrum of what is left has its peaks.
//! Invariant: the order of the catalogue decides nothing.

pub mod clocks;
pub mod smallest;
pub mod spectrum;
mod spots;
mod sums;
pub(super) mod trials;
mod turned;

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use crate::offline::gap::fit::share_that_holds;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::{BLOCK_S, Linear};
use crate::offline::gap::model::problem::{Problem, Residual};
use crate::offline::gap::model::usual::is_usual;
use crate::offline::gap::model::{Model, Tried};
use crate::plant::effects::{CATALOGUE, Entry, Parameter, Values};

use smallest::Smallest;
use sums::{Beyond, LOSS, Left, Sums, slopes};
use trials::{InVain, Trial, phase_of, seeds, variants};

/// What gains less, by all passes, is not worth a fit: an amplitude of seven standard deviations gains twice as much. Of small effects
/// that were named the least had five times as much.
const LEAST: f64 = 24.0;

/// What swings and gains less than this, by all passes, is in vain. If it does so on every other run it is not simulated on the rest: noise gains 2
/// there, and what is worth a fit half of [`LEAST`] and mostly much more.
const IN_VAIN: f64 = 6.0;

/// Rows that say of each other whether a trial changed them by chance, s to either side.
const NEAR_S: f64 = 0.02;

/// Share of the gain of the best trial of an effect from which on the next one may lead further, and from which on the best by another law may:
/// a line from here tells less of which law it is than of which values.
const NEARLY: f64 = 0.5;
const BY_ANOTHER_LAW: f64 = 0.1;

/// Part of the way to where the linear estimate leads.
const PART: f64 = 0.25;

/// So many of the surest are tried, whatever others gain, of those that are so sure by their blocks, in standard deviations, squared. Beside one of
/// them what is less than so sure is a few slips that came at another moment; and what gains less than this share of what the best does is not
/// missed before that is named. Of 224 effects that were named the least sure had 5.4, and the least a quarter of the gain of the best.
const SUREST: usize = 3;
const SURE: f64 = 9.0;
const UNSURE: f64 = 4.0;
const LITTLE: f64 = 0.03;

/// What may be missing, the most promising first, and what would have been seen.
pub struct Shortlist {
    /// Effects that explain something.
    pub scored: Vec<Scored>,
    /// Of every effect that is not in the model.
    pub smallest: Vec<Smallest>,
}

/// An effect that may be there.
#[derive(Clone, Debug)]
pub struct Scored {
    /// With the values that the linear estimate gives it, beside a model that makes room, beside one as it was, and a part of the first
    /// way, for an effect that is far from straight over all of it; then the first of other trials of which the gain does not tell whether
    /// they lead further either.
    pub starts: Vec<Model>,
    /// By how much the cost falls, if all were linear.
    pub gain: f64,
    /// In how many of its blocks' standard deviations, squared: what stick and slip imitate in a few blocks may gain more, and is less sure.
    pub sureness: f64,
    /// Whether it is one of the surest.
    pub is_sure: bool,
}

impl Scored {
    /// What is tried.
    pub fn entry(&self) -> &'static Entry {
        self.starts[0].effects.last().expect("it is tried with an effect").entry
    }
}

/// Every effect that is not in the model yet, with the best trial of its laws. All passes tell so many times as much as these rows. What is in vain is
/// spared, and kept there.
pub(super) fn shortlist(
    problem: &Problem<'_>,
    here: &Linear,
    peaks: &dyn Fn(&Parameter) -> Vec<f64>,
    passes: f64,
    in_vain: &mut InVain,
) -> Shortlist {
    let model = &here.model;
    let has = |name: &str| model.effects.iter().any(|tried| tried.entry.name == name);
    // A further harmonic is one beside the first.
    let is_further = |entry: &Entry| {
        let is_alike = |other: &&Entry| other.effect() == entry.effect() && other.equation == entry.equation;
        let first = CATALOGUE.iter().find(is_alike).map_or(entry.name, |first| first.name);
        first != entry.name && !has(first)
    };
    // Of two laws of the same bristles the first stands for both: a fit tells which it is.
    let is_second_law = |entry: &Entry| {
        let before = CATALOGUE.iter().take_while(|first| first.name != entry.name);
        let tried = model.effects.iter().map(|tried| tried.entry);
        before.chain(tried).any(|other| entry.is_in_the_place_of(other))
    };
    let shows = |entry: &Entry| problem.has_table() || !entry.is_of_table_scale();
    let unseen = CATALOGUE.iter().filter(|entry| !shows(entry) && entry.law_of.is_none());
    let trials: Vec<Trial> = CATALOGUE
        .iter()
        .filter(|entry| !has(entry.name) && !is_further(entry) && !is_second_law(entry) && shows(entry))
        .flat_map(|entry| seeds(entry, peaks).into_iter().map(move |values| (entry, values)))
        .filter(|(entry, values)| !model.has_twin_of(&Tried { entry, values: *values }))
        .filter(|trial| !in_vain.has(trial))
        .collect();
    let (mut listed, further) = listed(problem, here, &trials, passes);
    in_vain.extend(further);
    listed.scored = worth_a_fit(listed.scored, passes);
    listed.smallest.extend(unseen.map(|entry| Smallest::of(entry, f64::INFINITY)));
    listed
}

/// What those of these effects explain that explain most.
pub(super) fn gain_of(problem: &Problem<'_>, here: &Linear, names: &[&str]) -> f64 {
    let entries = CATALOGUE.iter().filter(|entry| names.contains(&entry.name));
    let trials: Vec<Trial> = entries
        .flat_map(|entry| seeds(entry, &|_| Vec::new()).into_iter().map(move |values| (entry, values)))
        .collect();
    let (Shortlist { scored, .. }, _) = listed(problem, here, &trials, 1.0);
    // Less is noise, of which one says nothing that another does not.
    scored.iter().map(|one| one.gain).filter(|gain| *gain > LEAST).fold(0.0, f64::max)
}

/// What such trials say, and which of them are in vain.
fn listed(problem: &Problem<'_>, here: &Linear, trials: &[Trial], passes: f64) -> (Shortlist, Vec<Trial>) {
    let model = &here.model;
    let solved = |linear: &Linear| {
        let equations = linear.normal(usize::MAX, LOSS).with_beliefs(model);
        let mut curvature = equations.curvature.clone();
        for place in 0..curvature.nrows() {
            curvature[(place, place)] += 1e-9;
        }
        Some((curvature.cholesky()?, equations))
    };
    let Some((curvature, equations)) = solved(here) else {
        return (Shortlist { scored: Vec::new(), smallest: Vec::new() }, Vec::new());
    };
    // What a problem holds only tells how much could be made up for: moved, it would stay there.
    let moves: Vec<bool> = (0..model.coordinate_count()).map(|at| problem.tells(model, at)).collect();
    let (known, covariance) = ((curvature.clone(), equations.slope, moves), curvature.inverse());
    let places = problem.places(Part::Fit);
    // Every other run first: a circle one way tells of what swings what that the other way does.
    let order: Vec<usize> = (0..places.len()).step_by(2).chain((1..places.len()).step_by(2)).collect();
    let (first, rest) = order.split_at(places.len().div_ceil(2));
    let half =
        Linear { model: model.clone(), runs: first.iter().map(|run| here.runs[*run].clone()).collect() };
    let half = solved(&half).filter(|_| !rest.is_empty());
    let [block, about] = [BLOCK_S, 2.0 * NEAR_S].map(|time_s| problem.rows_in(time_s));
    let left: Vec<Left> = here.runs.par_iter().map(Left::of).collect();
    let tangents: Vec<DMatrix<f64>> = order
        .par_iter()
        .map(|run| slopes(&left[*run].pulls, here.runs[*run].columns.iter().map(Option::as_deref), block))
        .collect();
    let tried = trials.par_iter().map(|(entry, values)| {
        let mut sums = Sums::new(model, entry);
        let add = |sums: &mut Sums, number: &usize| {
            let run = &here.runs[*number];
            let column = |values: Values| {
                let model = model.with(Tried { entry, values });
                let mut column = problem.residual(places[*number], &model, Part::Fit);
                for (column, residual) in column.iter_mut().zip(&run.residual) {
                    column.iter_mut().zip(residual).for_each(|(value, without)| *value -= without);
                }
                column
            };
            let columns: Vec<Residual> = variants(entry, *values).into_iter().map(column).collect();
            let columns = match <[Residual; 3]>::try_from(columns) {
                Ok(turned) => turned::columns(turned.each_ref(), about).to_vec(),
                Err(alone) => alone,
            };
            sums.add(run, &left[*number], &columns, block);
        };
        // The first trial of an effect is at its usual values.
        let is_first = entry.law_of.is_none() && *values == seeds(entry, &|_| Vec::new())[0];
        first.iter().for_each(|run| add(&mut sums, run));
        let swings = phase_of(entry).is_some();
        let is_little = |gain: f64| swings && passes * gain < IN_VAIN;
        if let Some((curvature, equations)) = half.as_ref().filter(|_| swings && !is_first)
            && is_little(sums.beyond(curvature).gain(&sums.slope, &equations.slope))
        {
            return (None, None, true);
        }
        rest.iter().for_each(|run| add(&mut sums, run));
        let beyond = sums.beyond(&known.0);
        // What no data tell from an effect that every model has is that one, by another name.
        if let Some(at) = twin_of(model, entry) {
            let share = (sums.crossed[(0, at)] / equations.curvature[(at, at)]).abs();
            let deviation =
                covariance[(at, at)].sqrt() * values[0].abs() / (share * entry.parameters[0].prior);
            return (None, is_first.then(|| Smallest::of(entry, deviation)), false);
        }
        let smallest = is_first.then(|| beyond.smallest(entry, values));
        let scored = sums.scored(beyond, &known, &tangents, model, Tried { entry, values: *values });
        let is_in_vain = is_little(scored.as_ref().map_or(0.0, |scored| scored.gain));
        (scored, smallest, is_in_vain)
    });
    let tried: Vec<(Option<Scored>, Option<Smallest>, bool)> = tried.collect();
    let in_vain = trials.iter().zip(&tried).filter(|(_, (.., is_in_vain))| *is_in_vain);
    let in_vain: Vec<Trial> = in_vain.map(|(trial, _)| *trial).collect();
    let (scored, smallest): (Vec<_>, Vec<_>) =
        tried.into_iter().map(|(scored, smallest, _)| (scored, smallest)).unzip();
    let of_usual = smallest::of_usual(model, &covariance);
    let mut by_name: BTreeMap<&str, Vec<Scored>> = BTreeMap::new();
    for scored in scored.into_iter().flatten() {
        by_name.entry(scored.entry().effect()).or_default().push(scored);
    }
    let scored = by_name.into_values().filter_map(best_of).collect();
    let smallest = smallest.into_iter().flatten().chain(of_usual);
    (Shortlist { scored, smallest: smallest.map(|one| one.by_passes(passes)).collect() }, in_vain)
}

/// What gains enough by all passes, and is sure enough, the most first; the surest beside what gains most.
fn worth_a_fit(mut all: Vec<Scored>, passes: f64) -> Vec<Scored> {
    all.retain(|one| passes * one.gain > LEAST);
    all.sort_by(|a, b| b.sureness.total_cmp(&a.sureness));
    all.iter_mut().filter(|one| one.sureness > SURE).take(SUREST).for_each(|one| one.is_sure = true);
    let is_any_sure = all.first().is_some_and(|surest| surest.is_sure);
    all.retain(|one| !is_any_sure || one.sureness > UNSURE);
    all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let little = all.first().map_or(0.0, |best| LITTLE * best.gain);
    all.retain(|one| one.is_sure || one.gain > little);
    all
}

/// The best of the trials of one effect, and where others lead: the next best, if that gains nearly as much, and the best by each other law.
fn best_of(mut trials: Vec<Scored>) -> Option<Scored> {
    trials.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let mut trials = trials.into_iter();
    let mut best = trials.next()?;
    let mut laws = vec![best.entry().name];
    for (place, other) in trials.enumerate() {
        let is_next = place == 0 && other.gain > NEARLY * best.gain;
        let law = other.entry().name;
        if is_next || !laws.contains(&law) && other.gain > BY_ANOTHER_LAW * best.gain {
            best.starts.extend(other.starts.into_iter().next());
        }
        laws.push(law);
    }
    Some(best)
}

/// The coordinate of an effect that every model has, from which no data tell another.
fn twin_of(model: &Model, entry: &Entry) -> Option<usize> {
    let is_twin = |tried: &Tried| is_usual(tried.entry) && tried.entry.aliases.contains(&entry.name);
    Some(model.first_coordinate(model.effects.iter().position(is_twin)?))
}

impl Sums {
    fn scored(
        &self,
        beyond: Beyond,
        (curvature, slope, moves): &(Cholesky<f64, Dyn>, DVector<f64>, Vec<bool>),
        tangents: &[DMatrix<f64>],
        model: &Model,
        Tried { entry, values }: Tried,
    ) -> Option<Scored> {
        let (shares, left) = beyond.shares(&self.slope, slope)?;
        let made_up = &beyond.made_up * &shares;
        let of_run = |(own, tangents): (&DMatrix<f64>, &DMatrix<f64>)| -> DVector<f64> {
            own.transpose() * &shares - tangents.transpose() * &made_up
        };
        let blocks = self.blocks.iter().zip(tangents).map(of_run);
        let sureness = sureness(blocks.flat_map(|of_run| of_run.iter().copied().collect::<Vec<f64>>()));
        let mut tried = values;
        let mut wanted = values;
        match phase_of(entry) {
            Some(place) => {
                let (cosine, sine) = (shares[0], shares[1]);
                wanted[0] = values[0] * cosine.hypot(sine);
                tried[place] = sine.atan2(cosine) / TAU * 360.0;
            }
            // What may be positive alone and wants to be negative is not there.
            None => {
                for place in entry.amplitudes() {
                    wanted[place] = values[place] * shares[0];
                }
            }
        }
        // As much of it as there may be, and what that gains: least of a parabola.
        let mut part = 1.0_f64;
        for place in entry.amplitudes().filter(|place| wanted[*place] != 0.0) {
            let [low, high] = entry.parameters[place].bounds;
            tried[place] = wanted[place].clamp(low, high);
            part = part.min(tried[place] / wanted[place]);
        }
        let gain = part * (2.0 - part) * shares.dot(&left);
        if !entry.is_present(&tried) || gain <= 0.0 {
            return None;
        }
        let moved = curvature.solve(&(-slope - self.crossed.transpose() * (part * &shares)));
        let share = share_that_holds(&moved);
        let moved = moved.iter().zip(moves).map(|(by, moves)| if *moves { share * by } else { 0.0 });
        let moved: Vec<f64> = moved.collect();
        let gone = |part: f64| {
            let way = model.coordinates().into_iter().zip(&moved);
            let mut values = tried;
            entry.amplitudes().for_each(|place| values[place] *= part);
            model.at(&way.map(|(at, by)| at + part * by).collect::<Vec<f64>>()).with(Tried { entry, values })
        };
        Some(Scored {
            starts: vec![gone(1.0), model.with(Tried { entry, values: tried }), gone(PART)],
            gain,
            sureness,
            is_sure: false,
        })
    }
}

/// How sure a sum is by what it is a sum of, in standard deviations, squared.
fn sureness(of: impl Iterator<Item = f64>) -> f64 {
    let [sum, squares] = of.fold([0.0; 2], |[sum, squares], one| [sum + one, squares + one * one]);
    sum * sum / squares
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;
    use crate::config;
    use crate::offline::gap::model::sensors::tests::{showing, swinging};
    use crate::offline::gap::model::usual;
    use crate::plant::effects::entry;
    use crate::plant::tests::paper_axis;

    #[test]
    fn what_gains_a_little_everywhere_is_surer_than_what_gains_more_in_one_place() {
        let [everywhere, once] = [
            sureness((0..100).map(|block| if block % 2 == 0 { 3.0 } else { -1.0 })),
            sureness((0..100).map(|block| if block == 7 { 1_000.0 } else { 1.0 })),
        ];
        assert!((everywhere - 20.0).abs() < 1e-9 && once < 1.3, "{everywhere}, {once}");
    }

    #[test]
    fn what_is_unsure_or_gains_little_beside_the_best_is_not_worth_a_fit() {
        let model = Model::new(paper_axis());
        let listed = |all: &[(&'static str, f64, f64)]| -> Vec<(&str, bool)> {
            let scored = all.iter().map(|(name, gain, sureness)| {
                let entry = entry(name).expect("an effect");
                let with = model.with(Tried { entry, values: entry.nominal() });
                Scored { starts: vec![with], gain: *gain, sureness: *sureness, is_sure: false }
            });
            let worth = worth_a_fit(scored.collect(), 2.0);
            worth.iter().map(|one| (one.entry().name, one.is_sure)).collect()
        };
        let [play, zone, drag] = ["backlash", "soft-zone", "quadratic-drag"];
        let [cogging, ripple] = ["motor-cogging", "torque-ripple"];
        // By both passes a gain of 11 is worth nothing, and one of 13 is.
        assert_eq!(listed(&[(play, 11.0, 50.0), (zone, 13.0, 3.9)]), [(zone, false)]);
        // Beside what is sure what is not is worth nothing either.
        let unsure = [(play, 90.0, 3.9), (zone, 80.0, 4.1), (drag, 70.0, 9.1)];
        assert_eq!(listed(&unsure), [(zone, false), (drag, true)]);
        // A hundredth of the best is little, unless it is sure.
        let beside = [(play, 9_000.0, 5.0), (zone, 90.0, 8.0), (drag, 80.0, 10.0)];
        assert_eq!(listed(&beside), [(play, false), (drag, true)]);
        let more = [(play, 9_000.0, 40.0), (cogging, 90.0, 17.0), (ripple, 80.0, 30.0), (drag, 70.0, 10.0)];
        assert_eq!(listed(&more), [(play, true), (cogging, true), (ripple, true)], "three at most");
        // Half as much stays, as sure as it may be.
        assert_eq!(listed(&[(play, 9_000.0, 5.0), (zone, 4_500.0, 5.0)]), [(play, false), (zone, false)]);
    }

    #[test]
    fn what_swings_in_vain_is_not_tried_again_and_what_is_there_is() {
        let machine = config::load("paper").expect("a machine");
        let file = usual::with(&Model::new(machine.axes[AxisId::X].plant));
        let cogging = entry("motor-cogging").expect("an effect");
        let problem = showing(
            &swinging(&machine, 5e-3),
            &file.with(Tried { entry: cogging, values: [0.01, 18.0, 40.0] }),
        );
        let here = Linear::widest(&problem, &file);
        let peaks = |parameter: &Parameter| match parameter.key {
            "periods-per-turn" => vec![18.0, 31.0],
            _ => Vec::new(),
        };
        let mut in_vain = InVain::default().beside(1.0);
        let mut look = || {
            let listed = shortlist(&problem, &here, &peaks, 1.0, &mut in_vain);
            let best =
                listed.scored[0].starts[0].effects.last().map(|tried| (tried.entry.name, tried.values));
            (best, listed.smallest.len())
        };
        let [(first, all), (again, fewer)] = [look(), look()];
        assert!(
            again == first
                && first.is_some_and(|(name, [_, order, _])| (name, order) == (cogging.name, 18.0))
        );
        assert!(fewer < all, "{fewer} of {all} were simulated to the end again");
        let tried = |order: f64| (cogging, [0.5 * cogging.nominal()[0], order, 0.0]);
        assert!(in_vain.has(&tried(31.0)) && !in_vain.has(&tried(18.0)));
    }

    #[test]
    fn another_trial_that_gains_nearly_as_much_or_is_by_another_law_is_another_start() {
        let model = Model::new(paper_axis());
        let trial = |(name, gain): (&str, f64)| {
            let entry = entry(name).expect("an effect");
            let with = model.with(Tried { entry, values: [gain, 0.0, 0.0] });
            Scored { starts: vec![with; 2], gain, sureness: gain, is_sure: false }
        };
        let starts = |trials: &[(&str, f64)]| -> Option<(f64, Vec<(&str, f64)>)> {
            let best = best_of(trials.iter().map(|one| trial(*one)).collect())?;
            let last = |start: &Model| start.effects.last().map(|tried| (tried.entry.name, tried.values[0]));
            Some((best.gain, best.starts.iter().skip(2).filter_map(last).collect()))
        };
        let [give, push] = ["cross-coupling", "cross-coupling-push"];
        for (trials, others) in [
            (&[(give, 3.0), (give, 9.0), (give, 6.0)][..], &[(give, 6.0)][..]),
            (&[(give, 3.0), (give, 9.0), (give, 4.0)], &[]),
            (&[(push, 3.0), (give, 9.0), (push, 2.0), (give, 4.0)], &[(push, 3.0)]),
            (&[(push, 8.0), (give, 9.0), (push, 7.0)], &[(push, 8.0)]),
            (&[(push, 0.8), (give, 9.0)], &[]),
        ] {
            assert_eq!(starts(trials), Some((9.0, others.to_vec())), "{trials:?}");
        }
        assert!(starts(&[]).is_none());
    }

    #[test]
    fn what_rows_do_not_tell_starts_where_it_is_though_it_could_make_up_for_an_effect() {
        let model = usual::with(&Model::new(paper_axis()));
        let (force, mass) = (model.constant_force().expect("it is usual"), 0);
        let count = model.coordinate_count();
        let of = |held: Option<usize>| {
            let sums = Sums {
                crossed: DMatrix::from_element(1, count, 0.1),
                columns: DMatrix::from_element(1, 1, 100.0),
                slope: DVector::from_element(1, -50.0),
                blocks: Vec::new(),
            };
            let curvature = DMatrix::identity(count, count).cholesky().expect("a regular matrix");
            let beyond = sums.beyond(&curvature);
            let moves = (0..count).map(|at| Some(at) != held).collect();
            let entry = entry("backlash").expect("an effect");
            let tried = Tried { entry, values: entry.nominal() };
            let known = (curvature, DVector::from_element(count, 0.3), moves);
            let scored = sums.scored(beyond, &known, &[], &model, tried).expect("a gain");
            let other = &scored.starts[0];
            [force, mass].map(|at| other.coordinates()[at] - model.coordinates()[at])
        };
        let [free, held] = [None, Some(force)].map(of);
        assert!(free[0] != 0.0 && free[1] != 0.0, "{free:?}");
        assert_eq!(held, [0.0, free[1]]);
    }
}
