//! Noise as a process: its autocovariances, and the predictor that makes it white.
//!
//! Invariant: of blocks and numbers alone; what they are noise of is not known here.

use super::floor::ORDER;
use crate::offline::median::median;

/// Stick and slip come at other moments in each pass. Blocks of this length whose power is so many times the usual
/// hold such an event and are no noise. s.
pub(in crate::offline::gap) const BLOCK_S: f64 = 0.2;
const EVENT: f64 = 4.0;
/// Fewer rows tell nothing.
const ROWS_MIN: usize = 200;

/// Autocovariances of most blocks: one with an event is none of them; nothing where these are few rows.
pub(super) fn autocovariances(blocks: &[Vec<f64>]) -> Option<Vec<f64>> {
    let power = |block: &Vec<f64>| block.iter().map(|value| value * value).sum::<f64>() / block.len() as f64;
    let mut powers: Vec<f64> = blocks.iter().map(power).collect();
    let usual = median(&mut powers).unwrap_or(0.0);
    let (mut lags, mut rows) = (vec![0.0; ORDER + 1], 0);
    for block in blocks.iter().filter(|block| power(block) <= EVENT * usual) {
        add_lags(block, &mut lags);
        rows += block.len();
    }
    (rows >= ROWS_MIN).then(|| lags.iter().map(|sum| sum / rows as f64).collect())
}

fn add_lags(values: &[f64], lags: &mut [f64]) {
    for (lag, sum) in lags.iter_mut().enumerate() {
        *sum += values.iter().zip(values.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>();
    }
}

/// Coefficients of the predictor of a process by its autocovariances, and what it leaves of the variance
/// (Levinson and Durbin).
pub(super) fn levinson(lags: &[f64]) -> (Vec<f64>, f64) {
    let mut left = lags[0];
    let mut memory: Vec<f64> = Vec::new();
    for order in 1..lags.len() {
        let known: f64 = memory.iter().enumerate().map(|(back, a)| a * lags[order - 1 - back]).sum();
        let reflection = (lags[order] - known) / left;
        // No process has such autocovariances: there are too few rows for this order.
        if reflection.is_nan() || reflection.abs() >= 1.0 {
            break;
        }
        let turned: Vec<f64> = memory.iter().rev().copied().collect();
        for (a, other) in memory.iter_mut().zip(turned) {
            *a -= reflection * other;
        }
        memory.push(reflection);
        left *= 1.0 - reflection * reflection;
    }
    (memory, left)
}

/// Variance of what a predictor leaves of another process, of these autocovariances.
pub(in crate::offline::gap) fn left_of(memory: &[f64], lags: &[f64]) -> f64 {
    let filter = || std::iter::once(1.0).chain(memory.iter().map(|a| -a)).enumerate();
    let at = |lag: usize| lags.get(lag).copied().unwrap_or(0.0);
    let pairs = filter().flat_map(|(i, a)| filter().map(move |(j, b)| (i.abs_diff(j), a * b)));
    pairs.map(|(lag, product)| product * at(lag)).sum::<f64>().max(0.0)
}
