//! What is said in the end of effects that nearly every axis has a little of ([`usual`](crate::offline::gap::model::usual)): which are named.
//!
//! What of them is not sure stays with the base.
//! Invariant: in the end effects with a name come first, in the order of their names.

use nalgebra::DMatrix;

use super::named::NamedEffect;
use super::near::{margin, weighed};
use crate::base::units::{Position, Velocity};
use crate::offline::gap::fit::blocks::Blocks;
use crate::offline::gap::fit::refit::ITERATIONS;
use crate::offline::gap::fit::{Effort, Fitted, believed, fit};
use crate::offline::gap::gates::candidate::Candidate;
use crate::offline::gap::gates::without::Without;
use crate::offline::gap::gates::{Gate, is_sure, judged};
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::{BLOCK_S, Linear, Loss, residuals};
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::model::steps::Steps;
use crate::offline::gap::model::{Model, Tried};
use crate::plant::effects::{Entry, entry, neutral_with_force_mm};
use crate::plant::steady_force;

/// By how much of the friction two laws of it may differ.
const NOTICEABLE: f64 = 0.01;
/// What leaves so many times the power of a signal without any of these effects leaves no less of it.
const LOUDER: f64 = 1.1;

/// What is to be said of these effects.
pub(in crate::offline::gap) struct Told {
    /// Those that are sure.
    pub(in crate::offline::gap) named: Vec<NamedEffect>,
    /// Their places in the list of the base.
    pub(in crate::offline::gap) places: Vec<usize>,
    /// Those that may be.
    pub(in crate::offline::gap) refused: Vec<Candidate>,
    /// With all effects that have names first.
    pub(in crate::offline::gap) model: Fitted,
}

/// Puts each of these effects, which come first in a model, to every gate; `start` is a base with them that rows in motion led to, `alone`
/// where it was fitted without any other.
pub(in crate::offline::gap) fn told(
    problem: &Problem<'_>,
    once: &Problem<'_>,
    model: &Fitted,
    [blocks, base]: [&Blocks; 2],
    [start, alone]: [&Model; 2],
) -> Told {
    let (usual, all) = (start.effects.len(), model.model.effects.len());
    // All rows say how sure a force is.
    let free = problem.holding_force(false);
    let mut model = of_the_spring(surely(&free, model, usual));
    let mut blocks = blocks.clone();
    let (mut named, mut places, mut refused) = (Vec::new(), Vec::new(), Vec::new());
    for place in 0..usual {
        let Some(as_last) = that_may_be_named(problem, &free, &model, place) else { continue };
        let test = Without::of(problem, once, &model, place, [start, &alone.without(place)]);
        let gated = |fitted| judged(&free, &test.fitted, [&test.blocks, base], fitted);
        let in_its_place = (0..place).chain([all - 1]).chain(place..all - 1).collect::<Vec<_>>();
        let mut own = gated(as_last);
        if own.failed.contains(&Gate::Fit) {
            // On its way to a bottom without it the base may have come to a deeper valley, which is there with it too.
            let begun = own.fitted.model.effects.last().map(|tried| test.fitted.model.with(*tried));
            let other = begun.map(|begun| fit(problem, &begun, Effort::Fine, None));
            if let Some(deeper) = other.filter(|other| other.total < own.fitted.total) {
                own = gated(with_all_sure(&free, &deeper));
                model = own.fitted.in_order(&in_its_place);
                blocks = Blocks::new(problem, &model.model);
            }
        }
        let is_needed = || {
            test.shows_need(&free, &model, &blocks, place)
                && !is_louder(problem, [&model.model, &test.fitted.model])
        };
        if own.failed.is_empty() && !is_needed() {
            own.failed.push(Gate::Needed);
        }
        if !own.failed.is_empty() {
            refused.push(own);
            continue;
        }
        let mut class = vec![own];
        let alike = aliases(problem, &model.model, place).into_iter().map(gated);
        class.extend(alike.filter(|other| other.failed.is_empty()));
        class.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let best = &class[0];
        // In the place of its twin.
        model = best.fitted.in_order(&in_its_place);
        let (name, margin) = (best.name(), margin(best.evidence));
        named.push(NamedEffect { name, class: weighed(class, margin), runner_up: None });
        places.push(place);
    }
    let silent = (0..usual).filter(|place| !places.contains(place));
    let order: Vec<usize> = (usual..all).chain(places.iter().copied()).chain(silent).collect();
    Told { named, places, refused, model: model.in_order(&order) }
}

