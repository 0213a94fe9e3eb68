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

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::fit::share_that_holds;
use super::linear::{BLOCK_S, K, Linear, LinearRun, Loss, product};
use super::model::{Model, Tried};
use super::problem::{Part, Problem, Residual};
use super::smallest::{self, Smallest};
use super::trials::{phase_of, seeds, variants};
use super::turned;
use super::usual::is_usual;
use crate::plant::effects::{CATALOGUE, Entry, Parameter, Values};

/// How rows count here: a large effect puts many of them far off, and what explains those is looked for.
const LOSS: Loss = Loss::straight(K);

/// What gains less, by all passes, is not worth a fit: an amplitude of seven standard deviations gains twice as much. Of small effects
/// that were named the least had five times as much.
const LEAST: f64 = 24.0;

/// Rows that say of each other whether a trial changed them by chance, s to either side.
const NEAR_S: f64 = 0.02;

/// Share of the gain of the best trial of an effect from which on another one may lead further.
const NEARLY: f64 = 0.5;

/// Part of the way to where the linear estimate leads.
const PART: f64 = 0.25;

/// So many of the surest are tried, whatever others gain.
const SUREST: usize = 3;

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
    /// way, for an effect that is far from straight over all of it; then the first of another trial that gains nearly as much, for there
    /// the gain does not tell which leads further either.
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

