//! Where the zero of a table scale is: the same in all runs, unless somebody set it anew between them.
//!
//! ```text
//!   runs that were recorded one after the other ──► one zero, a coordinate of the base
//!   runs that one zero puts apart               ──► a zero for each, which is no coordinate
//! ```
//!
//! How far motor and table are from each other on average tells of each run which way it was held back: in a run of small reversals that
//! hardly leaves its place more than all its rows do. With a zero for each run that is lost, and with one for runs that have none in
//! common it is wrong.
//! Invariant: the same rows tell the same zeros.

use serde::Serialize;

use super::forward::DEFLECTION;
use super::gates::PLAIN;
use super::linear::{Loss, residuals};
use super::model::Model;
use super::problem::{AxisData, Part, Problem, Residual, SIGNALS};
use super::refit::coarsely;
use super::usual;

/// Runs whose deflections are further apart have no zero in common, m: ten times as far as a drive could push a screw.
const APART_M: f64 = 1e-4;
/// Runs may be so many times as far apart as what encoders hide.
const COUNTS: f64 = 3.0;
/// Share of the rows of a run at either end that say nothing of its middle.
const TENTH: f64 = 0.1;
/// Zeros that are apart are so much of what is left, or it is something else.
const SHARE: f64 = 0.25;

/// Where the zero of a table scale is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Zeros {
    /// The same in all runs.
    OfAll,
    /// Each run has its own.
    OfEachRun,
}

/// The same runs with deflections about zero, which a scale may show millimetres away from; all by the same way but where they have no
/// zero in common.
pub(super) fn about_zero(mut data: Vec<AxisData>) -> (Vec<AxisData>, Zeros) {
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

/// What is left of the deflection of a run, from a zero of its own. Rows in which a slip comes a moment later say little of where that is.
pub(super) fn to_zero(left: &mut [f64], data: &AxisData, part: Part) {
    let (mut sum, mut weights) = (0.0, 0.0);
    for ((value, counts), [noise, bend]) in left.iter().zip(data.rows(part)).zip(data.powers(DEFLECTION)) {
        if *counts {
            let weight = (noise + bend).recip();
            sum += weight * value;
            weights += weight;
        }
    }
    let mean = sum / f64::max(weights, f64::MIN_POSITIVE);
    left.iter_mut().for_each(|value| *value -= mean);
}

impl Problem<'_> {
    /// What of a run changes where the zero of a signal is simulated so much higher.
    pub(super) fn shifted(&self, place: usize, (shifted, by): (usize, f64), part: Part) -> Residual {
        let data = &self.data[place];
        let by = if shifted == DEFLECTION { by } else { by * self.position_step_m };
        self.in_noise(place, part, |signal| {
            let rows = SIGNALS[signal].2(&data.measured).len();
            vec![if signal == shifted { -by } else { 0.0 }; rows]
        })
    }

    /// Whether an effect of the table scale shows no more than encoders hide: a machine begins anywhere within a count, and runs that are
    /// apart by as much show the same.
    pub fn may_be_of_counts(&self, model: &Model) -> bool {
        let is_hidden = |place: usize| {
            let without = model.without(place);
            let (mut sum, mut rows) = (0.0, 0);
            for run in 0..self.data.len() {
                let [with, without] = [model, &without].map(|model| self.simulated(run, model).deflection_m);
                sum += with.iter().zip(&without).map(|(with, without)| (with - without).powi(2)).sum::<f64>();
                rows += with.len();
            }
            sum < rows as f64 * (COUNTS * self.hidden_m).powi(2)
        };
        let is_of_scale = |place: usize| model.effects[place].entry.is_of_table_scale();
        self.zeros() == Zeros::OfAll
            && (0..model.effects.len()).any(|place| is_of_scale(place) && is_hidden(place))
    }

    /// Whether what a model leaves with one zero for all runs is that they have none in common: a zero for each makes up for it, beside that
    /// model or, where one zero has led it astray, beside a base from `start`.
    pub(super) fn zeros_are_apart(&self, start: &Model, model: &Model) -> bool {
        if self.zeros() == Zeros::OfEachRun || !self.has_table() {
            return false;
        }
        let parts = [Part::Fit, Part::Held];
        let rows = parts.map(|part| self.count(part)).iter().sum::<usize>();
        let cost = |problem: &Self, model: &Model| {
            let left = parts.map(|part| residuals(problem, model, part));
            left.iter().flatten().map(|run| Loss::LAST.sum(run)).sum::<f64>()
        };
        let one = cost(self, model);
        if one <= PLAIN * rows as f64 {
            return false;
        }
        let each = self.with_zeros(Zeros::OfEachRun);
        let is_of_zeros = |model: &Model| cost(&each, model) < (1.0 - SHARE) * one;
        is_of_zeros(model) || is_of_zeros(&coarsely(&each, &usual::with(start)).1.model)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
