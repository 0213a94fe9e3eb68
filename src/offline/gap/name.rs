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

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use serde::Serialize;

use super::fit::{Fitted, cost, cost_of, fit, rho};
use super::model::Model;
use super::problem::{Part, Problem};
use super::shortlist::{Scored, shortlist};
use crate::plant::effects::CATALOGUE;

/// Candidates that are fitted together with the base.
const FITTED: usize = 6;
/// Most effects that are named of an axis.
const EFFECTS_MAX: usize = 4;
/// Iterations of the fit of the base, and of a candidate with it.
const ITERATIONS: [usize; 2] = [12, 6];
/// Fall of the information criterion that a candidate must bring on the fitted rows, beyond what the number of candidates
/// explains.
const FALL: f64 = 10.0;
/// Fall of the cost on the rows that were not fitted, and the share of what is left there.
const HELD_FALL: f64 = 25.0;
const HELD_SHARE: f64 = 0.1;
/// An amplitude must be so many of its standard deviations.
const SURE: f64 = 4.0;
/// Candidates whose evidence is nearer than this, or than this share, cannot be told apart.
const NEAR: (f64, f64) = (20.0, 0.02);
/// Length of the blocks that are drawn to see how sure a fall is, s, and how often.
const BLOCK_S: f64 = 0.25;
const DRAWS: usize = 400;

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
    /// Name of the effect that it adds.
    pub fn name(&self) -> &'static str {
        self.fitted.model.effects.last().map_or("", |tried| tried.entry.name)
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

/// Rows of a part.
pub fn rows(problem: &Problem<'_>, part: Part) -> usize {
    (0..problem.data.len()).map(|place| problem.count(place, part)).sum()
}

/// Names what an axis lacks; `progress` is told what is being done.
pub fn name(
    problem: &Problem<'_>,
    start: &Model,
    peaks: &(dyn Fn(&Model, &str) -> Vec<f64> + Sync),
    progress: &(dyn Fn(&str) + Sync),
) -> Named {
    let rows = [Part::Fit, Part::Held].map(|part| rows(problem, part));
    progress("fitting the base model");
    let base = fit(problem, start, ITERATIONS[0]);
    let base_held = cost_of(problem, &base.model, Part::Held);
    let (mut model, mut held) = (base.clone(), base_held);
    let mut effects: Vec<NamedEffect> = Vec::new();
    let mut refused = Vec::new();
    while effects.len() < EFFECTS_MAX {
        progress("looking for what is missing");
        let here = model.model.clone();
        let listed = shortlist(problem, &here, &|key| peaks(&here, key));
        progress("fitting what may be missing");
        let mut candidates = tried(problem, &model, held, &listed, rows);
        candidates.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let (passed, failed): (Vec<Candidate>, Vec<Candidate>) =
            candidates.into_iter().partition(|candidate| candidate.failed.is_empty());
        refused = failed;
        let Some(best) = passed.first().cloned() else { break };
        let margin = NEAR.0.max(NEAR.1 * best.evidence);
        let (class, rest): (Vec<Candidate>, Vec<Candidate>) = passed.into_iter().partition(|candidate| {
            candidate.evidence > best.evidence - margin || is_alias(best.name(), candidate.name())
        });
        let runner_up =
            rest.first().or(refused.first()).map(|next| (next.name(), best.evidence - next.evidence));
        // Tempered: what is near a tie is to be told as one.
        let weights: Vec<f64> =
            class.iter().map(|one| (0.5 * (one.evidence - best.evidence) / margin).exp()).collect();
        let all: f64 = weights.iter().sum();
        let class = class.into_iter().zip(weights.iter().map(|weight| weight / all)).collect();
        (model, held) = (best.fitted.clone(), best.held);
        effects.push(NamedEffect { name: best.name(), class, runner_up });
    }
    // Backwards: what came first may have stood for what came later.
    let mut place = 0;
    while effects.len() > 1 && place < effects.len() {
        let without = fit(problem, &model.model.without(place), ITERATIONS[1]);
        let without_held = cost_of(problem, &without.model, Part::Held);
        let scale = scale(model.cost, rows[0]);
        let fall = (without.total - model.total) / scale;
        let held_fall = (without_held - held) / scale;
        if fall < FALL || held_fall < HELD_FALL {
            effects.remove(place);
            (model, held) = (without, without_held);
            place = 0;
        } else {
            place += 1;
        }
    }
    Named { base, base_held, model, held, effects, refused, rows }
}

