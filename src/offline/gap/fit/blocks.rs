//! How sure it is that a model does better on rows that it has not seen: block by block, whichever of them are drawn.
//!
//! Invariant: the same blocks give the same answer.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::{BLOCK_S, Loss, residuals};
use crate::offline::gap::model::problem::{Problem, Residual, SIGNALS};

/// How often blocks are drawn to see how sure a fall is, and in how many draws at most it may be none: one in a thousand,
/// for there are thirty candidates, and each may be the one that chance favours.
const DRAWS: (usize, usize) = (4_000, 4);
/// What shows in few blocks, as at reversals, is missing in some draws. It is no chance event where as many blocks may be left
/// out.
const LEFT_OUT: usize = 3;

/// Share of the blocks that may be of chance: one slip that comes a moment later, or somebody who leaned on the table.
const OF_CHANCE: f64 = 0.05;

/// Share of a fall that is most of it.
const MOST: f64 = 0.5;

/// Of each signal the cost of some rows, and how much its values tell.
type Block = [(f64, f64); SIGNALS.len()];

/// Cost of the rows that were not fitted, block by block.
#[derive(Clone, Debug)]
pub(in crate::offline::gap) struct Blocks(Vec<Block>);

impl Blocks {
    pub(in crate::offline::gap) fn new(problem: &Problem<'_>, model: &Model) -> Self {
        let length = problem.rows_in(BLOCK_S);
        let signals = problem.signals();
        let of_run = |(place, left): (usize, Residual)| {
            let weights = signals.iter().map(|signal| problem.weights(place, *signal).collect());
            let weights: Vec<Vec<f64>> = weights.collect();
            blocks_of(&left, |signal, row| weights[signal].get(row).copied().unwrap_or(0.0), length)
        };
        let runs = problem.places(Part::Held).into_iter().zip(residuals(problem, model, Part::Held));
        Self(runs.flat_map(of_run).collect())
    }

    /// Of what is left of runs, in blocks of so many rows that each tell as much as one.
    pub(in crate::offline::gap) fn of_residuals(runs: &[Residual], length: usize) -> Self {
        Self(runs.iter().flat_map(|left| blocks_of(left, |_, _| 1.0, length)).collect())
    }

    /// Of known costs of one signal.
    #[cfg(test)]
    pub(in crate::offline::gap) fn of(costs: Vec<f64>) -> Self {
        Self(costs.into_iter().map(|cost| [(cost, 400.0), (0.0, 0.0), (0.0, 0.0)]).collect())
    }

    pub(in crate::offline::gap) fn cost(&self) -> f64 {
        self.0.iter().map(cost_of).sum()
    }

    /// Cost of a signal alone.
    fn of_signal(&self, signal: usize) -> f64 {
        self.0.iter().map(|block| block[signal].0).sum()
    }

    /// Whether a signal costs more than noise, which costs one for each value, whatever chance did in a few of its blocks.
    pub(in crate::offline::gap) fn costs_more_than_noise(&self) -> bool {
        (0..SIGNALS.len()).any(|signal| {
            let excess = |block: &Block| block[signal].0 - block[signal].1;
            let mut excesses: Vec<f64> = self.0.iter().map(excess).collect();
            excesses.sort_by(f64::total_cmp);
            excesses.truncate(excesses.len() - (OF_CHANCE * excesses.len() as f64).ceil() as usize);
            excesses.iter().sum::<f64>() > 0.0
        })
    }

    /// Whether another model costs less by a share of what they cost less than a model `alone`: all signals together, or those that say most
    /// of it each by itself. What one signal showed hundreds of times louder than noise says nothing of what another one shows.
    pub(in crate::offline::gap) fn falls_further(&self, alone: &Self, other: &Self, share: f64) -> bool {
        let fall = self.cost() - other.cost();
        if fall >= share * (alone.cost() - self.cost()) {
            return true;
        }
        let of_signal = |signal: usize| [alone, self, other].map(|blocks| blocks.of_signal(signal));
        is_mostly_further((0..SIGNALS.len()).map(of_signal), share)
    }

    /// Whether they are worse than others also without the [`LEFT_OUT`] that speak most for it.
    pub(in crate::offline::gap) fn is_worse_in_many_than(&self, other: &Self) -> bool {
        let mut falls = self.falls_to(other);
        falls.sort_by(f64::total_cmp);
        falls.truncate(falls.len().saturating_sub(LEFT_OUT));
        falls.iter().sum::<f64>() > 0.0
    }

