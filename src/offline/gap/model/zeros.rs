//! Where the zero of a table scale is: the same in all runs, unless somebody set it anew between them.
//!
//! ```text
//!   runs that were recorded one after the other ──► one zero, a coordinate of the base, but for what encoders hide
//!   runs that one zero puts apart               ──► a zero for each, which is no coordinate
//! ```
//!
//! How far motor and table are from each other on average tells of each run which way it was held back: in a run of small reversals that
//! hardly leaves its place more than all its rows do. With a zero for each run that is lost, and with one for runs that have none in
//! common it is wrong.
//! Invariant: the same rows tell the same zeros.

use serde::Serialize;

use super::data::AxisData;
use super::linear::K;
use super::problem::Problem;
use crate::offline::median::median;
use crate::offline::product::product;

/// Runs whose deflections are further apart have no zero in common, m: ten times as far as a drive could push a screw.
const APART_M: f64 = 1e-4;
/// The furthest that two encoders are off together, each by half a count, in what both hide as a standard deviation: the root of six.
const FURTHEST: f64 = 2.449_489_742_783_178;
/// Steps from a median to the mean of what is near; every so many rows tell the median.
const STEPS: usize = 3;
const EVERY: usize = 8;
/// Share of the rows of a run at either end that say nothing of its middle.
const TENTH: f64 = 0.1;

/// Where the zero of a table scale is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Zeros {
    /// The same in all runs, as far as encoders tell.
    OfAll,
    /// Each run has its own.
    OfEachRun,
}

/// The same runs with deflections about zero, which a scale may show millimetres away from; all by the same way but where they have no
/// zero in common.
pub(in crate::offline::gap) fn about_zero(mut data: Vec<AxisData>) -> (Vec<AxisData>, Zeros) {
    let shown = || data.iter().map(|data| &data.measured.deflection_m).filter(|shown| !shown.is_empty());
    let middles: Vec<f64> = shown().map(|deflection_m| middle(deflection_m)).collect();
    let [low, high] = [f64::min, f64::max].map(|of| middles.iter().copied().reduce(of).unwrap_or(0.0));
    let zeros = if high - low > APART_M { Zeros::OfEachRun } else { Zeros::OfAll };
    let of_all = middle(&middles);
    for data in &mut data {
        let deflection_m = &mut data.measured.deflection_m;
        let zero = if zeros == Zeros::OfAll { of_all } else { middle(deflection_m) };
        deflection_m.iter_mut().for_each(|value| *value -= zero);
    }
    (data, zeros)
}

/// Half way between what a tenth of the values is below and above; zero of none. A table is held back one way and the other, and the
/// median is on one of these sides.
fn middle(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let [low, high] = [TENTH, 1.0 - TENTH].map(|share| sorted.get((share * sorted.len() as f64) as usize));
    low.zip(high).map_or(0.0, |(low, high)| 0.5 * (low + high))
}

/// Takes off what is left of the deflection of a run where its own zero is, which is no further than `reach_m` from that of all, beside
/// noise of so much rms. Rows have a standard deviation in that, and a weight: those in which a slip comes a moment later say little of
/// where it is.
pub(super) fn to_zero(left: &mut [f64], rows: [&[f64]; 2], [noise_m, reach_m]: [f64; 2]) {
    if let Some(zero_m) = zero(left, rows, K * noise_m) {
        let zero_m = zero_m.clamp(-reach_m, reach_m);
        left.iter_mut().for_each(|value| *value -= zero_m);
    }
}

/// The mean of values by their weights; those that are further off than so many of their deviations count as if they were there.
/// Nothing where none has a weight.
fn zero(values: &[f64], [deviations, weights]: [&[f64]; 2], edge: f64) -> Option<f64> {
    let all: f64 = weights.iter().sum();
    let few = values.iter().zip(weights).filter(|(_, weight)| **weight > 0.0).step_by(EVERY);
    let begun = median(&mut few.map(|(value, _)| *value).collect::<Vec<f64>>())?;
    let mut off = vec![0.0; values.len()];
    let nearer = |zero: f64, _| {
        // No branch, and no row waits for the one before it.
        for ((off, value), deviation) in off.iter_mut().zip(values).zip(deviations) {
            let furthest = edge * deviation;
            *off = (value - zero).min(furthest).max(-furthest);
        }
        zero + product(&off, weights) / all
    };
    Some((0..STEPS).fold(begun, nearer))
}

impl Problem<'_> {
    /// How far the zero of the table scale of a run may be from that of all, m: a machine that is switched on anew begins anywhere within a
    /// count.
    pub(super) fn zero_reach_m(&self) -> f64 {
        match self.zeros() {
            Zeros::OfAll => FURTHEST * self.hidden_m,
            Zeros::OfEachRun => f64::INFINITY,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zero_is_where_most_rows_are_whatever_a_slip_says() {
        // Noise of one, a tenth of the rows a hundred off, a tenth that nobody knows, and as many that do not count.
        let rows = (0..1_100).map(|row| match row % 11 {
            8 => [105.0, 1.0, 1.0],
            9 => [-500.0, 1e3, 1e-6],
            10 => [2e9, 1.0, 0.0],
            even if even % 2 == 0 => [6.0, 1.0, 1.0],
            _ => [4.0, 1.0, 1.0],
        });
        let rows: Vec<[f64; 3]> = rows.collect();
        let [values, deviations, weights] =
            [0, 1, 2].map(|of| rows.iter().map(|row| row[of]).collect::<Vec<f64>>());
        let found = zero(&values, [&deviations, &weights], K).expect("rows");
        assert!((found - 5.0).abs() < 0.6, "{found}");
        assert_eq!(zero(&values, [&deviations, &vec![0.0; 1_100]], K), None);
    }

    #[test]
    fn a_table_that_is_held_back_both_ways_has_its_zero_between_them() {
        // Six of ten rows the one way, a slip, and what nobody believes.
        let rows = (0..1_000).map(|row| if row % 10 < 6 { 7e-6 } else { -7e-6 });
        let rows: Vec<f64> = rows.chain([2e-6; 5]).chain([1.0; 3]).collect();
        assert_eq!(middle(&rows), 0.0);
        assert_eq!(middle(&[3.0]), 3.0);
        assert_eq!(middle(&[]), 0.0);
    }
}
