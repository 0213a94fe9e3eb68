//! An effect that was fitted together with the base, and what was against it.
//!
//! Invariant: what passed every gate has a name, and what failed one says which.

use std::collections::BTreeSet;

use super::Gate;
use crate::offline::gap::fit::{Fitted, scale};
use crate::offline::gap::model::usual::is_usual;
use crate::offline::gap::model::{Model, Tried};

/// What brings so much, in units of one row's variance, is there, if rows that judge do not deny it: its size alone is unsure.
const PLAIN: f64 = 2_000.0;

/// A candidate that was fitted.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Base and effects with it.
    pub fitted: Fitted,
    /// Cost on the rows that were not fitted.
    pub held: f64,
    /// By how much it is better than the model without it, both parts, in units of one row's variance.
    pub evidence: f64,
    /// The gates it did not pass.
    pub failed: Vec<Gate>,
}

impl Candidate {
    /// The effect that it adds.
    fn added(&self) -> Option<&Tried> {
        self.fitted.model.effects.last()
    }

    /// Name of that effect, whichever law of it.
    pub fn name(&self) -> &'static str {
        self.added().map_or("", |tried| tried.entry.effect())
    }

    /// Whether nearly every axis has that effect.
    pub(in crate::offline::gap) fn is_usual(&self) -> bool {
        self.added().is_some_and(|tried| is_usual(tried.entry))
    }

    /// Whether the scale at the table alone shows it.
    pub(in crate::offline::gap) fn is_of_table_scale(&self) -> bool {
        self.added().is_some_and(|tried| tried.entry.is_of_table_scale())
    }

    /// Keys and values of that effect.
    pub fn values(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let keyed = |tried: &Tried| tried.entry.parameters.iter().map(|one| one.key).zip(tried.values);
        self.added().into_iter().flat_map(keyed)
    }

    /// Whether it explains what there is, and only its values are not what such an effect has, or some run speaks against it: what a
    /// table does that sticks may speak against anything.
    pub fn is_doubtful(&self) -> bool {
        let is_doubt = |gate: &Gate| gate.is_of_values() || matches!(gate, Gate::Amplitude | Gate::Runs);
        !self.failed.is_empty() && self.failed.iter().all(is_doubt)
    }

    /// Whether it is at a bound beyond which it is that other one.
    pub fn is_on_its_way_to(&self, other: &Self) -> bool {
        let is_other =
            |model: Model| model.effects.last().is_some_and(|tried| tried.entry.effect() == other.name());
        self.failed.contains(&Gate::Bounds) && self.fitted.model.with_last_as_alike().any(is_other)
    }

    /// Whether it shows that something is missing, and not what: it explains it with values that no such effect has, or
    /// leaves much of it. How much of it there is need not be sure where that explains much.
    pub fn shows_something(&self) -> bool {
        let shows = |gate: &Gate| gate.is_of_values() || *gate == Gate::Explains;
        let may_be_unsure = |gate: &Gate| *gate == Gate::Amplitude && self.evidence > PLAIN;
        self.failed.iter().any(shows) && self.failed.iter().all(|gate| shows(gate) || may_be_unsure(gate))
    }
}

/// By how much a cost falls with a model of so many numbers more, in units of one row's variance, less what these explain by chance.
pub(in crate::offline::gap) fn fall(without: f64, with: &Fitted, numbers: usize, rows: usize) -> f64 {
    (without - with.total) / scale(with.cost, rows) - numbers as f64 * (rows.max(1) as f64).ln()
}

/// Of the laws that each effect may follow the one that is best for what its numbers cost; what falls furthest first.
pub(super) fn best_laws(without: f64, mut all: Vec<Fitted>, rows: usize) -> Vec<Fitted> {
    let fall = |one: &Fitted| fall(without, one, one.model.numbers(), rows);
    all.sort_by(|a, b| fall(b).total_cmp(&fall(a)));
    let mut seen = BTreeSet::new();
    all.retain(|fitted| seen.insert(fitted.model.last_effect()));
    all
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;
    use crate::plant::effects::entry;
    use crate::plant::tests::paper_axis;

    #[test]
    fn odd_values_show_that_something_is_missing_where_rows_that_judge_want_them() {
        let model = Model::new(paper_axis());
        let fitted = Fitted { model, cost: 0.0, total: 0.0, covariance: DMatrix::identity(1, 1) };
        for (failed, evidence, shows, is_doubtful) in [
            (&[Gate::Bounds][..], 100.0, true, true),
            (&[Gate::Whole, Gate::Explains], 100.0, true, false),
            (&[Gate::Whole, Gate::Amplitude], 100.0, false, true),
            (&[Gate::Bounds, Gate::Amplitude], 7_000.0, true, true),
            (&[Gate::Amplitude], 7_000.0, false, true),
            (&[Gate::Runs], 100.0, false, true),
            (&[Gate::Bounds, Gate::Judged], 7_000.0, false, false),
        ] {
            let candidate =
                Candidate { fitted: fitted.clone(), held: 0.0, evidence, failed: failed.to_vec() };
            assert_eq!(candidate.shows_something(), shows, "{failed:?}, {evidence}");
            assert_eq!(candidate.is_doubtful(), is_doubtful, "{failed:?}");
        }
    }

    #[test]
    fn a_law_of_more_numbers_must_be_worth_them() {
        const ROWS: usize = 1_000;
        let left = |law: &str, total: f64| {
            let tried = Tried { entry: entry(law).expect("an effect"), values: [5.0, 30.0, 0.0] };
            let model = Model::new(paper_axis()).with(tried);
            Fitted { model, cost: total, total, covariance: DMatrix::identity(1, 1) }
        };
        let [slope, wave, other] =
            ["position-dependent-friction", "position-dependent-friction-wave", "motor-cogging"];
        // Two numbers more cost fourteen rows.
        for (by_wave, wanted) in [(995.0, [slope, other]), (960.0, [wave, other])] {
            let all = vec![left(slope, 1_000.0), left(wave, by_wave), left(other, 1_100.0)];
            let best = best_laws(2_000.0, all, ROWS);
            let best: Vec<_> =
                best.iter().filter_map(|one| Some(one.model.effects.last()?.entry.name)).collect();
            assert_eq!(best, wanted, "{by_wave}");
        }
    }
}
