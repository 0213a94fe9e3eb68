//! What a candidate has to pass before its effect is named.
//!
//! Fits are judged by rows that they have not seen. Costs are divided by what the best model still leaves per row, so
//! that a model that is wrong elsewhere makes nothing significant.
//! Invariant: a function of fits and rows alone; the same candidate passes the same gates.

pub mod candidate;
pub mod crossed;
pub mod judged;
pub(super) mod without;

use std::cell::LazyCell;
use std::fmt;

use rayon::prelude::*;
use serde::Serialize;
use tracing::debug;

use crate::offline::gap::fit::blocks::Blocks;
use crate::offline::gap::fit::nearby::costs_nearby;
use crate::offline::gap::fit::refit::{ITERATIONS, PLAIN, beside, explains_much, is_far};
use crate::offline::gap::fit::{Effort, Fitted, fit, scale, to_the_bottom};
use crate::offline::gap::model::linear::Linear;
use crate::offline::gap::model::little::{is_on_its_way, is_stick};
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::model::usual::is_usual;
use crate::offline::gap::model::{Model, Tried};
use crate::plant::effects::{CATALOGUE, Entry, Experiment, Parameter};

use candidate::Candidate;
use judged::Judged;

/// Fall of the information criterion that a candidate must bring on the fitted rows, beyond what the number of candidates
/// explains.
pub(super) const FALL: f64 = 10.0;
/// Fall of the cost on the rows that were not fitted, and the share of what is left there: little, for somebody may have
/// leaned on the table in one of those runs.
pub(super) const HELD_FALL: f64 = 25.0;
const HELD_SHARE: f64 = 0.02;
/// A further effect must make the cost fall there by this share of what those before it did: their equations may be off by as
/// much, and so is what they leave. Of gains they are not.
pub(super) const FURTHER: f64 = 0.04;
/// An amplitude must be so many of its standard deviations. Nine runs tell their scatter, and seven deviations of Student's
/// distribution of as many are as sure as four of a normal one.
const SURE: f64 = 7.0;
/// And so many where all of it was fitted to the bottom: of 246 names the right ones had 6 there at least.
const STAYS: f64 = 5.0;
/// And so many by what the rows that judge say alone, which are fewer; more where few of them say so; and this share of what the
/// fitted rows say.
const ALONE: [f64; 2] = [4.0, 5.0];
const ALONE_SHARE: f64 = 0.5;
/// What commands foretell of each other these rows must not deny: it is enough that they are as sure by themselves.
const SAID: f64 = 3.0;
/// A delay or a lag of less than this share of a cycle of the loops is how one formulation of them differs from another.
const OF_CYCLE: f64 = 0.02;
/// What explains little must not make runs worse by so much of what it gains in others: what an axis does while it sticks imitates anything,
/// in one run this way and in another that.
const WORSE: f64 = 0.2;
/// A number that is so many standard deviations from a whole one, but within these, may be whole.
const NEAR: f64 = 4.0;
const WHOLE: [f64; 2] = [0.04, 0.15];

/// What a candidate has to pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Gate {
    /// Better on the fitted rows than its parameters explain.
    Fit,
    /// Better on rows it has not seen.
    Held,
    /// Better there whichever of them are drawn, or left out.
    Blocks,
    /// An amplitude that is sure not to be zero.
    Amplitude,
    /// An amplitude that the rows that judge want too, and not the base alone that it left free.
    Judged,
    /// An amplitude that not one run wants and another as much not.
    Runs,
    /// Values that the data chose and not the bounds.
    Bounds,
    /// Whole numbers where machines have no others.
    Whole,
    /// Worse again without it, all else fitted from where it stands with it.
    Needed,
    /// Little left of what there was.
    Explains,
}

impl Gate {
    /// Whether it asks the rows that judge.
    fn is_of_rows_that_judge(&self) -> bool {
        matches!(self, Self::Held | Self::Blocks | Self::Judged)
    }

    /// Whether it is about values, and not about whether anything is there.
    pub(super) fn is_of_values(&self) -> bool {
        matches!(self, Self::Bounds | Self::Whole)
    }
}

impl fmt::Display for Gate {
    /// What was against the candidate.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Fit => "explains no more than chance",
            Self::Held => "explains nothing of the rows that judge",
            Self::Blocks => "is not sure there",
            Self::Amplitude => "may be zero",
            Self::Judged => "is not what the rows that judge want",
            Self::Runs => "makes some runs worse",
            Self::Bounds => "has a value at its bound",
            Self::Whole => "has an order that is not whole",
            Self::Needed => "is not needed",
            Self::Explains => "leaves much",
        })
    }
}

