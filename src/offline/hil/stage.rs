//! The course of a run in virtual time, over any bus, up to where it is over.
//!
//! ```text
//!   cycle ─► record ──────────┐
//!   machine ─► truth, later ──┴─► see, both of the same cycle ─► over?
//! ```
//!
//! A machine in another process tells its truth in blocks. So the cycle may be ahead of what is seen, and
//! what it did beyond the end of the run is dropped: a run has the same cycles over any bus.
//! Invariant: the end depends on what was seen, never on how far the cycle was ahead.

use std::collections::VecDeque;

use super::course::{CYCLES_AFTER_MAX, Course};
use super::witness::{Ending, is_enabled};
use crate::base::axis::PerAxis;
use crate::base::input::Input;
use crate::base::record::CycleRecord;
use crate::base::sample::Freshness;
use crate::base::units::Velocity;
use crate::config::Machine;
use crate::config::scenario::Motion;
use crate::rt::bus::Bus;
use crate::rt::cycle::Cycle;
use crate::rt::cycle::pace::{Pace, Virtual};
use crate::rt::door::Orders;
use crate::sim::closed_loop::commission;
use crate::sim::truth::{AxisTruth, BLOCK_CYCLES};

/// An axis that stands for so many cycles has come to rest; a motor that swings on its screw has not.
const CYCLES_STILL: u64 = 100;

/// Truth of all axes in a cycle; `None`: nobody knows it.
pub type Truth = Option<PerAxis<AxisTruth>>;

/// Who knows what the axes behind a bus really do.
pub trait Truths<B> {
    /// Why it may fail.
    type Error;

    /// A cycle was run: puts what is known by now behind what was known before, one truth for each cycle.
    fn learn(&mut self, bus: &B, cycle: u64, known: &mut VecDeque<Truth>) -> Result<(), Self::Error>;
}

/// Whether a run is over: not with its orders, but when the axes have come to rest.
#[derive(Debug)]
pub struct Rest {
    standstill: PerAxis<Velocity>,
    done_since: Option<u64>,
    still_for: u64,
}

impl Rest {
    /// Of a machine that is about to run.
    pub fn new(machine: &Machine) -> Self {
        let standstill = machine.axes.map(|_, axis| axis.control.limits.standstill);
        Self { standstill, done_since: None, still_for: 0 }
    }

    /// A cycle was run, and its orders were done or not: whether that was the last.
    pub fn is_over(&mut self, record: &CycleRecord, is_done: bool, truth: &Truth) -> bool {
        if !is_done {
            return false;
        }
        let since = *self.done_since.get_or_insert(record.cycle);
        let is_still = record.axes.iter().all(|(axis, row)| match truth {
            Some(truth) => truth[axis].is_still(self.standstill[axis]),
            None => {
                let is_fresh = row.sample.freshness == Freshness::Fresh;
                is_fresh && !is_enabled(row) && row.sample.velocity.abs() <= self.standstill[axis]
            }
        });
        self.still_for = if is_still { self.still_for + 1 } else { 0 };
        self.still_for > CYCLES_STILL || record.cycle - since > CYCLES_AFTER_MAX
    }
}

/// A cycle that was run and not yet seen.
struct Pending {
    record: CycleRecord,
    inputs: Vec<Input>,
    is_done: bool,
}

/// One run; `see` is shown each cycle of it, its inputs, and the truth.
pub(super) fn run<B: Bus, T: Truths<B>>(
    machine: &Machine,
    motion: &Motion,
    bus: &mut B,
    truths: &mut T,
    mut see: impl FnMut(&CycleRecord, &[Input], &Truth),
) -> Result<Ending, T::Error> {
    let drives = match machine.drives() {
        Ok(drives) => drives,
        Err(error) => return Ok(Ending::Refused(error.to_string())),
    };
    let drives = match commission(bus, drives) {
        Ok(drives) => drives,
        Err(error) => return Ok(Ending::Refused(error.to_string())),
    };
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let mut course = Course::new(motion);
    let mut pace = Virtual::new(machine.cycle.period);
    let mut rest = Rest::new(machine);
    let mut ending = None;
    let (mut pending, mut known) = (VecDeque::new(), VecDeque::new());
    // Whole blocks, so that the truth of the last cycle is told.
    let cycles_max = course.cycles_max(machine.cycle.period).next_multiple_of(BLOCK_CYCLES);
    for _ in 0..cycles_max {
        let slot = pace.wait();
        let (record, inputs) = cycle.run(bus, &mut course, &slot, &mut || pace.now());
        let (record, inputs) = (*record, inputs.iter().copied().collect());
        // Where a run of the programs ends; what follows shows what it leaves behind.
        if ending.is_none() && course.is_done(&record) && cycle.is_at_rest() {
            ending = Some(course.ending(&record));
        }
        pending.push_back(Pending { record, inputs, is_done: ending.is_some() });
        truths.learn(bus, slot.number, &mut known)?;
        while let (Some(Pending { record, inputs, is_done }), Some(truth)) = (pending.front(), known.front())
        {
            see(record, inputs, truth);
            if rest.is_over(record, *is_done, truth) {
                return Ok(ending.unwrap_or(Ending::Unfinished));
            }
            pending.pop_front();
            known.pop_front();
        }
    }
    Ok(Ending::Unfinished)
}