/// Whether any of these effects, which are the first `usual` of a model, may have to be named.
pub(super) fn may_be_named(problem: &Problem<'_>, fitted: &Fitted, usual: usize) -> bool {
    let free = problem.holding_force(false);
    let model = surely(&free, fitted, usual);
    (0..usual).any(|place| that_may_be_named(problem, &free, &model, place).is_some())
}

/// A model with one of these effects last, if that is sure and more of the friction than two laws of it differ by.
fn that_may_be_named(
    problem: &Problem<'_>,
    free: &Problem<'_>,
    model: &Fitted,
    place: usize,
) -> Option<Fitted> {
    if !is_noticeable(problem, &model.model, place) {
        return None;
    }
    let last = (0..model.model.effects.len()).filter(|other| *other != place).chain([place]);
    let as_last = model.in_order(&last.collect::<Vec<_>>());
    is_sure(free, &as_last).then_some(as_last)
}

/// The same where any of these effects is worth it.
fn surely(free: &Problem<'_>, fitted: &Fitted, usual: usize) -> Fitted {
    let model = &fitted.model;
    let is_asked = (0..usual).any(|place| is_noticeable(free, model, place));
    if is_asked { with_all_sure(free, fitted) } else { fitted.clone() }
}

/// The same model with how sure all its coordinates are.
fn with_all_sure(free: &Problem<'_>, fitted: &Fitted) -> Fitted {
    let model = &fitted.model;
    let left = (Part::Fit, residuals(free, model, Part::Fit));
    let linear = Linear::new(free, model, left, None, &Steps::of(model, &fitted.covariance));
    let equations = linear.normal(free.rows_in(BLOCK_S), Loss::LAST).with_beliefs(model);
    let covariance = equations.covariance().unwrap_or_else(|| fitted.covariance.clone());
    Fitted { covariance, ..fitted.clone() }
}

/// Whether one of these effects is so much of the friction that two laws of it do not differ by as much.
fn is_noticeable(problem: &Problem<'_>, model: &Model, place: usize) -> bool {
    let setpoints = problem.data.iter().flat_map(|data| data.course.setpoints());
    let fastest = setpoints.map(|setpoint| setpoint.velocity.as_m_per_s().abs()).fold(0.0, f64::max);
    is_more_than_laws_differ(model, &model.without(place), Velocity::m_per_s(fastest))
}

fn is_more_than_laws_differ(with: &Model, without: &Model, fastest: Velocity) -> bool {
    let [with, without] = [with, without].map(|model| model.twin().plant);
    let [with_n, without_n] =
        [&with, &without].map(|plant| steady_force(plant, fastest, Position::ZERO).as_n());
    (with_n - without_n).abs() > NOTICEABLE * with.friction.sliding.as_n()
}

/// Whether the first of two models leaves more of a signal than the second, as it was measured, and of all together: what is always there is
/// slow, and whitened rows hardly show it.
fn is_louder(problem: &Problem<'_>, models: [&Model; 2]) -> bool {
    let all: Vec<[f64; 2]> = {
        let [with, without] = models.map(|model| problem.rms_left(model, Part::Held));
        let in_floors = |signal: usize| {
            let floor = problem.floor(signal, Part::Held)?;
            Some([with[signal], without[signal]].map(|rms| (rms / floor).powi(2)))
        };
        (0..with.len()).filter_map(in_floors).collect()
    };
    let [with, without] = [0, 1].map(|which| all.iter().map(|powers| powers[which]).sum::<f64>());
    with > without && all.iter().any(|[with, without]| *with > LOUDER * without)
}

