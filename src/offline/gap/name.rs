//! Which effect it is: the candidates of the shortlist are fitted together with the base, and each must pass every
//! gate before it is named.
//!
//! ```text
//!   base fit ─► shortlist ─► joint fits ─► gates ─► the best, with those that cannot be told from it ─► add ─┐
//!                  ▲                                                                                       │
//!                  └───────────────────────────────────────────────────────────────────────────────────────┘
//!   then backwards: each named effect must still be needed beside the others
//! ```
//!
//! Fits are judged by rows that they have not seen. Costs are divided by what the best model still leaves per row, so
//! that a model that is wrong elsewhere makes nothing significant.
//! Invariant: an effect that is named has passed every gate; one that has failed one is listed with it.

use rayon::prelude::*;
use serde::Serialize;

use super::blocks::Blocks;
use super::fit::{Effort, Fitted, LEAST_PER_ROW, believed, fit};
use super::linear::{Linear, Steps, cost_of, residuals};
use super::model::Model;
use super::problem::{Part, Problem};
use super::shortlist::{Scored, shortlist};
use super::spectrum::Peaks;
use crate::plant::effects::{CATALOGUE, Experiment, Parameter, entry};

/// Candidates that are fitted together with the base to the first pass of each command. Those that explain this share of
/// what the best of them explains stay after a few iterations from the better of two starts; in the end those of the
/// second share are fitted to all rows, and the others where none of these passes.
const FITTED: usize = 6;
const SHARES: [f64; 2] = [0.1, 0.6];
/// Most effects that are named of an axis.
const EFFECTS_MAX: usize = 4;
/// Iterations of coarse fits: of the base, and of a candidate with it, and those first few.
const ITERATIONS: [usize; 2] = [12, 6];
const FEW: usize = 2;
/// What leaves less than this share of what was left is fitted to the bottom.
const FAR: f64 = 0.95;
/// Fall of the information criterion that a candidate must bring on the fitted rows, beyond what the number of candidates
/// explains.
const FALL: f64 = 10.0;
/// Fall of the cost on the rows that were not fitted, and the share of what is left there: little, for somebody may have
/// leaned on the table in one of those runs.
const HELD_FALL: f64 = 25.0;
const HELD_SHARE: f64 = 0.02;
/// Cost per row that is plainly more than noise, which is 1.
const PLAIN: f64 = 1.1;
/// An amplitude must be so many of its standard deviations.
const SURE: f64 = 4.0;
/// A number that is as far from a whole one as its uncertainty allows, and within these, may be whole.
const WHOLE: [f64; 2] = [0.04, 0.15];
/// Candidates whose evidence is nearer than this, or than this share, cannot be told apart.
const NEAR: (f64, f64) = (20.0, 0.02);

/// A candidate that was fitted.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Base and effects with it.
    pub fitted: Fitted,
    /// Cost on the rows that were not fitted.
    pub held: f64,
    /// By how much it is better than the model without it, both parts, in units of one row's variance.
    pub evidence: f64,
    /// The gates it did not pass.
    pub failed: Vec<Gate>,
}

impl Candidate {
    /// Name of the effect that it adds, whichever law of it.
    pub fn name(&self) -> &'static str {
        self.fitted.model.effects.last().map_or("", |tried| tried.entry.effect())
    }
}

/// What a candidate has to pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Gate {
    /// Better on the fitted rows than its parameters explain.
    Fit,
    /// Better on rows it has not seen.
    Held,
    /// Better there whichever of them are drawn.
    Blocks,
    /// An amplitude that is sure not to be zero.
    Amplitude,
    /// Values that the data chose and not the bounds.
    Bounds,
    /// Whole numbers where machines have no others.
    Whole,
    /// Worse again without it, all else fitted from where it stands with it.
    Needed,
    /// Little left of what there was.
    Explains,
}

/// What an axis lacks.
#[derive(Debug)]
pub struct Named {
    /// The base alone.
    pub base: Fitted,
    /// Its cost on the rows that were not fitted.
    pub base_held: f64,
    /// Base and all that was named.
    pub model: Fitted,
    /// Its cost there.
    pub held: f64,
    /// What was named, in order, with what could not be told from it.
    pub effects: Vec<NamedEffect>,
    /// The best that failed a gate in the last round.
    pub refused: Vec<Candidate>,
    /// Rows of both parts.
    pub rows: [usize; 2],
}

impl Named {
    /// Takes back what was named: it passed every gate and explains too little all the same.
    pub fn withdraw(&mut self) {
        for effect in self.effects.drain(..) {
            let best = effect.class.into_iter().next();
            self.refused.extend(best.map(|(mut candidate, _)| {
                candidate.failed.push(Gate::Explains);
                candidate
            }));
        }
        (self.model, self.held) = (self.base.clone(), self.base_held);
    }
}

