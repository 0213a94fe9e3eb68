//! Products of the columns of a trial with each other, with those of the base, and with what is left.
//!
//! ```text
//!   held = C − X K⁻¹ Xᵀ      C = products of the columns, X those with the base, K those of the base, in the weights of the fit
//! ```
//!
//! Invariant: what the base can make up for gains nothing.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::smallest::Smallest;
use super::trials::phase_of;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::linear::{K, LinearRun, Loss};
use crate::offline::gap::model::problem::Residual;
use crate::offline::product::product;
use crate::plant::effects::{Entry, Values};

/// How rows count here: a large effect puts many of them far off, and what explains those is looked for.
pub(super) const LOSS: Loss = Loss::straight(K);

/// What the base cannot make up for of the columns of a trial.
pub(in crate::offline::gap) struct Beyond {
    /// By coordinate: how the base makes up for the rest.
    pub(super) made_up: DMatrix<f64>,
    /// Products of what it cannot.
    held: DMatrix<f64>,
}

impl Beyond {
    /// What is left of slopes of columns beside that of the base, and the amplitudes that make it zero.
    pub(in crate::offline::gap) fn shares(
        &self,
        slope: &DVector<f64>,
        of_base: &DVector<f64>,
    ) -> Option<(DVector<f64>, DVector<f64>)> {
        let left = self.made_up.transpose() * of_base - slope;
        Some((self.held.clone().cholesky()?.solve(&left), left))
    }

    /// By how much the cost falls, whatever the sign.
    pub(in crate::offline::gap) fn gain(&self, slope: &DVector<f64>, of_base: &DVector<f64>) -> f64 {
        self.shares(slope, of_base).map_or(0.0, |(shares, left)| shares.dot(&left))
    }

    pub(in crate::offline::gap) fn smallest(&self, entry: &'static Entry, values: &Values) -> Smallest {
        // Of two columns a quarter of a period apart the mean, for nobody knows its phase.
        let seen = (self.held.trace() / self.held.nrows() as f64).sqrt();
        Smallest::of(entry, values[0].abs() / (entry.parameters[0].prior * seen))
    }
}

/// Products over all runs of the columns of a trial: with the tangent, with each other, with what is left.
pub(super) struct Sums {
    pub(in crate::offline::gap) crossed: DMatrix<f64>,
    pub(in crate::offline::gap) columns: DMatrix<f64>,
    pub(in crate::offline::gap) slope: DVector<f64>,
    /// By run: products of each column with what is left of each block, as rows count in the end.
    pub(in crate::offline::gap) blocks: Vec<DMatrix<f64>>,
}

impl Sums {
    pub(in crate::offline::gap) fn new(model: &Model, entry: &Entry) -> Self {
        let count = model.coordinate_count();
        let columns = if phase_of(entry).is_some() { 2 } else { 1 };
        Self {
            crossed: DMatrix::zeros(columns, count),
            columns: DMatrix::zeros(columns, columns),
            slope: DVector::zeros(columns),
            blocks: Vec::new(),
        }
    }

    pub(in crate::offline::gap) fn add(
        &mut self,
        run: &LinearRun,
        left: &Left,
        columns: &[Residual],
        block: usize,
    ) {
        for (i, column) in columns.iter().enumerate() {
            let mut weighed = column.clone();
            for (weighed, weights) in weighed.iter_mut().zip(&left.weights) {
                weighed.iter_mut().zip(weights).for_each(|(value, weight)| *value *= weight);
            }
            self.slope[i] += products(&weighed, &run.residual);
            for (j, tangent) in run.columns.iter().enumerate() {
                self.crossed[(i, j)] += tangent.as_ref().map_or(0.0, |tangent| products(&weighed, tangent));
            }
            for (j, other) in columns.iter().enumerate() {
                self.columns[(i, j)] += products(&weighed, other);
            }
        }
        self.blocks.push(slopes(&left.pulls, columns.iter().map(Some), block));
    }

    pub(in crate::offline::gap) fn beyond(&self, curvature: &Cholesky<f64, Dyn>) -> Beyond {
        let made_up = curvature.solve(&self.crossed.transpose());
        let mut held = &self.columns - &self.crossed * &made_up;
        for place in 0..held.nrows() {
            held[(place, place)] += 1e-9 + 1e-6 * self.columns[(place, place)];
        }
        Beyond { made_up, held }
    }
}

/// What is left of a run, as all trials ask for it.
pub(in crate::offline::gap) struct Left {
    /// How much each row weighs here.
    weights: Residual,
    /// What is left of it, as it counts in the end.
    pub(super) pulls: Residual,
}

impl Left {
    pub(in crate::offline::gap) fn of(run: &LinearRun) -> Self {
        let each = |of: fn(&f64) -> f64| -> Residual {
            run.residual.iter().map(|left| left.iter().map(of).collect()).collect()
        };
        Self { weights: each(|left| LOSS.weight(*left)), pulls: each(|left| Loss::LAST.weight(*left) * left) }
    }
}

/// Products of columns with what pulls: by column and block of so many rows.
pub(in crate::offline::gap) fn slopes<'r>(
    pulls: &Residual,
    columns: impl ExactSizeIterator<Item = Option<&'r Residual>>,
    block: usize,
) -> DMatrix<f64> {
    let rows = pulls.iter().map(Vec::len).max().unwrap_or(0);
    let mut slopes = DMatrix::zeros(columns.len(), rows.div_ceil(block));
    for (place, column) in columns.enumerate() {
        for (pulls, column) in pulls.iter().zip(column.into_iter().flatten()) {
            for (number, (pulls, by)) in pulls.chunks(block).zip(column.chunks(block)).enumerate() {
                slopes[(place, number)] += product(pulls, by);
            }
        }
    }
    slopes
}

fn products(a: &Residual, b: &Residual) -> f64 {
    a.iter().zip(b).map(|(a, b)| product(a, b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_of_blocks_and_rows_that_are_far_off_count_for_little() {
        let mut left = vec![1.0; 6];
        left[4] = 40.0;
        let column = vec![vec![2.0; 6]];
        let run = LinearRun { residual: vec![left], columns: Vec::new() };
        let slopes = slopes(&Left::of(&run).pulls, [None, Some(&column)].into_iter(), 4);
        assert_eq!(slopes.shape(), (2, 2));
        assert_eq!([slopes[(0, 0)], slopes[(1, 0)]], [0.0, 8.0]);
        // Two, and the ten thousandth part of eighty.
        assert!((slopes[(1, 1)] - 2.008).abs() < 1e-9, "{}", slopes[(1, 1)]);
    }
}
