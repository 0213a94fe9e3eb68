//! What the rows that judge say of an effect by themselves.
//!
//! ```text
//!   fitted rows ──► base, times and places of the effect, and how sure they are ──┐
//!   rows that judge ──────────────────────────────────────────────────────────────┴─► its amplitudes
//! ```
//!
//! A base that is freed by an effect may do better on all rows, and the effect itself nothing. So its amplitudes are
//! asked once more of the rows that no model has seen, and of those alone.
//! Invariant: what the fitted rows say of an amplitude has no say here.

use nalgebra::{DMatrix, DVector};

use crate::offline::gap::fit::Fitted;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::{BLOCK_S, K, Linear, Loss, regular, residuals};
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::model::steps::Steps;

/// Rows that judge want another amplitude where theirs is so many of its standard deviations, and such a share, away.
const OTHER: f64 = 3.0;
const OTHER_SHARE: f64 = 0.25;

/// An amplitude by the rows that judge, in shares of what the fitted rows say of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Judged {
    /// What it is there.
    pub share: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

impl Judged {
    /// Whether it is more than so many of its standard deviations, and than a share.
    pub(super) fn is_more_than(&self, deviations: f64, share: f64) -> bool {
        self.share > f64::max(deviations * self.deviation, share)
    }
}

/// Whether rows that judge, which say so much of amplitudes alone, are sure of others than the fitted rows: what is the same thing has one
/// size in both. A time or a frequency that is off by what the fitted rows leave open is no other size.
pub(in crate::offline::gap) fn is_another(
    problem: &Problem<'_>,
    fitted: &Fitted,
    amplitudes: &[usize],
    alone: &[Judged],
) -> bool {
    let own: Vec<f64> = amplitudes.iter().map(|at| fitted.deviations(*at).recip()).collect();
    if !differ(alone, &own) {
        return false;
    }
    let Some(following) = asked(problem, fitted, amplitudes, &[]) else { return true };
    if !differ(&of_each(&following, &fitted.model, amplitudes), &own) {
        return false;
    }
    // What turned the phase of a swing is not straight: once more from where they lead.
    let mut to = fitted.model.coordinates();
    fitted.model.shapes().for_each(|shape| to[shape] += following.0[shape]);
    let there = Fitted { model: fitted.model.at(&to), ..fitted.clone() };
    differ(&self::alone(problem, &there, amplitudes), &own)
}

/// Whether all of what rows that judge say of amplitudes is surely another size than that of the fitted rows, which have such deviations as
/// shares.
fn differ(judged: &[Judged], own: &[f64]) -> bool {
    let differs = |(one, own): (&Judged, &f64)| {
        (one.share - 1.0).abs() > f64::max(OTHER * one.deviation.hypot(*own), OTHER_SHARE)
    };
    !judged.is_empty() && judged.iter().zip(own).all(differs)
}

/// What the rows that judge say of amplitudes: of each with all others as they follow it, but for times and places. Nothing
/// where they do not tell.
pub fn alone(problem: &Problem<'_>, fitted: &Fitted, amplitudes: &[usize]) -> Vec<Judged> {
    let shapes: Vec<usize> = fitted.model.shapes().collect();
    let found = asked(problem, fitted, amplitudes, &shapes);
    found.map_or_else(Vec::new, |found| of_each(&found, &fitted.model, amplitudes))
}

/// Where rows that judge lead all that follows amplitudes, but for what is held, and its covariance; nothing where they do not tell.
fn asked(
    problem: &Problem<'_>,
    fitted: &Fitted,
    amplitudes: &[usize],
    held: &[usize],
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let model = &fitted.model;
    let steps = Steps::of(model, &fitted.covariance);
    let known: Vec<usize> = (0..model.coordinate_count())
        .filter(|coordinate| !amplitudes.contains(coordinate) && !held.contains(coordinate))
        .collect();
    let left = (Part::Held, residuals(problem, model, Part::Held));
    let linear = Linear::new(problem, model, left, None, &steps).holding(held).where_straight_to_none(
        problem,
        Part::Held,
        amplitudes,
    );
    // By their size: what is far off tells most of an effect that is not there.
    let equations = linear.normal(problem.rows_in(BLOCK_S), Loss::straight(K));
    let equations = equations.with_known(&of_others(&fitted.covariance, &known)?);
    Some((equations.step()?, equations.covariance()?))
}

