//! Runs the test, with the friction-free twin beside it on a thread of its own, and keeps every cycle.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread;

use anyhow::Context;
use serde_json::{Value, json};

use super::super::live::{Job, RING_RECORDS, joined, records};
use crate::base::axis::{AXES_MAX, AxisId};
use crate::base::units::Position;
use crate::config::Machine;
use crate::config::plan::CircleRequest;
use crate::log::{Header, WriteOutcome};
use crate::offline::simulated;
use crate::offline::trace::{Trace, Tracing};
use crate::rt::control::profile::line_duration_s;
use crate::rt::cycle::procedure::{CircleTest, Ending, Programme, Step, Way};
use crate::rt::door::record_ring;
use crate::run::{self, Origin, Place};

/// A circular test and where it is to run.
pub(in crate::cli) struct CircleJob<'a> {
    pub(in crate::cli) machine: &'a Machine,
    /// Behind the boards, where the machine is simulated in this process.
    pub(in crate::cli) plant: &'a Machine,
    pub(in crate::cli) request: &'a CircleRequest,
    pub(in crate::cli) test: CircleTest,
    /// Whether the axes go back to where they stood: another run counts its places from there.
    pub(in crate::cli) returns: bool,
    pub(in crate::cli) place: &'a Place<'a>,
    pub(in crate::cli) allow_jitter: bool,
    pub(in crate::cli) stop_wish: Arc<AtomicBool>,
    pub(in crate::cli) log: &'a Path,
    /// Beside the progress.
    pub(in crate::cli) title: &'static str,
}

/// What a run left behind.
pub(in crate::cli) struct Recording {
    pub(in crate::cli) ending: Ending,
    /// Every cycle.
    pub(in crate::cli) trace: Trace,
    /// The same test without friction.
    pub(in crate::cli) twin: Option<Trace>,
    pub(in crate::cli) lost_records: u64,
    pub(in crate::cli) log: WriteOutcome,
    pub(in crate::cli) header: Header,
    /// How long it took, and how long the machine's clock ran, s.
    pub(in crate::cli) wall_s: f64,
    pub(in crate::cli) machine_s: f64,
}

impl CircleJob<'_> {
    /// What the axes do.
    pub(in crate::cli) fn programme(&self) -> Programme {
        let mut programme = Programme::from(self.test);
        if self.returns {
            let mut target = [None; AXES_MAX];
            target[AxisId::X.index()] = Some(Position::ZERO);
            target[AxisId::Y.index()] = Some(Position::ZERO);
            let (feed, acceleration) = (self.test.positioning_feed, self.machine.motion.path_acceleration);
            let back = Step::Line(Way { target, feed, acceleration });
            programme.steps = programme.steps.into_iter().chain([back]).collect();
        }
        programme
    }

    /// How long it takes, s.
    pub(in crate::cli) fn duration_s(&self) -> f64 {
        let back_s = self.test.circles.iter().flatten().last().filter(|_| self.returns).map_or(0.0, |last| {
            let (x, y) = last.end();
            let way = Position::m(x.as_m().hypot(y.as_m()));
            line_duration_s(way, self.test.positioning_feed, self.machine.motion.path_acceleration)
        });
        self.test.duration_s() + back_s
    }

    /// Runs it.
    pub(in crate::cli) fn record(self) -> anyhow::Result<Recording> {
        let (programme, duration_s) = (self.programme(), self.duration_s());
        let Self { machine, plant, request, test, returns, place, allow_jitter, stop_wish, log, title } =
            self;
        let job = Job { machine, plant, programme, place, allow_jitter, stop_wish, log, title, duration_s };
        let beside = |stop_wish: &Arc<AtomicBool>| {
            let (to_trace, trace_drain) = record_ring(RING_RECORDS);
            let tracer = thread::spawn(move || Trace::from_records(records(trace_drain.ring)));
            let (machine, stop) = (machine.clone().without_friction(), Arc::clone(stop_wish));
            let seed = place.seed;
            (Some(to_trace), (tracer, thread::spawn(move || twin(&machine, test, seed, &stop))))
        };
        let header = |origin: &Origin| {
            let mut header = header(machine, request, &test, origin, place);
            if returns {
                let last = header.motions.keys().max().copied().unwrap_or(0);
                header.motions.insert(last + 1, json!({ "kind": "line" }));
            }
            if place.interface.is_none() && plant.source != machine.source {
                header.extra.insert("plant".to_owned(), plant.source.clone());
            }
            header
        };
        let (run, (tracer, twin)) = job.run(header, beside)?;
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
}

/// The friction-free response of the same loop: the same test on the same machine without friction.
/// None when it did not complete.
pub(super) fn twin(
    machine: &Machine,
    test: CircleTest,
    seed: u64,
    stop_wish: &Arc<AtomicBool>,
) -> anyhow::Result<Option<Trace>> {
    let mut tracing = Tracing::default();
    let ending = simulated::run(machine, machine, test, seed, stop_wish, &mut tracing)?;
    Ok(if ending == Ending::Complete { Some(tracing.finish()?) } else { None })
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
