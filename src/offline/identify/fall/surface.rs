//! What simulated axes look like over a box of parameters, and how likely a box's places are for what was seen.
//!
//! ```text
//!   s = B(x) c + e        B: polynomials of the place x in the box,  e ~ N(0, Σ),  c and Σ from the draws
//! ```
//!
//! `c` and `Σ` are known as well as the draws tell them, so what another axis looks like is distributed as
//! Student's t in many dimensions (Box and Tiao, *Bayesian Inference in Statistical Analysis*, 1973, section 8.2); with
//! features of simulated runs this is the synthetic likelihood of Wood (2010, Nature 466, 1102). A place is a list
//! of numbers from -1 to 1. Invariant: nothing here knows what the numbers mean.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};
use statrs::function::gamma::ln_gamma;

/// A box of parameters as the draws show it.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    degree: usize,
    coefficients: DMatrix<f64>,
    /// Inverse of the sum of squares of the polynomials, and of what they leave.
    inverse: DMatrix<f64>,
    left: Cholesky<f64, Dyn>,
    /// Degrees of freedom of Student's t.
    freedom: f64,
}

impl Surface {
    /// From draws, each its place and what it looks like; `None` when they are too few for what they show.
    pub(super) fn new(draws: &[(&[f64], &[f64])], degree: usize) -> Option<Self> {
        let rows: Vec<Vec<f64>> = draws.iter().map(|(place, _)| polynomials(place, degree)).collect();
        let (count, terms, features) = (draws.len(), rows.first()?.len(), draws.first()?.1.len());
        if count < terms + features + 2 {
            return None;
        }
        let places = DMatrix::from_fn(count, terms, |row, term| rows[row][term]);
        let seen = DMatrix::from_fn(count, features, |row, feature| draws[row].1[feature]);
        let inverse = (places.transpose() * &places).try_inverse()?;
        let coefficients = &inverse * places.transpose() * &seen;
        let left = seen - places * &coefficients;
        let left = Cholesky::new(left.transpose() * left)?;
        let freedom = (count - terms - features + 1) as f64;
        Some(Self { degree, coefficients, inverse, left, freedom })
    }

    /// What an axis at a place looks like, on average.
    pub(super) fn expected(&self, place: &[f64]) -> Vec<f64> {
        let row = DVector::from_vec(polynomials(place, self.degree));
        self.coefficients.tr_mul(&row).iter().copied().collect()
    }

    /// How far what was seen is from a place: its square in units of the scatter, and how much wider the scatter
    /// is for want of draws.
    fn distance(&self, place: &[f64], seen: &[f64]) -> (f64, f64) {
        let row = DVector::from_vec(polynomials(place, self.degree));
        let off = DVector::from_column_slice(seen) - self.coefficients.tr_mul(&row);
        let square = off.dot(&self.left.solve(&off));
        (square, 1.0 + row.dot(&(&self.inverse * &row)))
    }

    /// Logarithm of the probability density of what was seen, at a place.
    pub(super) fn log_density(&self, place: &[f64], seen: &[f64]) -> f64 {
        let (square, wider) = self.distance(place, seen);
        let (features, all) = (seen.len() as f64, self.freedom + seen.len() as f64);
        ln_gamma(0.5 * all)
            - ln_gamma(0.5 * self.freedom)
            - 0.5 * features * (std::f64::consts::PI * wider).ln()
            - 0.5 * self.left.ln_determinant()
            - 0.5 * all * (square / wider).ln_1p()
    }

    /// What the misfit of one in a hundred axes is above, of so many numbers.
    pub(super) fn misfit_by_chance(&self, features: usize) -> f64 {
        // Of Fisher and Snedecor, as what is left is known as well as the draws tell it.
        FisherSnedecor::new(features as f64, self.freedom)
            .map_or(1.0, |by_chance| by_chance.inverse_cdf(0.99))
    }

    /// How much farther what was seen is from the mean of a place than axes there are, as the ratio of squares: 1 on
    /// average for an axis of that place.
    pub(super) fn misfit(&self, place: &[f64], seen: &[f64]) -> f64 {
        let (square, wider) = self.distance(place, seen);
        square / wider * self.freedom / seen.len() as f64
    }
}