/// An effect that was named.
#[derive(Debug)]
pub struct NamedEffect {
    /// Its name.
    pub name: &'static str,
    /// The best first, each with how probable it is among them.
    pub class: Vec<(Candidate, f64)>,
    /// The next that is worse, and by how much.
    pub runner_up: Option<(&'static str, f64)>,
}

impl NamedEffect {
    /// Names of its class, the best first.
    pub fn members(&self) -> impl Iterator<Item = &'static str> {
        self.class.iter().map(|(candidate, _)| candidate.name())
    }

    /// What an axis must do to tell it from the others of its class; nothing where it is alone, or where no log tells
    /// them apart.
    pub fn told_apart_by(&self) -> Option<Experiment> {
        let mut others = self.members();
        let open = others.find(|other| *other != self.name && !is_alias(self.name, other))?;
        Some(entry(open)?.experiment)
    }
}

/// Names what an axis lacks; `progress` is told what is being done.
pub fn name(problem: &Problem<'_>, start: &Model, progress: &(dyn Fn(&str) + Sync)) -> Named {
    let rows = [Part::Fit, Part::Held].map(|part| problem.count(part));
    progress("fitting the base model");
    let once = problem.first_passes();
    let coarse = coarsely(problem, &once, start);
    let (mut model, mut blocks) = (coarse.clone(), Blocks::new(problem, &coarse.model));
    // The base at its bottom, which is known where a name was put to the test.
    let mut base: Option<Fitted> = None;
    let mut effects: Vec<NamedEffect> = Vec::new();
    let mut refused = Vec::new();
    while effects.len() < EFFECTS_MAX {
        progress("looking for what is missing");
        let peaks = Peaks::new(problem, &model.model);
        let here_once = linear(&once, &model.model);
        // What the base may not go further with makes up for no more.
        let held: Vec<usize> = model.model.at_reach().collect();
        let listed = shortlist(&once, &here_once.holding(&held), &|key| peaks.of(key));
        progress("fitting what may be missing");
        let promising = screened(&once, &here_once, &listed);
        let mut candidates = Vec::new();
        // Of all rows, where anything is to be fitted to them.
        let mut here = None;
        for promising in promising.iter().filter(|promising| !promising.is_empty()) {
            let here = here.get_or_insert_with(|| linear(problem, &model.model));
            candidates.extend(tried(problem, here, &model, &blocks, promising, (&once, start), rows));
            if candidates.iter().any(|candidate: &Candidate| candidate.failed.is_empty()) {
                break;
            }
        }
        candidates.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let (passed, failed): (Vec<Candidate>, Vec<Candidate>) =
            candidates.into_iter().partition(|candidate| candidate.failed.is_empty());
        refused = failed;
        let Some(best) = passed.first().cloned() else { break };
        let margin = NEAR.0.max(NEAR.1 * best.evidence);
        // What says no more with more numbers is no other explanation.
        let count = |candidate: &Candidate| candidate.fitted.model.coordinate_count();
        let (class, rest): (Vec<Candidate>, Vec<Candidate>) = passed.into_iter().partition(|candidate| {
            let is_near = candidate.evidence > best.evidence - margin && count(candidate) <= count(&best);
            is_near || is_alias(best.name(), candidate.name())
        });
        let runner_up =
            rest.first().or(refused.first()).map(|next| (next.name(), best.evidence - next.evidence));
        // Tempered: what is near a tie is to be told as one.
        let weights: Vec<f64> =
            class.iter().map(|one| (0.5 * (one.evidence - best.evidence) / margin).exp()).collect();
        let all: f64 = weights.iter().sum();
        let class = class.into_iter().zip(weights.iter().map(|weight| weight / all)).collect();
        progress(&format!("{}: is it needed?", best.name()));
        model = if is_far(&best.fitted, &model) {
            best.fitted.clone()
        } else {
            refitted(problem, &once, &best.fitted.model, start)
        };
        blocks = Blocks::new(problem, &model.model);
        effects.push(NamedEffect { name: best.name(), class, runner_up });
        // On its way to the effect the base may have left a valley in which the fit without it was held up: what is
        // gained is what is lost again without it, from here.
        let test = Without::of(problem, &once, &model, effects.len() - 1, start);
        if effects.len() == 1 {
            base = Some(test.fitted.clone());
        }
        if !test.shows_need(&model, &blocks, effects.len() - 1, rows) {
            (model, blocks) = (test.fitted, test.blocks);
            effects.pop();
            let mut best = best;
            best.failed.push(Gate::Needed);
            refused.push(best);
            break;
        }
    }
    // Backwards: what came first may have stood for what came later.
    let mut place = 0;
    while effects.len() > 1 && place + 1 < effects.len() {
        let test = Without::of(problem, &once, &model, place, start);
        if test.shows_need(&model, &blocks, place, rows) {
            place += 1;
        } else {
            effects.remove(place);
            (model, blocks) = (test.fitted, test.blocks);
            place = 0;
        }
    }
    progress("fitting the base model to the end");
    let base = base.unwrap_or_else(|| fit(problem, &coarse.model, Effort::Fine, None));
    let base_blocks = Blocks::new(problem, &base.model);
    if effects.is_empty() {
        (model, blocks) = (base.clone(), base_blocks.clone());
    }
    let [base_held, held] = [base_blocks, blocks].map(|blocks| blocks.cost());
    Named { base, base_held, model, held, effects, refused, rows }
}

