//! What lies near the best explanation, and what of it the rows tell apart after all.
//!
//! Invariant: the best is the deepest, and effects that no data of this kind tell apart stay together.

use std::cell::OnceCell;
use std::collections::BTreeSet;

use rayon::prelude::*;
use tracing::debug;

use super::named::{NamedEffect, RunnerUp, is_alias};
use crate::offline::gap::fit::blocks::Blocks;
use crate::offline::gap::fit::refit::PLAIN;
use crate::offline::gap::fit::{Fitted, scale, to_the_bottom};
use crate::offline::gap::gates::candidate::Candidate;
use crate::offline::gap::gates::last_of;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::problem::Problem;

/// Candidates whose evidence is nearer than this, or than this share, cannot be told apart.
const NEAR: (f64, f64) = (20.0, 0.02);
/// The same share where coarse fits tell little: all of these are fitted to the bottom.
const ROUGHLY: f64 = 0.15;
/// What an effect must explain of what is left beyond noise to come before the one that it is with a number less: where that is much, in small
/// reversals without a table scale, it may be what bends a soft zone out of a play.
const FURTHER: f64 = 0.2;

/// By how much less a base may be believed, as twice the logarithm of its probability, than that of another explanation: files are off by a
/// factor of two once in a while.
const BELIEVED: f64 = 9.0;

/// How far behind a candidate with this evidence others are not told from it.
pub(super) fn margin(evidence: f64) -> f64 {
    NEAR.0.max(NEAR.1 * evidence)
}

/// Whether a candidate explains the fitted rows as well as the best: it may be behind where it judges for not standing at its bottom yet.
fn explains_as_much(candidate: &Candidate, best: &Candidate, rows: usize) -> bool {
    candidate.fitted.total < best.fitted.total + margin(best.evidence) * scale(best.fitted.cost, rows)
}

/// Whether a candidate explains so nearly as much that bottoms must tell. Louder noise tells little of which explains most; what nearly every
/// axis has is as likely as what scales all of the base; and what a scale alone shows moves no table that sticks, so that few steps
/// fit it where they fit no other.
fn explains_roughly_as_much(candidate: &Candidate, best: &Candidate, is_louder: bool) -> bool {
    let is_rough = is_louder || candidate.is_usual() || best.is_of_table_scale();
    is_rough && candidate.evidence > (1.0 - ROUGHLY) * best.evidence
}

/// By how much an explanation must be better than the one that it is with a number less, where the best costs so much.
fn price_of_a_number(cost: f64, rows: usize) -> f64 {
    FURTHER * (rows as f64 * (1.0 - scale(cost, rows).recip())).max(0.0)
}

/// Whether the last effect of a model is that of another with a number less.
fn is_with_less(model: &Model, other: &Model) -> bool {
    let mut with_less = other.with_last_as_alike().filter(|less| less.numbers() < other.numbers());
    with_less.any(|less| last_of(&less) == last_of(model))
}

/// What passed every gate, with what is near the best of it.
pub(super) struct Passed {
    /// The best first.
    pub(super) near: Vec<Candidate>,
    /// The others, the better ones first.
    pub(super) rest: Vec<Candidate>,
    /// What has more evidence is near by that alone.
    pub(super) least: f64,
}

impl Passed {
    /// Of candidates, the best first, that were fitted to so many rows, with noise as it is or as loud as what is left.
    pub(super) fn of(passed: Vec<Candidate>, rows: usize, is_louder: bool) -> Self {
        let best = passed[0].clone();
        let least = best.evidence - margin(best.evidence);
        let doubted = best.evidence - price_of_a_number(best.fitted.cost, rows);
        let numbers = |candidate: &Candidate| candidate.fitted.model.numbers();
        let (near, rest) = passed.into_iter().partition(|candidate| {
            let is_as_good = candidate.evidence > least || explains_as_much(candidate, &best, rows);
            // What says no more with more numbers is no other explanation.
            let is_near = is_as_good && numbers(candidate) <= numbers(&best);
            let is_less =
                candidate.evidence > doubted && is_with_less(&candidate.fitted.model, &best.fitted.model);
            let is_roughly = explains_roughly_as_much(candidate, &best, is_louder);
            is_near || is_less || is_roughly || is_alias(best.name(), candidate.name())
        });
        Self { near, rest, least }
    }
}

