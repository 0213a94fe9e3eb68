//! Linear least squares with the intervals of its coefficients.
//!
//! Residuals of a measured motion are never white: neighbouring rows share the same disturbance. The covariance
//! of the coefficients takes in the products of residuals up to a lag (Newey and West, 1987, Econometrica 55,
//! 703, with their triangular weights), after a first-order memory was taken out (Andrews and Monahan, 1992,
//! Econometrica 60, 953), so the intervals hold for filtered data too.
//! Invariant: columns that do not tell coefficients apart are an error, not a large number.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, StudentsT};
use thiserror::Error;

/// Least ratio of the smallest to the largest singular value of the scaled columns.
const CONDITION_MIN: f64 = 1e-9;

/// Most that a row of residuals is taken to keep of the row before it.
const KEPT_MAX: f64 = 0.97;

/// Why there is no fit.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum FitError {
    /// Not enough rows.
    #[error("{rows} rows for {coefficients} coefficients")]
    TooFewRows {
        /// Rows there are.
        rows: usize,
        /// Coefficients asked for.
        coefficients: usize,
    },
    /// Columns of different lengths.
    #[error("a column has {got} rows, the target has {expected}")]
    Length {
        /// Rows of the column.
        got: usize,
        /// Rows of the target.
        expected: usize,
    },
    /// Columns that cannot be told apart.
    #[error("the data do not tell the coefficients apart (condition {condition:.0e})")]
    Singular {
        /// Smallest to largest singular value of the scaled columns.
        condition: f64,
    },
    /// A value that is not finite.
    #[error("a value is not finite")]
    NotFinite,
}

/// A fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// In order of the columns.
    pub coefficients: Vec<f64>,
    /// Half widths of their 95 % intervals.
    pub half_width95: Vec<f64>,
    /// What the fit leaves, by rows.
    pub residuals: Vec<f64>,
    /// Norm of the residuals over the norm of the target.
    pub relative_error: f64,
}

/// Fit `target ≈ Σ coefficient · column`. Residuals up to `lag` rows apart may be correlated; 0: none are.
///
/// # Errors
/// When there are too few rows, or the columns do not tell the coefficients apart.
pub fn fit(columns: &[Vec<f64>], target: &[f64], lag: usize) -> Result<Fit, FitError> {
    let (rows, count) = (target.len(), columns.len());
    if rows <= count {
        return Err(FitError::TooFewRows { rows, coefficients: count });
    }
    if let Some(column) = columns.iter().find(|column| column.len() != rows) {
        return Err(FitError::Length { got: column.len(), expected: rows });
    }
    let norms: Vec<f64> = columns.iter().map(|column| norm(column)).collect();
    if !norms.iter().chain([&norm(target)]).all(|norm| norm.is_finite()) {
        return Err(FitError::NotFinite);
    }
    if norms.contains(&0.0) {
        return Err(FitError::Singular { condition: 0.0 });
    }
    // Scaled to length one: units of the columns do not decide what is singular.
    let scaled = DMatrix::from_fn(rows, count, |row, k| columns[k][row] / norms[k]);
    let target_vector = DVector::from_column_slice(target);
    let svd = scaled.clone().svd(true, true);
    let condition = svd.singular_values.min() / svd.singular_values.max();
    if condition < CONDITION_MIN {
        return Err(FitError::Singular { condition });
    }
    let Ok(solution) = svd.solve(&target_vector, 0.0) else {
        return Err(FitError::Singular { condition });
    };
    let residual_vector = &target_vector - &scaled * &solution;
    let inverse = (scaled.transpose() * &scaled).try_inverse().ok_or(FitError::Singular { condition })?;
    let covariance = &inverse * scores(&scaled, &residual_vector, lag) * &inverse;
    let freedom = (rows - count) as f64;
    let inflation = (rows as f64 / freedom).sqrt();
    let quantile = student95(freedom / (1.0 + lag as f64));
    let half_width = |k: usize| quantile * covariance[(k, k)].max(0.0).sqrt() * inflation / norms[k];
    Ok(Fit {
        coefficients: (0..count).map(|k| solution[k] / norms[k]).collect(),
        half_width95: (0..count).map(half_width).collect(),
        relative_error: residual_vector.norm() / target_vector.norm(),
        residuals: residual_vector.iter().copied().collect(),
    })
}

/// Two-sided 95 % quantile of Student's t.
pub fn student95(degrees_of_freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, degrees_of_freedom.max(1.0)).map_or(f64::NAN, |t| t.inverse_cdf(0.975))
}

