//! What a model costs each run on average about where it stands.
//!
//! ```text
//!   coordinates + L n      L Lᵀ = covariance, n normal ──► cost of each run ──► mean
//! ```
//!
//! Where a run is smooth that is what it costs at the bottom, and as much more for each model. Where a table sticks and slips a fit ends in a
//! hole that is narrower than what is not known, which chance dug: out of one of 4 000 to 16 000 in small reversals, a delay that gained as
//! much in all other runs seemed to make that one worse.
//! Invariant: the same model of the same rows costs the same.

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::Fitted;
use super::kicks::known;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::{Loss, residuals};
use crate::offline::gap::model::problem::Problem;

/// How far away, in standard deviations, and how many places, each with the one on the other side.
const AWAY: f64 = 1.0;
const PAIRS: usize = 4;

/// What the fitted rows of each run cost; what is not known stays where it is.
pub fn costs_nearby(problem: &Problem<'_>, fitted: &Fitted) -> Vec<f64> {
    let all: Vec<Vec<f64>> = places(problem, fitted)
        .par_iter()
        .map(|model| residuals(problem, model, Part::Fit).iter().map(|run| Loss::LAST.sum(run)).collect())
        .collect();
    let mean = |run: usize| all.iter().map(|costs| costs[run]).sum::<f64>() / all.len() as f64;
    (0..all[0].len()).map(mean).collect()
}

fn places(problem: &Problem<'_>, fitted: &Fitted) -> Vec<Model> {
    let (model, covariance) = (&fitted.model, &fitted.covariance);
    let at = model.coordinates();
    let known: Vec<usize> = known(covariance).filter(|place| problem.tells(model, *place)).collect();
    let known_covariance = covariance.select_rows(&known).select_columns(&known);
    // Of what is no covariance each coordinate by itself.
    let factor = known_covariance.clone().cholesky().map_or_else(
        || DMatrix::from_diagonal(&known_covariance.diagonal().map(f64::sqrt)),
        |factor| factor.l(),
    );
    let mut random = Pcg64Mcg::seed_from_u64(11);
    let pair = |_| {
        let drawn = DVector::from_fn(known.len(), |_, _| StandardNormal.sample(&mut random));
        let by: DVector<f64> = AWAY * &factor * drawn;
        [1.0, -1.0].map(|side| {
            let mut moved = at.clone();
            known.iter().zip(by.iter()).for_each(|(place, by)| moved[*place] += side * by);
            model.at(&moved)
        })
    };
    (0..PAIRS).flat_map(pair).collect()
}
