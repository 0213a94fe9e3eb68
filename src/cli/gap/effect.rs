//! An effect that was named, for people and for scripts: its values, why it is no other, and what would falsify it.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use crate::offline::gap::candidate::Candidate;
use crate::offline::gap::consequence::Consequence;
use crate::offline::gap::fit::Fitted;
use crate::offline::gap::gates::Gate;
use crate::offline::gap::named::RunnerUp;
use crate::offline::gap::problem::shown;
use crate::offline::gap::runs::Run;

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
    pub(super) runner_up: Option<Next>,
    /// What would show that it is none.
    pub(super) falsified_by: Option<Falsified>,
}

/// What is not named, and why.
#[derive(Debug, Serialize)]
pub(super) struct Next {
    name: &'static str,
    /// How much less it explains, in units of the logarithm of probability, twice.
    behind: f64,
    failed: Vec<Gate>,
    /// Whether it explains as much, and only takes more numbers.
    is_as_good: bool,
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

impl Next {
    pub(super) fn new(next: &RunnerUp) -> Self {
        let RunnerUp { name, behind, ref failed, is_as_good } = *next;
        Self { name, behind, failed: failed.clone(), is_as_good }
    }
}

impl fmt::Display for Next {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "not {}:", self.name)?;
        let mut reasons: Vec<String> = self.failed.iter().map(|gate| format!("it {gate}")).collect();
        if self.is_as_good {
            reasons.push("it explains as much, but with more numbers".to_owned());
        } else if self.behind > 0.0 {
            reasons.push(format!("it explains less, by {:.0} units of chi square", self.behind));
        }
        write!(out, " {}", reasons.join(", "))
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

    #[test]
    fn what_is_not_named_is_said_with_its_reason() {
        let told = |behind: f64, failed: Vec<Gate>, is_as_good: bool| {
            Next { name: "spring-load", behind, failed, is_as_good }.to_string()
        };
        let next = |behind, failed| told(behind, failed, false);
        assert_eq!(next(812.3, Vec::new()), "not spring-load: it explains less, by 812 units of chi square");
        assert_eq!(next(-5.0, vec![Gate::Bounds]), "not spring-load: it has a value at its bound");
        let as_good = told(16.7, Vec::new(), true);
        assert_eq!(as_good, "not spring-load: it explains as much, but with more numbers");
    }
}
