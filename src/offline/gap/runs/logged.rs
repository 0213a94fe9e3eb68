//! The runs of a log of ours: the stretches in which the loops of all axes acted and nothing else moved them.
//!
//! An axis without current follows no command, and an excitation is no part of the setpoint: rows with either are no
//! answer to the command. What a log is in needs no guess.
//! Invariant: no row is in two runs, and no stretch is left out without a word but those too short to tell anything.

use std::ops::Range;

use super::intake::{Intake, pieces};
use super::refused::{RunError, SHORTEST_S};
use crate::base::record::ModeTag;
use crate::config::Machine;
use crate::offline::identify::foreign::{Effort, ForeignAxis, Raw};
use crate::offline::trace::Trace;

/// The runs of a log.
///
/// # Errors
/// As [`of_raw`](super::intake::of_raw), but for units.
pub fn of_trace(name: &str, trace: &Trace, machine: &Machine) -> Result<Intake, RunError> {
    let stretches = in_loop(trace);
    let length_s = |rows: &Range<usize>| rows.len() as f64 * trace.period_s;
    let long: Vec<_> = stretches.iter().filter(|rows| length_s(rows) >= SHORTEST_S).collect();
    if long.is_empty() {
        let length_s = stretches.iter().map(length_s).fold(0.0, f64::max);
        return Err(RunError::TooShort { run: name.to_owned(), length_s });
    }
    let mut all = Intake::default();
    for (number, rows) in long.iter().enumerate() {
        let part = if long.len() == 1 { name.to_owned() } else { format!("{name}, stretch {}", number + 1) };
        match pieces(&part, raw_of(trace, rows, machine), machine) {
            Ok(intake) => all.extend(intake),
            // It was held, and moved in another.
            Err(RunError::Standing { .. }) if long.len() > 1 => {
                all.repaired.push(format!("{part}: left out, no axis was asked to move"));
            }
            Err(error) => return Err(error),
        }
    }
    Ok(all.taken_apart())
}

/// Rows of a log between those in which an axis was without current, followed another gain set or was excited.
fn in_loop(trace: &Trace) -> Vec<Range<usize>> {
    let is_driven = |row: usize| {
        trace.axes.iter().all(|axis| {
            matches!(axis.mode[row], ModeTag::Ready | ModeTag::Moving | ModeTag::Stopping)
                && axis.excitation_m_per_s[row] == 0.0
        })
    };
    let gains = |row: usize| trace.axes.iter().map(move |axis| axis.gain_set[row]);
    let mut stretches: Vec<Range<usize>> = Vec::new();
    for row in (0..trace.len()).filter(|row| is_driven(*row)) {
        match stretches.last_mut().filter(|last| last.end == row && gains(row).eq(gains(row - 1))) {
            Some(last) => last.end = row + 1,
            None => stretches.push(row..row + 1),
        }
    }
    stretches
}

fn raw_of(trace: &Trace, rows: &Range<usize>, machine: &Machine) -> Raw {
    let of = |column: &[f64]| column[rows.clone()].to_vec();
    let axes = (machine.axes.axes().zip(&trace.axes)).map(|(id, axis)| {
        let mut columns = ForeignAxis {
            setpoint_m: Some(of(&axis.setpoint_position_m)),
            position_m: of(&axis.motor_position_m),
            table_m: axis.table_position_m.as_deref().map(of),
            effort: Effort::Current(of(&axis.current_a)),
            controller: None,
        };
        // A stale sample is that of a cycle before.
        for (position_m, is_fresh) in columns.position_m.iter_mut().zip(&axis.is_fresh[rows.clone()]) {
            if !is_fresh {
                *position_m = f64::NAN;
            }
        }
        (machine.axis_names()[id.index()].clone(), columns)
    });
    Raw { time_s: of(&trace.time_s), axes: axes.collect() }
}