/// Whether rows that judge, mostly those of circles, show an effect if it is there.
fn shows_where_judged(entry: &Entry) -> bool {
    matches!(entry.experiment, Experiment::Circles | Experiment::Sweep)
}

/// Whether the rows that judge say nothing of an effect: on the others it makes plainly more than noise into noise, and
/// there it makes nothing surely worse. Circles tell little of what the force of the screw does to friction; they tell
/// of whatever shows at constant velocity, at such velocities: of a drag at 150 mm/s those of 40 mm/s do not.
pub(super) fn does_not_show_where_judged(
    entry: &Entry,
    are_silent: impl FnOnce() -> bool,
    without: &Fitted,
    with: &Fitted,
    held: [&Blocks; 2],
    rows: [usize; 2],
) -> bool {
    let per_row = |fitted: &Fitted| fitted.cost / rows[0].max(1) as f64;
    per_row(without) > PLAIN * per_row(with)
        && per_row(with) < 1.0
        && !held[1].is_surely_worse_than(held[0])
        && (!shows_where_judged(entry) || are_silent())
}

/// Models with an effect more, fitted to all rows and put to every gate but the last; those that the model has already
/// explain so much of the rows that judge. What explains much is fitted again by `refit`.
pub(super) fn tried(
    problem: &Problem<'_>,
    here: &Linear,
    without: &Fitted,
    blocks @ [blocks_without, alone]: [&Blocks; 2],
    promising: &[Model],
    refit: &(dyn Fn(&Model) -> Fitted + Sync),
) -> Vec<Candidate> {
    let without_held = blocks_without.cost();
    // What explains much leads far from where those derivatives hold. A further effect that makes rows that judge worse, though they
    // should show it, only found a valley of the others.
    let is_of_fit_alone = |fitted: &Fitted| {
        let of = fitted.model.effects.last().map(|tried| tried.entry);
        alone.cost() > without_held
            && of.is_some_and(shows_where_judged)
            && Blocks::new(problem, &fitted.model).cost() > without_held
    };
    // What leads nowhere stands before a slip that the base made its own.
    let leads_nowhere = |fitted: &Fitted| fitted.total > without.total;
    let is_worth_it =
        |fitted: &Fitted| leads_nowhere(fitted) || explains_much(fitted, without) && !is_of_fit_alone(fitted);
    let grown = |fitted: Fitted| if is_worth_it(&fitted) { refit(&fitted.model) } else { fitted };
    let both = |model: &Model| {
        let own = grown(fit(problem, model, Effort::Coarse(ITERATIONS[1]), Some(here)));
        // At its bound an effect may be on its way to another, and what leads far may lead to what is alike.
        let is_at_bound = own.model.is_at_bound(own.model.effects.len() - 1);
        let goes_on = is_at_bound || explains_much(&own, without);
        // Where that one is promising by itself, it began from where this one went already.
        let is_tried = |other: &Model| promising.iter().any(|one| last_of(one) == last_of(other));
        let is_asked = |other: &Model| goes_on && (is_at_bound || !is_tried(other));
        let of_alike = |model: Model| {
            let other = fit(problem, &model, Effort::Coarse(ITERATIONS[1]), None);
            if is_at_bound || other.total < own.total { grown(other) } else { other }
        };
        let others: Vec<Fitted> = own.model.with_last_as_alike().filter(is_asked).map(of_alike).collect();
        std::iter::once(own).chain(others)
    };
    let all: Vec<Fitted> = promising.par_iter().flat_map_iter(both).collect();
    let all = candidate::best_laws(without.total, all, problem.counts()[0]);
    all.into_par_iter().map(|fitted| judged(problem, without, blocks, fitted)).collect()
}

/// Name of the last effect of a model.
pub(super) fn last_of(model: &Model) -> Option<&'static str> {
    model.effects.last().map(|tried| tried.entry.name)
}

/// Places of the amplitudes of an effect of a model, among its coordinates: those that are none of the base.
pub(super) fn telling(model: &Model, place: usize) -> Vec<usize> {
    let (entry, first) = (model.effects[place].entry, model.first_coordinate(place));
    let tells = |amplitude: &usize| !entry.parameters[*amplitude].is_of_base;
    entry.amplitudes().filter(tells).map(|of| first + of).collect()
}