/// A class with how probable each member is. Tempered: what is near a tie is to be told as one, and what no data tell from the best is as
/// probable as that, wherever its fit ended.
pub(in crate::offline::gap) fn weighed(class: Vec<Candidate>, margin: f64) -> Vec<(Candidate, f64)> {
    let (best, name) = (class[0].evidence, class[0].name());
    let behind =
        |one: &Candidate| if is_alias(name, one.name()) { 0.0 } else { (best - one.evidence).max(0.0) };
    let weights: Vec<f64> = class.iter().map(|one| (-0.5 * behind(one) / margin).exp()).collect();
    let all: f64 = weights.iter().sum();
    class.into_iter().zip(weights.iter().map(|weight| weight / all)).collect()
}

/// Bottoms held against the best of them.
struct Beside<'h> {
    best: &'h Fitted,
    /// What it leaves per row.
    scale: f64,
    rows: usize,
    /// How far behind it others are not told from it.
    margin: f64,
    /// What a model leaves of the rows that judge.
    held: &'h dyn Fn(&Fitted) -> f64,
    /// What the best leaves of them.
    judged: OnceCell<f64>,
}

impl<'h> Beside<'h> {
    /// Of a best that leaves so much less than a model without its effect.
    fn of(best: &'h Fitted, lost: f64, rows: usize, held: &'h dyn Fn(&Fitted) -> f64) -> Self {
        let scale = scale(best.cost, rows);
        Self { best, scale, rows, margin: margin(lost / scale), held, judged: OnceCell::new() }
    }

    /// By how much a bottom is behind on the fitted rows.
    fn behind(&self, end: &Fitted) -> f64 {
        price(end, self.scale, self.rows) - price(self.best, self.scale, self.rows)
    }

    /// Whether that is more than chance makes of what no data tell apart.
    fn is_behind(&self, end: &Fitted) -> bool {
        self.behind(end) > self.margin
    }

    /// Whether it is none: its base is further from the file than what explains as much with one nearer to it, as when a larger mass and
    /// twice the viscous friction make friction that goes with the load out of more of the latter.
    fn is_made_up(&self, end: &Fitted) -> bool {
        let of_base = |fitted: &Fitted| fitted.model.base.iter().map(|at| at * at).sum::<f64>();
        self.behind(end) > 0.0 && of_base(end) > of_base(self.best) + BELIEVED
    }

    /// Whether it is behind on the rows that judge, too.
    fn is_behind_where_judged(&self, end: &Fitted) -> bool {
        (self.held)(end) > self.judged() + self.margin * self.scale
    }

    /// Whether the rows that judge know it better.
    fn is_ahead_where_judged(&self, end: &Fitted) -> bool {
        (self.held)(end) < self.judged()
    }

    fn judged(&self) -> f64 {
        *self.judged.get_or_init(|| (self.held)(self.best))
    }
}

/// What a model leaves of the fitted rows, and what its numbers cost, where the best leaves so much per row.
fn price(end: &Fitted, scale: f64, rows: usize) -> f64 {
    end.total / scale + end.model.numbers() as f64 * (rows.max(1) as f64).ln()
}

/// Whether the last effect of a model has a whole number to a turn.
fn is_whole(end: &Fitted) -> bool {
    end.model.effects.last().is_some_and(|tried| tried.entry.parameters.iter().any(|one| one.is_whole))
}

/// A candidate, and where its fit ended.
type Bottom = (Candidate, Fitted);

