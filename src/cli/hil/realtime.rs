//! A scenario over a virtual CAN interface on the wall clock: the cycle on its thread, the judgement here.
//!
//! ```text
//!   cycle ─► records ─┐
//!   hil-sim ─► truth ─┴─► watch ─► over? ─► the cycle ends
//! ```

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use anyhow::Context;

use super::super::live::joined;
use super::logs::Log;
use super::on_bus::OnBus;
use super::peer::Truth;
use crate::base::input::Input;
use crate::base::record::CycleRecord;
use crate::log::Pace;
use crate::offline::hil::{self, Course, Ending, Rest, Watch};
use crate::rt::cycle::pace::Wall;
use crate::rt::cycle::{Cycle, conduct};
use crate::rt::door::{Order, Orders, RecordDrain, record_ring};
use crate::run::{self, Origin, Prepared};

/// Records on their way to the judgement: seconds of a cycle at 2 kHz.
const RING_RECORDS: usize = 8_192;

impl OnBus<'_> {
    /// On the wall clock.
    pub(super) fn on_the_clock(&self, log: &mut Log) -> anyhow::Result<hil::Outcome> {
        self.ensure_virtual()?;
        // Before there is a second thread.
        let prepared = Prepared::new(&self.scenario.machine, Some(self.interface))?;
        prepared.judge(false)?;
        self.with_peer(Pace::Realtime, |truth| self.watched(prepared, truth, log))
    }

    fn watched(
        &self,
        prepared: Prepared<Course>,
        mut truth: Option<&mut Truth>,
        log: &mut Log,
    ) -> anyhow::Result<hil::Outcome> {
        let machine = &self.scenario.machine;
        let mut watch = Watch::new(self.scenario);
        let mut bus = run::open(machine, self.interface, &[])?;
        let drives = match run::commission(&mut bus, machine.drives()?) {
            Ok(drives) => drives,
            Err(error) => return Ok(watch.judge(Ending::Refused(error.to_string()))),
        };
        let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
        let (mut records, drain) = record_ring(RING_RECORDS);
        let shared = Arc::new(Shared::default());
        let course = Course::new(&self.scenario.motion);
        let cycles_max = course.cycles_max(machine.cycle.period);
        let mut orders = UntilOver { course, shared: Arc::clone(&shared), cycles_max };
        let (origin, period) = (Origin::soon().monotonic, machine.cycle.period);
        bus.set_origin(origin);
        let conductor = prepared.thread.give(move || {
            conduct(&mut cycle, &mut bus, &mut Wall::starting_at(origin, period), &mut orders, &mut records);
            orders.course
        });

        let mut rest = Rest::new(machine);
        let mut done = None;
        let outcome = each(drain, |record, inputs| {
            let truth = match &mut truth {
                Some(truth) => truth.of_cycle(record.cycle as u32)?,
                None => None,
            };
            watch.see(record, &truth);
            log.put(record, inputs);
            let is_done = record.cycle >= shared.done_at.load(Ordering::Relaxed);
            if is_done && done.is_none() {
                done = Some(*record);
            }
            let is_over = rest.is_over(record, is_done, &truth);
            if is_over {
                shared.is_over.store(true, Ordering::Relaxed);
            }
            Ok(is_over)
        });
        shared.is_over.store(true, Ordering::Relaxed);
        let course = joined(conductor).context("the thread of the cycle ended without having run it")?;
        outcome?;
        Ok(watch.judge(done.map_or(Ending::Unfinished, |last| course.ending(&last))))
    }
}

/// What the thread of the cycle shares with the judgement.
struct Shared {
    /// The first cycle in which the orders were done.
    done_at: AtomicU64,
    /// Nothing more is to be seen.
    is_over: AtomicBool,
}

impl Default for Shared {
    fn default() -> Self {
        Self { done_at: AtomicU64::new(u64::MAX), is_over: AtomicBool::new(false) }
    }
}

/// The orders of a course; the cycle goes on after them until the axes were seen at rest.
struct UntilOver {
    course: Course,
    shared: Arc<Shared>,
    cycles_max: u64,
}

impl Orders for UntilOver {
    fn next(&mut self, last: &CycleRecord) -> Option<Order> {
        let order = self.course.next(last);
        // A run ends at rest, so a course that does not end by itself is ended.
        if last.cycle >= self.cycles_max { Some(Order::Disable) } else { order }
    }
    fn is_done(&self, last: &CycleRecord) -> bool {
        if self.course.is_done(last) {
            self.shared.done_at.fetch_min(last.cycle, Ordering::Relaxed);
        }
        self.shared.is_over.load(Ordering::Relaxed) || last.cycle >= self.cycles_max
    }
}

/// Shows each record with its inputs as they come, until one was the last, or the cycle has ended.
fn each(
    mut drain: RecordDrain,
    mut see: impl FnMut(&CycleRecord, &[Input]) -> anyhow::Result<bool>,
) -> anyhow::Result<()> {
    let mut inputs: Vec<Input> = Vec::new();
    loop {
        // Asked first, so that what the cycle left behind is still taken.
        let is_abandoned = drain.ring.is_abandoned();
        match drain.ring.pop() {
            Ok(record) => {
                inputs.clear();
                while drain.inputs.peek().is_ok_and(|input| input.cycle <= record.cycle) {
                    inputs.extend(drain.inputs.pop());
                }
                if see(&record, &inputs)? {
                    return Ok(());
                }
            }
            Err(_empty) if is_abandoned => return Ok(()),
            // Well below the time in which the ring is filled.
            Err(_empty) => std::thread::sleep(Duration::from_millis(2)),
        }
    }
}