/// A model where nothing of it is known well yet.
fn linear(problem: &Problem<'_>, model: &Model) -> Linear {
    Linear::new(problem, model, residuals(problem, model, Part::Fit), None, &Steps::widest(model))
}

/// A model without one of its effects, fitted to the bottom from where it stands with it.
struct Without {
    fitted: Fitted,
    blocks: Blocks,
}

impl Without {
    fn of(problem: &Problem<'_>, once: &Problem<'_>, model: &Fitted, place: usize, start: &Model) -> Self {
        let fitted = refitted(problem, once, &model.model.without(place), start);
        Self { blocks: Blocks::new(problem, &fitted.model), fitted }
    }

    /// Whether it does worse on both parts than the model with the effect.
    fn shows_need(&self, model: &Fitted, blocks: &Blocks, place: usize, rows: [usize; 2]) -> bool {
        let parameters = model.model.effects[place].entry.parameters.len() as f64;
        let fall = (self.fitted.total - model.total) / scale(model.cost, rows[0])
            - parameters * (rows[0] as f64).ln();
        let held_fall = (self.blocks.cost() - blocks.cost()) / scale(blocks.cost(), rows[1]);
        let is_worse = held_fall > HELD_FALL && self.blocks.is_surely_worse_than(blocks);
        let is_plain = does_not_show_where_judged(&self.fitted, model, [&self.blocks, blocks], rows);
        fall > FALL && (is_worse || is_plain)
    }
}

/// A model fitted to the bottom.
fn refitted(problem: &Problem<'_>, once: &Problem<'_>, model: &Model, start: &Model) -> Fitted {
    fit(problem, &from_both(problem, once, model, start), Effort::Fine, None)
}

/// A model fitted coarsely, from where it stands and from where sums of rows lead from the base of the file: the base that
/// was fitted otherwise may stand in a valley of its own.
fn from_both(problem: &Problem<'_>, once: &Problem<'_>, model: &Model, start: &Model) -> Model {
    let of_file = Model { base: start.base, ..model.clone() };
    let coarsely =
        |once: &Problem<'_>, model: &Model| fit(once, model, Effort::Coarse(ITERATIONS[0]), None).model;
    let (one, other) =
        rayon::join(|| coarsely(once, model), || coarsely(once, &coarsely(&once.smooth(), &of_file)));
    better(problem, &one, &other).clone()
}

/// The base fitted coarsely.
fn coarsely(problem: &Problem<'_>, once: &Problem<'_>, start: &Model) -> Fitted {
    fit(problem, &from_both(problem, once, start, start), Effort::Coarse(ITERATIONS[0]), None)
}

/// Whether a model explains so much of what another leaves that it is fitted to the bottom before it is judged.
fn is_far(fitted: &Fitted, without: &Fitted) -> bool {
    fitted.total < FAR * without.total
}

fn better<'a>(problem: &Problem<'_>, one: &'a Model, other: &'a Model) -> &'a Model {
    let total = |model: &Model| cost_of(problem, model, Part::Fit) + believed(model);
    if total(other) < total(one) { other } else { one }
}

/// Whether the rows that judge say nothing of an effect: on the others it makes plainly more than noise into noise, and
/// there it makes nothing surely worse. Circles tell little of what the force of the screw does to friction.
fn does_not_show_where_judged(without: &Fitted, with: &Fitted, held: [&Blocks; 2], rows: [usize; 2]) -> bool {
    let per_row = |fitted: &Fitted| fitted.cost / rows[0].max(1) as f64;
    per_row(without) > PLAIN && per_row(with) < 1.0 && !held[1].is_surely_worse_than(held[0])
}

/// What is left per row.
fn scale(cost: f64, rows: usize) -> f64 {
    (cost / rows.max(1) as f64).max(LEAST_PER_ROW)
}

