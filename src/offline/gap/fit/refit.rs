//! A model fitted again: from more than one start, coarsely or to the bottom.
//!
//! Invariant: of two ends the deeper one is kept.

use rayon::prelude::*;

use super::louder::{is_much_left, led_down};
use super::{Effort, Fitted, fit, to_the_bottom, total_of};
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::model::twin::BASE;

/// Iterations of coarse fits: of the base, and of a candidate with it.
pub(in crate::offline::gap) const ITERATIONS: [usize; 2] = [12, 6];
/// Within how many priors a model must be straight about a row for it to count, fit by fit, from where rows in motion led;
/// the second for a base alone, where the first leaves more than noise and something to go on with.
const WAYS: [&[f64]; 2] = [&[0.1], &[0.3, 0.1, 0.05]];
/// A model that costs rows in motion no more than so many times what is least of it stands in their valley.
const SAME: f64 = 1.02;
/// By how many priors mass and stiffness of the file are moved apart: without a table scale only what rings tells one from
/// the other, and each frequency has a valley of its own.
const TUNED: [f64; 2] = [0.6, -0.6];
/// Within how many priors a model must be straight for what is named and judged.
const REACH: f64 = 0.1;
/// Cost per row that is plainly more than that of noise, as a ratio.
pub(in crate::offline::gap) const PLAIN: f64 = 1.05;
/// A model that leaves so many times as much without an effect needs it.
pub(in crate::offline::gap) const PLAINLY: f64 = 1.5;
/// A share of that reach that changes nothing.
const NO_WAY: f64 = 0.01;
/// How often a base is fitted again for what noise does about it, and what of its total is no change.
const ROUNDS: usize = 3;
const SETTLED: f64 = 0.01;
/// What leaves less than this share of what was left is far from it.
const FAR: f64 = 0.95;
/// What explains so much of what it leaves is fitted by all ways, and asked for need as rows count beside it, too: a few steps from a base
/// that has made up for it find a tenth of it.
const MUCH: f64 = 0.02;

/// A model fitted to the bottom.
pub(in crate::offline::gap) fn refitted(
    problem: &Problem<'_>,
    once: &Problem<'_>,
    model: &Model,
    start: &Model,
) -> Fitted {
    fit(problem, &from_both(problem, once, model, start), Effort::Fine, None)
}

/// The same where it is known where a coarse fit from there ends.
pub(in crate::offline::gap) fn refitted_from(
    problem: &Problem<'_>,
    once: &Problem<'_>,
    here: Model,
    start: &Model,
) -> Fitted {
    let led = led_from(once, &here, start);
    fit(problem, &deeper(problem, once, [here, led]), Effort::Fine, None)
}

/// A model fitted coarsely, from where it stands and from another base, by rows in motion and then by rows about which
/// it is straight: a base that was fitted without the effect may stand in a valley of its own.
fn from_both(problem: &Problem<'_>, once: &Problem<'_>, model: &Model, start: &Model) -> Model {
    let (here, led) = rayon::join(|| ended(once, model), || led_from(once, model, start));
    deeper(problem, once, [here, led])
}

/// Where rows in motion lead the effects of a model from another base.
fn led_from(once: &Problem<'_>, model: &Model, start: &Model) -> Model {
    led_by_motion(once, &[Model { base: start.base, ..model.clone() }])
}

/// The deeper of two models, of which the second is where rows in motion led.
fn deeper(problem: &Problem<'_>, once: &Problem<'_>, [here, led]: [Model; 2]) -> Model {
    if is_as_deep_in_motion(once, &here, &led) {
        return here;
    }
    let there = ended(once, &nearer(once, &led, 0));
    deepest([here, there].map(|end| (total_of(problem, &end), end))).1
}

/// Whether a model is as deep by rows in motion as one that they led to: that has only valleys of stick and slip to offer, which hang on chance.
fn is_as_deep_in_motion(once: &Problem<'_>, here: &Model, led: &Model) -> bool {
    once.in_motion(here).is_some_and(|moving| {
        let [own, other] = [here, led].map(|model| total_of(&moving, model));
        own <= SAME * other
    })
}

/// The same problem where rows in motion tell what they tell best, if there are any.
fn beside_motion<'m>(problem: &Problem<'m>, model: &Model) -> Problem<'m> {
    problem.holding_force(problem.in_motion(model).is_some())
}

/// Where the rows in motion lead from some models: the deepest of it.
fn led_by_motion(once: &Problem<'_>, begun: &[Model]) -> Model {
    let Some(moving) = once.in_motion(&begun[0]) else { return begun[0].clone() };
    let ends = begun.par_iter().map(|model| ended(&moving, model)).collect();
    deepest(with_totals(&moving, ends)).1
}

