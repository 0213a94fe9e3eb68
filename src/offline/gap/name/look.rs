//! One look for what a model lacks: a list of what may be missing, the most promising of it fitted to few rows, and those of
//! all rows that are worth it.
//!
//! Invariant: the same rows and the same model find the same.

use std::collections::BTreeSet;

use rayon::prelude::*;
use tracing::debug;

use crate::offline::gap::fit::blocks::Blocks;
use crate::offline::gap::fit::refit::{ITERATIONS, PLAIN, is_noise};
use crate::offline::gap::fit::{self, Effort, Fitted, fit, total_of};
use crate::offline::gap::gates;
use crate::offline::gap::gates::candidate::{self, Candidate};
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::Linear;
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::shortlist::smallest::Smallest;
use crate::offline::gap::shortlist::spectrum::Peaks;
use crate::offline::gap::shortlist::trials::InVain;
use crate::offline::gap::shortlist::{Scored, shortlist};

/// Candidates that are fitted together with the base to the first pass of each command. Those that explain this share of
/// what the best of them explains, and the surest, stay after a few iterations from the best of their starts; in the end those of
/// the second share are fitted to all rows, and the others where none of these passes.
const FITTED: usize = 6;
const SHARES: [f64; 2] = [0.1, 0.6];
/// What leaves so many times as much as another candidate has no prospect beside it; beside one that leaves noise, what plainly leaves more has
/// none.
const HOPELESS: f64 = 20.0;
/// Iterations of a candidate that is fitted to few rows, before it may be dropped.
const FEW: usize = 2;

/// Where it is looked, and for what.
pub(super) struct Look<'s, 'm> {
    /// All rows.
    pub(in crate::offline::gap) search: &'s Problem<'m>,
    /// Each command once.
    pub(in crate::offline::gap) searched: &'s Problem<'m>,
    /// The model that lacks it.
    pub(in crate::offline::gap) at: &'s Fitted,
    /// What that model and the base alone leave of the rows that judge.
    pub(in crate::offline::gap) judged: [&'s Blocks; 2],
}

impl Look<'_, '_> {
    /// The most promising, those that are tried first and the others; and what would have been seen of each effect that was not in vain before.
    pub(in crate::offline::gap) fn promising(
        &self,
        in_vain: &mut InVain,
        progress: &(dyn Fn(&str) + Sync),
    ) -> ([Vec<Model>; 2], Vec<Smallest>) {
        let Self { search, searched, at: Fitted { model, .. }, .. } = self;
        let peaks = Peaks::new(search, model);
        let free = Linear::widest(&searched.holding_force(false), model);
        // What the base may not go further with makes up for no more.
        let held: Vec<usize> = model.at_reach().collect();
        // All passes tell more than the first of each command.
        let passes = search.count(Part::Fit) as f64 / searched.count(Part::Fit).max(1) as f64;
        let peaks = |parameter: &_| peaks.of(parameter);
        let listed = shortlist(searched, &free.holding(&held), &peaks, passes, in_vain);
        progress("fitting what may be missing");
        let force: Vec<usize> = model.constant_force().into_iter().collect();
        (screened(searched, &free.holding(&force), &listed.scored), listed.smallest)
    }