/// All products of the coordinates up to a degree.
fn polynomials(place: &[f64], degree: usize) -> Vec<f64> {
    let mut terms = vec![(1.0, degree)];
    for x in place {
        terms = terms
            .into_iter()
            .flat_map(|(term, left)| (0..=left).map(move |power| (term * x.powi(power as i32), left - power)))
            .collect();
    }
    terms.into_iter().map(|(term, _)| term).collect()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Three features of two parameters, the first two with a common error.
    fn seen(place: &[f64], random: &mut Pcg64Mcg) -> Vec<f64> {
        let mut error = || -> f64 { StandardNormal.sample(random) };
        let common = error();
        let [x, y] = [place[0], place[1]];
        vec![
            5.0 * x + 2.0 * x * y + common + 0.3 * error(),
            -2.0 * y + x * x + common,
            3.0 * y + 0.5 * error() - x,
        ]
    }

    fn surface(random: &mut Pcg64Mcg, count: usize) -> Surface {
        let places: Vec<Vec<f64>> =
            (0..count).map(|_| (0..2).map(|_| random.random_range(-1.0..1.0)).collect()).collect();
        let all: Vec<Vec<f64>> = places.iter().map(|place| seen(place, random)).collect();
        let draws: Vec<(&[f64], &[f64])> =
            places.iter().zip(&all).map(|(place, seen)| (&place[..], &seen[..])).collect();
        Surface::new(&draws, 2).expect("enough draws")
    }

    #[test]
    fn what_comes_from_a_place_is_as_far_from_it_as_it_says() {
        let mut random = Pcg64Mcg::seed_from_u64(4);
        let surface = surface(&mut random, 60);
        let place = [0.3, -0.5];
        let misfits: Vec<f64> =
            (0..2_000).map(|_| surface.misfit(&place, &seen(&place, &mut random))).collect();
        let above = |bound: f64| misfits.iter().filter(|misfit| **misfit > bound).count();
        // Quantiles of F with 3 and 52 degrees of freedom; the surface itself is known from 60 draws only.
        assert!((800..=1_200).contains(&above(0.80)), "{} of 2000 above the median", above(0.80));
        assert!((40..=180).contains(&above(2.78)), "{} of 2000 above 95 %", above(2.78));
        let elsewhere = surface.misfit(&[-0.9, 0.9], &seen(&place, &mut random));
        assert!(elsewhere > 10.0, "{elsewhere} at a place where it is not");
    }

    #[test]
    fn the_density_is_one_over_all_that_may_be_seen() {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let places: Vec<[f64; 1]> = (0..20).map(|_| [random.random_range(-1.0..1.0)]).collect();
        let all: Vec<[f64; 1]> = places
            .iter()
            .map(|[x]| {
                let error: f64 = StandardNormal.sample(&mut random);
                [2.0 * x + error]
            })
            .collect();
        let draws: Vec<(&[f64], &[f64])> =
            places.iter().zip(&all).map(|(place, seen)| (&place[..], &seen[..])).collect();
        let surface = Surface::new(&draws, 1).expect("enough draws");
        let step = 0.01;
        let sum: f64 =
            (-3_000..3_000).map(|k| surface.log_density(&[0.4], &[f64::from(k) * step]).exp() * step).sum();
        assert!((sum - 1.0).abs() < 1e-3, "{sum}");
    }

    #[test]
    fn too_few_draws_are_no_surface() {
        let mut random = Pcg64Mcg::seed_from_u64(6);
        let places: Vec<Vec<f64>> = (0..10).map(|_| vec![random.random_range(-1.0..1.0), 0.1]).collect();
        let all: Vec<Vec<f64>> = places.iter().map(|place| seen(place, &mut random)).collect();
        let draws: Vec<(&[f64], &[f64])> =
            places.iter().zip(&all).map(|(place, seen)| (&place[..], &seen[..])).collect();
        assert!(Surface::new(&draws, 2).is_none());
    }

    #[test]
    fn polynomials_are_all_products_up_to_their_degree() {
        let mut terms = polynomials(&[2.0, 3.0], 2);
        terms.sort_by(f64::total_cmp);
        assert_eq!(terms, [1.0, 2.0, 3.0, 4.0, 6.0, 9.0]);
        assert_eq!(polynomials(&[2.0], 3), [1.0, 2.0, 4.0, 8.0]);
    }
}
