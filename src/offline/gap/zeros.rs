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
use crate::offline::median::median;

/// Runs whose deflections are further apart have no zero in common, m: ten times as far as a drive could push a screw.
const APART_M: f64 = 1e-4;
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

/// The median; zero of none.
fn middle(values: &[f64]) -> f64 {
    median(&mut values.to_vec()).unwrap_or(0.0)
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