/// Whether the last effect of a model stands at one of its bounds.
fn is_at_bound(end: &Fitted) -> bool {
    end.is_at_bound(end.model.effects.len() - 1)
}

/// Puts the best explanation first, each effect once: what costs the least by rows and numbers, unless there is one that is to be preferred where
/// fitted rows hardly tell. `without` is the model without any of them, `held` what one leaves of the rows that judge.
fn in_order(ends: &mut Vec<Bottom>, without: &Fitted, rows: usize, held: &dyn Fn(&Fitted) -> f64) {
    let deepest = ends.iter().min_by(|a, b| a.1.total.total_cmp(&b.1.total)).expect("an end");
    let scale = scale(deepest.1.cost, rows);
    let price = |end: &Fitted| price(end, scale, rows);
    ends.sort_by(|a, b| price(&a.1).total_cmp(&price(&b.1)));
    // Of those that began elsewhere the best.
    let mut seen = BTreeSet::new();
    ends.retain(|(candidate, _)| seen.insert(candidate.name()));
    let doubted = price(&ends[0].1) + price_of_a_number(ends[0].1.cost, rows);
    let is_doubted =
        |(_, less): &Bottom| is_with_less(&less.model, &ends[0].1.model) && price(less) < doubted;
    if let Some(less) = ends.iter().position(is_doubted) {
        ends[..=less].rotate_right(1);
    }
    // At its bound it is on its way to what explains most of it as well.
    let gained = |end: &Fitted| without.total - end.total;
    let is_beyond = |(_, end): &Bottom| {
        let mut alike = ends[0].1.model.with_last_as_alike();
        !is_at_bound(end)
            && gained(end) > (1.0 - ROUGHLY) * gained(&ends[0].1)
            && alike.any(|other| other.last_effect() == end.model.last_effect())
    };
    let beyond = if is_at_bound(&ends[0].1) { ends.iter().position(is_beyond) } else { None };
    if let Some(other) = beyond {
        ends[..=other].rotate_right(1);
    }
    // What rows that judge know better with fewer numbers, and fitted rows do not tell from the best, comes first.
    let beside = Beside::of(&ends[0].1, without.total - ends[0].1.total, rows, held);
    let is_simpler = |(_, end): &Bottom| {
        end.model.numbers() < ends[0].1.model.numbers()
            && !beside.is_behind(end)
            && beside.is_ahead_where_judged(end)
    };
    // Few waves along the way are as long as a turn of the screw by chance.
    let is_of_turn = |(_, end): &Bottom| is_whole(end) && !is_whole(&ends[0].1) && beside.behind(end) < 1.0;
    let first = ends.iter().position(is_simpler).or_else(|| ends.iter().position(is_of_turn));
    if let Some(first) = first {
        ends[..=first].rotate_right(1);
    }
}

/// Candidates that explain nearly as much as the best, at their bottoms.
pub(super) struct Near {
    /// The best first.
    pub(in crate::offline::gap) class: Vec<Candidate>,
    /// The best.
    pub(in crate::offline::gap) model: Fitted,
    /// The next that their bottoms tell from it.
    pub(super) told_apart: Option<RunnerUp>,
}