/// Every effect that is not in the model yet, with the best trial of its laws. All passes tell so many times as much as these rows.
pub fn shortlist(
    problem: &Problem<'_>,
    here: &Linear,
    peaks: &dyn Fn(&Parameter) -> Vec<f64>,
    passes: f64,
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
    let trials: Vec<(&'static Entry, Values)> = CATALOGUE
        .iter()
        .filter(|entry| !has(entry.name) && !is_further(entry) && !is_second_law(entry) && shows(entry))
        .flat_map(|entry| seeds(entry, peaks).into_iter().map(move |values| (entry, values)))
        .filter(|(entry, values)| !model.has_twin_of(&Tried { entry, values: *values }))
        .collect();
    let mut listed = listed(problem, here, &trials, passes);
    listed.smallest.extend(unseen.map(|entry| Smallest::of(entry, f64::INFINITY)));
    listed
}

/// What those of these effects explain that explain most.
pub(super) fn gain_of(problem: &Problem<'_>, here: &Linear, names: &[&str]) -> f64 {
    let entries = CATALOGUE.iter().filter(|entry| names.contains(&entry.name));
    let trials: Vec<(&'static Entry, Values)> = entries
        .flat_map(|entry| seeds(entry, &|_| Vec::new()).into_iter().map(move |values| (entry, values)))
        .collect();
    listed(problem, here, &trials, 1.0).scored.first().map_or(0.0, |best| best.gain)
}

/// What such trials say.
fn listed(
    problem: &Problem<'_>,
    here: &Linear,
    trials: &[(&'static Entry, Values)],
    passes: f64,
) -> Shortlist {
    let model = &here.model;
    let equations = here.normal(usize::MAX, LOSS).with_beliefs(model);
    let mut curvature = equations.curvature.clone();
    for place in 0..curvature.nrows() {
        curvature[(place, place)] += 1e-9;
    }
    let Some(curvature) = curvature.cholesky() else {
        return Shortlist { scored: Vec::new(), smallest: Vec::new() };
    };
    // What a problem holds only tells how much could be made up for: moved, it would stay there.
    let moves: Vec<bool> = (0..model.coordinate_count()).map(|at| problem.tells(model, at)).collect();
    let (known, covariance) = ((curvature.clone(), equations.slope, moves), curvature.inverse());
    let places = problem.places(Part::Fit);
    let [block, about] = [BLOCK_S, 2.0 * NEAR_S].map(|time_s| problem.rows_in(time_s));
    let left: Vec<Left> = here.runs.par_iter().map(Left::of).collect();
    let tangents: Vec<DMatrix<f64>> = left
        .par_iter()
        .zip(&here.runs)
        .map(|(left, run)| slopes(&left.pulls, run.columns.iter().map(Option::as_deref), block))
        .collect();
    let tried = trials.par_iter().map(|(entry, values)| {
        let mut sums = Sums::new(model, entry);
        for (place, (run, left)) in places.iter().zip(here.runs.iter().zip(&left)) {
            let column = |values: Values| {
                let mut column = problem.residual(*place, &model.with(Tried { entry, values }), Part::Fit);
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
            sums.add(run, left, &columns, block);
        }
        let beyond = sums.beyond(&known.0);
        // The first trial of an effect is at its usual values.
        let is_first = entry.law_of.is_none() && *values == seeds(entry, &|_| Vec::new())[0];
        // What no data tell from an effect that every model has is that one, by another name.
        if let Some(at) = twin_of(model, entry) {
            let share = (sums.crossed[(0, at)] / equations.curvature[(at, at)]).abs();
            let deviation =
                covariance[(at, at)].sqrt() * values[0].abs() / (share * entry.parameters[0].prior);
            return (None, is_first.then(|| Smallest::of(entry, deviation)));
        }
        let smallest = is_first.then(|| beyond.smallest(entry, values));
        (sums.scored(beyond, &known, &tangents, model, Tried { entry, values: *values }), smallest)
    });
    let (scored, smallest): (Vec<Option<Scored>>, Vec<Option<Smallest>>) = tried.unzip();
    let of_usual = smallest::of_usual(model, &covariance);
    let mut by_name: BTreeMap<&str, Vec<Scored>> = BTreeMap::new();
    for scored in scored.into_iter().flatten() {
        by_name.entry(scored.entry().effect()).or_default().push(scored);
    }
    let best = by_name.into_values().filter_map(best_of);
    let mut best: Vec<Scored> = best.filter(|scored| passes * scored.gain > LEAST).collect();
    best.sort_by(|a, b| b.sureness.total_cmp(&a.sureness));
    best.iter_mut().take(SUREST).for_each(|scored| scored.is_sure = true);
    best.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let smallest = smallest.into_iter().flatten().chain(of_usual);
    Shortlist { scored: best, smallest: smallest.map(|one| one.by_passes(passes)).collect() }
}

/// The best of the trials of one effect, and where the next best leads if that gains nearly as much.
fn best_of(mut trials: Vec<Scored>) -> Option<Scored> {
    trials.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let mut trials = trials.into_iter();
    let mut best = trials.next()?;
    let next = trials.next().filter(|next| next.gain > NEARLY * best.gain);
    best.starts.extend(next.and_then(|next| next.starts.into_iter().next()));
    Some(best)
}

/// The coordinate of an effect that every model has, from which no data tell another.
fn twin_of(model: &Model, entry: &Entry) -> Option<usize> {
    let is_twin = |tried: &Tried| is_usual(tried.entry) && tried.entry.aliases.contains(&entry.name);
    Some(model.first_coordinate(model.effects.iter().position(is_twin)?))
}

/// What the base cannot make up for of the columns of a trial.
struct Beyond {
    /// By coordinate: how the base makes up for the rest.
    made_up: DMatrix<f64>,
    /// Products of what it cannot.
    held: DMatrix<f64>,
}

impl Beyond {
    fn smallest(&self, entry: &'static Entry, values: &Values) -> Smallest {
        // Of two columns a quarter of a period apart the mean, for nobody knows its phase.
        let seen = (self.held.trace() / self.held.nrows() as f64).sqrt();
        Smallest::of(entry, values[0].abs() / (entry.parameters[0].prior * seen))
    }
}

/// Products over all runs of the columns of a trial: with the tangent, with each other, with what is left.
struct Sums {
    crossed: DMatrix<f64>,
    columns: DMatrix<f64>,
    slope: DVector<f64>,
    /// By run: products of each column with what is left of each block, as rows count in the end.
    blocks: Vec<DMatrix<f64>>,
}

impl Sums {
    fn new(model: &Model, entry: &Entry) -> Self {
        let count = model.coordinate_count();
        let columns = if phase_of(entry).is_some() { 2 } else { 1 };
        Self {
            crossed: DMatrix::zeros(columns, count),
            columns: DMatrix::zeros(columns, columns),
            slope: DVector::zeros(columns),
            blocks: Vec::new(),
        }
    }

    fn add(&mut self, run: &LinearRun, left: &Left, columns: &[Residual], block: usize) {
        for (i, column) in columns.iter().enumerate() {
            let mut weighed = column.clone();
            for (weighed, weights) in weighed.iter_mut().zip(&left.weights) {
                weighed.iter_mut().zip(weights).for_each(|(value, weight)| *value *= weight);
            }
            self.slope[i] += products(&weighed, &run.residual);
            for (j, tangent) in run.columns.iter().enumerate() {
                self.crossed[(i, j)] += tangent.as_ref().map_or(0.0, |tangent| products(&weighed, tangent));
            }
            for (j, other) in columns.iter().enumerate() {
                self.columns[(i, j)] += products(&weighed, other);
            }
        }
        self.blocks.push(slopes(&left.pulls, columns.iter().map(Some), block));
    }

    fn beyond(&self, curvature: &Cholesky<f64, Dyn>) -> Beyond {
        let made_up = curvature.solve(&self.crossed.transpose());
        let mut held = &self.columns - &self.crossed * &made_up;
        for place in 0..held.nrows() {
            held[(place, place)] += 1e-9 + 1e-6 * self.columns[(place, place)];
        }
        Beyond { made_up, held }
    }

    fn scored(
        &self,
        Beyond { made_up, held }: Beyond,
        (curvature, slope, moves): &(Cholesky<f64, Dyn>, DVector<f64>, Vec<bool>),
        tangents: &[DMatrix<f64>],
        model: &Model,
        Tried { entry, values }: Tried,
    ) -> Option<Scored> {
        let left = made_up.transpose() * slope - &self.slope;
        let shares = held.cholesky()?.solve(&left);
        let made_up = &made_up * &shares;
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

/// What is left of a run, as all trials ask for it.
struct Left {
    /// How much each row weighs here.
    weights: Residual,
    /// What is left of it, as it counts in the end.
    pulls: Residual,
}

impl Left {
    fn of(run: &LinearRun) -> Self {
        let each = |of: fn(&f64) -> f64| -> Residual {
            run.residual.iter().map(|left| left.iter().map(of).collect()).collect()
        };
        Self { weights: each(|left| LOSS.weight(*left)), pulls: each(|left| Loss::LAST.weight(*left) * left) }
    }
}

/// Products of columns with what pulls: by column and block of so many rows.
fn slopes<'r>(
    pulls: &Residual,
    columns: impl ExactSizeIterator<Item = Option<&'r Residual>>,
    block: usize,
) -> DMatrix<f64> {
    let rows = pulls.iter().map(Vec::len).max().unwrap_or(0);
    let mut slopes = DMatrix::zeros(columns.len(), rows.div_ceil(block));
    for (place, column) in columns.enumerate() {
        for (pulls, column) in pulls.iter().zip(column.into_iter().flatten()) {
            for (number, (pulls, by)) in pulls.chunks(block).zip(column.chunks(block)).enumerate() {
                slopes[(place, number)] += product(pulls, by);
            }
        }
    }
    slopes
}

/// How sure a sum is by what it is a sum of, in standard deviations, squared.
fn sureness(of: impl Iterator<Item = f64>) -> f64 {
    let [sum, squares] = of.fold([0.0; 2], |[sum, squares], one| [sum + one, squares + one * one]);
    sum * sum / squares
}

fn products(a: &Residual, b: &Residual) -> f64 {
    a.iter().zip(b).map(|(a, b)| product(a, b)).sum()
}

#[cfg(test)]
mod tests {
    use super::super::usual;
    use super::*;
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
    fn another_trial_that_gains_nearly_as_much_is_another_start() {
        let model = Model::new(paper_axis());
        let trial = |gain: f64, starts: usize| Scored {
            starts: vec![model.clone(); starts],
            gain,
            sureness: gain,
            is_sure: false,
        };
        let starts = |gains: [f64; 3]| {
            let best =
                best_of(gains.iter().zip([1, 2, 4]).map(|(gain, count)| trial(*gain, count)).collect());
            best.map(|best| (best.gain, best.starts.len()))
        };
        assert_eq!(starts([3.0, 9.0, 6.0]), Some((9.0, 2 + 1)), "where the second leads, too");
        assert_eq!(starts([3.0, 9.0, 4.0]), Some((9.0, 2)), "the best alone");
        assert!(best_of(Vec::new()).is_none());
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

    #[test]
    fn products_are_of_blocks_and_rows_that_are_far_off_count_for_little() {
        let mut left = vec![1.0; 6];
        left[4] = 40.0;
        let column = vec![vec![2.0; 6]];
        let run = LinearRun { residual: vec![left], columns: Vec::new() };
        let slopes = slopes(&Left::of(&run).pulls, [None, Some(&column)].into_iter(), 4);
        assert_eq!(slopes.shape(), (2, 2));
        assert_eq!([slopes[(0, 0)], slopes[(1, 0)]], [0.0, 8.0]);
        // Two, and the ten thousandth part of eighty.
        assert!((slopes[(1, 1)] - 2.008).abs() < 1e-9, "{}", slopes[(1, 1)]);
    }
}
