//! Which effects could explain what is left: each is tried once at its usual size, and what of it the other
//! coordinates cannot make up for is held against what is left.
//!
//! ```text
//!   s = residual without - residual with the effect      T = what the fitted coordinates do
//!   gain = (sᵀ P r)² / (sᵀ P s),  P = 1 - T (TᵀT + prior)⁻¹ Tᵀ             in the weights of the fit
//! ```
//!
//! Effects with a phase give two such columns, a quarter of a period apart. What else is not linear is tried at a few
//! values, frequencies where the spectrum of what is left has its peaks.
//! Invariant: the order of the catalogue decides nothing.

use std::f64::consts::TAU;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::model::{Model, Tried};
use super::problem::{Part, Problem, Residual};
use crate::plant::effects::{CATALOGUE, Entry, Values};

/// Share of its usual size at which an effect is tried.
const SHARE: f64 = 0.5;

/// An effect that may be there.
#[derive(Clone, Copy, Debug)]
pub struct Scored {
    /// With the values that the linear estimate gives it.
    pub tried: Tried,
    /// By how much the cost falls, if all were linear.
    pub gain: f64,
}

/// Values at which an entry is tried; its amplitude is that of the trial.
fn seeds(entry: &'static Entry, peaks: &dyn Fn(&str) -> Vec<f64>) -> Vec<Values> {
    let mut nominal = entry.nominal();
    nominal[0] = if nominal[0] == 0.0 { entry.parameters[0].prior } else { nominal[0] } * SHARE;
    let mut seeds = vec![nominal];
    for (place, parameter) in entry.parameters.iter().enumerate().skip(1) {
        if parameter.unit == "deg" {
            continue;
        }
        let [low, high] = parameter.bounds;
        let mut others: Vec<f64> = peaks(parameter.key);
        if others.is_empty() {
            others = [0.3, 3.0].map(|factor| parameter.nominal * factor).to_vec();
        }
        let others: Vec<f64> = others.into_iter().filter(|value| (low..=high).contains(value)).collect();
        let so_far = seeds.clone();
        for other in others {
            seeds.extend(so_far.iter().map(|seed| {
                let mut seed = *seed;
                seed[place] = other;
                seed
            }));
        }
    }
    seeds
}

fn phase_of(entry: &Entry) -> Option<usize> {
    entry.parameters.iter().position(|parameter| parameter.unit == "deg")
}

