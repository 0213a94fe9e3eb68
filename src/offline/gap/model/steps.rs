//! Over which step each coordinate is differentiated: as wide as what is not known of it. That is wide against the roughness of
//! stick and slip at first, and narrow where a coordinate is known well.
//!
//! Invariant: no step is wider than its coordinate bears, nor without width.

use nalgebra::{DMatrix, DVector};

use super::Model;

/// Widest step of a derivative and narrowest, in coordinates; and between them how many standard deviations.
const STEP: (f64, f64, f64) = (0.04, 2e-4, 2.0);

/// By coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct Steps(Vec<f64>);

impl Steps {
    /// Where nothing is known yet.
    pub fn widest(model: &Model) -> Self {
        Self(model.widest_steps(STEP.0))
    }

    /// For coordinates of this covariance.
    pub fn of(model: &Model, covariance: &DMatrix<f64>) -> Self {
        let of = |(variance, widest): (&f64, f64)| {
            (STEP.2 * variance.max(0.0).sqrt()).clamp(STEP.1.min(widest), widest)
        };
        Self(covariance.diagonal().iter().zip(model.widest_steps(STEP.0)).map(of).collect())
    }

    /// That of a coordinate.
    pub(super) fn of_coordinate(&self, coordinate: usize) -> f64 {
        self.0[coordinate]
    }

    /// Whether a step goes as far as they do.
    pub(super) fn are_within(&self, step: &DVector<f64>) -> bool {
        step.iter().zip(&self.0).map(|(step, own)| (step / own).powi(2)).sum::<f64>() >= 1.0
    }

    /// Whether they are as narrow as that asks for, or nearly.
    pub fn is_fine_for(&self, model: &Model, covariance: &DMatrix<f64>) -> bool {
        self.0.iter().zip(Self::of(model, covariance).0).all(|(own, wanted)| *own <= 3.0 * wanted)
    }
}