/// Where a way from a model ends, before rows count whether or not it is straight about them.
fn nearer(once: &Problem<'_>, begun: &Model, number: usize) -> Model {
    let nearer =
        |model: Model, reach: &f64| ended(&once.where_straight(&model, *reach, number as u64), &model);
    WAYS[number].iter().fold(begun.clone(), nearer)
}

/// A base with mass and stiffness so many priors apart.
fn apart(base: &Model, by: f64) -> Model {
    let mut at = base.coordinates();
    for (coordinate, base) in at.iter_mut().zip(&BASE) {
        match base.name {
            "mass" => *coordinate += by,
            "stiffness" => *coordinate -= by,
            _ => {}
        }
    }
    base.at(&at)
}

/// Where a coarse fit ends.
pub(in crate::offline::gap) fn ended(problem: &Problem<'_>, model: &Model) -> Model {
    fit(problem, model, Effort::Coarse(ITERATIONS[0]), None).model
}

fn with_totals(problem: &Problem<'_>, ends: Vec<Model>) -> Vec<(f64, Model)> {
    ends.into_iter().map(|model| (total_of(problem, &model), model)).collect()
}

fn deepest(ends: impl IntoIterator<Item = (f64, Model)>) -> (f64, Model) {
    ends.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).expect("an end")
}

/// The base fitted to the bottom from where it stands beside an effect, or from where it was fitted without: whichever leads
/// deeper; and by how much both ends differ: what is that rough tells of no effect that explains less. Where coarse fits differ by
/// so much that it matters, both go to the bottom. Where the deeper one plainly leaves more than was reached with an effect, no bottom
/// of its valleys would do.
pub(in crate::offline::gap) fn base_refitted(
    problem: &Problem<'_>,
    once: &Problem<'_>,
    ends: [&Model; 2],
    reached: f64,
    matters: impl Fn(&Fitted, f64) -> bool,
) -> (Fitted, f64) {
    let mut ends = with_totals(problem, ends.par_iter().map(|model| ended(once, model)).collect());
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    if ends[0].0 > PLAINLY * reached {
        let fitted = fit(problem, &ends[0].1, Effort::Coarse(ITERATIONS[1]), None);
        return (fitted, 0.0);
    }
    let bottom_of = |(_, model): &(f64, Model)| fit(problem, model, Effort::Fine, None);
    let (deeper, apart) = (bottom_of(&ends[0]), ends[1].0 - ends[0].0);
    if !matters(&deeper, apart) {
        return (deeper, apart);
    }
    let other = bottom_of(&ends[1]);
    let apart = (other.total - deeper.total).abs();
    (if other.total < deeper.total { other } else { deeper }, apart)
}

/// The base fitted coarsely, the problem in which rows count by how straight it is about them, and where rows in motion led.
pub(in crate::offline::gap) fn coarsely<'m>(
    problem: &Problem<'m>,
    start: &Model,
) -> (Problem<'m>, Fitted, Model) {
    let problem = &beside_motion(problem, start);
    let once = problem.first_passes();
    let mut begun = vec![start.clone()];
    if !problem.has_table() {
        begun.extend(TUNED.map(|by| apart(start, by)));
    }
    let led = led_by_motion(&once, &begun);
    let (near, first) = about(problem, &nearer(&once, &led, 0));
    // Where little is left another way leads nowhere else, and where much is, something is missing that no way makes up for.
    if is_noise(&near, &first) || is_much_left(&near, &first.model) {
        return (near, first, led);
    }
    let other = about(problem, &nearer(&once, &led, 1));
    let is_deeper = leaves_less((&other.0, &other.1), (&near, &first), 1.0);
    let (near, fitted) = if is_deeper { other } else { (near, first) };
    (near, fitted, led)
}

/// Whether a base leaves less than this share of another, by rows as they count, and with means as noise moves them, about each of them:
/// without that, a base that breaks away as easily as noise makes it would be the deeper one.
fn leaves_less(
    (near, base): (&Problem<'_>, &Fitted),
    (other_near, other): (&Problem<'_>, &Fitted),
    share: f64,
) -> bool {
    let of_base = base.total + total_of(other_near, &base.model);
    let of_other = other.total + total_of(near, &other.model);
    of_base < share * of_other
}

/// The same problem where rows count, and noise moves means, as they do about a model.
pub(in crate::offline::gap) fn beside<'m>(problem: &Problem<'m>, model: &Model) -> Problem<'m> {
    problem.where_straight(model, REACH, 0)
}

/// The same about a model that was fitted to it; nothing where that is how it is.
pub(in crate::offline::gap) fn unsettled<'m>(near: &Problem<'m>, fitted: &Fitted) -> Option<Problem<'m>> {
    let next = beside(near, &fitted.model);
    let total = total_of(&next, &fitted.model);
    ((total / fitted.total - 1.0).abs() > SETTLED).then_some(next)
}

