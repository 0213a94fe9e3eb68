//! Scenarios on the simulated machine: run, watched and judged.
//!
//! ```text
//!   Scenario ─► Course (orders) ─► cycle ─► records ─┐
//!            └► rack with script ─► truth ───────────┴► Witness ─► Evidence ─► judge ─► Outcome
//! ```
//!
//! Where the records come from is the caller's: [`run_in_memory`] has host and machine in one thread and
//! knows the truth; a run over a bus gives the witness its records alone, and what only the truth can tell
//! stays unjudged.
//! Invariant: the same scenario gives the same outcome to the bit; what is judged was measured.

mod course;
mod judge;
mod path;
pub mod survey;
mod witness;

pub use course::{CYCLES_AFTER_MAX, Course};
pub use judge::{Finding, Outcome, judge};
pub use witness::{AxisTruth, Ending, Evidence, Witness};

use crate::base::record::CycleRecord;
use crate::base::time::Moment;
use crate::config::Machine;
use crate::config::scenario::{Motion, Scenario};
use crate::offline::circle::{self, Run};
use crate::offline::trace::Trace;
use crate::rt::cycle::Cycle;
use crate::rt::cycle::pace::{Pace, Virtual};
use crate::rt::door::Orders;
use crate::sim::closed_loop::Wired;
use crate::sim::rack::Rack;
use crate::sim::script::Script;

/// An axis that stands for so many cycles has come to rest; a motor that swings on its screw has not.
const CYCLES_STILL: u64 = 100;

/// Runs a scenario with host and machine in one thread, in virtual time, and judges it.
pub fn run_in_memory(scenario: &Scenario) -> Outcome {
    let keeps_records = scenario.expect.protrusion.is_some();
    let mut witness = Witness::new(&scenario.machine, &scenario.script);
    let mut records = Vec::new();
    let ending = in_memory(&scenario.machine, &scenario.motion, &scenario.script, |record, rack| {
        witness.see(record, Some(&|axis| AxisTruth::of(rack, axis)));
        if keeps_records {
            records.push(*record);
        }
    });
    let mut evidence = witness.finish(ending);
    if keeps_records && evidence.ending == Ending::Complete {
        evidence.protrusion_um = protrusion_um(scenario, &records);
    }
    judge(&scenario.expect, &scenario.machine, evidence)
}

/// One run; `see` is shown each cycle with the machine behind it. A run goes on until the axes have come
/// to rest, which is later than the orders are done where a fault has taken the current away.
fn in_memory(
    machine: &Machine,
    motion: &Motion,
    script: &Script,
    mut see: impl FnMut(&CycleRecord, &Rack),
) -> Ending {
    let mut bus = Wired::new(machine.rack(script.seed).with_script(script));
    let drives = match machine.drives() {
        Ok(drives) => drives,
        Err(error) => return Ending::Refused(error.to_string()),
    };
    let drives = match bus.commission(drives) {
        Ok(drives) => drives,
        Err(error) => return Ending::Refused(error.to_string()),
    };
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let mut course = Course::new(motion);
    let mut pace = Virtual::new(machine.cycle.period);
    let cycles_max = course.cycles_max(machine.cycle.period);
    let (mut done_since, mut still_for) = (None, 0);
    for number in 0..cycles_max {
        let slot = pace.wait();
        let (record, _inputs) = cycle.run(&mut bus, &mut course, &slot, &mut || pace.now());
        see(record, bus.rack());
        if done_since.is_none() && course.is_done(record) {
            done_since = Some((number, course.ending(record)));
        }
        if let Some((since, ending)) = &done_since {
            let is_still = machine.axes.iter().all(|(axis, settings)| {
                AxisTruth::of(bus.rack(), axis).is_still(settings.control.limits.standstill)
            });
            still_for = if is_still { still_for + 1 } else { 0 };
            if still_for > CYCLES_STILL || number - since > CYCLES_AFTER_MAX {
                return ending.clone();
            }
        }
    }
    Ending::Unfinished
}

/// Highest protrusion of a circular test at the motor encoders, um, against the same test on the same
/// machine without friction, in which nothing goes wrong. `None` where there is no whole circle to judge.
pub fn protrusion_um(scenario: &Scenario, records: &[CycleRecord]) -> Option<f64> {
    let Motion::Circle { test, .. } = &scenario.motion else { return None };
    let nothing = Script { seed: scenario.script.seed, ..Script::default() };
    let mut smooth = Vec::new();
    let machine = scenario.machine.clone().without_friction();
    in_memory(&machine, &scenario.motion, &nothing, |record, _| smooth.push(*record));
    let [rough, smooth] = [records, &smooth].map(|records| Trace::from_records(records).ok());
    let (rough, smooth) = (rough?, smooth?);
    // Each circle follows a straight move to its start.
    let stretches: Option<Vec<_>> = (1..)
        .zip(test.circles.iter().flatten())
        .map(|(number, motion)| {
            let [rough, smooth] = [&rough, &smooth].map(|trace| trace.stretch(2 * number).ok());
            Some((motion.circle, rough?, smooth?))
        })
        .collect();
    let stretches = stretches?;
    let runs: Vec<Run<'_>> = stretches
        .iter()
        .map(|(nominal, trace, twin)| Run { nominal: *nominal, trace, friction_free: Some(twin) })
        .collect();
    circle::analyse(&runs).ok().map(|test| test.motor.protrusion_um.max)
}

/// The cycle whose SYNC is the first at or after a moment of the script.
fn cycle_at(machine: &Machine, moment: Moment) -> u64 {
    let since = (moment - Moment::ZERO).as_ns();
    let period = machine.cycle.period.as_ns();
    since.div_euclid(period) as u64 + u64::from(since.rem_euclid(period) > 0)
}