impl Near {
    /// Fits each to the bottom: a coarse fit, and a search where noise is louder than it is, may not tell what rows do. Those with
    /// `least` evidence and less are only near in such a search, or by the fitted rows; `held` is what a model leaves of those that judge.
    pub(in crate::offline::gap) fn of(
        (near, least): (Vec<Candidate>, f64),
        to_the_bottom: &(dyn Fn(&Candidate) -> Fitted + Sync),
        held: &dyn Fn(&Fitted) -> f64,
        without: &Fitted,
        rows: usize,
    ) -> Self {
        let ends: Vec<Fitted> = near.par_iter().map(to_the_bottom).collect();
        let mut ends: Vec<Bottom> = near.into_iter().zip(ends).collect();
        for (candidate, end) in &ends {
            debug!(
                name = candidate.name(),
                gained = without.total - end.total,
                held = held(end),
                "at its bottom"
            );
        }
        in_order(&mut ends, without, rows, held);
        let (best, model) = (ends[0].0.name(), ends[0].1.clone());
        let beside = Beside::of(&model, without.total - model.total, rows, held);
        // What no data tell apart ends elsewhere by chance, and so does by a little what was near before, unless rows that judge say so
        // too.
        let is_apart = |(candidate, end): &Bottom| {
            // More numbers that say no more are no other explanation.
            let has_more = end.model.numbers() > model.model.numbers();
            let was_far = candidate.evidence <= least || end.cost > PLAIN * model.cost;
            let is_behind = if has_more {
                beside.behind(end) >= 0.0
            } else {
                beside.is_behind(end) && (was_far || beside.is_behind_where_judged(end))
            };
            !is_alias(best, candidate.name()) && (is_behind || beside.is_made_up(end))
        };
        let (apart, ends): (Vec<_>, Vec<_>) = ends.into_iter().partition(is_apart);
        // What it is with a number less explains no less than it by that.
        let is_as_good = |end: &Fitted| {
            is_with_less(&model.model, &end.model)
                && !is_at_bound(end)
                && end.total < model.total + NEAR.0 * beside.scale
        };
        let next = apart.iter().find(|(_, end)| is_as_good(end)).or(apart.first());
        let told_apart = next.map(|(candidate, end)| RunnerUp {
            name: candidate.name(),
            behind: beside.behind(end),
            failed: Vec::new(),
            is_as_good: is_as_good(end),
        });
        let at_its_bottom = |(candidate, fitted)| Candidate { fitted, ..candidate };
        Self { class: ends.into_iter().map(at_its_bottom).collect(), told_apart, model }
    }
}

impl NamedEffect {
    /// Where rows count about a model with it, which loses so much without it: what is behind there at its bottom, by the fitted rows and
    /// by those that judge, is told apart.
    pub(super) fn tell_apart(&mut self, problem: &Problem<'_>, model: &Fitted, lost: f64) {
        let held = |fitted: &Fitted| Blocks::new(problem, &fitted.model).cost();
        let beside = Beside::of(model, lost, problem.count(Part::Fit), &held);
        let (name, mut apart) = (self.name, None);
        self.class.retain(|(candidate, _)| {
            let other = candidate.name();
            if other == name || is_alias(name, other) {
                return true;
            }
            let end = to_the_bottom(problem, &candidate.fitted);
            let is_behind = beside.is_behind(&end) && beside.is_behind_where_judged(&end);
            let is_apart = is_behind || beside.is_made_up(&end);
            if is_apart {
                let behind = beside.behind(&end);
                apart.get_or_insert(RunnerUp { name: other, behind, failed: Vec::new(), is_as_good: false });
            }
            !is_apart
        });
        self.runner_up = apart.or(self.runner_up.take());
        let all: f64 = self.class.iter().map(|(_, weight)| weight).sum();
        self.class.iter_mut().for_each(|(_, weight)| *weight /= all);
    }
}

#[cfg(test)]
pub(in crate::offline::gap) mod tests {
    use std::sync::Arc;

    use nalgebra::DMatrix;

    use super::*;
    use crate::base::axis::AxisId;
    use crate::config;
    use crate::offline::gap::fit::{Effort, fit, total_of};
    use crate::offline::gap::model::Tried;
    use crate::offline::gap::model::sensors::tests::swinging;
    use crate::plant::effects::entry;
    use crate::plant::tests::paper_axis;