/// Whether an amplitude of the last effect of a model is sure not to be zero, by the fitted rows or those that judge.
pub(super) fn is_sure(problem: &Problem<'_>, fitted: &Fitted) -> bool {
    let telling = telling(&fitted.model, fitted.model.effects.len() - 1);
    telling.iter().any(|amplitude| fitted.is_surely_not_zero(*amplitude, SURE))
        || judged::alone(problem, fitted, &telling).iter().any(|alone| alone.is_more_than(SURE, ALONE_SHARE))
}

/// The gate that the last effect of a model does not pass any more at its bottom: there it may go to a bound, or be so unsure of its
/// size that its interval ends there, and what rows that judge were sure of by themselves may be anything, unless they are as sure of
/// this end.
pub(super) fn lost_at(problem: &Problem<'_>, bottom: &Fitted) -> Option<Gate> {
    let last = bottom.model.effects.len() - 1;
    if bottom.is_at_bound(last) && !is_on_its_way(problem, &bottom.model.effects[last]) {
        return Some(Gate::Bounds);
    }
    let telling = telling(&bottom.model, last);
    let stays = telling.iter().any(|amplitude| bottom.is_surely_not_zero(*amplitude, STAYS))
        || is_sure_together(problem, bottom, &telling, &judged::alone(problem, bottom, &telling));
    (!stays).then_some(Gate::Amplitude)
}

/// Whether fitted rows and those that judge, which are not the same, are as sure of an amplitude together, and of one size.
fn is_sure_together(problem: &Problem<'_>, fitted: &Fitted, telling: &[usize], asked: &[Judged]) -> bool {
    are_as_sure(fitted, telling, asked) && !judged::is_another(problem, fitted, telling, asked)
}

fn are_as_sure(fitted: &Fitted, telling: &[usize], asked: &[Judged]) -> bool {
    let said = telling.iter().zip(asked).filter(|(_, one)| one.is_more_than(SAID, ALONE_SHARE));
    let deviations = |(at, one): (&usize, &Judged)| fitted.deviations(*at).hypot(one.share / one.deviation);
    said.map(deviations).any(|together| together > SURE)
}

