//! Where a search stands: what it has named, fitted to the runs as their rows count there.
//!
//! Invariant: model, costs and the rows that they are compared by belong together.

use crate::offline::gap::fit::Fitted;
use crate::offline::gap::fit::blocks::Blocks;
use crate::offline::gap::gates::without::Without;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::problem::Problem;

/// Where a search stands: the runs as their rows count there, and a model fitted to them.
pub(super) struct Stand<'m> {
    pub(in crate::offline::gap) problem: Problem<'m>,
    /// Each command once.
    pub(in crate::offline::gap) once: Problem<'m>,
    pub(in crate::offline::gap) model: Fitted,
    /// What the model costs on the rows that were not fitted.
    pub(in crate::offline::gap) blocks: Blocks,
}

impl<'m> Stand<'m> {
    /// With a model that was fitted to the runs as they are.
    pub(in crate::offline::gap) fn at(problem: Problem<'m>, model: Fitted) -> Self {
        Self { once: problem.first_passes(), blocks: Blocks::new(&problem, &model.model), problem, model }
    }

    /// With another model of the same rows.
    pub(in crate::offline::gap) fn move_to(&mut self, model: Fitted) {
        self.blocks = Blocks::new(&self.problem, &model.model);
        self.model = model;
    }

    /// With the model without one of its effects.
    pub(super) fn go_without(&mut self, Without { fitted, blocks, .. }: Without) {
        (self.model, self.blocks) = (fitted, blocks);
    }
}

/// What a further effect is held against: the base, or the model without all that its effects may explain wrong.
pub(super) fn exact(model: &Model, base: &Model) -> Model {
    let is_exact = |place: &usize| model.effects[*place].entry.is_of_gains();
    let (exact, others): (Vec<usize>, Vec<usize>) =
        (base.effects.len()..model.effects.len()).partition(is_exact);
    if exact.is_empty() { base.clone() } else { model.without_all(&others) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::offline::gap::model::Tried;
    use crate::plant::effects::entry;
    use crate::plant::tests::paper_axis;

    #[test]
    fn a_further_effect_is_held_against_what_may_be_wrong_of_those_before_it() {
        let base = Model::new(paper_axis());
        let of = |names: &[&'static str]| {
            names.iter().fold(base.clone(), |model, name| {
                let entry = entry(name).expect("an effect");
                model.with(Tried { entry, values: entry.nominal() })
            })
        };
        for (named, exact) in [
            (&["servo-gain-mismatch", "presliding"][..], &["servo-gain-mismatch"][..]),
            (&["servo-gain-mismatch"], &["servo-gain-mismatch"]),
            // A filter may be of another order, and a pulse of another shape.
            (&["command-filter"], &[]),
            (&["reversal-compensation", "presliding"], &[]),
            (&[], &[]),
        ] {
            let left = super::exact(&of(named), &base);
            let left: Vec<&str> = left.effects.iter().map(|tried| tried.entry.name).collect();
            assert_eq!(left, exact, "{named:?}");
        }
    }
}
