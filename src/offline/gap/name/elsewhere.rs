//! Where else the last effect of a model may stand, when it has been fitted to the bottom: by other values that change much the same.
//!
//! Invariant: what these begin from leaves about as much as the model does.

use crate::offline::gap::model::{FALLS, Model};

/// The share of where a parabola ends at which a bell has fallen as far.
const AS_FAR: f64 = 0.35;
/// How what changes slowly is over sooner, in shares of its time. Over runs of a minute all that takes ten is alike, and from there the way to a
/// time within the runs bends: a warm-up of 9.6 % in 40 s was one of 69 % in 683 s, for sure.
const TIME: &str = "time-constant-s";
const SOONER: [f64; 2] = [0.25, 0.0625];

impl Model {
    /// The same where friction falls as the file says, and its last effect is the fall that the base had come to, if that is the wider one: each
    /// may stand in the place of the other.
    pub(super) fn with_falls_exchanged(&self) -> Option<Self> {
        let last = self.effects.last().filter(|tried| tried.entry.name == FALLS)?;
        let [extra_n, velocity_mm_per_s, _] = last.values;
        let mut model = self.falling_as_filed();
        let [come_to, filed] = [self, &model].map(|model| model.twin().plant.friction);
        let end_mm_per_s = come_to.fall_end.as_mm_per_s();
        if end_mm_per_s <= velocity_mm_per_s {
            return None;
        }
        let [come_to_n, filed_n] =
            [come_to, filed].map(|friction| (friction.breakaway - friction.sliding).as_n());
        let values = [(come_to_n + extra_n - filed_n).max(extra_n), AS_FAR * end_mm_per_s, 2.0];
        model.effects.last_mut()?.values = values;
        Some(model)
    }

    /// The same with its last effect as fast and over sooner, if it changes slowly.
    pub(super) fn with_last_over_sooner(&self) -> impl Iterator<Item = Self> {
        let last = self.effects.last();
        let time = last.and_then(|last| last.entry.parameters.iter().position(|one| one.key == TIME));
        let sooner = move |share: f64| {
            let place = time?;
            let mut model = self.clone();
            let last = model.effects.last_mut()?;
            last.values[0] *= share;
            last.values[place] *= share;
            let [least, _] = last.entry.parameters[place].bounds;
            (last.values[place] > least).then_some(model)
        };
        SOONER.into_iter().filter_map(sooner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::offline::gap::model::twin::BASE;
    use crate::offline::gap::model::{FALL, Tried};
    use crate::plant::effects::entry;
    use crate::plant::tests::paper_axis;

    #[test]
    fn what_changes_slowly_may_be_over_sooner() {
        let with = |name: &str, values| {
            Model::new(paper_axis()).with(Tried { entry: entry(name).expect("an effect"), values })
        };
        let values = |model: &Model| -> Vec<[f64; 2]> {
            let values = |other: Model| [other.effects[0].values[0], other.effects[0].values[1]];
            model.with_last_over_sooner().map(values).collect()
        };
        assert_eq!(values(&with("friction-warm-up", [60.0, 800.0, 0.0])), [[15.0, 200.0], [3.75, 50.0]]);
        assert_eq!(values(&with("thermal-growth", [8.0, 100.0, 0.0])), [[2.0, 25.0]], "no time is so short");
        assert!(values(&with("backlash", [3.0, 0.0, 0.0])).is_empty());
    }

    #[test]
    fn a_fall_that_the_base_had_come_to_is_the_effect_where_that_is_the_narrower_one() {
        let file = paper_axis();
        let fall = |velocity_mm_per_s: f64| Tried {
            entry: entry(FALLS).expect("an effect"),
            values: [17.0, velocity_mm_per_s, 4.0],
        };
        let mut base = Model::new(file);
        for (base, at) in BASE.iter().zip(&mut base.base) {
            *at = if FALL.contains(&base.name) { 1.5 } else { 0.2 };
        }
        let end_mm_per_s = base.twin().plant.friction.fall_end.as_mm_per_s();
        assert!(base.with(fall(1.1 * end_mm_per_s)).with_falls_exchanged().is_none());
        let narrow = base.with(fall(0.1 * end_mm_per_s));
        let other = narrow.with_falls_exchanged().expect("the base's is the wider one");
        let [extra_n, velocity_mm_per_s, _] = other.effects[0].values;
        assert!((velocity_mm_per_s / end_mm_per_s - AS_FAR).abs() < 1e-9);
        let standing_n = |model: &Model| model.twin().plant.friction.breakaway.as_n();
        let [before_n, after_n] = [standing_n(&narrow) + 17.0, standing_n(&other) + extra_n];
        assert!((after_n - before_n).abs() < 1e-6, "{after_n} N holds it, {before_n} N did");
        assert_eq!(other.twin().plant.friction.fall_end, file.friction.fall_end);
    }
}