/// What is left per row, at least the 1 of noise.
fn scale(cost: f64, rows: usize) -> f64 {
    (cost / rows.max(1) as f64).max(1.0)
}

fn is_alias(name: &str, other: &str) -> bool {
    CATALOGUE.iter().any(|entry| {
        (entry.name == name && entry.aliases.contains(&other))
            || (entry.name == other && entry.aliases.contains(&name))
    })
}

fn tried(
    problem: &Problem<'_>,
    without: &Fitted,
    without_held: f64,
    listed: &[Scored],
    rows: [usize; 2],
) -> Vec<Candidate> {
    let blocks_without = blocks(problem, &without.model);
    listed
        .par_iter()
        .take(FITTED)
        .map(|scored| {
            let fitted = fit(problem, &without.model.with(scored.tried), ITERATIONS[1]);
            let held = cost_of(problem, &fitted.model, Part::Held);
            let added = fitted.model.effects.len() - 1;
            let parameters = scored.tried.entry.parameters.len();
            let scale = scale(fitted.cost, rows[0]);
            let held_scale = self::scale(held, rows[1]);
            let fall = (without.total - fitted.total) / scale - parameters as f64 * (rows[0] as f64).ln();
            let held_fall = (without_held - held) / held_scale;
            let left = without_held - expected_cost(rows[1]);
            let mut failed = Vec::new();
            if fall <= FALL + 2.0 * (CATALOGUE.len() as f64).ln() {
                failed.push(Gate::Fit);
            }
            if held_fall <= HELD_FALL || (without_held - held) < HELD_SHARE * left {
                failed.push(Gate::Held);
            }
            if !is_sure(&blocks_without, &blocks(problem, &fitted.model)) {
                failed.push(Gate::Blocks);
            }
            let place = fitted.model.coordinate_count() - parameters;
            let amplitude = fitted.model.coordinates()[place];
            let sigma = (fitted.covariance[(place, place)] * scale).sqrt();
            if amplitude.abs() <= SURE * sigma {
                failed.push(Gate::Amplitude);
            }
            if fitted.model.is_at_bound(added) {
                failed.push(Gate::Bounds);
            }
            Candidate { evidence: fall + held_fall, fitted, held, failed }
        })
        .collect()
}

/// What pure noise costs.
fn expected_cost(rows: usize) -> f64 {
    rows as f64
}

/// Cost of the rows that were not fitted, block by block.
fn blocks(problem: &Problem<'_>, model: &Model) -> Vec<f64> {
    let length = (BLOCK_S / problem.machine.cycle.period.as_s()) as usize;
    let mut blocks = Vec::new();
    for place in (0..problem.data.len()).filter(|place| problem.data[*place].has(Part::Held)) {
        let residual = problem.residual(place, model, Part::Held);
        let rows = residual.iter().map(Vec::len).max().unwrap_or(0);
        for from in (0..rows).step_by(length) {
            let of = |signal: &Vec<f64>| {
                signal.iter().skip(from).take(length).map(|value| rho(*value)).sum::<f64>()
            };
            blocks.push(residual.iter().map(of).sum());
        }
    }
    blocks
}

/// Whether blocks drawn again are better in 95 of 100 draws.
fn is_sure(without: &[f64], with: &[f64]) -> bool {
    let falls: Vec<f64> = without.iter().zip(with).map(|(a, b)| a - b).collect();
    if falls.is_empty() {
        return false;
    }
    let mut random = Pcg64Mcg::seed_from_u64(5);
    let worse = (0..DRAWS)
        .filter(|_| (0..falls.len()).map(|_| falls[random.random_range(0..falls.len())]).sum::<f64>() <= 0.0)
        .count();
    worse * 20 <= DRAWS
}

/// Cost of a model on a run, for whoever wants to see where it is.
pub fn cost_of_run(problem: &Problem<'_>, place: usize, model: &Model, part: Part) -> f64 {
    cost(&problem.residual(place, model, part))
}
