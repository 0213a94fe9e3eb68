//! Watches a run cycle by cycle and keeps what it is judged by.
//!
//! Records say what the host believed and did; the truth, where there is a simulated machine at hand,
//! says what the axes did. Without it the drives' own words stand for the current, and the last fresh
//! samples for the motion.
//! Invariant: counts are in cycles since the first scripted fault began; nothing before it is counted.

use super::cycle_at;
use super::path::Path;
use super::stage::Truth;
use crate::base::axis::{AxisId, PerAxis};
use crate::base::fault::Fault;
use crate::base::record::{AxisRecord, CycleRecord, ModeTag};
use crate::base::sample::Freshness;
use crate::base::time::Moment;
use crate::base::units::{Current, Position, Velocity};
use crate::config::Machine;
use crate::rt::drive::state::DriveState;
use crate::sim::script::Script;
use crate::sim::truth::AxisTruth;

/// Cycles between two looks at the distance from the path.
const LOOK_EVERY: u64 = 4;

/// How a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The motion was carried out.
    Complete,
    /// A fault stopped it.
    Faulted,
    /// Nothing was enabled or moved, and why.
    Refused(String),
    /// It came to no end in its time.
    Unfinished,
}

/// What was seen of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    /// How it ended.
    pub ending: Ending,
    /// Cycles that were run.
    pub cycles: u64,
    /// The first fault of its own that each axis had.
    pub faults: PerAxis<Option<Fault>>,
    /// Cycles from the first scripted fault until the first axis had a fault.
    pub named_after: Option<u64>,
    /// Until the drive of each axis gives no current, for good; `None`: it still does.
    pub current_zero_after: PerAxis<Option<u64>>,
    /// Until every motor and table stands, for good; `None`: one still moves.
    pub rest_after: Option<u64>,
    /// Until both are so and no axis is under control.
    pub stop_after: Option<u64>,
    /// Largest error of a fresh position that control acted on; `None` without the truth.
    pub position_error: Option<Position>,
    /// Largest distance from the path after the first scripted fault; `None` without the truth.
    pub path_error: Option<Position>,
    /// Oldest sample under which an axis was under control, in cycles.
    pub age_cycles: u32,
    /// Highest protrusion of a circle, um, where it was asked for.
    pub protrusion_um: Option<f64>,
}

impl Evidence {
    /// Cycles until no drive gives current; `None`: one still does.
    pub fn all_current_zero_after(&self) -> Option<u64> {
        self.current_zero_after.as_slice().iter().try_fold(0, |all, own| Some(all.max((*own)?)))
    }

    /// The same of the axes that had a fault of their own.
    pub fn own_current_zero_after(&self) -> Option<u64> {
        let own = self.faults.iter().filter(|(_, fault)| fault.is_some());
        own.map(|(axis, _)| self.current_zero_after[axis]).try_fold(0, |all, own| Some(all.max(own?)))
    }
}

/// Watches a run.
#[derive(Debug)]
pub struct Witness {
    standstill: PerAxis<Velocity>,
    struck: u64,
    path: Path,
    /// The last cycles with current, with motion, and with an axis under control.
    last_current: PerAxis<Option<u64>>,
    last_motion: Option<u64>,
    last_control: Option<u64>,
    last: u64,
    evidence: Evidence,
}

impl Witness {
    /// A witness of a machine under a script.
    pub fn new(machine: &Machine, script: &Script) -> Self {
        let first = script.faults.iter().map(|fault| fault.at).min().unwrap_or_default();
        Self {
            standstill: machine.axes.map(|_, axis| axis.control.limits.standstill),
            struck: cycle_at(machine, Moment::ZERO + first),
            path: Path::default(),
            last_current: PerAxis::filled(machine.axes.count(), None),
            last_motion: None,
            last_control: None,
            last: 0,
            evidence: Evidence {
                ending: Ending::Unfinished,
                cycles: 0,
                faults: PerAxis::filled(machine.axes.count(), None),
                named_after: None,
                current_zero_after: PerAxis::filled(machine.axes.count(), None),
                rest_after: None,
                stop_after: None,
                position_error: None,
                path_error: None,
                age_cycles: 0,
                protrusion_um: None,
            },
        }
    }