fn is_alias(name: &str, other: &str) -> bool {
    CATALOGUE.iter().any(|entry| {
        (entry.name == name && entry.aliases.contains(&other))
            || (entry.name == other && entry.aliases.contains(&name))
    })
}

/// The most promising of a list, fitted to few rows beside the model that was fitted before, from the better of two
/// starts: those that explain most of it, and those that explain less.
fn screened(once: &Problem<'_>, here: &Linear, listed: &[Scored]) -> [Vec<Model>; 2] {
    let without = here.cost() + believed(&here.model);
    let rows = once.count(Part::Fit);
    let explained = |fitted: &Fitted| {
        let parameters = fitted.model.coordinate_count() - here.model.coordinate_count();
        (without - fitted.total) / scale(fitted.cost, rows) - parameters as f64 * (rows.max(1) as f64).ln()
    };
    let best = |all: &[Fitted]| all.iter().map(explained).fold(0.0, f64::max);
    let begun = |scored: &Scored| {
        let [first, second] =
            scored.starts.each_ref().map(|start| fit(once, start, Effort::Coarse(FEW), Some(here)));
        if second.total < first.total { second } else { first }
    };
    let ended = |begun: Fitted| fit(once, &begun.model, Effort::Coarse(ITERATIONS[1] - FEW), Some(here));
    let mut begun: Vec<Fitted> = listed.par_iter().take(FITTED).map(begun).collect();
    let least = SHARES[0] * best(&begun);
    begun.retain(|one| explained(one) > least);
    let mut ended: Vec<Fitted> = begun.into_par_iter().map(ended).collect();
    ended.retain(|one| explained(one) > 0.0);
    let least = SHARES[1] * best(&ended);
    let (most, less): (Vec<Fitted>, Vec<Fitted>) = ended.into_iter().partition(|one| explained(one) >= least);
    [most, less].map(|all| all.into_iter().map(|fitted| fitted.model).collect())
}

/// Models with an effect more, fitted to all rows and put to every gate but the last.
fn tried(
    problem: &Problem<'_>,
    here: &Linear,
    without: &Fitted,
    blocks_without: &Blocks,
    promising: &[Model],
    (once, start): (&Problem<'_>, &Model),
    rows: [usize; 2],
) -> Vec<Candidate> {
    let without_held = blocks_without.cost();
    let one = |promising: &Model| {
        let mut fitted = fit(problem, promising, Effort::Coarse(ITERATIONS[1]), Some(here));
        // What explains much leads far from where those derivatives hold.
        if is_far(&fitted, without) {
            fitted = refitted(problem, once, &fitted.model, start);
        }
        let blocks = Blocks::new(problem, &fitted.model);
        let held = blocks.cost();
        let added = fitted.model.effects.len() - 1;
        let entry = fitted.model.effects[added].entry;
        let parameters = entry.parameters.len();
        let scale = scale(fitted.cost, rows[0]);
        let held_scale = self::scale(held, rows[1]);
        let fall = (without.total - fitted.total) / scale - parameters as f64 * (rows[0] as f64).ln();
        let held_fall = (without_held - held) / held_scale;
        // Pure noise costs 1 per row.
        let left = without_held - rows[1] as f64;
        let mut failed = Vec::new();
        if fall <= FALL + 2.0 * (CATALOGUE.len() as f64).ln() {
            failed.push(Gate::Fit);
        }
        let is_hidden = does_not_show_where_judged(without, &fitted, [blocks_without, &blocks], rows);
        if !is_hidden && (held_fall <= HELD_FALL || (without_held - held) < HELD_SHARE * left) {
            failed.push(Gate::Held);
        }
        if !is_hidden && !blocks_without.is_surely_worse_than(&blocks) {
            failed.push(Gate::Blocks);
        }
        let place = fitted.model.first_coordinate(added);
        if !entry.amplitudes().any(|amplitude| fitted.is_surely_not_zero(place + amplitude, SURE)) {
            failed.push(Gate::Amplitude);
        }
        if fitted.model.is_at_bound(added) {
            failed.push(Gate::Bounds);
        }
        let is_whole = |(of, parameter): (usize, &Parameter)| {
            let value = fitted.model.effects[added].values[of];
            let sigma = fitted.covariance[(place + of, place + of)].sqrt() * parameter.prior;
            let reach = (SURE * sigma).clamp(WHOLE[0], WHOLE[1]);
            !parameter.is_whole || (value - value.round()).abs() <= reach
        };
        if !entry.parameters.iter().enumerate().all(is_whole) {
            failed.push(Gate::Whole);
        }
        Candidate { evidence: fall + held_fall, fitted, held, failed }
    };
    promising.par_iter().map(one).collect()
}
