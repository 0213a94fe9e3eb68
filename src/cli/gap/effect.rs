//! An effect that was named, for people and for scripts: its values, why it is no other, and what would falsify it.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use crate::offline::gap::fit::Fitted;
use crate::offline::gap::gates::candidate::Candidate;
use crate::offline::gap::model::problem::shown;
use crate::offline::gap::name::named::RunnerUp;
use crate::offline::gap::runs::Run;
use crate::offline::gap::show::consequence::Consequence;

#[derive(Debug, Serialize)]
pub(super) struct Effect {
    pub(super) axis: String,
    pub(super) name: &'static str,
    parameters: BTreeMap<String, f64>,
    interval: BTreeMap<String, [f64; 2]>,
    confidence: f64,
    alternatives: Vec<&'static str>,
    /// What would tell it from those of its class; nothing where nothing does, or none is needed.
    pub(super) told_apart_by: Option<String>,
    /// What came next, where the effect is alone.
    pub(super) runner_up: Option<RunnerUp>,
    /// What would show that it is none.
    pub(super) falsified_by: Option<Falsified>,
}

/// Runs that the file without the effect would have to foretell as well as with it.
#[derive(Debug, Serialize)]
pub(super) struct Falsified {
    experiment: String,
    /// Where the two are furthest apart of what was recorded.
    run: String,
    signal: &'static str,
    unit: &'static str,
    /// How far, rms.
    apart: f64,
    /// Noise, rms.
    noise: f64,
}

impl fmt::Display for Effect {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}:", self.name)?;
        let [.., values, confidence] = self.cells();
        write!(out, " {values}, confidence {confidence}")?;
        if !self.alternatives.is_empty() {
            write!(out, ", or else {}", self.alternatives.join(" or "))?;
        }
        self.sentences().iter().try_for_each(|sentence| write!(out, "\n    {sentence}"))
    }
}

impl Falsified {
    pub(super) fn new(effect: &Candidate, follows: &Consequence, runs: &[Run]) -> Self {
        let (signal, factor, unit) = shown(follows.signal);
        let entry = effect.fitted.model.effects.last().map(|tried| tried.entry);
        Self {
            experiment: entry.map_or_else(String::new, |entry| entry.experiment.to_string()),
            run: runs[follows.run].name.clone(),
            signal,
            unit,
            apart: factor * follows.rms,
            noise: factor * follows.noise,
        }
    }
}

impl fmt::Display for Falsified {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { experiment, run, signal, unit, apart, noise } = self;
        write!(
            out,
            "falsified by {experiment}, recorded anew, that the file without it foretells as well: of {run} it has the {signal} off by {} {unit} rms (noise {})",
            short(*apart),
            short(*noise)
        )
    }
}

impl Effect {
    pub(super) fn new(
        axis: String,
        fitted: &Fitted,
        place: usize,
        confidence: f64,
        alternatives: Vec<&'static str>,
    ) -> Self {
        let values = fitted.effect(place);
        Self {
            axis,
            name: fitted.model.effects[place].entry.effect(),
            parameters: values.iter().map(|(key, value, _)| ((*key).to_owned(), *value)).collect(),
            interval: values.into_iter().map(|(key, _, interval)| (key.to_owned(), interval)).collect(),
            confidence,
            alternatives,
            told_apart_by: None,
            runner_up: None,
            falsified_by: None,
        }
    }

    /// Axis, name, values with intervals, and confidence, as cells of a table.
    pub(super) fn cells(&self) -> [String; 4] {
        let values = self.parameters.iter().map(|(key, value)| match self.interval.get(key) {
            Some([low, high]) => format!("{key} {} ({} to {})", short(*value), short(*low), short(*high)),
            None => format!("{key} {}", short(*value)),
        });
        let values: Vec<String> = values.collect();
        [self.axis.clone(), self.name.to_owned(), values.join(", "), format!("{:.2}", self.confidence)]
    }

    /// Why it is this and no other, and what would falsify it.
    pub(super) fn sentences(&self) -> Vec<String> {
        let apart = self.told_apart_by.iter().map(|by| format!("told apart from its class by {by}"));
        let next = self.runner_up.iter().map(ToString::to_string);
        apart.chain(next).chain(self.falsified_by.iter().map(ToString::to_string)).collect()
    }

    /// The same with a second harmonic of its own in it.
    fn take_in(&mut self, harmonic: Self) {
        let second = |key: &String| format!("second-{key}");
        self.parameters.extend(harmonic.parameters.iter().map(|(key, value)| (second(key), *value)));
        self.interval.extend(harmonic.interval.iter().map(|(key, interval)| (second(key), *interval)));
    }
}

/// Each effect of an axis once.
pub(super) fn once(effects: impl Iterator<Item = Effect>) -> Vec<Effect> {
    let mut all: Vec<Effect> = Vec::new();
    for effect in effects {
        match all.iter_mut().find(|first| first.axis == effect.axis && first.name == effect.name) {
            Some(first) => first.take_in(effect),
            None => all.push(effect),
        }
    }
    all
}

/// Three digits that say something.
pub(super) fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let places = 2 - value.abs().log10().floor().clamp(-6.0, 2.0) as i32;
    format!("{value:.*}", places.max(0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_harmonic_is_told_with_its_effect() {
        let cogging = |axis: &str, torque_nm: f64| Effect {
            axis: axis.to_owned(),
            name: "motor-cogging",
            parameters: BTreeMap::from([("torque-nm".to_owned(), torque_nm)]),
            interval: BTreeMap::from([("torque-nm".to_owned(), [0.9 * torque_nm, 1.1 * torque_nm])]),
            confidence: 1.0,
            alternatives: Vec::new(),
            told_apart_by: None,
            runner_up: None,
            falsified_by: None,
        };
        let effects = once([cogging("x", 2.0), cogging("y", 3.0), cogging("x", 1.0)].into_iter());
        let [x, y] = effects.as_slice() else { panic!("{effects:?}") };
        assert_eq!(x.parameters.values().copied().collect::<Vec<f64>>(), [1.0, 2.0]);
        assert!(x.interval.contains_key("second-torque-nm"));
        assert_eq!(y.parameters.len(), 1);
    }
}