/// Every effect that is not in the model yet, with the best of its trials, the most promising first.
pub fn shortlist(
    problem: &Problem<'_>,
    model: &Model,
    peaks: &(dyn Fn(&str) -> Vec<f64> + Sync),
) -> Vec<Scored> {
    let present = |entry: &Entry| model.effects.iter().any(|tried| tried.entry.name == entry.name);
    let trials: Vec<(&'static Entry, Values)> = CATALOGUE
        .iter()
        .filter(|entry| !present(entry))
        .flat_map(|entry| seeds(entry, peaks).into_iter().map(move |values| (entry, values)))
        .collect();
    let places: Vec<usize> =
        (0..problem.data.len()).filter(|place| problem.data[*place].has(Part::Fit)).collect();
    let mut fitted = Fitted::new(model);
    let mut sums: Vec<Sums> = trials.iter().map(|(entry, _)| Sums::new(model, entry)).collect();
    for place in places {
        let here = Here::new(problem, model, place);
        fitted.add(&here);
        sums.par_iter_mut().zip(&trials).for_each(|(sums, (entry, values))| {
            let columns: Vec<Residual> = variants(entry, *values)
                .into_iter()
                .map(|values| {
                    let tried = model.with(Tried { entry, values });
                    let mut column = problem.residual(place, &tried, Part::Fit);
                    for (column, residual) in column.iter_mut().zip(&here.residual) {
                        for (value, without) in column.iter_mut().zip(residual) {
                            *value = without - *value;
                        }
                    }
                    column
                })
                .collect();
            sums.add(&here, &columns);
        });
    }
    let Some(fitted) = fitted.solved() else { return Vec::new() };
    let mut best: Vec<Scored> = Vec::new();
    for (sums, (entry, values)) in sums.iter().zip(&trials) {
        let Some(scored) = sums.scored(&fitted, entry, *values) else { continue };
        match best.iter_mut().find(|other| other.tried.entry.name == entry.name) {
            Some(other) if other.gain >= scored.gain => {}
            Some(other) => *other = scored,
            None => best.push(scored),
        }
    }
    best.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    best
}

/// The values of the columns of a trial: one, or two a quarter of a period apart.
fn variants(entry: &Entry, values: Values) -> Vec<Values> {
    let Some(place) = phase_of(entry) else { return vec![values] };
    [0.0, 90.0]
        .map(|phase| {
            let mut values = values;
            values[place] = phase;
            values
        })
        .to_vec()
}

/// A run with what the model leaves of it, and what its coordinates do there.
struct Here {
    residual: Residual,
    weights: Vec<Vec<f64>>,
    tangent: Vec<Residual>,
}

impl Here {
    fn new(problem: &Problem<'_>, model: &Model, place: usize) -> Self {
        const STEP: f64 = 0.04;
        let residual = problem.residual(place, model, Part::Fit);
        let coordinates = model.coordinates();
        let tangent = (0..coordinates.len())
            .into_par_iter()
            .map(|coordinate| {
                let mut moved = coordinates.clone();
                moved[coordinate] += STEP;
                let mut column = problem.residual(place, &model.at(&moved), Part::Fit);
                for (column, residual) in column.iter_mut().zip(&residual) {
                    for (value, here) in column.iter_mut().zip(residual) {
                        *value = (here - *value) / STEP;
                    }
                }
                column
            })
            .collect();
        // As in the fit: rows that are far off count by their size.
        let weigh = |value: &f64| if value.abs() <= 4.0 { 1.0 } else { 4.0 / value.abs() };
        let weights = residual.iter().map(|rows| rows.iter().map(weigh).collect()).collect();
        Self { residual, weights, tangent }
    }

    fn product(&self, a: &Residual, b: &Residual) -> f64 {
        let mut sum = 0.0;
        for ((a, b), weights) in a.iter().zip(b).zip(&self.weights) {
            sum += a.iter().zip(b).zip(weights).map(|((a, b), w)| a * b * w).sum::<f64>();
        }
        sum
    }
}

/// Products over all runs of what the fitted coordinates do: with each other, and with what is left.
struct Fitted {
    tangent: DMatrix<f64>,
    left: DVector<f64>,
}

impl Fitted {
    fn new(model: &Model) -> Self {
        let count = model.coordinate_count();
        let mut tangent = DMatrix::zeros(count, count);
        for (place, sure) in model.sureness().into_iter().enumerate() {
            tangent[(place, place)] = sure.powi(-2) + 1e-9;
        }
        Self { tangent, left: DVector::zeros(count) }
    }

    fn add(&mut self, here: &Here) {
        for (i, a) in here.tangent.iter().enumerate() {
            self.left[i] += here.product(a, &here.residual);
            for (j, b) in here.tangent.iter().enumerate().take(i + 1) {
                let product = here.product(a, b);
                self.tangent[(i, j)] += product;
                if i != j {
                    self.tangent[(j, i)] += product;
                }
            }
        }
    }

    fn solved(self) -> Option<(Cholesky<f64, Dyn>, DVector<f64>)> {
        Some((self.tangent.cholesky()?, self.left))
    }
}

/// Products over all runs of the columns of a trial: with the tangent, with each other, with what is left.
struct Sums {
    crossed: DMatrix<f64>,
    columns: DMatrix<f64>,
    left: DVector<f64>,
}

impl Sums {
    fn new(model: &Model, entry: &Entry) -> Self {
        let count = model.coordinate_count();
        let columns = if phase_of(entry).is_some() { 2 } else { 1 };
        Self {
            crossed: DMatrix::zeros(columns, count),
            columns: DMatrix::zeros(columns, columns),
            left: DVector::zeros(columns),
        }
    }

    fn add(&mut self, here: &Here, columns: &[Residual]) {
        for (i, column) in columns.iter().enumerate() {
            self.left[i] += here.product(column, &here.residual);
            for (j, tangent) in here.tangent.iter().enumerate() {
                self.crossed[(i, j)] += here.product(column, tangent);
            }
            for (j, other) in columns.iter().enumerate() {
                self.columns[(i, j)] += here.product(column, other);
            }
        }
    }

    fn scored(
        &self,
        (tangent, tangent_left): &(Cholesky<f64, Dyn>, DVector<f64>),
        entry: &'static Entry,
        values: Values,
    ) -> Option<Scored> {
        let made_up = tangent.solve(&self.crossed.transpose());
        let left = &self.left - made_up.transpose() * tangent_left;
        let mut held = &self.columns - &self.crossed * &made_up;
        for place in 0..held.nrows() {
            held[(place, place)] += 1e-9 + 1e-6 * self.columns[(place, place)];
        }
        let shares = held.cholesky()?.solve(&left);
        let mut tried = values;
        let [low, high] = entry.parameters[0].bounds;
        let gain = match phase_of(entry) {
            Some(place) => {
                let (cosine, sine) = (shares[0], shares[1]);
                tried[0] = (values[0] * cosine.hypot(sine)).clamp(low, high);
                tried[place] = sine.atan2(cosine) / TAU * 360.0;
                shares.dot(&left)
            }
            None => {
                tried[0] = (values[0] * shares[0]).clamp(low, high);
                // What may be positive alone and wants to be negative is not there.
                if tried[0] == 0.0 { 0.0 } else { shares.dot(&left) }
            }
        };
        (gain > 0.0 && tried[0] != 0.0).then_some(Scored { tried: Tried { entry, values: tried }, gain })
    }
}
