//! A model fitted to the runs of an axis in closed loop: Gauss and Newton with Levenberg's damping, on whitened
//! residuals, with what is believed of each coordinate beforehand.
//!
//! ```text
//!   minimise  Σ ρ(residual) + Σ ((coordinate - expected) / sureness)²      ρ of Huber: a square up to K, straight beyond
//! ```
//!
//! Stick and slip are events: near a reversal single rows jump where a model lands on another branch. Rows beyond `K`
//! standard deviations count by their size and not by its square, so that events do not outvote motion.
//! Derivatives are differences over a step that is wide against the roughness of the events.
//! Invariant: a fit never ends worse than it began.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::model::Model;
use super::problem::{Part, Problem, Residual};

/// Rows beyond this count by their size, in standard deviations.
const K: f64 = 4.0;
/// Step of a derivative, in coordinates.
const STEP: f64 = 0.04;
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
    /// Covariance of the coordinates for residuals of variance 1.
    pub covariance: DMatrix<f64>,
}

/// Twice the negative logarithm of how probable a residual is, but for a constant.
pub fn rho(value: f64) -> f64 {
    let size = value.abs();
    if size <= K { size * size } else { K * (2.0 * size - K) }
}

fn weight(value: f64) -> f64 {
    let size = value.abs();
    if size <= K { 1.0 } else { K / size }
}

/// Sum of `ρ` over a residual.
pub fn cost(residual: &Residual) -> f64 {
    residual.iter().flatten().map(|value| rho(*value)).sum()
}

/// Sum of `ρ` of a model over a part of all runs.
pub fn cost_of(problem: &Problem<'_>, model: &Model, part: Part) -> f64 {
    places(problem, part).into_par_iter().map(|place| cost(&problem.residual(place, model, part))).sum()
}

fn places(problem: &Problem<'_>, part: Part) -> Vec<usize> {
    (0..problem.data.len()).filter(|place| problem.data[*place].has(part)).collect()
}

/// Normal equations of a model: curvature, slope and cost.
struct Normal {
    curvature: DMatrix<f64>,
    slope: DVector<f64>,
    cost: f64,
}

fn normal(problem: &Problem<'_>, model: &Model) -> Normal {
    let coordinates = model.coordinates();
    let count = coordinates.len();
    let one = |place: usize| {
        let residual = problem.residual(place, model, Part::Fit);
        let columns: Vec<Option<Residual>> = (0..count)
            .into_par_iter()
            .map(|coordinate| {
                let mut moved = coordinates.clone();
                moved[coordinate] += STEP;
                let mut other = model.at(&moved);
                let mut step = other.coordinates()[coordinate] - coordinates[coordinate];
                if step < 0.5 * STEP {
                    moved[coordinate] = coordinates[coordinate] - STEP;
                    other = model.at(&moved);
                    step = other.coordinates()[coordinate] - coordinates[coordinate];
                }
                if step.abs() < 0.5 * STEP || step.abs() > 2.0 * STEP {
                    return None;
                }
                let mut column = problem.residual(place, &other, Part::Fit);
                for (column, residual) in column.iter_mut().zip(&residual) {
                    for (value, here) in column.iter_mut().zip(residual) {
                        *value = (*value - here) / step;
                    }
                }
                Some(column)
            })
            .collect();
        let mut sum = Normal {
            curvature: DMatrix::zeros(count, count),
            slope: DVector::zeros(count),
            cost: cost(&residual),
        };
        for (signal, rows) in residual.iter().enumerate() {
            let weights: Vec<f64> = rows.iter().map(|value| weight(*value)).collect();
            for i in 0..count {
                let Some(a) = &columns[i] else { continue };
                let weighed: Vec<f64> = a[signal].iter().zip(&weights).map(|(a, w)| a * w).collect();
                sum.slope[i] += dot(&weighed, rows);
                for (j, b) in columns.iter().enumerate().take(i + 1) {
                    let Some(b) = b else { continue };
                    let entry = dot(&weighed, &b[signal]);
                    sum.curvature[(i, j)] += entry;
                    if i != j {
                        sum.curvature[(j, i)] += entry;
                    }
                }
            }
        }
        sum
    };
    let mut all = Normal { curvature: DMatrix::zeros(count, count), slope: DVector::zeros(count), cost: 0.0 };
    for place in places(problem, Part::Fit) {
        let part = one(place);
        all.curvature += part.curvature;
        all.slope += part.slope;
        all.cost += part.cost;
    }
    all
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn believed(model: &Model) -> f64 {
    let (at, expected, sureness) = (model.coordinates(), model.expected(), model.sureness());
    at.iter().zip(expected).zip(sureness).map(|((at, expected), sure)| ((at - expected) / sure).powi(2)).sum()
}

/// The model fitted from where it stands, in at most so many iterations.
pub fn fit(problem: &Problem<'_>, start: &Model, iterations: usize) -> Fitted {
    let mut model = start.clone();
    let (mut damping, factor) = DAMPING;
    let mut covariance = DMatrix::zeros(model.coordinate_count(), model.coordinate_count());
    let mut cost = f64::INFINITY;
    let mut total = f64::INFINITY;
    for _ in 0..iterations {
        let mut equations = normal(problem, &model);
        let (at, expected, sureness) = (model.coordinates(), model.expected(), model.sureness());
        for (place, ((at, expected), sure)) in at.iter().zip(expected).zip(sureness).enumerate() {
            equations.curvature[(place, place)] += sure.powi(-2);
            equations.slope[place] += (at - expected) * sure.powi(-2);
        }
        cost = equations.cost;
        total = cost + believed(&model);
        if let Some(inverse) = regular(&equations.curvature) {
            covariance = inverse;
        }
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
            let other_cost = cost_of(problem, &other, Part::Fit);
            let other_total = other_cost + believed(&other);
            if other_total < total {
                gained = total - other_total;
                (model, cost, total) = (other, other_cost, other_total);
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

fn regular(curvature: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let mut curvature = curvature.clone();
    for place in 0..curvature.nrows() {
        // A coordinate that does nothing has no curvature.
        curvature[(place, place)] += 1e-9;
    }
    curvature.cholesky().map(|cholesky| cholesky.inverse())
}

impl Fitted {
    /// Key, value and 95 % interval of each parameter of the effect that was added last.
    pub fn last_effect(&self) -> Vec<(&'static str, f64, [f64; 2])> {
        let Some(tried) = self.model.effects.last() else { return Vec::new() };
        let parameters = tried.entry.parameters;
        let first = self.model.coordinate_count() - parameters.len();
        let of = |(place, (parameter, value)): (usize, (&crate::plant::effects::Parameter, &f64))| {
            let sigma = self.covariance[(first + place, first + place)].sqrt() * parameter.prior;
            (parameter.key, *value, [value - 1.96 * sigma, value + 1.96 * sigma])
        };
        parameters.iter().zip(&tried.values).enumerate().map(of).collect()
    }
}
