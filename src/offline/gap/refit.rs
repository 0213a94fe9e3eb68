//! A model fitted again: from more than one start, coarsely or to the bottom.
//!
//! Invariant: of two ends the deeper one is kept.

use rayon::prelude::*;

use super::fit::{Effort, Fitted, LEAST_PER_ROW, believed, fit};
use super::linear::cost_of;
use super::model::Model;
use super::problem::{Part, Problem};

/// Iterations of coarse fits: of the base, and of a candidate with it.
pub(super) const ITERATIONS: [usize; 2] = [12, 6];
/// How many rows are summed up on the way, one after the other: none from where a model stands, and from the file twice.
const WAYS: [&[usize]; 3] = [&[], &[128, 32, 8], &[256, 64, 16]];
/// What leaves less than this share of what was left is fitted to the bottom.
const FAR: f64 = 0.95;

/// A model fitted to the bottom.
pub(super) fn refitted(problem: &Problem<'_>, once: &Problem<'_>, model: &Model, start: &Model) -> Fitted {
    fit(problem, &by_all_ways(problem, once, model, start), Effort::Fine, None)
}

/// A model fitted coarsely, from where it stands and from where sums of rows lead from the base of the file: a base that
/// was fitted without the effect may stand in a valley of its own, and where stick and slip make many valleys, no way is
/// always the best.
fn by_all_ways(problem: &Problem<'_>, once: &Problem<'_>, model: &Model, start: &Model) -> Model {
    let of_file = Model { base: start.base, ..model.clone() };
    let ended =
        |once: &Problem<'_>, model: &Model| fit(once, model, Effort::Coarse(ITERATIONS[0]), None).model;
    let way = |sums: &&[usize]| {
        let begun = if sums.is_empty() { model } else { &of_file };
        ended(once, &sums.iter().fold(begun.clone(), |model, rows| ended(&once.summed_up(*rows), &model)))
    };
    let ends: Vec<Model> = WAYS.par_iter().map(way).collect();
    let total = |model: &Model| cost_of(problem, model, Part::Fit) + believed(model);
    let totals: Vec<f64> = ends.iter().map(total).collect();
    let best = (0..ends.len()).min_by(|a, b| totals[*a].total_cmp(&totals[*b])).expect("a way");
    ends[best].clone()
}

/// The base fitted coarsely.
pub(super) fn coarsely(problem: &Problem<'_>, once: &Problem<'_>, start: &Model) -> Fitted {
    fit(problem, &by_all_ways(problem, once, start, start), Effort::Coarse(ITERATIONS[0]), None)
}

/// Whether a model explains so much of what another leaves that it is fitted to the bottom before it is judged.
pub(super) fn is_far(fitted: &Fitted, without: &Fitted) -> bool {
    fitted.total < FAR * without.total
}

/// What is left per row.
pub(super) fn scale(cost: f64, rows: usize) -> f64 {
    (cost / rows.max(1) as f64).max(LEAST_PER_ROW)
}
