//! What was named of an axis, and what it is named from.
//!
//! Invariant: the base and the model that are held against each other stand on the same rows.

use std::fmt;

use serde::Serialize;

use crate::offline::gap::fit::Fitted;
use crate::offline::gap::fit::blocks::Blocks;
use crate::offline::gap::gates::Gate;
use crate::offline::gap::gates::candidate::Candidate;
use crate::offline::gap::model::Tried;
use crate::offline::gap::model::usual::is_usual;
use crate::offline::gap::shortlist::smallest::Smallest;
use crate::plant::effects::{CATALOGUE, Experiment, entry};

/// Beside what was named later an effect of which less than this share is left stood for that: by so much two laws of one effect differ.
const LEFT: f64 = 0.05;

/// What an axis lacks.
#[derive(Debug)]
pub struct Named {
    /// By how much the clock of each run had to be set forward, s, where they have none in common.
    pub clocks_behind_s: Option<Vec<f64>>,
    /// The base alone.
    pub base: Fitted,
    /// Base and all that was named.
    pub model: Fitted,
    /// What both cost on the rows that were not fitted.
    pub(in crate::offline::gap) blocks: [Blocks; 2],
    /// What was named, in order, with what could not be told from it.
    pub effects: Vec<NamedEffect>,
    /// The best that failed a gate in the last round.
    pub refused: Vec<Candidate>,
    /// Beside what was named, what else would have been.
    pub smallest: Vec<Smallest>,
    /// Rows of both parts.
    pub rows: [usize; 2],
}

impl Named {
    /// Costs of the base and of all that was named on the rows that were not fitted.
    pub fn held(&self) -> [f64; 2] {
        self.blocks.each_ref().map(Blocks::cost)
    }

    /// How many of the effects were searched for, and not fitted with the base from the beginning.
    pub(in crate::offline::gap) fn searched(&self) -> usize {
        let is_usual = |name| entry(name).is_some_and(is_usual);
        self.effects.iter().filter(|effect| !effect.members().any(is_usual)).count()
    }

    /// Takes back what was named: it passed every gate and explains too little all the same.
    pub fn withdraw(&mut self) {
        let taken_back = self.effects.drain(..).filter_map(|effect| effect.refused_by(Gate::Explains));
        self.refused.extend(taken_back);
        self.model = self.base.clone();
        self.blocks[1] = self.blocks[0].clone();
    }
}

/// An effect that was named.
#[derive(Debug)]
pub struct NamedEffect {
    /// Its name.
    pub name: &'static str,
    /// The best first, each with how probable it is among them.
    pub class: Vec<(Candidate, f64)>,
    /// The next that is none of them.
    pub runner_up: Option<RunnerUp>,
}

/// What came next, and why it is not what was named.
#[derive(Clone, Debug, Serialize)]
pub struct RunnerUp {
    /// Its name.
    pub name: &'static str,
    /// How much less it explains, in units of the logarithm of probability, twice; less than nothing where a gate alone is against it.
    pub behind: f64,
    /// The gates it did not pass.
    pub failed: Vec<Gate>,
    /// Whether it explains as much, and only that it takes more numbers is against it.
    pub is_as_good: bool,
}

impl fmt::Display for RunnerUp {
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

impl NamedEffect {
    /// The best of its class, which a gate refused after all.
    pub(super) fn refused_by(self, gate: Gate) -> Option<Candidate> {
        let (mut best, _) = self.class.into_iter().next()?;
        best.failed.push(gate);
        Some(best)
    }

    /// What is named beside it explains something else, and is none of its class.
    pub(super) fn apart_from(&mut self, named: &[&str]) {
        let name = self.name;
        self.class.retain(|(one, _)| one.name() == name || !named.contains(&one.name()));
        let all: f64 = self.class.iter().map(|(_, weight)| weight).sum();
        self.class.iter_mut().for_each(|(_, weight)| *weight /= all);
    }

    /// Its class with the values of each, the best first.
    pub(in crate::offline::gap) fn tried(&self) -> impl Iterator<Item = &Tried> {
        self.class.iter().filter_map(|(candidate, _)| candidate.fitted.model.effects.last())
    }