/// `Σ w(l) Σ e(i) e(i+l) x(i) x(i+l)'`, both ways. Without a lag the rows are taken as they are; else each
/// column loses what it keeps of its last row, and gets it back in the sum.
fn scores(columns: &DMatrix<f64>, residuals: &DVector<f64>, lag: usize) -> DMatrix<f64> {
    let rows =
        DMatrix::from_fn(columns.nrows(), columns.ncols(), |row, k| columns[(row, k)] * residuals[row]);
    if lag == 0 {
        return rows.transpose() * &rows;
    }
    let kept = DVector::from_fn(rows.ncols(), |k, _| kept(rows.column(k).as_slice()));
    let fresh = DMatrix::from_fn(rows.nrows() - 1, rows.ncols(), |row, k| {
        rows[(row + 1, k)] - kept[k] * rows[(row, k)]
    });
    let sum = correlated(&fresh, lag);
    DMatrix::from_fn(sum.nrows(), sum.ncols(), |j, k| sum[(j, k)] / ((1.0 - kept[j]) * (1.0 - kept[k])))
}

/// Share of a value that is left of the value before it.
fn kept(values: &[f64]) -> f64 {
    let product: f64 = values.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let square: f64 = values.iter().map(|value| value * value).sum();
    if square > 0.0 { (product / square).clamp(-KEPT_MAX, KEPT_MAX) } else { 0.0 }
}

fn correlated(weighted: &DMatrix<f64>, lag: usize) -> DMatrix<f64> {
    let mut sum = weighted.transpose() * weighted;
    for apart in 1..=lag.min(weighted.nrows() - 1) {
        let weight = 1.0 - apart as f64 / (lag + 1) as f64;
        let rest = weighted.nrows() - apart;
        let product = weighted.rows(0, rest).transpose() * weighted.rows(apart, rest);
        sum += (&product + product.transpose()) * weight;
    }
    sum
}

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const ROWS: usize = 400;

    fn columns() -> Vec<Vec<f64>> {
        let x = |row: usize| row as f64 / 40.0;
        vec![vec![1.0; ROWS], (0..ROWS).map(x).collect(), (0..ROWS).map(|row| 1e6 * x(row).sin()).collect()]
    }

    fn target(noise: &[f64]) -> Vec<f64> {
        let columns = columns();
        (0..ROWS).map(|row| 3.0 - 0.5 * columns[1][row] + 2e-6 * columns[2][row] + noise[row]).collect()
    }

    #[test]
    fn what_was_put_in_comes_out() {
        let fit = fit(&columns(), &target(&[0.0; ROWS]), 0).expect("a fit");
        for (found, truth) in fit.coefficients.iter().zip([3.0, -0.5, 2e-6]) {
            assert!((found / truth - 1.0).abs() < 1e-12, "{found} for {truth}");
        }
        assert!(fit.relative_error < 1e-12);
    }

    /// How many of 1000 intervals contain the truth, with noise that remembers a part of itself.
    fn coverage(memory: f64, lag: usize) -> usize {
        let mut random = Pcg64Mcg::seed_from_u64(7);
        let truth = [3.0, -0.5, 2e-6];
        let mut inside = 0;
        for _ in 0..334 {
            let mut last = 0.0;
            let noise: Vec<f64> = (0..ROWS)
                .map(|_| {
                    let new: f64 = StandardNormal.sample(&mut random);
                    last = memory * last + new;
                    last
                })
                .collect();
            let fit = fit(&columns(), &target(&noise), lag).expect("a fit");
            let is_in = |k: &usize| (fit.coefficients[*k] - truth[*k]).abs() <= fit.half_width95[*k];
            inside += (0..3).filter(is_in).count();
        }
        inside * 1_000 / (334 * 3)
    }

    #[test]
    fn intervals_contain_the_truth_as_often_as_they_say() {
        let white = coverage(0.0, 0);
        assert!((930..=970).contains(&white), "{white} of 1000");
        let correlated = coverage(0.8, 30);
        // 400 rows with this memory tell no more than 44 without: a sum of lags is then a little short.
        assert!((890..=970).contains(&correlated), "{correlated} of 1000");
        let neglected = coverage(0.8, 0);
        assert!(neglected < 700, "{neglected} of 1000: the test cannot tell");
    }

    #[test]
    fn columns_that_say_the_same_are_refused() {
        let mut same = columns();
        same[2] = same[1].iter().map(|x| 4.0 * x).collect();
        assert!(matches!(fit(&same, &target(&[0.0; ROWS]), 0), Err(FitError::Singular { .. })));
        same[2] = vec![0.0; ROWS];
        assert!(matches!(fit(&same, &target(&[0.0; ROWS]), 0), Err(FitError::Singular { .. })));
        let few: Vec<_> = columns().iter().map(|column| column[..3].to_vec()).collect();
        assert_eq!(fit(&few, &[1.0; 3], 0), Err(FitError::TooFewRows { rows: 3, coefficients: 3 }));
    }
}
