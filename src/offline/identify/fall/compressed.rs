//! A few numbers in place of many: what a signature tells of each coordinate of its place, by a straight line.
//!
//! ```text
//!   t = x̄ + β' (s - s̄)          β: ridge regression of the places x of the draws on what they look like
//! ```
//!
//! How likely a place is for many numbers needs many more draws to be known; a line through the draws for each
//! coordinate keeps nearly all that the numbers tell of it (Fearnhead and Prangle, 2012, J. R. Statist. Soc. B 74, 419).
//! A line agrees with its own draws better than with others, so each draw is told by the line of all others: what they
//! are off then is what the log is off, and an interval needs no correction.
//! Invariant: no draw is in the line that tells it.

use nalgebra::{Cholesky, DMatrix, DVector};

/// What may be added to the squares of the numbers, in units of their own scatter: the most foretelling of them is.
const RIDGES: [f64; 5] = [1.0, 3.0, 10.0, 30.0, 100.0];

/// What signatures tell, by coordinates.
#[derive(Clone, Debug)]
pub(super) struct Compressed {
    /// Of each draw, by all others.
    pub(super) draws: Vec<Vec<f64>>,
    /// Of what was seen, by all draws.
    pub(super) seen: Vec<f64>,
}

impl Compressed {
    /// Of draws, each its place and what it looks like, and of what was seen. `None` where there are no draws.
    pub(super) fn new(draws: &[(&[f64], &[f64])], seen: &[f64]) -> Option<Self> {
        let (count, coordinates, features) = (draws.len(), draws.first()?.0.len(), seen.len());
        let share = 1.0 / count as f64;
        let mean = |of: &dyn Fn(usize) -> f64| share * (0..count).map(of).sum::<f64>();
        let means: Vec<f64> = (0..features).map(|feature| mean(&|draw| draws[draw].1[feature])).collect();
        let deviation =
            |feature: usize| mean(&|draw| (draws[draw].1[feature] - means[feature]).powi(2)).sqrt().max(1e-9);
        let deviations: Vec<f64> = (0..features).map(deviation).collect();
        let scaled = |of: &[f64], feature: usize| (of[feature] - means[feature]) / deviations[feature];
        let columns = DMatrix::from_fn(count, features, |draw, feature| scaled(draws[draw].1, feature));
        let asked = DVector::from_fn(features, |feature, _| scaled(seen, feature));
        let centre: Vec<f64> = (0..coordinates).map(|way| mean(&|draw| draws[draw].0[way])).collect();
        let places = DMatrix::from_fn(count, coordinates, |draw, way| draws[draw].0[way] - centre[way]);
        let squares = columns.transpose() * &columns;
        let mut best: Vec<Option<(f64, DVector<f64>, f64)>> = vec![None; coordinates];
        for ridge in RIDGES {
            let Some(sum) = Cholesky::new(&squares + DMatrix::identity(features, features) * ridge) else {
                continue;
            };
            let lines = sum.solve(&(columns.transpose() * &places));
            let inverse = sum.inverse();
            let own = |draw: usize| {
                let row = columns.row(draw);
                share + (row * &inverse * row.transpose())[(0, 0)]
            };
            // What a line without a draw leaves of it follows from what the line with it leaves.
            let left = &places - &columns * &lines;
            let others = DVector::from_fn(count, |draw, _| 1.0 / (1.0 - own(draw)).max(share));
            for (way, best) in best.iter_mut().enumerate() {
                let left = left.column(way).component_mul(&others);
                let square = left.norm_squared();
                if best.as_ref().is_none_or(|(least, ..)| square < *least) {
                    *best = Some((square, left, asked.dot(&lines.column(way))));
                }
            }
        }
        let best: Vec<(f64, DVector<f64>, f64)> = best.into_iter().collect::<Option<_>>()?;
        let told = |draw: usize| -> Vec<f64> {
            best.iter().zip(draws[draw].0).map(|((_, left, _), place)| place - left[draw]).collect()
        };
        Some(Self {
            draws: (0..count).map(told).collect(),
            seen: best.iter().zip(&centre).map(|((.., told), centre)| centre + told).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const FEATURES: usize = 30;

    /// Draws that thirty features tell something of: of the first coordinate three, of the second none.
    fn draws(count: usize, random: &mut Pcg64Mcg) -> Vec<(Vec<f64>, Vec<f64>)> {
        let one = |random: &mut Pcg64Mcg| {
            let place: Vec<f64> = (0..2).map(|_| random.random_range(-1.0..1.0)).collect();
            let seen = (0..FEATURES)
                .map(|feature| {
                    let error: f64 = StandardNormal.sample(random);
                    let told = if feature % 10 == 0 { 3.0 * place[0] } else { 0.0 };
                    500.0 + 40.0 * (told + error)
                })
                .collect();
            (place, seen)
        };
        (0..count).map(|_| one(random)).collect()
    }

    /// Mean square by which what is told is off, of the draws and of others that are seen.
    fn off(way: usize) -> [f64; 2] {
        let mut random = Pcg64Mcg::seed_from_u64(8);
        let all = draws(60, &mut random);
        let borrowed: Vec<(&[f64], &[f64])> =
            all.iter().map(|(place, seen)| (&place[..], &seen[..])).collect();
        let others = draws(300, &mut random);
        let told = |seen: &[f64]| Compressed::new(&borrowed, seen).expect("draws");
        let of_draws = told(&all[0].1).draws;
        let mean = |squares: Vec<f64>| squares.iter().sum::<f64>() / squares.len() as f64;
        [
            mean(
                all.iter()
                    .zip(&of_draws)
                    .map(|((place, _), told)| (told[way] - place[way]).powi(2))
                    .collect(),
            ),
            mean(others.iter().map(|(place, seen)| (told(seen).seen[way] - place[way]).powi(2)).collect()),
        ]
    }

    #[test]
    fn what_draws_are_off_is_what_others_are_off() {
        let [own, other] = off(0);
        assert!((0.7..1.4).contains(&(own / other)), "{own} of the draws, {other} of others");
        // A third of the square is what one knows without looking; three features leave a thirtieth of it and more.
        assert!(other < 0.08, "{other} is off");
    }

    #[test]
    fn of_what_nothing_tells_the_mean_is_told() {
        let [own, other] = off(1);
        assert!((0.7..1.4).contains(&(own / other)), "{own} of the draws, {other} of others");
        assert!(other < 0.6, "{other} is off, with a third for the mean");
    }
}
