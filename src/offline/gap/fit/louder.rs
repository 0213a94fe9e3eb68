//! Noise taken for louder than it is: where a model leaves so much that a bounded loss does not tell which way is down.
//!
//! Invariant: all but one row in a hundred count.

use super::blocks::Blocks;
use super::refit::{ITERATIONS, ended};
use super::{Effort, Fitted, fit, knee};
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::{K, residuals};
use crate::offline::gap::model::problem::Problem;

/// Where the knee of the loss would have to be so many times as far, the search takes noise for louder than it is.
const LOUDER: f64 = 2.0;
/// It goes on while what is left falls to this share of it.
const FALLS: f64 = 0.8;

/// How many times too loud what a model leaves is for the knee of the loss.
fn beyond(problem: &Problem<'_>, model: &Model) -> f64 {
    knee(&residuals(problem, model, Part::Fit)) / K
}

/// Whether a model leaves so much that the bounded loss does not tell which way is down.
pub(super) fn is_much_left(problem: &Problem<'_>, model: &Model) -> bool {
    beyond(problem, model) >= LOUDER
}

/// Where a model ends by noise that is as loud as what it leaves, again and again while that falls: at once by noise as it is, most rows
/// are too far off to lead anywhere.
pub(super) fn led_down(problem: &Problem<'_>, model: &Model) -> Model {
    let mut model = model.clone();
    let mut by = beyond(problem, &model);
    while by >= LOUDER {
        let nearer = ended(&problem.louder(by), &model);
        let left = beyond(problem, &nearer);
        if left > FALLS * by {
            break;
        }
        (model, by) = (nearer, left);
    }
    model
}

/// A search in which noise counts as louder than it is.
pub(in crate::offline::gap) struct Louder<'m> {
    pub(in crate::offline::gap) problem: Problem<'m>,
    pub(in crate::offline::gap) once: Problem<'m>,
    pub(in crate::offline::gap) fitted: Fitted,
    pub(in crate::offline::gap) blocks: Blocks,
    /// Those of the base alone.
    pub(in crate::offline::gap) alone: Blocks,
}

impl<'m> Louder<'m> {
    /// Where a model leaves so much that the bounded loss does not tell which way is down, noise is as loud as makes all but one row
    /// in a hundred count; nothing where there is little of it.
    pub(in crate::offline::gap) fn for_what_is_left(
        problem: &Problem<'m>,
        model: &Model,
        [start, alone]: [&Model; 2],
    ) -> Option<Self> {
        let by = beyond(problem, model);
        if by < LOUDER {
            return None;
        }
        let louder = problem.louder(by);
        let once = louder.first_passes();
        // What was named has been fitted to the bottom, and tells which valley it is.
        let is_base = model.effects.len() == start.effects.len();
        let from = if is_base { &ended(&once, model) } else { model };
        let fitted = fit(&louder, from, Effort::Coarse(ITERATIONS[0]), None);
        let [blocks, alone] = [&fitted.model, alone].map(|model| Blocks::new(&louder, model));
        Some(Self { problem: louder, once, fitted, blocks, alone })
    }
}
