//! Whether an effect foretells each command from the others, where the rows that judge cannot show it.
//!
//! ```text
//!   runs of all commands but one ──► amplitudes ─┐
//!   all runs ──► base beside them, or alone ─────┴─► what both leave of the runs of that one
//! ```
//!
//! Circles of 5 mm say nothing of a scale that is off by 2 um/m, which a sweep of 200 mm shows. So each command judges
//! what the others say, all of it linear about the model with the effect, so that no other valley of the base has a say.
//! What is tried beside others must explain more than may be left of those: in runs and signals that say most of it, as
//! large a share of what those explain there as it must of rows that judge.
//! Invariant: no command has a say in the amplitude that it judges.

use nalgebra::{DMatrix, DVector};

use super::FURTHER;
use super::judged::Judged;
use crate::offline::gap::fit::Fitted;
use crate::offline::gap::fit::blocks::{Blocks, is_mostly_further};
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::{BLOCK_S, Linear, LinearRun, Loss, Normal, regular, residuals};
use crate::offline::gap::model::problem::{Problem, Residual};
use crate::offline::gap::model::steps::Steps;

/// Rows that judge do not show an amplitude that they leave unsure by more than this share of it, and which they
/// put within so many standard deviations of what it is.
const UNSURE: f64 = 0.2;
const NEAR: f64 = 2.0;
/// What commands foretell of each other is this share of what all of them gain at least.
const FORETOLD: f64 = 0.5;

/// Whether rows that judge say neither that amplitudes are there nor that they are not.
pub(super) fn is_silent(judged: &[Judged]) -> bool {
    let is_unsure = |one: &Judged| one.deviation > UNSURE && (one.share - 1.0).abs() < NEAR * one.deviation;
    !judged.is_empty() && judged.iter().all(is_unsure)
}

/// By how much the cost of each run falls with amplitudes that all other commands ask for, where that is surely no chance, most of what
/// all of them gain, and more than what effects leave that were named already, of which `before` are the amplitudes; nothing otherwise.
pub fn foretold(
    problem: &Problem<'_>,
    fitted: &Fitted,
    amplitudes: &[usize],
    before: &[usize],
) -> Option<Vec<f64>> {
    let model = &fitted.model;
    let steps = Steps::of(model, &fitted.covariance);
    let shapes: Vec<usize> = model.shapes().collect();
    let of_part = |part: Part| {
        let left = (part, residuals(problem, model, part));
        let linear = Linear::new(problem, model, left, None, &steps)
            .holding(&shapes)
            .where_straight_to_none(problem, part, amplitudes);
        let commands = problem.places(part).into_iter().map(|place| problem.data[place].command);
        commands.zip(linear.runs).collect::<Vec<_>>()
    };
    let runs: Vec<(usize, LinearRun)> = [Part::Fit, Part::Held].into_iter().flat_map(of_part).collect();
    let block = problem.rows_in(BLOCK_S);
    let equations = |run: &LinearRun| {
        let columns: Vec<Option<&Residual>> = run.columns.iter().map(Option::as_deref).collect();
        Normal::of(&run.residual, &columns, block, Loss::LAST)
    };
    let each: Vec<Normal> = runs.iter().map(|(_, run)| equations(run)).collect();
    let sum_of = |counts: &dyn Fn(usize) -> bool| {
        let counting = runs.iter().zip(&each).filter(|((command, _), _)| counts(*command));
        counting
            .map(|(_, equations)| equations.clone())
            .reduce(Normal::plus)
            .map(|sum| sum.with_beliefs(model))
    };
    let all = sum_of(&|_| true)?;
    let coordinates = model.coordinates();
    // What is left of each run with these amplitudes, and a base that all runs agree on.
    let left = |amplitudes_of: &dyn Fn(usize) -> Option<Vec<(usize, f64)>>| -> Option<Vec<Residual>> {
        let moved =
            |(command, run): &(usize, LinearRun)| Some(run.moved(&step_to(&all, &amplitudes_of(*command)?)?));
        runs.iter().map(moved).collect()
    };
    let by = |sum: &Normal| {
        let step = sum.step()?;
        Some(amplitudes.iter().map(|at| (*at, step[*at])).collect())
    };
    let none_of = |all: &[usize]| Some(all.iter().map(|at| (*at, -coordinates[*at])).collect());
    let without = left(&|_| none_of(amplitudes))?;
    let by_all = left(&|_| by(&all))?;
    let by_others = left(&|own| by(&sum_of(&|other| other != own)?))?;
    let of_all = |left: &[Residual]| Blocks::of_residuals(left, block);
    let [before_it, with_it, foretold] = [&without, &by_all, &by_others].map(|left| of_all(left));
    let is_sure = before_it.is_surely_worse_than(&foretold)
        && before_it.cost() - foretold.cost() > FORETOLD * (before_it.cost() - with_it.cost());
    if !is_sure {
        return None;
    }
    if !before.is_empty() {
        let alone = left(&|_| none_of(&[amplitudes, before].concat()))?;
        if !is_further(&alone, &without, &by_others) {
            return None;
        }
    }
    let cost = |run: &Residual| Loss::LAST.sum(run);
    Some(without.iter().zip(&by_others).map(|(without, with)| cost(without) - cost(with)).collect())
}