/// The same model where a constant force beside a spring is that of the spring: of the two only the sum is known, and one name says
/// it.
fn of_the_spring(mut fitted: Fitted) -> Fitted {
    let place = |name: &str| fitted.model.effects.iter().position(|tried| tried.entry.name == name);
    let (Some(spring), Some(constant)) = (place("spring-load"), place("constant-force")) else {
        return fitted;
    };
    let [at, force] = [spring, constant].map(|place| fitted.model.first_coordinate(place));
    let [of_spring, of_force] = [spring, constant].map(|place| fitted.model.effects[place].entry.parameters);
    let [n_per_mm, neutral_mm] = [0, 1].map(|of| fitted.model.effects[spring].values[of]);
    let force_n = fitted.model.effects[constant].values[0];
    if n_per_mm == 0.0 || force_n == 0.0 {
        return fitted;
    }
    let apart_m = fitted.model.twin().pushed_apart_m();
    fitted.model.effects[constant].values[0] = 0.0;
    // What a force that is always there moves without the zero of the table, a spring moves with it.
    let (zero, per_m) = Model::table_zero();
    let moved = per_m * (apart_m - fitted.model.twin().pushed_apart_m());
    fitted.model.base[zero] += moved;
    let moved_mm = neutral_with_force_mm([n_per_mm, neutral_mm], force_n);
    fitted.model.effects[spring].values[1] = moved_mm;
    // How the neutral point moves with force and stiffness, in coordinates.
    let mut moves = DMatrix::identity(fitted.covariance.nrows(), fitted.covariance.ncols());
    let per_mm = 1.0 / of_spring[1].prior;
    moves[(zero, force)] = moved / (force_n / of_force[0].prior);
    moves[(at + 1, force)] = of_force[0].prior / n_per_mm * per_mm;
    moves[(at + 1, at)] = -force_n / n_per_mm.powi(2) * of_spring[0].prior * per_mm;
    fitted.covariance = &moves * &fitted.covariance * moves.transpose();
    fitted.total = fitted.cost + believed(&fitted.model);
    fitted
}

/// A model fitted with what no data tell from one of its effects in the place of that, as large as makes up for it.
fn aliases(problem: &Problem<'_>, model: &Model, place: usize) -> Vec<Fitted> {
    let others = model.effects[place].entry.aliases.iter().filter_map(|name| entry(name));
    let alike = others.filter_map(|other| with_alias(model, place, other));
    alike.map(|other| fit(problem, &other, Effort::Coarse(ITERATIONS[0]), None)).collect()
}