/// A base fitted coarsely to rows that count by how straight it is about them, until noise moves the mean about it as it did about
/// the one before.
pub(in crate::offline::gap) fn about<'m>(problem: &Problem<'m>, base: &Model) -> (Problem<'m>, Fitted) {
    let coarse = |near: &Problem<'m>, base: &Model| fit(near, base, Effort::Coarse(ITERATIONS[0]), None);
    let (mut near, mut weighed) = (beside(problem, base), base.clone());
    let mut fitted = coarse(&near, base);
    for _ in 0..ROUNDS {
        if is_where(&fitted.model, &weighed) {
            break;
        }
        let Some(next) = unsettled(&near, &fitted) else { break };
        weighed = fitted.model;
        fitted = coarse(&next, &weighed);
        near = next;
    }
    (near, fitted)
}

/// Whether a model is so near to another that rows count about it as they do about that one.
fn is_where(model: &Model, other: &Model) -> bool {
    let near = |(at, other): (f64, f64)| (at - other).abs() < NO_WAY * REACH;
    model.coordinates().into_iter().zip(other.coordinates()).all(near)
}

/// The base by another way from where rows in motion led, if it leaves plainly less: where one leaves so much that something must be
/// missing and nothing explains it, it was the way.
pub(in crate::offline::gap) fn another_way<'m>(
    problem: &Problem<'m>,
    led: &Model,
    base: (&Problem<'m>, &Fitted),
) -> Option<(Problem<'m>, Fitted)> {
    let problem = &beside_motion(problem, led);
    let other = about(problem, &nearer(&problem.first_passes(), led, 1));
    leaves_less((&other.0, &other.1), base, FAR).then_some(other)
}

/// The effects of a model fitted to the bottom beside the base of the file, as that was without them; with the problem in which rows count by
/// how straight it is about them. Nothing where rows in motion lead no deeper from there than the model stands.
pub(in crate::offline::gap) fn anew<'m>(
    problem: &Problem<'m>,
    model: &Model,
    filed: &Model,
) -> Option<(Problem<'m>, Fitted)> {
    let begun = Model { base: filed.base, ..model.clone() };
    let down = led_down(&problem.first_passes(), &begun);
    let once = beside_motion(problem, model).first_passes();
    let led = led_by_motion(&once, &[down]);
    if is_as_deep_in_motion(&once, model, &led) {
        return None;
    }
    let (near, coarse, _) = coarsely(problem, &led);
    let fitted = to_the_bottom(&near, &coarse);
    Some((near, fitted))
}

/// The deepest of a bottom and those that other models lead to.
pub(in crate::offline::gap) fn also_from(problem: &Problem<'_>, bottom: Fitted, others: &[Model]) -> Fitted {
    let ends = others.iter().map(|other| fit(problem, other, Effort::Fine, None));
    ends.fold(bottom, |best, other| if other.total < best.total { other } else { best })
}

/// A model fitted coarsely, from where it stands and from another base.
pub(in crate::offline::gap) fn coarsely_from(
    problem: &Problem<'_>,
    once: &Problem<'_>,
    model: &Model,
    start: &Model,
) -> Fitted {
    fit(problem, &from_both(problem, once, model, start), Effort::Coarse(ITERATIONS[0]), None)
}

/// Whether a model explains much of what another leaves.
pub(in crate::offline::gap) fn explains_much(fitted: &Fitted, without: &Fitted) -> bool {
    explains(MUCH, fitted, without)
}

/// Whether a model explains more of what another leaves than a share of what is left by itself.
pub(in crate::offline::gap) fn explains(share: f64, fitted: &Fitted, without: &Fitted) -> bool {
    without.total > (1.0 + share) * fitted.total
}

/// Whether it explains so much that no valley of stick and slip may have a say.
pub(in crate::offline::gap) fn is_far(fitted: &Fitted, without: &Fitted) -> bool {
    fitted.total < FAR * without.total
}

/// Whether a model leaves no more than noise of the rows that it was fitted to.
pub(in crate::offline::gap) fn is_noise(problem: &Problem<'_>, fitted: &Fitted) -> bool {
    beyond_noise(problem, fitted) <= 0.0
}

