//! Where else along its valley a fit might end deeper.
//!
//! Invariant: models are moved along what is known of them alone.

use std::ops::Range;

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::left_by;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::linear::Loss;
use crate::offline::gap::model::problem::{Problem, Residual};

/// So many standard deviations away.
const KICKS: [f64; 4] = [-8.0, -2.5, 2.5, 8.0];
/// Of a coordinate something is known within these standard deviations; one without any moves nothing.
const KNOWN: Range<f64> = 1e-9..0.5;

/// Models some standard deviations of each coordinate away, the others moved as they follow it.
pub(super) fn kicked_from(model: &Model, covariance: &DMatrix<f64>) -> Vec<Model> {
    let at = model.coordinates();
    let moved = |coordinate: usize, by: f64| {
        let sigma = covariance[(coordinate, coordinate)].sqrt();
        let share = by / sigma;
        let to: Vec<f64> =
            at.iter().zip(covariance.column(coordinate).iter()).map(|(at, with)| at + share * with).collect();
        model.at(&to)
    };
    known(covariance).flat_map(|coordinate| KICKS.map(|by| moved(coordinate, by))).collect()
}

/// Coordinates of a covariance of which more is known than before there were data.
pub(in crate::offline::gap) fn known(covariance: &DMatrix<f64>) -> impl Iterator<Item = usize> {
    (0..covariance.nrows()).filter(|place| KNOWN.contains(&covariance[(*place, *place)].sqrt()))
}

/// That of some models which leaves the least of the first passes, with what it leaves of all rows and the total.
pub(in crate::offline::gap) fn best_of(
    problem: &Problem<'_>,
    models: &[Model],
    loss: Loss,
) -> Option<(Model, Vec<Residual>, f64)> {
    if models.is_empty() {
        return None;
    }
    let once = problem.first_passes();
    let totals: Vec<f64> = models.par_iter().map(|model| left_by(&once, model, loss).1).collect();
    let best = (0..models.len()).min_by(|a, b| totals[*a].total_cmp(&totals[*b]))?;
    let (left, total) = left_by(problem, &models[best], loss);
    Some((models[best].clone(), left, total))
}