    /// A cycle has been run; `truths` are what each axis did at the SYNC of this cycle.
    pub fn see(&mut self, record: &CycleRecord, truths: &Truth) {
        let cycle = record.cycle;
        self.evidence.cycles += 1;
        self.last = cycle;
        for (axis, row) in record.axes.iter() {
            self.see_axis(axis, row, truths.as_ref().map(|truths| &truths[axis]), cycle);
        }
        if record.axes.as_slice().iter().any(is_energised) {
            self.path.lead(&record.axes.map(|_, row| row.setpoint.position));
        }
        if cycle >= self.struck
            && cycle.is_multiple_of(LOOK_EVERY)
            && let Some(truths) = &truths
        {
            let distance = self.path.distance(&truths.map(|_, truth| truth.position));
            raise(&mut self.evidence.path_error, distance);
        }
    }

    fn see_axis(&mut self, axis: AxisId, row: &AxisRecord, truth: Option<&AxisTruth>, cycle: u64) {
        let own = row.fault.filter(|fault| *fault != Fault::OtherAxis);
        if own.is_some() && self.evidence.faults[axis].is_none() {
            self.evidence.faults[axis] = own;
            self.evidence.named_after.get_or_insert(cycle.saturating_sub(self.struck));
        }
        let is_fresh = row.sample.freshness == Freshness::Fresh;
        let has_current = match truth {
            Some(truth) => truth.current != Current::ZERO,
            None => is_enabled(row) && row.command.current != Current::ZERO,
        };
        let moves = match truth {
            Some(truth) => !truth.is_slower_than(self.standstill[axis]),
            None => is_fresh && row.sample.velocity.abs() > self.standstill[axis],
        };
        for (is_so, last) in [
            (has_current, &mut self.last_current[axis]),
            (moves, &mut self.last_motion),
            (is_energised(row), &mut self.last_control),
        ] {
            if is_so {
                *last = Some(cycle);
            }
        }
        if is_energised(row) {
            self.evidence.age_cycles = self.evidence.age_cycles.max(row.sample.age_cycles);
            if let Some(truth) = truth.filter(|_| is_fresh && cycle >= self.struck) {
                let error = (row.sample.position - truth.position).abs();
                raise(&mut self.evidence.position_error, Some(error));
            }
        }
    }

    /// The run is over.
    pub fn finish(mut self, ending: Ending) -> Evidence {
        // The cycle after the last in which it was so, if the run went on that long.
        let (struck, end) = (self.struck, self.last);
        let after = |last: Option<u64>| match last {
            Some(last) if last >= end => None,
            Some(last) => Some((last + 1).saturating_sub(struck)),
            None => Some(0),
        };
        let evidence = &mut self.evidence;
        evidence.ending = ending;
        evidence.current_zero_after = self.last_current.map(|_, last| after(*last));
        evidence.rest_after = after(self.last_motion);
        let last_current = self.last_current.as_slice().iter().copied().max().flatten();
        evidence.stop_after = after(last_current.max(self.last_motion).max(self.last_control));
        self.evidence
    }
}

/// Whether the loops act on an axis.
fn is_energised(row: &AxisRecord) -> bool {
    matches!(row.mode, ModeTag::Ready | ModeTag::Moving | ModeTag::Stopping)
}

/// Whether the drive last said that it gives current.
pub(super) fn is_enabled(row: &AxisRecord) -> bool {
    DriveState::decode(row.sample.raw.status_word) == Some(DriveState::OperationEnabled)
}

fn raise(largest: &mut Option<Position>, seen: Option<Position>) {
    if let Some(seen) = seen {
        *largest = Some(largest.filter(|largest| *largest >= seen).unwrap_or(seen));
    }
}
