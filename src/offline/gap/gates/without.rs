//! Whether an effect of a model is needed: what is gained with it is what is lost again without it.
//!
//! Invariant: the model without it is at a bottom of its own.

use std::cell::LazyCell;

use tracing::debug;

use super::candidate;
use super::crossed;
use super::judged;
use super::{FALL, HELD_FALL, bear_out, does_not_show_where_judged, does_not_speak_against, telling};
use crate::offline::gap::fit::blocks::Blocks;
use crate::offline::gap::fit::louder::Louder;
use crate::offline::gap::fit::refit::{PLAINLY, base_refitted, ended, refitted_from};
use crate::offline::gap::fit::{Effort, Fitted, fit, scale};
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::model::{FALLS, Model};

/// What is needed explains so many times as much as ends of the base without it differ by: another of its valleys would do the
/// same.
const ROUGH: f64 = 3.0;

/// What is noise with an effect, and so many times as much without it, needs it however rough its valleys are.
const ALL: f64 = 1.25;

/// Whether a model needs an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::offline::gap) enum Need {
    Shown,
    /// Of all that speaks for it only the rows that judge want it smaller or larger.
    OfAnotherSize,
    None,
}

/// A model without one of its effects, fitted to the bottom from where it stands with it.
pub(in crate::offline::gap) struct Without {
    pub(in crate::offline::gap) fitted: Fitted,
    pub(in crate::offline::gap) blocks: Blocks,
    /// By how much its ends differ.
    rough: f64,
}

impl Without {
    /// `start` is a base that rows in motion led to, `alone` where it was fitted without any effect but for those that nobody names before the end.
    pub(in crate::offline::gap) fn of(
        problem: &Problem<'_>,
        once: &Problem<'_>,
        model: &Fitted,
        place: usize,
        [start, alone]: [&Model; 2],
    ) -> Self {
        let without = model.model.without(place);
        let (fitted, rough) = if without.effects.len() == alone.effects.len() {
            let rows = problem.count(Part::Fit);
            let matters = |base: &Fitted, apart: f64| is_rough(base, model, apart, rows);
            let found = base_refitted(problem, once, [&without, alone], model.total, matters);
            if model.model.effects[place].entry.name == FALLS {
                // What it had of the fall, the base has lost.
                deeper(found, fit(problem, &without.falling_as_filed(), Effort::Fine, None))
            } else {
                found
            }
        } else {
            let here = ended(once, &without);
            let near = fit(problem, &here, Effort::Coarse(0), None);
            let is_plain = near.total > PLAINLY * model.total;
            (if is_plain { near } else { refitted_from(problem, once, here, start) }, 0.0)
        };
        Self { blocks: Blocks::new(problem, &fitted.model), fitted, rough }
    }

    /// Without the last one, and whether it is needed. Where it leaves so much that a bounded loss tells nothing of it, by noise
    /// that is taken for louder; what it leaves may bend its size there, and nowhere else.
    pub(in crate::offline::gap) fn of_last(
        problem: &Problem<'_>,
        once: &Problem<'_>,
        (model, blocks): (&Fitted, &Blocks),
        bases: [&Model; 2],
    ) -> (Self, Need) {
        let last = model.model.effects.len() - 1;
        let Some(louder) = Louder::for_what_is_left(problem, &model.model, bases) else {
            let test = Self::of(problem, once, model, last, bases);
            let is_shown = test.shows_need(problem, model, blocks, last);
            return (test, if is_shown { Need::Shown } else { Need::None });
        };
        let test = Self::of(&louder.problem, &louder.once, &louder.fitted, last, bases);
        let need = test.need(&louder.problem, &louder.fitted, &louder.blocks, last);
        (test.in_terms_of(problem), need)
    }

    /// The same where rows count as in this problem.
    fn in_terms_of(self, problem: &Problem<'_>) -> Self {
        let fitted = fit(problem, &self.fitted.model, Effort::Coarse(0), None);
        Self { blocks: Blocks::new(problem, &fitted.model), fitted, ..self }
    }