/// A model with another effect in the place of one, as large as makes friction differ by as much between both ways.
fn with_alias(model: &Model, place: usize, other: &'static Entry) -> Option<Model> {
    let without = model.without(place);
    let uneven_n = |model: &Model| {
        let plant = model.twin().plant;
        let velocity = plant.friction.fall_end * 2.0;
        let [there, back] =
            [velocity, -velocity].map(|velocity| steady_force(&plant, velocity, Position::ZERO));
        (there + back).as_n()
    };
    let values = other.nominal();
    let usual = without.with(Tried { entry: other, values });
    let [own_n, usual_n] = [model, &usual].map(|model| uneven_n(model) - uneven_n(&without));
    let share = own_n / usual_n;
    share.is_finite().then(|| {
        let mut values = values;
        values[0] *= share;
        without.with(Tried { entry: other, values })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::tests::paper_axis;

    #[test]
    fn a_force_and_a_friction_that_differs_by_direction_are_as_large_as_each_other() {
        let asymmetry = entry("direction-asymmetry").expect("an effect");
        let alone = Model::new(paper_axis());
        for force_n in [146.0, -20.0] {
            let force =
                Tried { entry: entry("constant-force").expect("an effect"), values: [force_n, 0.0, 0.0] };
            let other = with_alias(&alone.with(force), 0, asymmetry).expect("an asymmetry");
            assert_eq!(other.effects.len(), 1);
            let share = -force_n / paper_axis().friction.sliding.as_n();
            let found = 1e-2 * other.effects[0].values[0];
            assert!((found / share - 1.0).abs() < 1e-2, "{found} for {force_n} N, not {share}");
        }
    }

    #[test]
    fn what_two_laws_of_friction_may_differ_by_is_not_to_be_named() {
        let alone = Model::new(paper_axis());
        for (name, value, is_more) in [
            ("constant-force", 5.0, false),
            ("constant-force", -50.0, true),
            ("viscous-friction", 0.1, false),
            ("viscous-friction", 1.0, true),
        ] {
            let with =
                alone.with(Tried { entry: entry(name).expect("an effect"), values: [value, 0.0, 0.0] });
            let found = is_more_than_laws_differ(&with, &alone, Velocity::mm_per_s(33.0));
            assert_eq!(found, is_more, "{name} of {value}");
        }
    }

    #[test]
    fn a_constant_force_beside_a_spring_only_moves_its_neutral_point() {
        let tried = |name, of: &[f64]| {
            let entry = entry(name).expect("an effect");
            let mut values = entry.nominal();
            values[..of.len()].copy_from_slice(of);
            Tried { entry, values }
        };
        let model = Model::new(paper_axis())
            .with(tried("constant-force", &[-120.0]))
            .with(tried("spring-load", &[1.2, 99.0]));
        // Only the sum is known, by 2 N: what the force is more, the spring is less.
        let count = model.coordinate_count();
        let mut covariance = DMatrix::identity(count, count) * 1e-8;
        let [force, spring] = [0, 1].map(|place| model.first_coordinate(place));
        let (prior_n, prior_mm) =
            (model.effects[0].entry.parameters[0].prior, model.effects[1].entry.parameters[1].prior);
        let (alone_n, sum_n) = (300.0, 2.0);
        let of_force = f64::powi(alone_n / prior_n, 2);
        covariance[(force, force)] = of_force;
        let against = -(alone_n / prior_n) * (alone_n / 1.2 / prior_mm);
        covariance[(force, spring + 1)] = against;
        covariance[(spring + 1, force)] = against;
        covariance[(spring + 1, spring + 1)] =
            (alone_n / 1.2 / prior_mm).powi(2) + (sum_n / 1.2 / prior_mm).powi(2);
        let zero_um = |model: &Model| {
            let twin = model.twin();
            1e6 * (twin.table_zero_m + twin.pushed_apart_m())
        };
        let before_um = zero_um(&model);
        assert!(before_um < -0.5, "{before_um} um");
        let fitted = Fitted { model, cost: 1.0, total: 2.0, covariance };
        let mut slack = fitted.clone();
        slack.model.effects[1].values[0] = 0.0;
        let slack = of_the_spring(slack);
        assert_eq!(slack.model.effects[0].values[0], -120.0, "a spring that is none holds no force");
        let fitted = of_the_spring(fitted);
        assert!((zero_um(&fitted.model) - before_um).abs() < 1e-6, "the table scale shows another zero");
        let [of_force, of_spring] = [0, 1].map(|place| fitted.model.effects[place].values);
        assert_eq!(of_force[0], 0.0);
        assert!((of_spring[1] - -1.0).abs() < 1e-9, "{}", of_spring[1]);
        let sigma_mm = fitted.covariance[(spring + 1, spring + 1)].sqrt() * prior_mm;
        assert!((sigma_mm - sum_n / 1.2).abs() < 0.02, "{sigma_mm}");
    }
}