    /// Those fitted to all rows and put to the gates: the others only where none of the first passes.
    pub(in crate::offline::gap) fn tried(
        &self,
        promising: &[Vec<Model>; 2],
        refit: &(dyn Fn(&Model) -> Fitted + Sync),
    ) -> Vec<Candidate> {
        let mut candidates = Vec::new();
        // Of all rows, where anything is to be fitted to them.
        let mut here = None;
        for promising in promising.iter().filter(|promising| !promising.is_empty()) {
            let here = here.get_or_insert_with(|| Linear::widest(self.search, &self.at.model));
            candidates.extend(gates::tried(self.search, here, self.at, self.judged, promising, refit));
            if candidates.iter().any(|candidate: &Candidate| candidate.failed.is_empty()) {
                break;
            }
        }
        candidates
    }
}

/// The most promising of a list, fitted to few rows beside the model that was fitted before, from the best of their
/// starts: those that explain most of it, and those that explain less.
fn screened(once: &Problem<'_>, here: &Linear, listed: &[Scored]) -> [Vec<Model>; 2] {
    if listed.is_empty() {
        return Default::default();
    }
    let rows = once.count(Part::Fit);
    // By these rows alone the base goes further with no effect either.
    let alone = fit::ending(once, &here.model, Effort::Coarse(FEW), Some(here));
    for Scored { starts, gain, sureness, is_sure } in listed {
        debug!(law = starts.first().and_then(gates::last_of), gain, sureness, is_sure, "on the shortlist");
    }
    let explained = |fitted: &Fitted, alone: &Fitted| {
        candidate::fall(alone.total, fitted, fitted.model.numbers() - here.model.numbers(), rows)
    };
    let best = |all: &mut dyn Iterator<Item = &Fitted>, alone: &Fitted| {
        all.map(|one| explained(one, alone)).fold(0.0, f64::max)
    };
    // By each law from the best of its starts.
    let begun = |scored: &Scored| -> Vec<(Fitted, bool)> {
        let left = scored.starts.par_iter().map(|start| (total_of(once, start), start));
        let mut left: Vec<(f64, &Model)> = left.collect();
        left.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut laws = BTreeSet::new();
        left.retain(|(_, start)| laws.insert(gates::last_of(start)));
        left.into_par_iter()
            .map(|(_, start)| fit::ending(once, start, Effort::Coarse(FEW), Some(here)))
            .collect()
    };
    let ended = |(begun, has_ended): (Fitted, bool)| {
        let effort = Effort::Coarse(ITERATIONS[1] - FEW);
        if has_ended { begun } else { fit(once, &begun.model, effort, Some(here)) }
    };
    let tried = listed.par_iter().enumerate().filter(|(place, one)| *place < FITTED || one.is_sure);
    let mut begun: Vec<(Fitted, bool)> = tried.flat_map(|(_, one)| begun(one)).collect();
    // Of what is sure, the law that leaves least.
    let sure = |among: &mut dyn Iterator<Item = &Fitted>| -> Vec<&'static str> {
        let among: Vec<&Fitted> = among.collect();
        let of_effect = |one: &Scored| {
            let is_of = |fitted: &&&Fitted| fitted.model.last_effect() == Some(one.entry().effect());
            let least = among.iter().filter(is_of).min_by(|a, b| a.total.total_cmp(&b.total));
            least.and_then(|fitted| gates::last_of(&fitted.model))
        };
        listed.iter().filter(|one| one.is_sure).filter_map(of_effect).collect()
    };
    let is_of =
        |fitted: &Fitted, laws: &[&str]| gates::last_of(&fitted.model).is_some_and(|law| laws.contains(&law));
    // What is alike is tried from where the other went: where one leads far from the base, the linear estimate of the
    // other may not.
    let alike: Vec<Model> = begun.iter().flat_map(|(one, _)| one.model.with_last_as_alike()).collect();
    let alike = alike.par_iter().map(|one| fit::ending(once, one, Effort::Coarse(FEW), Some(here)));
    deeper_of_laws(&mut begun, alike.collect());
    // So is what shares with an effect that is there already, which moves that one far from where its derivatives are known.
    let shared: Vec<Model> = begun.iter().flat_map(|(one, _)| one.model.with_last_sharing()).collect();
    let shared = shared.par_iter().map(|one| (fit(once, one, Effort::Coarse(ITERATIONS[1]), None), true));
    deeper_of_laws(&mut begun, shared.collect());
    let least = SHARES[0] * best(&mut begun.iter().map(|(one, _)| one), &alone.0);
    let laws = sure(&mut begun.iter().map(|(one, _)| one));
    begun.retain(|(one, _)| explained(one, &alone.0) > least || is_of(one, &laws));
    let (alone, mut ended): (Fitted, Vec<Fitted>) =
        rayon::join(|| ended(alone), || begun.into_par_iter().map(ended).collect());
    let laws = sure(&mut ended.iter());
    ended.retain(|one| explained(one, &alone) > 0.0 || is_of(one, &laws));
    for Fitted { model, total, cost, .. } in &ended {
        debug!(law = gates::last_of(model), total, cost, rows, without = alone.total, "fitted to few rows");
    }
    let least = SHARES[1] * best(&mut ended.iter(), &alone);
    let hopeless = hopeless(once, &ended);
    let (most, less): (Vec<Fitted>, Vec<Fitted>) =
        ended.into_iter().partition(|one| explained(one, &alone) >= least && one.total < hopeless);
    [most, less].map(|all| all.into_iter().map(|fitted| fitted.model).collect())
}

