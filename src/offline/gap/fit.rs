//! A model fitted to the runs of an axis in closed loop: Gauss and Newton with Levenberg's damping, on whitened
//! residuals, with what is believed of each coordinate beforehand.
//!
//! ```text
//!   minimise  Σ ρ(residual) + Σ ((coordinate - expected) / sureness)²      ρ of Huber: a square up to K, straight beyond
//! ```
//!
//! A candidate is fitted beside a model that was fitted before with the derivatives that are known of that one: only
//! its own are computed anew, and what is left always is.
//! Invariant: a fit never ends worse than it began.

use nalgebra::DMatrix;

use super::linear::{BLOCK_S, Linear, cost, residuals};
use super::model::Model;
use super::problem::{Part, Problem};
use crate::plant::effects::Parameter;

/// Damping at the start, and by how much it falls and grows.
const DAMPING: (f64, f64) = (1e-3, 6.0);
/// An iteration that gains less than this share of the cost is the last.
const ENOUGH: f64 = 1e-4;

/// A model with what it leaves.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The model.
    pub model: Model,
    /// Sum of `ρ` over the rows it was fitted to.
    pub cost: f64,
    /// The same with what is believed beforehand.
    pub total: f64,
    /// Covariance of the coordinates.
    pub covariance: DMatrix<f64>,
}

fn believed(model: &Model) -> f64 {
    let (at, expected, sureness) = (model.coordinates(), model.expected(), model.sureness());
    at.iter().zip(expected).zip(sureness).map(|((at, expected), sure)| ((at - expected) / sure).powi(2)).sum()
}

/// The model fitted from where it stands, in at most so many iterations; with the derivatives of `known` for the
/// coordinates that it has.
pub fn fit(problem: &Problem<'_>, start: &Model, iterations: usize, known: Option<&Linear>) -> Fitted {
    let block = ((BLOCK_S / problem.machine.cycle.period.as_s()) as usize).max(1);
    let mut model = start.clone();
    let (mut damping, factor) = DAMPING;
    let mut left = residuals(problem, &model, Part::Fit);
    let mut cost: f64 = left.iter().map(self::cost).sum();
    let mut total = cost + believed(&model);
    let mut covariance = DMatrix::zeros(model.coordinate_count(), model.coordinate_count());
    for _ in 0..iterations {
        let linear = Linear::new(problem, &model, left, known);
        let equations = linear.normal(block).with_beliefs(&model);
        left = linear.runs.into_iter().map(|run| run.residual).collect();
        if let Some(found) = equations.covariance() {
            covariance = found;
        }
        let at = model.coordinates();
        let mut gained = 0.0;
        for _ in 0..5 {
            let mut damped = equations.curvature.clone();
            for place in 0..damped.nrows() {
                damped[(place, place)] += damping * damped[(place, place)].max(1e-12);
            }
            let Some(cholesky) = damped.cholesky() else {
                damping *= factor;
                continue;
            };
            let step = cholesky.solve(&equations.slope);
            // A step of more than a few priors leaves where the derivatives hold.
            let largest = step.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
            let share = if largest > 1.5 { 1.5 / largest } else { 1.0 };
            let tried: Vec<f64> = at.iter().zip(step.iter()).map(|(at, step)| at - share * step).collect();
            let other = model.at(&tried);
            let other_left = residuals(problem, &other, Part::Fit);
            let other_cost: f64 = other_left.iter().map(self::cost).sum();
            let other_total = other_cost + believed(&other);
            if other_total < total {
                gained = total - other_total;
                (model, left, cost, total) = (other, other_left, other_cost, other_total);
                damping = (damping / factor).max(1e-9);
                break;
            }
            damping *= factor;
        }
        if gained < ENOUGH * total {
            break;
        }
    }
    Fitted { model, cost, total, covariance }
}

impl Fitted {
    /// Key, value and 95 % interval of each parameter of the effect of a place in the list.
    pub fn effect(&self, place: usize) -> Vec<(&'static str, f64, [f64; 2])> {
        let Some(tried) = self.model.effects.get(place) else { return Vec::new() };
        let first = self.model.first_coordinate(place);
        let of = |(place, (parameter, value)): (usize, (&Parameter, &f64))| {
            let sigma = self.covariance[(first + place, first + place)].sqrt() * parameter.prior;
            let [low, high] = parameter.bounds;
            let interval = [value - 1.96 * sigma, value + 1.96 * sigma];
            (
                parameter.key,
                *value,
                interval.map(|end| if parameter.unit == "deg" { end } else { end.clamp(low, high) }),
            )
        };
        tried.entry.parameters.iter().zip(&tried.values).enumerate().map(of).collect()
    }
}
