//! Runs the test, with the friction-free twin beside it on a thread of its own, and keeps every cycle.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread;

use anyhow::Context;
use serde_json::{Value, json};

use super::super::live::{Job, RING_RECORDS, joined, records};
use crate::config::Machine;
use crate::config::plan::CircleRequest;
use crate::log::{Header, WriteOutcome};
use crate::offline::trace::Trace;
use crate::rt::cycle::pace::Virtual;
use crate::rt::cycle::procedure::{CircleTest, Ending, Procedure};
use crate::rt::cycle::{Cycle, conduct};
use crate::rt::door::record_ring;
use crate::run::{self, Origin, Place};
use crate::sim::closed_loop::{Patient, Wired};

/// What a run left behind.
pub(super) struct Recording {
    pub(super) ending: Ending,
    /// Every cycle.
    pub(super) trace: Trace,
    /// The same test without friction.
    pub(super) twin: Option<Trace>,
    pub(super) lost_records: u64,
    pub(super) log: WriteOutcome,
    pub(super) header: Header,
    /// How long it took, and how long the machine's clock ran, s.
    pub(super) wall_s: f64,
    pub(super) machine_s: f64,
}

/// Run the test where the `place` says.
pub(super) fn record(
    machine: &Machine,
    request: &CircleRequest,
    test: &CircleTest,
    place: &Place<'_>,
    allow_jitter: bool,
    log: &Path,
) -> anyhow::Result<Recording> {
    let job = Job {
        machine,
        plant: machine,
        programme: (*test).into(),
        place,
        allow_jitter,
        log,
        title: "circular test",
        duration_s: test.duration_s(),
    };
    let beside = |stop_wish: &Arc<AtomicBool>| {
        let (to_trace, trace_drain) = record_ring(RING_RECORDS);
        let tracer = thread::spawn(move || Trace::from_records(records(trace_drain.ring)));
        let (machine, test, stop) = (machine.clone().without_friction(), *test, Arc::clone(stop_wish));
        let seed = place.seed;
        (Some(to_trace), (tracer, thread::spawn(move || twin(&machine, test, seed, stop))))
    };
    let (run, (tracer, twin)) = job.run(|origin| header(machine, request, test, origin, place), beside)?;
    let trace = joined(tracer).context("the run left no trace")?;
    Ok(Recording {
        ending: run.ending,
        twin: joined(twin)?,
        lost_records: run.lost_records,
        machine_s: run.cycles as f64 * machine.cycle.period.as_s(),
        trace,
        log: run.log,
        header: run.header,
        wall_s: run.wall_s,
    })
}

/// The friction-free response of the same loop: the same test on the same machine without friction.
/// None when it did not complete.
pub(super) fn twin(
    machine: &Machine,
    test: CircleTest,
    seed: u64,
    stop_wish: Arc<AtomicBool>,
) -> anyhow::Result<Option<Trace>> {
    let mut bus = Wired::new(machine.rack(seed));
    let drives = bus.commission(machine.drives()?)?;
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let (ring, drain) = record_ring(RING_RECORDS);
    let tracer = thread::spawn(move || Trace::from_records(records(drain.ring)));
    let mut orders = Procedure::new(test, stop_wish);
    let mut records = Patient(ring);
    let mut grid = Virtual::new(machine.cycle.period);
    let last = conduct(&mut cycle, &mut bus, &mut grid, &mut orders, &mut records);
    drop(records);
    let trace = joined(tracer)?;
    Ok((orders.ending(&last) == Ending::Complete).then_some(trace))
}

pub(in crate::cli) fn header(
    machine: &Machine,
    request: &CircleRequest,
    test: &CircleTest,
    origin: &Origin,
    place: &Place<'_>,
) -> Header {
    let motions: BTreeMap<u32, Value> = test
        .circles
        .iter()
        .flatten()
        .enumerate()
        .flat_map(|(index, motion)| {
            // The procedure orders a straight move, then the circle.
            let number = 2 * index as u32 + 1;
            let circle = &motion.circle;
            let description = json!({
                "kind": "circle",
                "direction": circle.direction,
                "centre_x_mm": circle.centre_x.as_mm(),
                "centre_y_mm": circle.centre_y.as_mm(),
                "radius_mm": circle.radius.as_mm(),
                "feed_mm_per_min": circle.feed.as_mm_per_min(),
                "start_angle_deg": circle.start_angle_rad.to_degrees(),
                "revolutions": circle.revolutions,
            });
            [(number, json!({ "kind": "line" })), (number + 1, description)]
        })
        .collect();
    let mut header = run::header(machine, place, origin, "quadrant");
    header.motions = motions;
    header.extra.insert("gains".to_owned(), request.gains.clone());
    header
}