/// What else a law leads to takes the place of what it led to before, if it leaves less.
fn deeper_of_laws(found: &mut Vec<(Fitted, bool)>, others: Vec<(Fitted, bool)>) {
    for other in others {
        let law = |(fitted, _): &(Fitted, bool)| gates::last_of(&fitted.model);
        match found.iter_mut().find(|one| law(one) == law(&other)) {
            Some(one) if one.0.total <= other.0.total => {}
            Some(one) => *one = other,
            None => found.push(other),
        }
    }
}

/// What leaves so much and more has no prospect beside these.
fn hopeless(once: &Problem<'_>, ended: &[Fitted]) -> f64 {
    let deepest = ended.iter().min_by(|a, b| a.total.total_cmp(&b.total));
    deepest.map_or(f64::INFINITY, |one| one.total * if is_noise(once, one) { PLAIN } else { HOPELESS })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::DMatrix;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::base::axis::AxisId;
    use crate::config;
    use crate::offline::gap::measure::forward::Signals;
    use crate::offline::gap::model::Tried;
    use crate::offline::gap::model::sensors::tests::{showing, swinging};
    use crate::offline::gap::model::usual;
    use crate::plant::effects::{Values, entry};

    #[test]
    fn an_effect_that_is_far_from_straight_is_begun_a_part_of_its_way() {
        let machine = config::load("paper").expect("a machine");
        let file = usual::with(&Model::new(machine.axes[AxisId::X].plant));
        let entry = entry("torque-saturation").expect("an effect");
        let truth = file.with(Tried { entry, values: [6.0, 0.0, 0.0] });
        let problem = showing(&swinging(&machine, 5e-3), &truth);
        let here = Linear::widest(&problem, &file);
        let listed = shortlist(&problem, &here, &|_| Vec::new(), 1.0, &mut InVain::default());
        let [best, _] = screened(&problem, &here, &listed.scored);
        let found = best[0].effects.last().expect("an effect");
        assert_eq!(found.entry.name, entry.name);
        assert!((found.values[0] - 6.0).abs() < 0.01, "{} %/A", found.values[0]);
    }

    #[test]
    fn what_the_base_alone_gains_of_few_rows_makes_nothing_promising() {
        let machine = config::load("paper").expect("a machine");
        let file = usual::with(&Model::new(machine.axes[AxisId::X].plant));
        let mut heavier = file.coordinates();
        heavier[0] += 0.1;
        let problem = showing(&swinging(&machine, 5e-3), &file.at(&heavier));
        let entry = entry("motor-cogging").expect("an effect");
        let cogging = file.with(Tried { entry, values: entry.nominal() });
        let sure = Scored { starts: vec![cogging], gain: 100.0, sureness: 50.0, is_sure: true };
        let [most, less] = screened(&problem, &Linear::widest(&problem, &file), &[sure]);
        assert_eq!([most.len(), less.len()], [0, 1], "it is sure, and explains nothing");
    }

    #[test]
    fn beside_what_leaves_noise_what_plainly_leaves_more_is_hopeless() {
        let machine = config::load("paper").expect("a machine");
        let problem = showing(&swinging(&machine, 5e-3), &Model::new(machine.axes[AxisId::X].plant));
        let rows = problem.count(Part::Fit) as f64;
        let hopeless = |per_row: f64| {
            let left = |total: f64| Fitted {
                model: Model::new(machine.axes[AxisId::X].plant),
                cost: total,
                total,
                covariance: DMatrix::zeros(0, 0),
            };
            hopeless(&problem, &[left(2.0 * per_row * rows), left(per_row * rows)]) / (per_row * rows)
        };
        assert!((hopeless(0.9) - PLAIN).abs() < 1e-9 && (hopeless(1.2) - HOPELESS).abs() < 1e-9);
    }

    #[test]
    fn an_effect_is_begun_by_each_of_its_laws() {
        let machine = config::load("paper").expect("a machine");
        let file = usual::with(&Model::new(machine.axes[AxisId::X].plant));
        let with = |name: &str, amplitude: f64| {
            file.with(Tried { entry: entry(name).expect("an effect"), values: [amplitude, 47.0, 0.0] })
        };
        let [motor, push] = ["torque-disturbance", "torque-disturbance-push"];
        let problem = showing(&swinging(&machine, 5e-3), &with(push, 300.0));
        let here = Linear::widest(&problem, &file);
        let starts = vec![with(motor, 0.45), with(push, 30.0)];
        let [by_motor, by_push] = [0, 1].map(|start: usize| total_of(&problem, &starts[start]));
        assert!(by_motor < by_push, "the wrong law leaves less: {by_motor} and {by_push}");
        let scored = Scored { starts, gain: 200.0, sureness: 60.0, is_sure: false };
        let [most, _] = screened(&problem, &here, &[scored]);
        let found = most.iter().map(|model| model.effects.last().expect("an effect"));
        let found: Vec<_> = found.filter(|tried| tried.entry.name == push).collect();
        assert_eq!(found.len(), 1, "{most:?}");
        assert!((found[0].values[0] / 300.0 - 1.0).abs() < 1e-3, "{:?}", found[0].values);
    }

    #[test]
    fn what_stood_for_two_effects_shares_with_the_second() {
        let machine = config::load("paper").expect("a machine");
        let file = usual::with(&Model::new(machine.axes[AxisId::X].plant));
        let with = |model: &Model, name: &str, values: Values| {
            model.with(Tried { entry: entry(name).expect("an effect"), values })
        };
        let both = |play_um: f64, zone: Values| {
            with(&with(&file, "backlash", [play_um, 0.0, 0.0]), "soft-zone", zone)
        };
        let problem = showing(&swinging(&machine, 5e-3), &both(4.0, [70.0, 2.0, 0.0]));
        let play = fit(&problem, &with(&file, "backlash", [6.5, 0.0, 0.0]), Effort::Fine, None);
        let here = Linear::widest(&problem, &play.model);
        let starts = vec![with(&play.model, "soft-zone", [30.0, 0.5, 0.0])];
        let scored = Scored { starts, gain: 200.0, sureness: 60.0, is_sure: false };
        let [most, _] = screened(&problem, &here, &[scored]);
        let found: Vec<Values> = most[0].effects.iter().map(|one| one.values).collect();
        assert!((found[2][0] - 4.0).abs() < 0.2 && (found[3][1] - 2.0).abs() < 0.2, "{found:?}");
    }

    #[test]
    fn the_surest_is_kept_by_the_law_that_leaves_least() {
        let machine = config::load("paper").expect("a machine");
        let file = usual::with(&Model::new(machine.axes[AxisId::X].plant));
        let with =
            |name: &str, values: Values| file.with(Tried { entry: entry(name).expect("an effect"), values });
        // What is left is noise.
        let silent = showing(&swinging(&machine, 5e-3), &file);
        let mut data = silent.data[0].clone();
        let mut random = Pcg64Mcg::seed_from_u64(4);
        let Signals { following_error_m, deflection_m, current_a } = &mut data.measured;
        for (signal, loud) in [(following_error_m, 1e-7), (deflection_m, 1e-7), (current_a, 0.05)] {
            for value in signal {
                let by: f64 = StandardNormal.sample(&mut random);
                *value += loud * by;
            }
        }
        let problem = silent.with_data(Arc::new(vec![data]));
        let here = Linear::widest(&problem, &file);
        let kept = |starts: &[Model], is_sure: bool| -> usize {
            let scored = Scored { starts: starts.to_vec(), gain: 200.0, sureness: 60.0, is_sure };
            screened(&problem, &here, &[scored]).concat().len()
        };
        let swings = [("torque-disturbance", 0.5), ("torque-disturbance-push", 0.1)]
            .map(|(name, amplitude)| with(name, [amplitude, 47.0, 0.0]));
        assert_eq!([false, true].map(|is_sure| kept(&swings, is_sure)), [0, 1], "it explains nothing");
    }
}