/// A model whose last effect is put to every gate but the last.
pub(super) fn judged(
    problem: &Problem<'_>,
    without: &Fitted,
    [blocks_without, alone]: [&Blocks; 2],
    fitted: Fitted,
) -> Candidate {
    let rows = problem.counts();
    let without_held = blocks_without.cost();
    let blocks = Blocks::new(problem, &fitted.model);
    let held = blocks.cost();
    let added = fitted.model.effects.len() - 1;
    let entry = fitted.model.effects[added].entry;
    let held_scale = scale(held, rows[1]);
    let mut fall = candidate::fall(without.total, &fitted, entry.numbers(), rows[0]);
    let held_fall = (without_held - held) / held_scale;
    // Pure noise costs 1 per row.
    let left = without_held - rows[1] as f64;
    let mut failed = Vec::new();
    if !is_no_chance(fall) {
        failed.push(Gate::Fit);
    }
    let is_hidden =
        does_not_show_where_judged(entry, || false, without, &fitted, [blocks_without, &blocks], rows);
    // What will have no name may be as little as it is: what has one is the truer beside it.
    let is_nameless = is_stick(&fitted.model.effects[added]);
    let is_worth_it = held_fall > HELD_FALL
        && without_held - held >= HELD_SHARE * left
        && (is_nameless || blocks_without.falls_further(alone, &blocks, FURTHER));
    if !is_hidden && !is_worth_it {
        failed.push(Gate::Held);
    }
    let in_all_draws = blocks_without.is_surely_worse_than(&blocks);
    if !is_hidden && !in_all_draws && !blocks_without.is_worse_in_many_than(&blocks) {
        failed.push(Gate::Blocks);
    }
    let place = fitted.model.first_coordinate(added);
    let telling = telling(&fitted.model, added);
    let is_sure = telling.iter().any(|amplitude| fitted.is_surely_not_zero(*amplitude, SURE));
    let is_little = is_of_formulation(&fitted.model.effects[added], problem.machine.cycle.period.as_s());
    if is_little {
        failed.push(Gate::Amplitude);
    }
    if fitted.model.is_at_bound(added) && !is_on_its_way(problem, &fitted.model.effects[added]) {
        failed.push(Gate::Bounds);
    }
    let is_whole = |(of, parameter): (usize, &Parameter)| {
        let value = fitted.model.effects[added].values[of];
        let sigma = fitted.covariance[(place + of, place + of)].sqrt() * parameter.prior;
        let reach = (NEAR * sigma).clamp(WHOLE[0], WHOLE[1]);
        !parameter.is_whole || (value - value.round()).abs() <= reach
    };
    if !entry.parameters.iter().enumerate().all(is_whole) {
        failed.push(Gate::Whole);
    }
    let asked = LazyCell::new(|| judged::alone(problem, &fitted, &telling));
    // Last, for it takes longest. What has values that no such effect has is asked too: it may show that something is missing.
    if failed.iter().all(Gate::is_of_values) && !is_hidden {
        let deviations = ALONE[usize::from(!in_all_draws)];
        let wants = |deviations: f64| asked.iter().any(|one| one.is_more_than(deviations, ALONE_SHARE));
        if !wants(deviations) {
            failed.push(Gate::Judged);
        }
        // In some of the fitted runs stick and slip may say anything; rows that nobody fitted need no help then.
        if !is_sure && !wants(SURE) {
            failed.push(Gate::Amplitude);
        }
    } else if !is_sure && !failed.contains(&Gate::Amplitude) {
        failed.push(Gate::Amplitude);
    }
    let may_be_off = |entry: &Entry| !is_usual(entry) && !entry.is_of_gains();
    let before = (0..added).filter(|place| may_be_off(fitted.model.effects[*place].entry));
    let before: Vec<usize> = before.flat_map(|place| self::telling(&fitted.model, place)).collect();
    let foretold = LazyCell::new(|| crossed::foretold(problem, &fitted, &telling, &before));
    let rows_that_judge_are_silent = is_sure
        && !failed.is_empty()
        && failed.iter().all(Gate::is_of_rows_that_judge)
        && does_not_speak_against(&asked);
    let is_sure_by_both = failed.contains(&Gate::Amplitude)
        && failed.iter().all(|gate| matches!(gate, Gate::Amplitude | Gate::Blocks))
        && !is_little
        && is_sure_together(problem, &fitted, &telling, &asked);
    // Both say so, whichever commands do.
    let is_sure_by_each = || in_all_draws && telling.iter().any(|at| fitted.is_surely_not_zero(*at, SAID));
    // Where each command bears it out.
    let is_borne_out = || is_sure_by_both && is_sure_by_each() || foretold.is_some();
    if (rows_that_judge_are_silent || is_sure_by_both) && is_borne_out() {
        failed.clear();
    }
    if failed.is_empty()
        && !is_far(&fitted, without)
        && makes_runs_worse(problem, without, &fitted)
        && !is_gained(foretold.as_deref())
    {
        failed.push(Gate::Runs);
    }
    let is_plain_where_judged = || asked.iter().any(|one| one.is_more_than(SURE, ALONE_SHARE));
    if (failed == [Gate::Fit] || failed == [Gate::Runs]) && is_plain_where_judged() {
        let (near, [without, with]) = beside_it(problem, without, &fitted);
        let other = candidate::fall(without.total, &with, entry.numbers(), rows[0]);
        let runs_bear_it_out = || {
            !makes_runs_worse(&near, &without, &with)
                || is_gained(crossed::foretold(&near, &with, &telling, &before).as_deref())
        };
        if is_no_chance(other) && runs_bear_it_out() {
            (fall, failed) = (other, Vec::new());
        }
    }
    debug!(
        law = entry.name,
        values = ?&fitted.model.effects[added].values[..entry.parameters.len()],
        fall,
        held_fall,
        deviations = ?telling.iter().map(|at| fitted.deviations(*at)).collect::<Vec<f64>>(),
        judged = ?*asked,
        ?failed,
        "put to the gates"
    );
    Candidate { evidence: fall + held_fall, fitted, held, failed }
}

/// Whether a fall is more than the best of so many candidates explains by chance.
fn is_no_chance(fall: f64) -> bool {
    fall > FALL + 2.0 * (CATALOGUE.len() as f64).ln()
}

/// Both models at their bottoms, as rows count and noise moves means beside the effect: what speaks against it may be a slip that chance
/// gave the base.
fn beside_it<'m>(problem: &Problem<'m>, without: &Fitted, with: &Fitted) -> (Problem<'m>, [Fitted; 2]) {
    let near = beside(problem, &with.model);
    let (without, with) = rayon::join(|| to_the_bottom(&near, without), || to_the_bottom(&near, with));
    (near, [without, with])
}

