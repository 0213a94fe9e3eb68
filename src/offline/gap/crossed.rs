//! Whether an effect foretells each command from the others, where the rows that judge cannot show it.
//!
//! ```text
//!   runs of all commands but one ──► amplitudes ─┐
//!   all runs ──► base beside them, or alone ─────┴─► what both leave of the runs of that one
//! ```
//!
//! Circles of 5 mm say nothing of a scale that is off by 2 um/m, which a sweep of 200 mm shows. So each command judges
//! what the others say, all of it linear about the model with the effect, so that no other valley of the base has a say.
//! Invariant: no command has a say in the amplitude that it judges.

use nalgebra::{DMatrix, DVector};

use super::blocks::Blocks;
use super::fit::Fitted;
use super::judged::Judged;
use super::linear::{BLOCK_S, Linear, LinearRun, Loss, Normal, Steps, regular, residuals};
use super::problem::{Part, Problem, Residual};

/// Rows that judge do not show an amplitude that they leave unsure by more than this share of it, and which they
/// put within so many standard deviations of what it is.
const UNSURE: f64 = 0.2;
const NEAR: f64 = 3.0;
/// What commands foretell of each other is this share of what all of them gain at least.
const FORETOLD: f64 = 0.5;

/// Whether commands judge amplitudes in the place of rows that judge and say this of them, and find them.
pub(super) fn stands_in(
    problem: &Problem<'_>,
    fitted: &Fitted,
    amplitudes: &[usize],
    judged: &[Judged],
) -> bool {
    is_silent(judged) && is_foretold(problem, fitted, amplitudes)
}

/// Whether rows that judge say neither that amplitudes are there nor that they are not.
fn is_silent(judged: &[Judged]) -> bool {
    let is_unsure = |one: &Judged| one.deviation > UNSURE && (one.share - 1.0).abs() < NEAR * one.deviation;
    !judged.is_empty() && judged.iter().all(is_unsure)
}

/// Whether the runs of each command are foretold better with some amplitudes than without by those of the others, and all together
/// surely are.
pub fn is_foretold(problem: &Problem<'_>, fitted: &Fitted, amplitudes: &[usize]) -> bool {
    let model = &fitted.model;
    let steps = Steps::of(model, &fitted.covariance);
    let shapes: Vec<usize> = model.shapes().collect();
    let of_part = |part: Part| {
        let left = (part, residuals(problem, model, part));
        let linear = Linear::new(problem, model, left, None, &steps).holding(&shapes);
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
    let Some(all) = sum_of(&|_| true) else { return false };
    let coordinates = model.coordinates();
    // What is left of each run with these amplitudes, and a base that all runs agree on.
    let left = |amplitudes_of: &dyn Fn(usize) -> Option<Vec<(usize, f64)>>| -> Option<Blocks> {
        let moved =
            |(command, run): &(usize, LinearRun)| Some(run.moved(&step_to(&all, &amplitudes_of(*command)?)?));
        Some(Blocks::of_residuals(&runs.iter().map(moved).collect::<Option<Vec<_>>>()?, block))
    };
    let by = |sum: &Normal| {
        let step = sum.step()?;
        Some(amplitudes.iter().map(|at| (*at, step[*at])).collect())
    };
    let without = left(&|_| Some(amplitudes.iter().map(|at| (*at, -coordinates[*at])).collect()));
    let by_all = left(&|_| by(&all));
    let by_others = left(&|own| by(&sum_of(&|other| other != own)?));
    let (Some(without), Some(by_all), Some(by_others)) = (without, by_all, by_others) else { return false };
    let fall = |with: &Blocks| without.cost() - with.cost();
    without.is_surely_worse_than(&by_all) && fall(&by_others) > FORETOLD * fall(&by_all)
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
    fn others_follow_where_a_coordinate_is_moved() {
        let columns: [Residual; 2] = [vec![vec![1.0, 1.0, 1.0, 1.0]], vec![vec![1.0, 0.0, 1.0, 0.0]]];
        let residual: Residual = vec![vec![0.0; 4]];
        let equations = Normal::of(&residual, &[Some(&columns[0]), Some(&columns[1])], 2, Loss::LAST);
        let step = step_to(&equations, &[(1, -2.0)]).expect("it is regular");
        // Half of the rows go down by two, and all of them up by what is between.
        assert!((step[0] - 1.0).abs() < 1e-6 && step[1] == -2.0, "{step}");
    }
}