    /// Whether next to nothing is left, as it is tried now, of what it was when it was named.
    pub(super) fn has_shrunk(&self, now: &Tried) -> bool {
        let is_left = |then: &Tried| {
            let mut amplitudes = now.entry.amplitudes();
            amplitudes.any(|place| now.values[place].abs() > LEFT * then.values[place].abs())
        };
        !self.tried().take(1).any(|then| then.entry.name != now.entry.name || is_left(then))
    }

    /// How probable a member of its class is. What explains as much is as likely, whatever it takes to say it.
    pub fn confidence(&self, rank: usize) -> f64 {
        let is_doubted = self.runner_up.as_ref().is_some_and(|next| next.is_as_good);
        self.class[rank].1 * if is_doubted { 0.5 } else { 1.0 }
    }

    /// Names of its class, the best first.
    pub fn members(&self) -> impl Iterator<Item = &'static str> {
        self.class.iter().map(|(candidate, _)| candidate.name())
    }

    /// What an axis must do to tell it from the others of its class; nothing where it is alone, or where no log tells
    /// them apart.
    pub fn told_apart_by(&self) -> Option<Experiment> {
        let mut others = self.members();
        let open = others.find(|other| *other != self.name && !is_alias(self.name, other))?;
        Some(entry(open)?.experiment)
    }
}

/// Whether no data of this kind tell one effect from another.
pub(super) fn is_alias(name: &str, other: &str) -> bool {
    CATALOGUE.iter().any(|entry| {
        (entry.name == name && entry.aliases.contains(&other))
            || (entry.name == other && entry.aliases.contains(&name))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::offline::gap::name::near::tests::candidate;

    #[test]
    fn what_is_named_beside_an_effect_is_no_other_explanation_of_it() {
        let members = [("torque-ripple", 0.375), ("backlash", 0.125), ("reversal-compensation", 0.5)];
        let class = members.map(|(name, weight)| (candidate(name, 1_000.0), weight)).to_vec();
        let mut named = NamedEffect { name: "torque-ripple", class, runner_up: None };
        named.apart_from(&["torque-ripple", "reversal-compensation"]);
        let left: Vec<(&str, f64)> = named.class.iter().map(|(one, weight)| (one.name(), *weight)).collect();
        assert_eq!(left, [("torque-ripple", 0.75), ("backlash", 0.25)]);
        for (is_as_good, confidence) in [(false, 0.75), (true, 0.375)] {
            let failed = Vec::new();
            named.runner_up = Some(RunnerUp { name: "soft-zone", behind: 16.7, failed, is_as_good });
            assert_eq!(named.confidence(0), confidence);
        }
    }

    #[test]
    fn what_has_a_twentieth_left_of_what_it_was_has_shrunk() {
        let friction = candidate("position-dependent-friction", 1_000.0);
        let then = friction.fitted.model.effects[0];
        let named = NamedEffect { name: friction.name(), class: vec![(friction, 1.0)], runner_up: None };
        let left = |share: f64| Tried { values: [-share * then.values[0], 0.0, 0.0], ..then };
        assert_eq!([0.04, 0.06, 1.0].map(|share| named.has_shrunk(&left(share))), [true, false, false]);
        let spot = entry("position-dependent-friction-spot").expect("another law of it");
        assert!(!named.has_shrunk(&Tried { entry: spot, ..left(0.04) }));
    }

    #[test]
    fn what_is_not_named_is_said_with_its_reason() {
        let told = |behind: f64, failed: Vec<Gate>, is_as_good: bool| {
            RunnerUp { name: "spring-load", behind, failed, is_as_good }.to_string()
        };
        let next = |behind, failed| told(behind, failed, false);
        assert_eq!(next(812.3, Vec::new()), "not spring-load: it explains less, by 812 units of chi square");
        assert_eq!(next(-5.0, vec![Gate::Bounds]), "not spring-load: it has a value at its bound");
        let as_good = told(16.7, Vec::new(), true);
        assert_eq!(as_good, "not spring-load: it explains as much, but with more numbers");
    }
}
