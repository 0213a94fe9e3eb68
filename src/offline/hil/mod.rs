//! Scenarios on the simulated machine: run, watched and judged.
//!
//! ```text
//!   Scenario ─► Course (orders) ─► cycle ─► records ─┐
//!            └► rack with script ─► truth ───────────┴► Witness ─► Evidence ─► judge ─► Outcome
//! ```
//!
//! [`run_in_memory`] has host and machine in one thread; [`run_on`] takes any bus, and whoever knows the truth
//! of the machine behind it. What only the truth can tell stays unjudged where nobody knows it.
//! Invariant: the same scenario gives the same outcome to the bit, over any bus; what is judged was measured.

mod course;
mod judge;
mod path;
mod stage;
pub mod survey;
mod witness;

use std::collections::VecDeque;
use std::convert::Infallible;

pub use course::{CYCLES_AFTER_MAX, Course};
pub use judge::{Finding, Outcome, judge};
pub use stage::{Rest, Truth, Truths};
pub use witness::{Ending, Evidence, Witness};

use crate::base::input::Input;
use crate::base::record::CycleRecord;
use crate::base::time::Moment;
use crate::config::Machine;
use crate::config::scenario::{Motion, Scenario};
use crate::offline::circle::{self, Run};
use crate::offline::trace::Trace;
use crate::rt::bus::Bus;
use crate::sim::closed_loop::Wired;

/// Runs a scenario with host and machine in one thread, in virtual time, and judges it.
pub fn run_in_memory(scenario: &Scenario) -> Outcome {
    in_memory(scenario, |_, _| ())
}

/// The same; `see` is shown each cycle of the run and its inputs.
pub fn in_memory(scenario: &Scenario, see: impl FnMut(&CycleRecord, &[Input])) -> Outcome {
    let rack = scenario.machine.rack(scenario.script.seed).with_script(&scenario.script);
    let Ok(outcome) = run_on(scenario, &mut Wired::new(rack), &mut AtHand, see);
    outcome
}

/// Runs a scenario in virtual time over a bus whose machine plays its script, and judges it; `see` is shown
/// each cycle of the run and its inputs.
///
/// # Errors
/// Those of `truths`.
pub fn run_on<B: Bus, T: Truths<B>>(
    scenario: &Scenario,
    bus: &mut B,
    truths: &mut T,
    mut see: impl FnMut(&CycleRecord, &[Input]),
) -> Result<Outcome, T::Error> {
    let mut watch = Watch::new(scenario);
    let ending = stage::run(&scenario.machine, &scenario.motion, bus, truths, |record, inputs, truth| {
        watch.see(record, truth);
        see(record, inputs);
    })?;
    Ok(watch.judge(ending))
}

/// The machine is in this process.
struct AtHand;

impl Truths<Wired> for AtHand {
    type Error = Infallible;

    fn learn(&mut self, bus: &Wired, _: u64, known: &mut VecDeque<Truth>) -> Result<(), Infallible> {
        known.push_back(Some(bus.rack().truths()));
        Ok(())
    }
}

/// Watches a run of a scenario, wherever its records come from, and judges it at its end.
#[derive(Debug)]
pub struct Watch<'a> {
    scenario: &'a Scenario,
    witness: Witness,
    /// What a protrusion is measured from, if one is judged.
    records: Option<Vec<CycleRecord>>,
}

impl<'a> Watch<'a> {
    /// Of a run that is about to begin.
    pub fn new(scenario: &'a Scenario) -> Self {
        Self {
            scenario,
            witness: Witness::new(&scenario.machine, &scenario.script),
            records: scenario.expect.protrusion.map(|_| Vec::new()),
        }
    }

    /// A cycle was run.
    pub fn see(&mut self, record: &CycleRecord, truth: &Truth) {
        self.witness.see(record, truth);
        if let Some(records) = &mut self.records {
            records.push(*record);
        }
    }

    /// The run is over, and so it ended.
    pub fn judge(self, ending: Ending) -> Outcome {
        let mut evidence = self.witness.finish(ending);
        if let Some(records) = self.records.filter(|_| evidence.ending == Ending::Complete) {
            evidence.protrusion_um = protrusion_um(self.scenario, &records);
        }
        judge(&self.scenario.expect, &self.scenario.machine, evidence)
    }
}

/// Highest protrusion of a circular test at the motor encoders, um, against the same test on the same
/// machine without friction, in which nothing goes wrong. `None` where there is no whole circle to judge.
pub fn protrusion_um(scenario: &Scenario, records: &[CycleRecord]) -> Option<f64> {
    let Motion::Circle { test, .. } = &scenario.motion else { return None };
    let mut smooth = Vec::new();
    let machine = scenario.machine.clone().without_friction();
    let mut bus = Wired::new(machine.rack(scenario.script.seed));
    let keep = |record: &CycleRecord, _: &[Input], _: &Truth| smooth.push(*record);
    let Ok(_) = stage::run(&machine, &scenario.motion, &mut bus, &mut AtHand, keep);
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
