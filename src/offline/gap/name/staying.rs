//! What was named and is only what every axis has a [`little`](crate::offline::gap::model::little) of: it stays with the base, without a name.
//!
//! Invariant: what is named beside it is named as before, and the model that is compared with the base has it too.

use super::named::NamedEffect;
use crate::offline::gap::fit::{Effort, Fitted, fit, total_of};
use crate::offline::gap::model::Model;
use crate::offline::gap::model::little::{end_s, is_drift, is_of_the_fall, is_stick};
use crate::offline::gap::model::problem::Problem;
use crate::plant::effects::warmed_share;

/// What changes steadily: its time constant in times of all runs, and its change until they end as a share of that of a
/// friction which settles.
const FAR: f64 = 30.0;
const EVEN: f64 = 0.8;

/// A base and a model with what was named first, where what every axis has a little of has no name: it stays with the base, and so does what
/// cannot be told from it.
pub(super) fn without_little(
    problem: &Problem<'_>,
    named: &mut Vec<NamedEffect>,
    [base, model]: [Fitted; 2],
) -> [Fitted; 2] {
    let end_s = end_s(problem);
    let (known, all) = (named.len(), model.model.effects.len());
    let is_little = |place: &usize| {
        let tried = &model.model.effects[*place];
        let sticks = named[*place].tried().any(is_stick) || is_stick(tried);
        if sticks || is_of_the_fall(tried, &model.model.nominal.friction) {
            return true;
        }
        let longest_s = model.effect(*place).get(1).map_or(0.0, |(_, _, [_, longest_s])| *longest_s);
        let explains_as_steady = || explains_as_steady(problem, &model, *place, end_s);
        is_drift(tried, longest_s, end_s, &explains_as_steady)
    };
    let (little, staying): (Vec<usize>, Vec<usize>) = (0..known).partition(is_little);
    if little.is_empty() {
        return [base, model];
    }
    let mut place = 0..;
    named.retain(|_| place.next().is_some_and(|place| staying.contains(&place)));
    let model = model.in_order(&staying.into_iter().chain(known..all).chain(little).collect::<Vec<_>>());
    [if named.is_empty() { model.clone() } else { base }, model]
}

/// Which share of what a friction explains that changes, it explains at least where it changes steadily.
fn explains_as_steady(problem: &Problem<'_>, model: &Fitted, place: usize, end_s: f64) -> f64 {
    let time_constant_s = FAR * end_s;
    let until_then = warmed_share([1.0, time_constant_s, 0.0], end_s);
    let steadily = |model: &Model, share: f64| {
        let mut steady = model.clone();
        let drop = share * warmed_share(model.effects[place].values, end_s) / until_then;
        steady.effects[place].values = [drop, time_constant_s, 0.0];
        steady
    };
    let fitted = |start: &Model| fit(problem, start, Effort::Fine, None);
    let steady = fitted(&steadily(&model.model, EVEN));
    // Where the fit went back to what settles.
    let steady = total_of(problem, &steadily(&steady.model, 1.0));
    let without = fitted(&model.model.without(place)).total;
    (without - steady) / (without - model.total)
}
