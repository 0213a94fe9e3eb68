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

use nalgebra::DMatrix;

use super::fit::Fitted;
use super::linear::{BLOCK_S, K, Linear, Loss, regular, residuals};
use super::problem::{Part, Problem};
use super::steps::Steps;

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

/// Whether rows that judge are sure of other amplitudes than the fitted rows: what is the same thing has one size in both.
pub(super) fn is_another(judged: &[Judged]) -> bool {
    let differs = |one: &Judged| (one.share - 1.0).abs() > f64::max(OTHER * one.deviation, OTHER_SHARE);
    !judged.is_empty() && judged.iter().all(differs)
}

/// What the rows that judge say of amplitudes: of each with all others as they follow it, but for times and places. Nothing
/// where they do not tell.
pub fn alone(problem: &Problem<'_>, fitted: &Fitted, amplitudes: &[usize]) -> Vec<Judged> {
    let model = &fitted.model;
    let steps = Steps::of(model, &fitted.covariance);
    let shapes: Vec<usize> = model.shapes().collect();
    let known: Vec<usize> = (0..model.coordinate_count())
        .filter(|coordinate| !amplitudes.contains(coordinate) && !shapes.contains(coordinate))
        .collect();
    let left = (Part::Held, residuals(problem, model, Part::Held));
    let linear = Linear::new(problem, model, left, None, &steps).holding(&shapes).where_straight_to_none(
        problem,
        Part::Held,
        amplitudes,
    );
    // By their size: what is far off tells most of an effect that is not there.
    let equations = linear.normal(problem.rows_in(BLOCK_S), Loss::straight(K));
    let found = of_others(&fitted.covariance, &known).and_then(|curvature| {
        let equations = equations.with_known(&curvature);
        Some((equations.step()?, equations.covariance()?))
    });
    let Some((step, covariance)) = found else { return Vec::new() };
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
    use super::*;

    #[test]
    fn what_has_another_size_where_nobody_fitted_is_another_thing() {
        for (share, deviation, is_other) in [
            (0.66, 0.08, true),
            (1.53, 0.14, true),
            (0.17, 0.27, true),
            // Within what is not sure, or off by little.
            (0.68, 0.17, false),
            (1.21, 0.01, false),
        ] {
            let one = Judged { share, deviation };
            assert_eq!(is_another(&[one]), is_other, "{share}, {deviation}");
            // One of two amplitudes that stays as it is tells that it is the same.
            assert!(!is_another(&[one, Judged { share: 1.0, deviation: 0.1 }]));
        }
        assert!(!is_another(&[]));
    }
}
