//! Nonlinear least squares by Levenberg and Marquardt, with the covariance of what it finds.
//!
//! Differences for the derivatives: the residuals are cheap and smooth, and parameters come scaled to about one.
//! Invariant: a fit whose parameters cannot be told apart has no covariance, and so no value.

use nalgebra::{DMatrix, DVector};

/// Step of the differences.
const DIFFERENCE: f64 = 1e-6;
const STEPS_MAX: usize = 200;
/// Smaller steps are the end.
const STEP_MIN: f64 = 1e-10;
/// Least ratio of singular values at which parameters are told apart.
const CONDITION_MIN: f64 = 1e-10;

/// What was found.
#[derive(Clone, Debug)]
pub(super) struct Descent {
    /// The parameters.
    pub(super) parameters: DVector<f64>,
    /// Their covariance, as large as the residuals say, and no smaller than their weights say.
    pub(super) covariance: DMatrix<f64>,
    /// Residuals less parameters.
    pub(super) freedom: usize,
}

/// Fit weighted residuals, each with a standard deviation of one, from a start.
pub(super) fn fit(residuals: impl Fn(&DVector<f64>) -> DVector<f64>, start: DVector<f64>) -> Option<Descent> {
    let mut parameters = start;
    let mut left = residuals(&parameters);
    let freedom = left.len().checked_sub(parameters.len()).filter(|freedom| *freedom > 0)?;
    let mut damping = 1e-3;
    for _ in 0..STEPS_MAX {
        let jacobian = jacobian(&residuals, &parameters, &left);
        let normal = jacobian.transpose() * &jacobian;
        let slope = jacobian.transpose() * &left;
        let damped = &normal + DMatrix::from_diagonal(&normal.diagonal()) * damping;
        let step = damped.lu().solve(&-slope)?;
        let tried = &parameters + &step;
        let after = residuals(&tried);
        if after.norm_squared() < left.norm_squared() {
            (parameters, left) = (tried, after);
            damping *= 0.2;
            if step.amax() < STEP_MIN {
                break;
            }
        } else {
            damping *= 5.0;
            if damping > 1e12 {
                break;
            }
        }
    }
    let jacobian = jacobian(&residuals, &parameters, &left);
    let values = jacobian.clone().singular_values();
    // Not a number is no condition either.
    let is_sound = values.min() > CONDITION_MIN * values.max();
    if !is_sound {
        return None;
    }
    let inverse = (jacobian.transpose() * &jacobian).try_inverse()?;
    let misfit = (left.norm_squared() / freedom as f64).max(1.0);
    Some(Descent { parameters, covariance: inverse * misfit, freedom })
}

fn jacobian(
    residuals: &impl Fn(&DVector<f64>) -> DVector<f64>,
    at: &DVector<f64>,
    left: &DVector<f64>,
) -> DMatrix<f64> {
    let mut jacobian = DMatrix::zeros(left.len(), at.len());
    for place in 0..at.len() {
        let mut there = at.clone();
        there[place] += DIFFERENCE;
        jacobian.set_column(place, &((residuals(&there) - left) / DIFFERENCE));
    }
    jacobian
}

impl Descent {
    /// A value made of the parameters, and its standard deviation.
    pub(super) fn value(&self, of: impl Fn(&DVector<f64>) -> f64) -> (f64, f64) {
        let here = of(&self.parameters);
        let slope = DVector::from_fn(self.parameters.len(), |place, _| {
            let mut there = self.parameters.clone();
            there[place] += DIFFERENCE;
            (of(&there) - here) / DIFFERENCE
        });
        (here, (slope.transpose() * &self.covariance * &slope)[(0, 0)].max(0.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decay(parameters: &DVector<f64>, time: f64) -> f64 {
        parameters[0] * (-parameters[1] * time).exp()
    }

    #[test]
    fn a_curve_is_found_with_the_spread_of_its_noise() {
        let truth = DVector::from_vec(vec![2.0, 0.7]);
        let noise = |row: usize| 0.01 * ((row * 7919 % 101) as f64 / 50.0 - 1.0) * 3.0_f64.sqrt();
        let data: Vec<f64> = (0..200).map(|row| decay(&truth, row as f64 * 0.02) + noise(row)).collect();
        let residuals = |at: &DVector<f64>| {
            DVector::from_fn(200, |row, _| (decay(at, row as f64 * 0.02) - data[row]) / 0.01)
        };
        let found = fit(residuals, DVector::from_vec(vec![1.0, 2.0])).unwrap();
        for place in 0..2 {
            let (value, std) = found.value(|at| at[place]);
            assert!((value - truth[place]).abs() < 3.0 * std, "{value} of {}, {std}", truth[place]);
            assert!((5e-4..5e-3).contains(&std), "{std}");
        }
    }

    #[test]
    fn parameters_that_act_alike_have_no_value() {
        let residuals = |at: &DVector<f64>| DVector::from_fn(50, |row, _| at[0] + at[1] - row as f64);
        assert!(fit(residuals, DVector::from_vec(vec![0.3, 0.1])).is_none());
    }
}
