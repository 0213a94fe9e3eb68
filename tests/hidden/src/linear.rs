//! The little linear algebra that severity needs: an autoregression as a whitening filter, and normal equations.
//! Invariant: what was whitened by its own filter has a variance of one.

/// Terms of the autoregression: 8 ms.
const ORDER: usize = 16;

/// A filter that makes white noise of variance one of the noise it was made from.
#[derive(Clone, Debug)]
pub struct Whitening {
    taps: [f64; ORDER],
    scale: f64,
}

impl Whitening {
    /// For the noise of one session, from the differences of two of them: each has half of the variance.
    pub fn of_difference(runs: &[Vec<f64>]) -> Self {
        let mut correlation = [0.0; ORDER + 1];
        let mut count = 0;
        for run in runs {
            let mean = run.iter().sum::<f64>() / run.len() as f64;
            for (lag, sum) in correlation.iter_mut().enumerate() {
                let pairs = run.iter().zip(&run[lag.min(run.len())..]);
                *sum += pairs.map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
            }
            count += run.len();
        }
        correlation.iter_mut().for_each(|sum| *sum *= 0.5 / count as f64);
        // A floor for what is all but predictable; without noise there is nothing to whiten.
        correlation[0] = correlation[0] * (1.0 + 1e-6) + f64::MIN_POSITIVE;
        let (taps, variance) = levinson(&correlation);
        Self { taps, scale: variance.sqrt().recip() }
    }

    /// The signal through the filter, which begins with zeros.
    pub fn apply(&self, signal: &[f64]) -> Vec<f32> {
        let at = |n: usize| {
            let past = signal[n.saturating_sub(ORDER)..n].iter().rev();
            let predicted: f64 = self.taps.iter().zip(past).map(|(tap, value)| tap * value).sum();
            (self.scale * (signal[n] - predicted)) as f32
        };
        (0..signal.len()).map(at).collect()
    }
}

/// Levinson's recursion: the taps that predict best, and the variance of what they miss.
fn levinson(correlation: &[f64; ORDER + 1]) -> ([f64; ORDER], f64) {
    let mut taps = [0.0; ORDER];
    let mut variance = correlation[0];
    for order in 0..ORDER {
        let predicted: f64 = (0..order).map(|n| taps[n] * correlation[order - n]).sum();
        let reflection = (correlation[order + 1] - predicted) / variance;
        let before = taps;
        for n in 0..order {
            taps[n] = before[n] - reflection * before[order - 1 - n];
        }
        taps[order] = reflection;
        variance *= 1.0 - reflection * reflection;
    }
    (taps, variance)
}

/// Solve `matrix x = right` for a positive definite matrix, by Cholesky.
pub fn solve(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let count = right.len();
    for n in 0..count {
        for m in 0..=n {
            let sum: f64 = (0..m).map(|k| matrix[n][k] * matrix[m][k]).sum();
            let rest = matrix[n][m] - sum;
            matrix[n][m] = if n == m { rest.max(f64::MIN_POSITIVE).sqrt() } else { rest / matrix[m][m] };
        }
    }
    for n in 0..count {
        let sum: f64 = (0..n).map(|k| matrix[n][k] * right[k]).sum();
        right[n] = (right[n] - sum) / matrix[n][n];
    }
    for n in (0..count).rev() {
        let sum: f64 = (n + 1..count).map(|k| matrix[k][n] * right[k]).sum();
        right[n] = (right[n] - sum) / matrix[n][n];
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::random;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn coloured_noise_becomes_white_of_variance_one() {
        let mut source = random(1, 1);
        let mut session = || {
            let mut value = 0.0;
            let mut next = || {
                let white: f64 = StandardNormal.sample(&mut source);
                value = 0.9 * value + 3.0 * white;
                value
            };
            (0..50_000).map(|_| next()).collect::<Vec<f64>>()
        };
        let (one, other) = (session(), session());
        let difference = one.iter().zip(&other).map(|(a, b)| a - b).collect();
        let white = Whitening::of_difference(&[difference]).apply(&one);
        let mean = |lag: usize| {
            white.iter().zip(&white[lag..]).map(|(a, b)| f64::from(a * b)).sum::<f64>() / white.len() as f64
        };
        assert!((mean(0) - 1.0).abs() < 0.02, "variance {}", mean(0));
        assert!(mean(1).abs() < 0.02, "correlation {} with the sample before", mean(1));
    }

    #[test]
    fn equations_are_solved() {
        let solved = solve(vec![vec![4.0, 2.0], vec![2.0, 3.0]], vec![10.0, 8.0]);
        assert!((solved[0] - 1.75).abs() < 1e-12 && (solved[1] - 1.5).abs() < 1e-12, "{solved:?}");
    }
}
