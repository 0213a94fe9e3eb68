//! What a scenario expects against what was seen: one finding for each expectation.
//!
//! Invariant: a finding names what was measured, the bound and the unit; what could not be measured is
//! named as unjudged, never as met.

use std::fmt;

use serde::Serialize;

use super::witness::{Ending, Evidence};
use crate::base::axis::AxisId;
use crate::base::units::Position;
use crate::config::Machine;
use crate::config::scenario::{Expectations, ExpectedEnding};

/// One expectation, judged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Its key in the scenario.
    pub expectation: &'static str,
    /// What was seen.
    pub measured: String,
    /// What was wanted.
    pub wanted: String,
    /// Whether it was met.
    pub is_met: bool,
}

impl fmt::Display for Finding {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { expectation, measured, wanted, is_met } = self;
        let verdict = if *is_met { "as expected" } else { "NOT as expected" };
        write!(out, "{expectation}: {measured}, wanted {wanted}: {verdict}")
    }
}

/// A run with its judgement.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// What was seen.
    pub evidence: Evidence,
    /// Each expectation that was judged, in order of the scenario's keys.
    pub findings: Vec<Finding>,
    /// Expectations that only the truth could tell, where nobody knew it.
    pub unjudged: Vec<&'static str>,
}

impl Outcome {
    /// Whether everything came as expected.
    pub fn is_met(&self) -> bool {
        self.findings.iter().all(|finding| finding.is_met)
    }
}

/// Judges what was seen.
pub fn judge(expect: &Expectations, machine: &Machine, evidence: Evidence) -> Outcome {
    let mut findings = vec![ending(expect.ending, machine, &evidence)];
    let cycles = [
        (
            "own-current-zero-within-cycles",
            expect.own_current_zero_within_cycles,
            evidence.own_current_zero_after(),
        ),
        ("current-zero-within-cycles", expect.current_zero_within_cycles, evidence.all_current_zero_after()),
        ("rest-within-cycles", expect.rest_within_cycles, evidence.rest_after),
    ];
    for (expectation, bound, measured) in cycles {
        findings.extend(bound.map(|bound| Finding {
            expectation,
            measured: measured.map_or("never".to_owned(), |cycles| format!("{cycles} cycles")),
            wanted: format!("{bound} cycles or fewer"),
            is_met: measured.is_some_and(|cycles| cycles <= bound),
        }));
    }
    let lengths = [
        ("position-error-max-um", expect.position_error_max, evidence.position_error),
        ("path-error-max-um", expect.path_error_max, evidence.path_error),
    ];
    let mut unjudged = Vec::new();
    for (expectation, bound, measured) in lengths {
        match (bound, measured) {
            (Some(bound), Some(length)) => findings.push(Finding {
                expectation,
                measured: um(length),
                wanted: format!("{} or less", um(bound)),
                is_met: length <= bound,
            }),
            (Some(_), None) => unjudged.push(expectation),
            (None, _) => {}
        }
    }
    findings.extend(expect.protrusion.map(|(low, high)| {
        let measured = evidence.protrusion_um.map(Position::um);
        Finding {
            expectation: "protrusion-um",
            measured: measured.map_or("no whole circle".to_owned(), um),
            wanted: format!("{} to {}", um(low), um(high)),
            is_met: measured.is_some_and(|height| low <= height && height <= high),
        }
    }));
    Outcome { evidence, findings, unjudged }
}

fn um(length: Position) -> String {
    format!("{:.3} um", length.as_um())
}

fn ending(expected: ExpectedEnding, machine: &Machine, evidence: &Evidence) -> Finding {
    let faults: Vec<String> = evidence
        .faults
        .iter()
        .filter_map(|(axis, fault)| Some(format!("axis {axis} {}", (*fault)?.name())))
        .collect();
    let measured = match &evidence.ending {
        Ending::Complete => "complete".to_owned(),
        Ending::Faulted if faults.is_empty() => "faulted".to_owned(),
        Ending::Faulted => format!("faulted ({})", faults.join(", ")),
        Ending::Refused(why) => format!("refused ({why})"),
        Ending::Unfinished => "unfinished".to_owned(),
    };
    let (wanted, is_met) = match expected {
        ExpectedEnding::Complete => ("complete".to_owned(), evidence.ending == Ending::Complete),
        ExpectedEnding::Refused => ("refused".to_owned(), matches!(evidence.ending, Ending::Refused(_))),
        ExpectedEnding::Faulted { fault, axis } => {
            let axes: Vec<AxisId> = match axis {
                Some(axis) => vec![axis],
                None => machine.axes.axes().collect(),
            };
            let has_it = |axis: &AxisId| evidence.faults[*axis] == Some(fault);
            let who = axis.map_or("each axis".to_owned(), |axis| format!("axis {axis}"));
            let is_met = evidence.ending == Ending::Faulted && axes.iter().all(has_it);
            (format!("faulted ({who} {})", fault.name()), is_met)
        }
    };
    Finding { expectation: "ending", measured, wanted, is_met }
}