    fn falls_to(&self, other: &Self) -> Vec<f64> {
        self.0.iter().zip(&other.0).map(|(own, other)| cost_of(own) - cost_of(other)).collect()
    }

    /// Whether blocks drawn again are worse than others in all but [`DRAWS`].
    pub(in crate::offline::gap) fn is_surely_worse_than(&self, other: &Self) -> bool {
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

/// Whether most of what costs fall by last, of three each, is of those that fall by a share of what they fell by before.
pub(in crate::offline::gap) fn is_mostly_further(costs: impl Iterator<Item = [f64; 3]>, share: f64) -> bool {
    let (mut all, mut further) = (0.0, 0.0);
    for [alone, without, with] in costs {
        let fall = without - with;
        all += fall;
        further += if fall >= share * (alone - without).max(0.0) { fall } else { 0.0 };
    }
    further > MOST * all
}

/// What is left of a run in blocks of so many rows, each of which tells so much of a signal; one that does not count is zero.
fn blocks_of(left: &Residual, weight: impl Fn(usize, usize) -> f64, length: usize) -> Vec<Block> {
    let rows = left.iter().map(Vec::len).max().unwrap_or(0);
    let of = |from: usize| {
        let mut block = Block::default();
        for (number, ((cost, told), signal)) in block.iter_mut().zip(left).enumerate() {
            let values = || signal.iter().enumerate().skip(from).take(length);
            *cost = values().map(|(_, value)| Loss::LAST.of(*value)).sum();
            *told = values().filter(|(_, value)| **value != 0.0).map(|(row, _)| weight(number, row)).sum();
        }
        block
    };
    (0..rows).step_by(length).map(of).collect()
}

/// Of all signals of a block.
fn cost_of(block: &Block) -> f64 {
    block.iter().map(|(cost, _)| cost).sum()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn what_one_signal_showed_much_louder_says_nothing_of_what_another_shows() {
        let of = |costs: [f64; 3]| Blocks(vec![costs.map(|cost| (cost, 400.0))]);
        let (alone, with_one) = (of([2_000.0, 90_000.0, 3_500.0]), of([1_800.0, 2_500.0, 3_400.0]));
        for (other, falls) in [
            // Little beside what the deflection told, and all that the current tells.
            ([1_790.0, 2_400.0, 2_000.0], true),
            // What the first effect left where it was named.
            ([1_790.0, 500.0, 3_390.0], false),
            ([1_700.0, 500.0, 3_200.0], false),
            // A twenty-fifth of all of it.
            ([1_000.0, 500.0, 2_500.0], true),
            // Nothing.
            ([1_800.0, 2_500.0, 3_400.0], false),
        ] {
            assert_eq!(with_one.falls_further(&alone, &of(other), 0.04), falls, "{other:?}");
        }
    }

    /// Blocks that fall by so much on average, and by so much more or less.
    fn falling(by: f64, scatter: f64) -> [Blocks; 2] {
        let fall = |block: usize| by + scatter * (TAU * block as f64 * 0.37).sin();
        let without: Vec<f64> = (0..60).map(|block| 400.0 + fall(block)).collect();
        [Blocks::of(without), Blocks::of(vec![400.0; 60])]
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
    fn blocks_cost_more_than_noise_if_all_but_a_few_do() {
        // One in twenty of each.
        for (usual, few, is_more) in [(390.0, 4_000.0, false), (410.0, 400.0, true), (390.0, 380.0, false)] {
            let cost = |block: usize| if block.is_multiple_of(20) { few } else { usual };
            assert_eq!(
                Blocks::of((0..60).map(cost).collect()).costs_more_than_noise(),
                is_more,
                "{usual}, {few}"
            );
        }
        // Where half of them do.
        let half = (0..60_usize).map(|block| if block.is_multiple_of(2) { 500.0 } else { 380.0 });
        assert!(Blocks::of(half.collect()).costs_more_than_noise());
    }

    #[test]
    fn a_fall_at_each_reversal_is_no_chance_event() {
        let with = Blocks::of(vec![400.0; 45]);
        for (reversals, in_many) in [(4, true), (3, false), (1, false)] {
            let fall = |block: usize| if block < reversals { 1_800.0 } else { -1.0 };
            let without = Blocks::of((0..45).map(|block| 400.0 + fall(block)).collect());
            assert!(!without.is_surely_worse_than(&with), "too few for draws");
            assert_eq!(without.is_worse_in_many_than(&with), in_many, "{reversals} reversals");
        }
    }
}