    /// Whether it does worse on both parts than the model with the effect, which has the same size on both.
    pub(in crate::offline::gap) fn shows_need(
        &self,
        problem: &Problem<'_>,
        model: &Fitted,
        blocks: &Blocks,
        place: usize,
    ) -> bool {
        self.need(problem, model, blocks, place) == Need::Shown
    }

    fn need(&self, problem: &Problem<'_>, model: &Fitted, blocks: &Blocks, place: usize) -> Need {
        let rows = problem.counts();
        let entry = model.model.effects[place].entry;
        let fall = candidate::fall(self.fitted.total, model, entry.parameters.len(), rows[0]);
        let held_fall = (self.blocks.cost() - blocks.cost()) / scale(blocks.cost(), rows[1]);
        let is_rough = is_rough(&self.fitted, model, self.rough, rows[0]);
        let amplitudes = telling(&model.model, place);
        let judged = LazyCell::new(|| judged::alone(problem, model, &amplitudes));
        // Where a table sticks, a slip that comes at another moment may outweigh in many draws what all other rows want.
        let is_sure = || {
            self.blocks.is_surely_worse_than(blocks)
                || self.blocks.is_worse_in_many_than(blocks)
                || bear_out(&judged)
        };
        let is_worse = held_fall > HELD_FALL && is_sure();
        let are_silent = || crossed::is_silent(&judged);
        let held = [&self.blocks, blocks];
        let is_plain = does_not_show_where_judged(entry, are_silent, &self.fitted, model, held, rows);
        // Linear about the model with it, no other valley has a say.
        let is_foretold = || {
            held_fall > -HELD_FALL
                && !blocks.is_surely_worse_than(&self.blocks)
                && does_not_speak_against(&judged)
                && crossed::foretold(problem, model, &amplitudes, &[]).is_some()
        };
        debug!(law = entry.name, fall, held_fall, self.rough, is_rough, is_plain, judged = ?*judged, "is it needed?");
        if fall <= FALL || !(!is_rough && (is_worse || is_plain) || is_foretold()) {
            return Need::None;
        }
        if judged::is_another(problem, model, &amplitudes, &judged) {
            Need::OfAnotherSize
        } else {
            Need::Shown
        }
    }
}

/// The deeper of two ends, and by how much they differ at least.
fn deeper((found, apart): (Fitted, f64), other: Fitted) -> (Fitted, f64) {
    let apart = apart.max((found.total - other.total).abs());
    (if other.total < found.total { other } else { found }, apart)
}

/// Whether ends of a base differ by so much that another of its valleys may do what a model does that leaves noise of these rows, or
/// more.
fn is_rough(base: &Fitted, model: &Fitted, apart: f64, rows: usize) -> bool {
    let is_all = base.total > ALL * model.total && model.cost < rows as f64;
    !is_all && base.total - model.total <= ROUGH * apart
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;
    use crate::plant::tests::paper_axis;

    #[test]
    fn valleys_of_a_base_may_do_what_explains_little_and_never_what_leaves_nothing() {
        const ROWS: usize = 10_000;
        let fitted = |per_row: f64| Fitted {
            model: Model::new(paper_axis()),
            cost: per_row * ROWS as f64,
            total: per_row * ROWS as f64,
            covariance: DMatrix::identity(1, 1),
        };
        for (without, with, apart_per_row, may) in [
            (1.1, 0.9, 0.05, false),
            (1.1, 0.9, 0.1, true),
            // All that is more than noise.
            (1.6, 0.9, 0.3, false),
            // It leaves much.
            (2.6, 1.9, 0.3, true),
        ] {
            let apart = apart_per_row * ROWS as f64;
            let found = is_rough(&fitted(without), &fitted(with), apart, ROWS);
            assert_eq!(found, may, "{without} and {with} per row, ends {apart_per_row} apart");
        }
    }
}