fn of_each(
    (step, covariance): &(DVector<f64>, DMatrix<f64>),
    model: &Model,
    amplitudes: &[usize],
) -> Vec<Judged> {
    let coordinates = model.coordinates();
    let of = |at: &usize| Judged {
        share: 1.0 + step[*at] / coordinates[*at],
        deviation: (covariance[(*at, *at)].sqrt() / coordinates[*at]).abs(),
    };
    amplitudes.iter().map(of).collect()
}

/// What is known of some coordinates whatever the others are: the inverse of their covariance, in the place of all.
fn of_others(covariance: &DMatrix<f64>, known: &[usize]) -> Option<DMatrix<f64>> {
    let inverse = regular(&covariance.select_rows(known).select_columns(known))?;
    let mut all = DMatrix::zeros(covariance.nrows(), covariance.ncols());
    for (row, at) in known.iter().enumerate() {
        for (column, other) in known.iter().enumerate() {
            all[(*at, *other)] = inverse[(row, column)];
        }
    }
    Some(all)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::base::axis::AxisId;
    use crate::config;
    use crate::offline::gap::model::Tried;
    use crate::offline::gap::model::sensors::tests::problem_of;
    use crate::plant::effects::entry;

    #[test]
    fn what_has_another_size_where_nobody_fitted_is_another_thing() {
        for (share, deviation, own, is_other) in [
            (0.66, 0.08, 0.05, true),
            (1.53, 0.14, 0.05, true),
            (0.17, 0.27, 0.05, true),
            (2.0, 0.2, 0.145, true),
            // Within what is not sure, in either, or off by little.
            (0.68, 0.17, 0.05, false),
            (0.66, 0.08, 0.14, false),
            (1.21, 0.01, 0.01, false),
        ] {
            let one = Judged { share, deviation };
            assert_eq!(differ(&[one], &[own]), is_other, "{share}, {deviation}, {own}");
            // One of two amplitudes that stays as it is tells that it is the same.
            assert!(!differ(&[one, Judged { share: 1.0, deviation: 0.1 }], &[own; 2]));
        }
        assert!(!differ(&[], &[]));
    }

    #[test]
    fn a_frequency_that_fitted_rows_leave_open_makes_no_other_size() {
        let machine = config::load("paper").expect("a machine");
        let place_m = |row: usize| 5e-3 * (1.0 - (row as f64 * 5e-4 * 6.0).cos());
        let problem = problem_of(&machine, 24_000, place_m, [1e-7, 1e-7, 0.05]);
        let entry = entry("torque-disturbance").expect("an effect");
        let with = |hz: f64| {
            Model::new(machine.axes[AxisId::X].plant).with(Tried { entry, values: [0.05, hz, 0.0] })
        };
        let mut data = problem.data[0].clone();
        data.measured = problem.simulated(0, &with(30.03));
        // A quarter of a turn behind where nobody fitted.
        data.fit = (0..24_000).map(|row| (800..4_000).contains(&row)).collect();
        data.held = (0..24_000).map(|row| row >= 8_000).collect();
        let problem = problem.with_data(Arc::new(vec![data]));
        let model = with(30.0);
        let (count, amplitude) = (model.coordinate_count(), model.first_coordinate(0));
        for (sigma_hz, is_other) in [(0.1, false), (1e-4, true)] {
            let mut covariance = DMatrix::identity(count, count) * 1e-6;
            covariance[(amplitude + 1, amplitude + 1)] = f64::powi(sigma_hz / entry.parameters[1].prior, 2);
            let fitted = Fitted { model: model.clone(), cost: 0.0, total: 0.0, covariance };
            let alone = alone(&problem, &fitted, &[amplitude]);
            let found = is_another(&problem, &fitted, &[amplitude], &alone);
            assert_eq!(found, is_other, "{sigma_hz} Hz, {alone:?}");
        }
    }
}
