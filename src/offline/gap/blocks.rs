//! How sure it is that a model does better on rows that it has not seen: block by block, whichever of them are drawn.
//!
//! Invariant: the same blocks give the same answer.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::linear::{BLOCK_S, Loss, residuals};
use super::model::Model;
use super::problem::{Part, Problem};

/// How often blocks are drawn to see how sure a fall is, and in how many draws at most it may be none: one in a thousand,
/// for there are thirty candidates, and each may be the one that chance favours.
const DRAWS: (usize, usize) = (4_000, 4);
/// What shows in few blocks, as at reversals, is missing in some draws. It is no chance event where as many blocks may be left
/// out.
const LEFT_OUT: usize = 3;

/// Cost of the rows that were not fitted, block by block.
#[derive(Clone, Debug)]
pub(super) struct Blocks(Vec<f64>);

impl Blocks {
    pub(super) fn new(problem: &Problem<'_>, model: &Model) -> Self {
        let length = (BLOCK_S / problem.machine.cycle.period.as_s()) as usize;
        let mut blocks = Vec::new();
        for residual in residuals(problem, model, Part::Held) {
            let rows = residual.iter().map(Vec::len).max().unwrap_or(0);
            for from in (0..rows).step_by(length) {
                let of = |signal: &Vec<f64>| {
                    signal.iter().skip(from).take(length).map(|value| Loss::LAST.of(*value)).sum::<f64>()
                };
                blocks.push(residual.iter().map(of).sum());
            }
        }
        Self(blocks)
    }

    /// Of known costs.
    #[cfg(test)]
    pub(super) const fn of(costs: Vec<f64>) -> Self {
        Self(costs)
    }

    pub(super) fn cost(&self) -> f64 {
        self.0.iter().sum()
    }

    /// Whether they are worse than others also without the [`LEFT_OUT`] that speak most for it.
    pub(super) fn is_worse_in_many_than(&self, other: &Self) -> bool {
        let mut falls = self.falls_to(other);
        falls.sort_by(f64::total_cmp);
        falls.truncate(falls.len().saturating_sub(LEFT_OUT));
        falls.iter().sum::<f64>() > 0.0
    }

    fn falls_to(&self, other: &Self) -> Vec<f64> {
        self.0.iter().zip(&other.0).map(|(a, b)| a - b).collect()
    }

    /// Whether blocks drawn again are worse than others in all but [`DRAWS`].
    pub(super) fn is_surely_worse_than(&self, other: &Self) -> bool {
        let falls = self.falls_to(other);
        if falls.is_empty() {
            return false;
        }
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let drawn = |_: &usize| {
            (0..falls.len()).map(|_| falls[random.random_range(0..falls.len())]).sum::<f64>() <= 0.0
        };
        (0..DRAWS.0).filter(drawn).count() <= DRAWS.1
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// Blocks that fall by so much on average, and by so much more or less.
    fn falling(by: f64, scatter: f64) -> [Blocks; 2] {
        let fall = |block: usize| by + scatter * (TAU * block as f64 * 0.37).sin();
        let without: Vec<f64> = (0..60).map(|block| 400.0 + fall(block)).collect();
        [Blocks(without), Blocks(vec![400.0; 60])]
    }

    #[test]
    fn a_fall_that_few_blocks_make_is_not_sure() {
        // The mean of 60 blocks scatters by 0.09 of this.
        for (by, is_sure) in [(1.0, false), (2.0, false), (6.0, true)] {
            let [without, with] = falling(by, 10.0);
            assert_eq!(without.is_surely_worse_than(&with), is_sure, "{by}");
        }
        let [without, with] = falling(-1.0, 0.0);
        assert!(!without.is_surely_worse_than(&with));
    }

    #[test]
    fn a_fall_at_each_reversal_is_no_chance_event() {
        let with = Blocks(vec![400.0; 45]);
        for (reversals, in_many) in [(4, true), (3, false), (1, false)] {
            let fall = |block: usize| if block < reversals { 1_800.0 } else { -1.0 };
            let without = Blocks((0..45).map(|block| 400.0 + fall(block)).collect());
            assert!(!without.is_surely_worse_than(&with), "too few for draws");
            assert_eq!(without.is_worse_in_many_than(&with), in_many, "{reversals} reversals");
        }
    }
}
