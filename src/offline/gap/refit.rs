//! A model fitted again: from more than one start, coarsely or to the bottom.
//!
//! Invariant: of two ends the deeper one is kept.

use rayon::prelude::*;

use super::fit::{Effort, Fitted, LEAST_PER_ROW, fit, total_of};
use super::model::{BASE, Model};
use super::problem::{Part, Problem};

/// Iterations of coarse fits: of the base, and of a candidate with it.
pub(super) const ITERATIONS: [usize; 2] = [12, 6];
/// Within how many priors a model must be straight about a row for it to count, fit by fit: never mind from where a model
/// stands, and from the file; and once more from there where the ends of these differ by more than a share of the cost.
const WAYS: [&[f64]; 3] = [&[], &[0.3, 0.1, 0.05], &[0.5, 0.25, 0.1]];
const SAME: f64 = 1e-3;
/// By how many priors mass and stiffness of the file are moved apart, where all that leaves more than noise: without a table
/// scale only what rings tells one from the other, and each frequency has a valley of its own.
const TUNED: [f64; 2] = [0.6, -0.6];
/// The same for what is named and judged.
const REACH: f64 = 0.05;
/// What leaves less than this share of what was left is fitted to the bottom.
const FAR: f64 = 0.95;

/// A model fitted to the bottom.
pub(super) fn refitted(problem: &Problem<'_>, once: &Problem<'_>, model: &Model, start: &Model) -> Fitted {
    fit(problem, &by_all_ways(problem, once, model, start), Effort::Fine, None)
}

/// A model fitted coarsely, from where it stands and from the base of the file, by rows about which it is straight: a base
/// that was fitted without the effect may stand in a valley of its own, and where stick and slip make many valleys, no
/// way is always the best.
fn by_all_ways(problem: &Problem<'_>, once: &Problem<'_>, model: &Model, start: &Model) -> Model {
    let of_file = Model { base: start.base, ..model.clone() };
    let walked = |ways: std::ops::Range<usize>| -> Vec<(f64, Model)> {
        let begun = |number: usize| if WAYS[number].is_empty() { model } else { &of_file };
        let ends: Vec<Model> =
            ways.into_par_iter().map(|number| by_way(once, begun(number), number)).collect();
        with_totals(problem, ends)
    };
    let mut ends = walked(0..2);
    if (ends[0].0 / ends[1].0 - 1.0).abs() > SAME {
        ends.extend(walked(2..WAYS.len()));
    }
    deepest(ends).1
}

/// Where a way from a model ends.
fn by_way(once: &Problem<'_>, begun: &Model, number: usize) -> Model {
    let nearer =
        |model: Model, reach: &f64| ended(&once.where_straight(&model, *reach, number as u64), &model);
    ended(once, &WAYS[number].iter().fold(begun.clone(), nearer))
}

/// A base with mass and stiffness so many priors apart.
fn apart(base: &Model, by: f64) -> Model {
    let mut at = base.coordinates();
    for (coordinate, base) in at.iter_mut().zip(&BASE) {
        match base.name {
            "mass" => *coordinate += by,
            "stiffness" => *coordinate -= by,
            _ => {}
        }
    }
    base.at(&at)
}

/// Where a coarse fit ends.
pub(super) fn ended(problem: &Problem<'_>, model: &Model) -> Model {
    fit(problem, model, Effort::Coarse(ITERATIONS[0]), None).model
}

fn with_totals(problem: &Problem<'_>, ends: Vec<Model>) -> Vec<(f64, Model)> {
    ends.into_iter().map(|model| (total_of(problem, &model), model)).collect()
}

fn deepest(ends: impl IntoIterator<Item = (f64, Model)>) -> (f64, Model) {
    ends.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).expect("an end")
}

/// The base fitted to the bottom from where it stands beside an effect, and from where it was fitted without.
pub(super) fn base_refitted(problem: &Problem<'_>, once: &Problem<'_>, ends: [&Model; 2]) -> Fitted {
    let ends = ends.par_iter().map(|model| ended(once, model)).collect();
    fit(problem, &deepest(with_totals(problem, ends)).1, Effort::Fine, None)
}

/// The base fitted coarsely, and the problem in which rows count by how straight it is about them.
pub(super) fn coarsely<'m>(problem: &Problem<'m>, start: &Model) -> (Problem<'m>, Fitted) {
    let once = problem.first_passes();
    let model = by_all_ways(problem, &once, start, start);
    let best = (total_of(problem, &model), model);
    let tuned = if best.0 > problem.count(Part::Fit) as f64 { &TUNED[..] } else { &[] };
    let ends = tuned.par_iter().map(|by| by_way(&once, &apart(start, *by), 1)).collect();
    let (_, model) = deepest(with_totals(problem, ends).into_iter().chain([best]));
    let problem = problem.where_straight(&model, REACH, 0);
    let fitted = fit(&problem, &model, Effort::Coarse(ITERATIONS[0]), None);
    (problem, fitted)
}

/// A model fitted coarsely, from where it stands and from the base of the file.
pub(super) fn coarsely_from(
    problem: &Problem<'_>,
    once: &Problem<'_>,
    model: &Model,
    start: &Model,
) -> Fitted {
    fit(problem, &by_all_ways(problem, once, model, start), Effort::Coarse(ITERATIONS[0]), None)
}

/// Whether a model explains so much of what another leaves that it is fitted to the bottom before it is judged.
pub(super) fn is_far(fitted: &Fitted, without: &Fitted) -> bool {
    fitted.total < FAR * without.total
}

/// What is left per row.
pub(super) fn scale(cost: f64, rows: usize) -> f64 {
    (cost / rows.max(1) as f64).max(LEAST_PER_ROW)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::tests::paper_axis;

    #[test]
    fn bases_apart_swing_at_other_frequencies_about_the_same_middle() {
        let file = Model::new(paper_axis());
        let natural = |by: f64| {
            let values = apart(&file, by).base_values();
            let of = |name: &str| values.iter().find(|(base, _)| base.name == name).expect("a parameter").1;
            (of("stiffness") / of("mass")).sqrt()
        };
        let [higher, lower] = TUNED.map(|by| natural(-by) / natural(0.0));
        assert!(higher > 1.1 && (higher * lower - 1.0).abs() < 1e-9, "{higher}, {lower}");
    }
}