    /// A candidate that explains all of it but so much, with an effect.
    pub(in crate::offline::gap::name) fn candidate(name: &str, left: f64) -> Candidate {
        let tried = Tried { entry: entry(name).expect("an effect"), values: [1.0, 20.0, 0.0] };
        let model = Model::new(paper_axis()).with(tried);
        let count = model.coordinate_count();
        let covariance = DMatrix::identity(count, count) * 1e-6;
        let fitted = Fitted { model, cost: left, total: left, covariance };
        Candidate { fitted, held: 0.0, evidence: 90_000.0 - left, failed: Vec::new() }
    }

    #[test]
    fn of_an_effect_that_began_from_two_places_the_deeper_is_left() {
        let near = [("backlash", 1_200.0), ("soft-zone", 1_000.0), ("backlash", 1_005.0)];
        let near: Vec<Candidate> = near.iter().map(|(name, left)| candidate(name, *left)).collect();
        let without = candidate("backlash", 90_000.0).fitted;
        let own = |candidate: &Candidate| candidate.fitted.clone();
        let found = Near::of((near, 0.0), &own, &|fitted| fitted.total, &without, 1_000);
        let class: Vec<(&str, f64)> = found.class.iter().map(|one| (one.name(), one.fitted.total)).collect();
        assert_eq!(class, [("backlash", 1_005.0)], "and a number more is worth more than five units");
        let next = found.told_apart.expect("a runner-up");
        assert!(next.name == "soft-zone" && next.is_as_good, "{next:?}");
    }

    #[test]
    fn what_is_on_its_way_to_another_comes_after_it() {
        let without = candidate("backlash", 90_000.0).fitted;
        let class = |softness: f64, left: f64| -> Vec<&str> {
            let mut near = vec![candidate("soft-zone", 1_000.0), candidate("backlash", left)];
            near[0].fitted.model.effects[0].values[0] = softness;
            let own = |candidate: &Candidate| candidate.fitted.clone();
            let found = Near::of((near, 0.0), &own, &|fitted| fitted.total, &without, 1_000);
            found.class.iter().map(Candidate::name).collect()
        };
        assert_eq!(class(60.0, 1_200.0), ["soft-zone", "backlash"]);
        assert_eq!(class(84.95, 1_200.0), ["backlash", "soft-zone"]);
        assert_eq!(class(84.95, 20_000.0), ["soft-zone"], "it leaves much more");
    }

    #[test]
    fn of_two_that_fitted_rows_do_not_tell_apart_the_simpler_is_first_if_rows_that_judge_know_it_better() {
        let without = Fitted { total: 100_000.0, ..candidate("scale-error", 100_000.0).fitted };
        let first = |left: f64, held: [f64; 2]| -> &str {
            let near = vec![candidate("pitch-error", left), candidate("scale-error", 10_000.0)];
            let ends = |candidate: &Candidate| candidate.fitted.clone();
            let held = |end: &Fitted| held[usize::from(last_of(&end.model) == Some("scale-error"))];
            Near::of((near, 0.0), &ends, &held, &without, 10_000).class[0].name()
        };
        assert_eq!(first(9_500.0, [2_010.0, 2_000.0]), "scale-error");
        assert_eq!(first(9_500.0, [2_000.0, 2_010.0]), "pitch-error");
        assert_eq!(first(7_000.0, [2_010.0, 2_000.0]), "pitch-error", "fitted rows tell them apart");
    }

    #[test]
    fn a_wave_as_long_as_a_turn_is_of_the_screw() {
        let without = candidate("screw-ripple", 90_000.0).fitted;
        let first = |left: f64| -> &str {
            let near = vec![
                candidate("position-dependent-friction-wave", left),
                candidate("screw-ripple", 10_000.0),
            ];
            let ends = |candidate: &Candidate| candidate.fitted.clone();
            Near::of((near, 0.0), &ends, &|_| 0.0, &without, 10_000).class[0].name()
        };
        assert_eq!(first(9_999.5), "screw-ripple");
        assert_eq!(first(9_990.0), "position-dependent-friction", "it is another wave");
    }

