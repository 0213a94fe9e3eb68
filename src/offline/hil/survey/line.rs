//! A line of the survey: what the runs of one case came to.
//!
//! Invariant: counts of outcomes add up to the runs; a run without a stop has no time to it, and one that
//! never came to it is told as never.

use std::collections::BTreeMap;

use serde::{Serialize, Serializer};

use super::{Case, Run, Survey, further};
use crate::base::units::Position;
use crate::offline::hil::Ending;

/// Cycles until something was so, over the runs in which it should have become so.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Extent {
    /// In the middle of the runs; `None`: never.
    pub median: Option<u64>,
    /// In the worst; `None`: never.
    pub max: Option<u64>,
}

impl Extent {
    /// Over these; `None` where there are none.
    fn of(cycles: impl Iterator<Item = Option<u64>>) -> Option<Self> {
        let mut cycles: Vec<u64> = cycles.map(|cycles| cycles.unwrap_or(u64::MAX)).collect();
        cycles.sort_unstable();
        let told = |cycles: u64| Some(cycles).filter(|cycles| *cycles < u64::MAX);
        let max = told(*cycles.last()?);
        let median = cycles.get((cycles.len() - 1) / 2).copied().and_then(told);
        Some(Self { median, max })
    }
}

/// A run that went on with data that were more wrong than may stay unseen.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CarriedOn {
    /// Kind of the fault.
    pub fault: &'static str,
    /// How much of it.
    pub how: String,
    /// The axis it happened to; `None`: the bus.
    pub axis: Option<String>,
    /// When it began, s since the first SYNC.
    pub at_s: f64,
    /// How the run ended.
    pub outcome: String,
    /// How wrong a position was that a closed loop acted on, um.
    pub position_error_um: f64,
    /// How wrong it may be unseen, um.
    pub unseen_um: f64,
}

/// What the runs of one case came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// Kind of the fault.
    pub fault: &'static str,
    /// How much of it.
    pub how: String,
    /// Runs by how they ended: number and name of the fault, `complete`, `refused`, `unfinished`.
    pub outcomes: BTreeMap<String, usize>,
    /// Until the drives of axes with a fault of their own gave no current; absent where there was no fault.
    pub current_zero_cycles: Option<Extent>,
    /// Until every motor and table stood.
    pub rest_cycles: Option<Extent>,
    /// Largest error of a fresh position that a closed loop acted on; absent where none did.
    #[serde(serialize_with = "um", rename = "position_error_um")]
    pub position_error: Option<Position>,
    /// Furthest that the true place was from the circle.
    #[serde(serialize_with = "um", rename = "off_circle_um")]
    pub off_circle: Option<Position>,
    /// Cycles of current by an old command, in the worst run.
    pub old_command_cycles: u64,
    /// Runs that went on with wrong data.
    pub carried_on: Vec<CarriedOn>,
}

fn um<S: Serializer>(length: &Option<Position>, serializer: S) -> Result<S::Ok, S::Error> {
    length.map(Position::as_um).serialize(serializer)
}

fn largest(lengths: impl Iterator<Item = Option<Position>>) -> Option<Position> {
    lengths.flatten().reduce(further)
}

/// How a run ended, in a word.
fn outcome(run: &Run) -> String {
    match (&run.evidence.ending, run.fault()) {
        (Ending::Complete, None) => "complete".to_owned(),
        (Ending::Refused(_), _) => "refused".to_owned(),
        (Ending::Unfinished, None) => "unfinished".to_owned(),
        (Ending::Faulted, None) => "faulted".to_owned(),
        (Ending::Complete | Ending::Unfinished | Ending::Faulted, Some(fault)) => {
            format!("{} {}", fault.number(), fault.name())
        }
    }
}

impl Line {
    pub(super) fn of(case: &Case, runs: &[Run], survey: &Survey) -> Self {
        let mut outcomes = BTreeMap::new();
        for run in runs {
            *outcomes.entry(outcome(run)).or_default() += 1;
        }
        let stopped = || runs.iter().map(|run| (run, &run.evidence)).filter(|(run, _)| run.fault().is_some());
        let unseen = survey.unseen(&case.effect);
        let carried_on = |run: &Run| {
            let error = run.evidence.position_error.filter(|error| *error > unseen)?;
            Some(CarriedOn {
                fault: case.fault(),
                how: case.how.clone(),
                axis: run.axis.map(|axis| axis.to_string()),
                at_s: run.at.as_s(),
                outcome: outcome(run),
                position_error_um: error.as_um(),
                unseen_um: unseen.as_um(),
            })
        };
        Self {
            fault: case.fault(),
            how: case.how.clone(),
            outcomes,
            current_zero_cycles: Extent::of(stopped().map(|(_, seen)| seen.own_current_zero_after())),
            rest_cycles: Extent::of(stopped().map(|(_, seen)| seen.rest_after)),
            position_error: largest(runs.iter().map(|run| run.evidence.position_error)),
            off_circle: largest(runs.iter().map(|run| run.off_circle)),
            old_command_cycles: runs.iter().map(|run| run.old_command_cycles).max().unwrap_or(0),
            carried_on: runs.iter().filter_map(carried_on).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_extent_has_its_middle_and_its_worst_and_knows_never() {
        let of = |cycles: &[Option<u64>]| Extent::of(cycles.iter().copied());
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[Some(9), Some(2), Some(4)]), Some(Extent { median: Some(4), max: Some(9) }));
        assert_eq!(of(&[Some(9), Some(2)]), Some(Extent { median: Some(2), max: Some(9) }));
        assert_eq!(of(&[None, Some(2), Some(3)]), Some(Extent { median: Some(3), max: None }));
        assert_eq!(of(&[None]), Some(Extent { median: None, max: None }));
    }
}