/// Whether an effect is so little, or a time so short, that two formulations of the same machine or loops differ by as much.
fn is_of_formulation(tried: &Tried, period_s: f64) -> bool {
    let Parameter { unit, least, .. } = tried.entry.parameters[0];
    let size = tried.values[0].abs();
    size < least || (unit == "us" && 1e-6 * size < OF_CYCLE * period_s)
}

/// Whether rows that judge are sure by themselves that an amplitude is there, however few of them say so.
pub(super) fn bear_out(judged: &[Judged]) -> bool {
    judged.iter().any(|one| one.is_more_than(ALONE[1], ALONE_SHARE))
}

/// Whether rows that judge say that an amplitude is there, or nothing.
pub(super) fn does_not_speak_against(judged: &[Judged]) -> bool {
    crossed::is_silent(judged) || judged.iter().any(|one| one.is_more_than(SAID, ALONE_SHARE))
}

/// Whether a model with an effect costs some of the fitted runs much of what it gains in the others.
fn makes_runs_worse(problem: &Problem<'_>, without: &Fitted, with: &Fitted) -> bool {
    let [without, with] = [without, with].map(|fitted| costs_nearby(problem, fitted));
    costs_much(&without.iter().zip(&with).map(|(without, with)| without - with).collect::<Vec<f64>>())
}

/// Whether commands that foretell each other gain by it, and none loses much: linear about the model with it, no valley of stick and slip has
/// a say.
fn is_gained(foretold: Option<&[f64]>) -> bool {
    foretold.is_some_and(|gained| !costs_much(gained))
}