/// How much more than noise it leaves of them.
pub(in crate::offline::gap) fn beyond_noise(problem: &Problem<'_>, fitted: &Fitted) -> f64 {
    fitted.cost - PLAIN * problem.count(Part::Fit) as f64
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::base::axis::AxisId;
    use crate::base::units::Current;
    use crate::config;
    use crate::offline::gap::model::Tried;
    use crate::offline::gap::model::sensors::tests::{showing, swinging};
    use crate::offline::gap::model::twin::Base;
    use crate::plant::effects::entry;
    use crate::plant::tests::paper_axis;

    #[test]
    fn bases_apart_swing_at_other_frequencies_about_the_same_middle() {
        let file = Model::new(paper_axis());
        let natural = |by: f64| {
            let values = apart(&file, by).base_values();
            let of = |name: &str| values.iter().find(|(base, _)| base.name == name).expect("a parameter").1;
            (of("stiffness") / of("mass")).sqrt()
        };
        let [higher, lower] = TUNED.map(|by| natural(-by) / natural(0.0));
        assert!(higher > 1.1 && (higher * lower - 1.0).abs() < 1e-9, "{higher}, {lower}");
    }

    #[test]
    fn what_a_torque_constant_makes_of_all_forces_is_no_gain_of_the_velocity_loop() {
        let machine = config::load("paper").expect("a machine");
        let problem = swinging(&machine, 5e-3);
        let file = Model::new(machine.axes[AxisId::X].plant);
        let gains = |position: f64| Tried {
            entry: entry("servo-gain-mismatch").expect("an effect"),
            values: [position, 0.0, 0.0],
        };
        let lighter = |base: &Base| match base.name {
            "mass" | "motor_inertia" | "stiffness" | "damping" | "sliding" | "breakaway_excess" => {
                -0.12 / base.prior
            }
            _ => 0.0,
        };
        let truth = file.at(&BASE.iter().map(lighter).collect::<Vec<f64>>()).with(gains(3.0));
        let problem = showing(&problem, &truth);
        let found = ended(&problem, &file.with(gains(1.0))).effects[0].values;
        assert!((found[0] - 3.0).abs() < 0.1 && found[1].abs() < 0.5, "{found:?}");
    }

    #[test]
    fn what_rows_in_motion_lead_no_deeper_than_is_not_begun_anew() {
        let machine = config::load("paper").expect("a machine");
        let file = Model::new(machine.axes[AxisId::X].plant);
        let cogging = Tried { entry: entry("motor-cogging").expect("an effect"), values: [0.05, 18.0, 40.0] };
        let truth = file.with(cogging);
        let problem = showing(&swinging(&machine, 5e-3), &truth);
        assert!(anew(&problem, &truth, &file).is_none(), "it is there");
        let far = truth.at(&truth.coordinates().iter().map(|at| at + 2.0).collect::<Vec<f64>>());
        let (near, found) = anew(&problem, &far, &file).expect("a deeper one");
        assert!(found.total < 0.1 * total_of(&near, &far), "{} of {}", found.total, total_of(&near, &far));
    }

    #[test]
    fn of_two_laws_the_bottom_tells_which_it_is() {
        let machine = config::load("paper").expect("a machine");
        let problem = swinging(&machine, 5e-3);
        let file = Model::new(machine.axes[AxisId::X].plant);
        let with = |law: &str, ms: f64| {
            file.with(Tried { entry: entry(law).expect("an effect"), values: [ms, 0.0, 0.0] })
        };
        let laws = ["command-filter", "command-filter-by-rows"];
        for (law, other) in [(laws[0], laws[1]), (laws[1], laws[0])] {
            let problem = showing(&problem, &with(law, 1.3));
            let bottom = fit(&problem, &with(other, 1.5), Effort::Fine, None);
            let laws: Vec<Model> = bottom.model.by_other_laws().collect();
            let found = also_from(&problem, bottom, &laws).model.effects[0];
            assert_eq!(found.entry.name, law);
            assert!((found.values[0] - 1.3).abs() < 1e-3, "{law}: {} ms", found.values[0]);
        }
    }

    #[test]
    fn a_base_that_breaks_away_as_easily_as_noise_makes_it_is_not_the_deeper_one() {
        let machine = config::load("paper").expect("a machine");
        let mut problem = swinging(&machine, 2e-5);
        problem.shakes = Current::a(0.1);
        let truth = Model::new(machine.axes[AxisId::X].plant);
        let mut data = problem.data[0].clone();
        data.measured = problem.with_means_about(&truth).simulated(0, &truth);
        let problem = problem.with_data(Arc::new(vec![data]));
        let easy = ended(&problem, &truth);
        let total = |model: &Model| total_of(&problem, model);
        assert!(total(&easy) < 0.7 * total(&truth), "{} of {}", total(&easy), total(&truth));
        let [truth, easy] = [truth, easy].map(|base| {
            let near = problem.where_straight(&base, REACH, 0);
            let fitted = fit(&near, &base, Effort::Coarse(0), None);
            (near, fitted)
        });
        let [truth, easy] = [&truth, &easy].map(|(near, fitted)| (near, fitted));
        assert!(leaves_less(truth, easy, 1.0) && !leaves_less(easy, truth, 1.0));
    }
}