    #[test]
    fn what_no_data_tell_apart_is_as_probable_as_the_best() {
        let weights = |names: [&str; 2]| {
            let class = vec![candidate(names[0], 10_000.0), candidate(names[1], 11_000.0)];
            [0, 1].map(|place| weighed(class.clone(), 100.0)[place].1)
        };
        assert_eq!(weights(["constant-force", "direction-asymmetry"]), [0.5, 0.5]);
        let [best, other] = weights(["backlash", "soft-zone"]);
        assert!(best > 0.99 && other > 0.0, "{best}, {other}");
    }

    #[test]
    fn a_lag_is_told_from_a_delay_where_both_kinds_of_rows_say_so() {
        let machine = config::load("paper").expect("a machine");
        let mut problem = swinging(&machine, 5e-3);
        let file = Model::new(machine.axes[AxisId::X].plant);
        let with = |name: &str, us: f64| {
            file.with(Tried { entry: entry(name).expect("an effect"), values: [us, 0.0, 0.0] })
        };
        let mut data = problem.data[0].clone();
        data.measured = problem.simulated(0, &with("actuator-delay", 400.0));
        for judged in [false, true] {
            data.fit =
                (0..6_000).map(|row| (800..if judged { 3_000 } else { 6_000 }).contains(&row)).collect();
            data.held = (0..6_000).map(|row| judged && row >= 3_000).collect();
            problem = problem.with_data(Arc::new(vec![data.clone()]));
            let fitted = |name: &str| fit(&problem, &with(name, 300.0), Effort::Coarse(6), None);
            let ends = ["actuator-delay", "current-loop-lag"].map(fitted);
            let lost = total_of(&problem, &file) - ends[0].total;
            let candidate = |fitted: &Fitted| Candidate {
                fitted: fitted.clone(),
                held: 0.0,
                evidence: 0.0,
                failed: Vec::new(),
            };
            let class = ends.each_ref().map(|fitted| (candidate(fitted), 0.5)).to_vec();
            let mut named = NamedEffect { name: "actuator-delay", class, runner_up: None };
            named.tell_apart(&problem, &ends[0], lost);
            assert_eq!(named.class.len(), if judged { 1 } else { 2 });
            assert_eq!(named.class[0].1, if judged { 1.0 } else { 0.5 });
            assert_eq!(named.runner_up.map(|next| next.name), judged.then_some("current-loop-lag"));
        }
    }

    #[test]
    fn what_explains_the_fitted_rows_as_well_is_near_whatever_rows_that_judge_say() {
        let best = candidate("current-loop-lag", 10_000.0);
        for (left, is_near) in [(9_000.0, true), (11_500.0, true), (11_700.0, false)] {
            let behind = Candidate { evidence: 40_000.0, ..candidate("actuator-delay", left) };
            assert_eq!(explains_as_much(&behind, &best, 10_000), is_near, "{left}");
        }
    }

    #[test]
    fn bottoms_tell_what_louder_noise_does_not_what_every_axis_has_and_what_stands_beside_an_error_of_the_scale()
     {
        let asked = |best: &str, other: &str, left: f64, is_louder: bool| {
            explains_roughly_as_much(&candidate(other, left), &candidate(best, 10_000.0), is_louder)
        };
        assert!(asked("load-dependent-friction", "viscous-friction", 21_000.0, false));
        assert!(!asked("load-dependent-friction", "viscous-friction", 23_000.0, false));
        assert!(!asked("viscous-friction", "load-dependent-friction", 21_000.0, false));
        assert!(asked("scale-error", "spring-load", 21_000.0, false));
        assert!(!asked("spring-load", "scale-error", 21_000.0, false));
        assert!(asked("spring-load", "scale-error", 21_000.0, true));
    }