/// Whether some of what was gained was lost, by more than a share of the rest.
fn costs_much(gained: &[f64]) -> bool {
    let of = |side: f64| gained.iter().map(|gain| (side * gain).max(0.0)).sum::<f64>();
    of(-1.0) > WORSE * of(1.0)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use nalgebra::DMatrix;

    use super::*;
    use crate::base::axis::AxisId;
    use crate::config;
    use crate::offline::gap::model::sensors::tests::{showing, swinging};
    use crate::plant::effects::entry;
    use crate::plant::tests::paper_axis;

    #[test]
    fn what_explains_a_fiftieth_or_leads_nowhere_is_fitted_by_all_ways() {
        let machine = config::load("paper").expect("a machine");
        let problem = swinging(&machine, 5e-3);
        let file = Model::new(machine.axes[AxisId::X].plant);
        let with = |name: &str, value: f64| {
            file.with(Tried { entry: entry(name).expect("an effect"), values: [value, 50.0, 0.0] })
        };
        let problem = showing(&problem, &with("torque-disturbance", 0.5));
        let promising = [with("backlash", 0.1)];
        let here = Linear::widest(&problem, &file);
        let own = fit(&problem, &promising[0], Effort::Coarse(ITERATIONS[1]), Some(&here));
        let blocks = Blocks::new(&problem, &file);
        for (explained, is_asked) in [(0.01, false), (0.03, true), (-0.001, true)] {
            let without = Fitted { model: file.clone(), total: (1.0 + explained) * own.total, ..own.clone() };
            let asked = AtomicBool::new(false);
            let refit = |model: &Model| {
                asked.store(true, Ordering::Relaxed);
                fit(&problem, model, Effort::Coarse(0), None)
            };
            tried(&problem, &here, &without, [&blocks, &blocks], &promising, &refit);
            assert_eq!(asked.into_inner(), is_asked, "{explained}");
        }
    }

    #[test]
    fn a_size_whose_interval_ends_at_its_bound_is_none_that_the_data_chose() {
        let machine = config::load("paper").expect("a machine");
        let problem = swinging(&machine, 5e-3);
        let model = Model::new(machine.axes[AxisId::X].plant);
        let entry = entry("resonance").expect("an effect");
        let base = model.coordinates().len();
        // Hundredths of the mass, Hz, hundredths of critical.
        for (mass, sigma, lost) in [
            (73.0, 3.0, Some(Gate::Bounds)),
            (73.0, 1.0, Some(Gate::Bounds)),
            (65.0, 1.0, None),
            (65.0, 20.0, Some(Gate::Bounds)),
        ] {
            let model = model.with(Tried { entry, values: [mass, 250.0, 8.0] });
            let mut covariance = DMatrix::identity(base + 3, base + 3) * 1e-6;
            let prior = entry.parameters[0].prior;
            covariance[(base, base)] = (sigma / prior).powi(2);
            let fitted = Fitted { model, cost: 0.0, total: 0.0, covariance };
            assert_eq!(lost_at(&problem, &fitted), lost, "{mass} % ± {sigma}");
        }
    }

    #[test]
    fn rows_that_were_fitted_and_those_that_judge_are_as_sure_together() {
        let entry = entry("reversal-compensation").expect("an effect");
        let model = Model::new(paper_axis()).with(Tried { entry, values: [0.011, 14.0, 12.0] });
        let (at, count) = (model.first_coordinate(0), model.coordinate_count());
        let amplitude = model.coordinates()[at];
        for (deviations, share, deviation, are_sure) in [
            // As a pulse of 11 mA with counts of 67 nm.
            (4.4, 1.03, 0.16, true),
            (4.4, 1.03, 0.25, false),
            (2.0, 1.03, 0.16, false),
            // Rows that judge say little by themselves.
            (6.9, 0.9, 0.31, false),
        ] {
            let mut covariance = DMatrix::identity(count, count);
            covariance[(at, at)] = f64::powi(amplitude / deviations, 2);
            let fitted = Fitted { model: model.clone(), cost: 0.0, total: 0.0, covariance };
            let found = are_as_sure(&fitted, &[at], &[Judged { share, deviation }]);
            assert_eq!(found, are_sure, "{deviations}, {share} ± {deviation}");
        }
    }

    #[test]
    fn a_time_of_a_hundredth_of_a_cycle_and_a_zone_a_few_per_cent_softer_are_how_formulations_differ() {
        for (name, value, is) in [
            ("current-loop-lag", 6.2, true),
            ("actuator-delay", 9.0, true),
            ("actuator-delay", 36.0, false),
            ("soft-zone", 6.4, true),
            ("soft-zone", 24.0, false),
            ("backlash", 0.1, false),
        ] {
            let tried = Tried { entry: entry(name).expect("an effect"), values: [value, 0.0, 0.0] };
            assert_eq!(is_of_formulation(&tried, 5e-4), is, "{name} {value}");
        }
    }

    #[test]
    fn rows_that_judge_may_say_nothing_or_that_it_is_there() {
        for (share, deviation, may) in
            [(1.2, 0.5, true), (0.9, 0.1, true), (0.88, 0.18, true), (0.45, 0.15, false), (0.1, 0.25, false)]
        {
            assert_eq!(does_not_speak_against(&[Judged { share, deviation }]), may, "{share}, {deviation}");
        }
        assert!(!does_not_speak_against(&[]));
    }

    #[test]
    fn what_one_run_gains_another_must_not_lose() {
        for (gained, costs) in [
            (&[100.0, 50.0, -20.0][..], false),
            (&[100.0, -40.0, 10.0], true),
            (&[30.0, 20.0], false),
            (&[-1.0], true),
        ] {
            assert_eq!(costs_much(gained), costs, "{gained:?}");
        }
    }

    #[test]
    fn rows_that_judge_may_say_nothing_of_what_is_plain_in_the_others_but_not_speak_against_it() {
        let rows = [100_000, 20_000];
        let fitted = |per_row: f64| Fitted {
            model: Model::new(paper_axis()),
            cost: per_row * rows[0] as f64,
            total: per_row * rows[0] as f64,
            covariance: DMatrix::identity(1, 1),
        };
        let blocks = |each: f64| Blocks::of(vec![each; 40]);
        let of_load = entry("load-dependent-friction").expect("an effect");
        for (without, with, held, says_nothing) in [
            // As load-dependent friction on circles.
            (1.13, 0.76, 400.0, true),
            // It does not make all of it noise, or there was hardly more than noise.
            (1.5, 1.1, 400.0, false),
            (0.79, 0.76, 400.0, false),
            // Surely worse where it is judged.
            (1.13, 0.76, 410.0, false),
        ] {
            let held = [&blocks(400.0), &blocks(held)];
            let found =
                does_not_show_where_judged(of_load, || false, &fitted(without), &fitted(with), held, rows);
            assert_eq!(found, says_nothing, "{without} and {with} per row");
        }
        // Circles show it: what they do not is none.
        let ripple = entry("encoder-eccentricity").expect("an effect");
        let held = [&blocks(400.0), &blocks(400.0)];
        for are_silent in [false, true] {
            let (without, with) = (fitted(1.13), fitted(0.76));
            let found = does_not_show_where_judged(ripple, || are_silent, &without, &with, held, rows);
            assert_eq!(found, are_silent, "constant velocities show it, where they are such");
        }
    }
}