/// Whether most of what a further effect makes the cost of runs fall by is in runs and signals in which it is a share of
/// what those before it did: their equations may be off by as much.
fn is_further(alone: &[Residual], without: &[Residual], with: &[Residual]) -> bool {
    let costs = |left: &[Residual]| -> Vec<f64> {
        left.iter().flatten().map(|signal| signal.iter().map(|value| Loss::LAST.of(*value)).sum()).collect()
    };
    let [alone, without, with] = [alone, without, with].map(costs);
    let each =
        alone.iter().zip(&without).zip(&with).map(|((alone, without), with)| [*alone, *without, *with]);
    is_mostly_further(each, FURTHER)
}

/// How far the minimum is where some coordinates are moved by so much.
fn step_to(equations: &Normal, moved: &[(usize, f64)]) -> Option<DVector<f64>> {
    let mut step = DVector::zeros(equations.slope.len());
    moved.iter().for_each(|(at, by)| step[*at] = *by);
    let others: Vec<usize> =
        (0..step.len()).filter(|at| moved.iter().all(|(moved, _)| moved != at)).collect();
    let slope = &equations.slope + &equations.curvature * &step;
    let curvature: DMatrix<f64> = equations.curvature.select_rows(&others).select_columns(&others);
    let rest = -(regular(&curvature)? * slope.select_rows(&others));
    others.iter().zip(rest.iter()).for_each(|(at, by)| step[*at] = *by);
    Some(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_say_nothing_speak_neither_for_an_amplitude_nor_against_it() {
        for (share, deviation, silent) in [
            (1.1, 0.33, true),
            (-0.6, 1.6, true),
            // Sure that it is there, or that it is not.
            (1.0, 0.1, false),
            (0.0, 0.3, false),
        ] {
            assert_eq!(is_silent(&[Judged { share, deviation }]), silent, "{share}, {deviation}");
        }
        assert!(!is_silent(&[]));
    }

    #[test]
    fn what_comes_beside_others_says_most_where_they_explain_little() {
        // Two runs of two signals, of which each row costs as much.
        let left = |costs: [[f64; 2]; 2]| -> Vec<Residual> {
            costs.iter().map(|run| run.iter().map(|cost| vec![cost.sqrt(); 100]).collect()).collect()
        };
        let (alone, without) = (left([[8.0, 1.0], [1.1, 1.0]]), left([[2.0, 1.0], [1.1, 1.0]]));
        for (with, further) in [
            // In the run and the signal of which those before it said nothing.
            ([[2.0, 1.0], [1.1, 0.9]], true),
            // A fortieth of what they explained where they did.
            ([[1.85, 1.0], [1.1, 1.0]], false),
            ([[1.85, 1.0], [1.0, 1.0]], false),
            // A tenth of it.
            ([[1.4, 1.0], [1.1, 1.0]], true),
        ] {
            assert_eq!(is_further(&alone, &without, &left(with)), further, "{with:?}");
        }
    }

    #[test]
    fn others_follow_where_a_coordinate_is_moved() {
        let columns: [Residual; 2] = [vec![vec![1.0, 1.0, 1.0, 1.0]], vec![vec![1.0, 0.0, 1.0, 0.0]]];
        let residual: Residual = vec![vec![0.0; 4]];
        let equations = Normal::of(&residual, &[Some(&columns[0]), Some(&columns[1])], 2, Loss::LAST);
        let step = step_to(&equations, &[(1, -2.0)]).expect("it is regular");
        // Half of the rows go down by two, and all of them up by what is between.
        assert!((step[0] - 1.0).abs() < 1e-6 && step[1] == -2.0, "{step}");
    }
}