    #[test]
    fn what_was_near_is_told_apart_where_rows_that_judge_say_so_too() {
        let without = Fitted { total: 25_000.0, ..candidate("backlash", 25_000.0).fitted };
        let class = |held: [f64; 2]| -> Vec<&str> {
            let near =
                [candidate("current-loop-lag", 10_000.0), candidate("actuator-delay", 10_000.0)].to_vec();
            let is_lag = |of: &Fitted| last_of(&of.model) == Some("current-loop-lag");
            let end = |candidate: &Candidate| {
                let left = if is_lag(&candidate.fitted) { 10_000.0 } else { 10_400.0 };
                Fitted { cost: left, total: left, ..candidate.fitted.clone() }
            };
            let held = |end: &Fitted| held[usize::from(!is_lag(end))];
            let near = Near::of((near, 0.0), &end, &held, &without, 10_000);
            near.class.iter().map(Candidate::name).collect()
        };
        assert_eq!(class([9_000.0, 9_100.0]), ["current-loop-lag", "actuator-delay"]);
        assert_eq!(class([9_000.0, 12_000.0]), ["current-loop-lag"]);
    }

    #[test]
    fn what_needs_a_base_that_is_much_further_from_its_file_is_no_other_explanation() {
        let without = Fitted { total: 25_000.0, ..candidate("backlash", 25_000.0).fitted };
        let class = |priors: f64, left: f64| -> Vec<&str> {
            let mut other = candidate("load-dependent-friction", left);
            other.fitted.model.base[0] = priors;
            let near = vec![candidate("viscous-friction", 10_000.0), other];
            let end = |candidate: &Candidate| candidate.fitted.clone();
            Near::of((near, 0.0), &end, &|_| 0.0, &without, 10_000)
                .class
                .iter()
                .map(Candidate::name)
                .collect()
        };
        assert_eq!(class(2.9, 10_010.0), ["viscous-friction", "load-dependent-friction"]);
        assert_eq!(class(3.1, 10_010.0), ["viscous-friction"]);
        assert_eq!(class(3.1, 9_990.0), ["load-dependent-friction", "viscous-friction"], "it explains more");
    }

    #[test]
    fn more_numbers_that_say_no_more_are_no_other_explanation() {
        const ROWS: usize = 10_000;
        let without = Fitted { total: 100_000.0, ..candidate("scale-error", 100_000.0).fitted };
        let class = |all: &[(&str, f64)]| -> Vec<&str> {
            let near = all.iter().map(|(name, left)| candidate(name, *left)).collect();
            let ends = |candidate: &Candidate| candidate.fitted.clone();
            Near::of((near, 0.0), &ends, &|_| 0.0, &without, ROWS).class.iter().map(Candidate::name).collect()
        };
        // A swing of many times the travel is a slope, by three numbers.
        for (left, names) in [
            (10_000.0, vec!["scale-error"]),
            (10_040.0, vec!["scale-error"]),
            // Surely better, by what two numbers are worth.
            (9_900.0, vec!["pitch-error", "scale-error"]),
        ] {
            assert_eq!(class(&[("scale-error", 10_000.0), ("pitch-error", left)]), names, "{left}");
        }
        // What is left beyond noise may be what wants the further numbers.
        assert_eq!(class(&[("backlash", 13_000.0), ("soft-zone", 12_900.0)]), ["backlash", "soft-zone"]);
        assert_eq!(class(&[("backlash", 15_000.0), ("soft-zone", 12_900.0)]), ["soft-zone"]);
        // A gain of the velocity loop is one that the base has as well.
        let gains = class(&[("command-filter", 10_000.0), ("servo-gain-mismatch", 9_999.0)]);
        assert_eq!(gains, ["servo-gain-mismatch", "command-filter"]);
        // What no data tell apart stays together, whatever it takes to say it.
        let twins = class(&[("encoder-eccentricity", 10_000.0), ("pitch-error", 10_000.0)]);
        assert_eq!(twins, ["encoder-eccentricity", "pitch-error"]);
    }
}
