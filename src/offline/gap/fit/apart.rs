//! Whether the zero of a table scale was set anew between runs that one zero for all puts apart.
//!
//! Invariant: what a model of one zero leaves no more than noise of, has one.

use super::refit::{PLAIN, coarsely};
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::{Loss, residuals};
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::model::usual;
use crate::offline::gap::model::zeros::Zeros;

/// Zeros that are apart are so much of what is left, or it is something else; and so much beside a model that they have led astray.
const SHARE: f64 = 0.25;
const HINT: f64 = 0.02;

impl Problem<'_> {
    /// Whether what a model leaves with one zero for all runs is that they have none in common: a zero for each makes up for it, beside that
    /// model or, where one zero has led it astray, beside a base from `start`.
    pub(in crate::offline::gap) fn zeros_are_apart(&self, start: &Model, model: &Model) -> bool {
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
        let beside = |model: &Model| 1.0 - cost(&each, model) / one;
        let share = beside(model);
        share > SHARE || share > HINT && beside(&coarsely(&each, &usual::with(start)).1.model) > SHARE
    }
}
