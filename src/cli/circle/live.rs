//! Runs the test: the cycle on its thread, the log on another, the friction-free twin on a third, and
//! this one shows the progress.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use crate::base::record::CycleRecord;
use crate::base::time::{Moment, Span};
use crate::config::Machine;
use crate::config::plan::CircleRequest;
use crate::log::header::file_stamp;
use crate::log::{Header, Pace, WriteOutcome, Writer};
use crate::offline::trace::Trace;
use crate::rt::bus::Bus;
use crate::rt::bus::lockstep::{self, Lockstep, NoPeer};
use crate::rt::bus::socketcan::SocketCan;
use crate::rt::cycle::pace::{Virtual, Wall};
use crate::rt::cycle::procedure::{CircleTest, Ending, Procedure};
use crate::rt::cycle::{Cycle, conduct};
use crate::rt::door::{Both, record_ring};
use crate::rt::drive::{Drives, Operational};
use crate::run::{self, Origin, Place, Prepared};
use crate::sim::closed_loop::{Patient, Wired, commission};

/// Records on their way to the disk: seconds of a cycle at 2 kHz, so that a slow disk loses nothing.
const RING_RECORDS: usize = 8_192;
/// How long a machine in another process may be silent: far beyond a busy desk.
pub(in crate::cli) const PATIENCE: Span = Span::ms(2_000);

/// Now, as a part of a file name.
pub(super) fn stamp_now() -> String {
    file_stamp(run::wall_now_ns())
}

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
    let moves_a_machine = place.interface.is_some() && place.pace == Pace::Realtime;
    let stop_wish = run::stop_wish(!moves_a_machine)?;
    let run = Run { began: Instant::now(), machine, request, test, place, log, stop_wish };
    match (place.interface, place.pace) {
        (None, pace) => {
            let prepared = (pace == Pace::Realtime).then(|| Prepared::new(machine, None)).transpose()?;
            let mut bus = Wired::new(machine.rack(place.seed));
            let drives = bus.commission(machine.drives()?)?;
            Ok(run.on(bus, drives, prepared, |_, _| ())?.0)
        }
        (Some(interface), Pace::Realtime) => {
            let prepared = Prepared::new(machine, Some(interface))?;
            let mut bus = run::open(machine, interface, &[])?;
            prepared.judge(allow_jitter)?;
            let drives = run::commission(&mut bus, machine.drives()?)?;
            Ok(run.on(bus, drives, Some(prepared), SocketCan::set_origin)?.0)
        }
        (Some(interface), Pace::Virtual) => {
            let mut bus = lock_step(machine, interface)?;
            let drives = commission(&mut bus, machine.drives()?)?;
            let (recording, bus) = run.on(bus, drives, None, |_, _| ())?;
            if bus.is_peer_lost() {
                eprintln!("{interface}: {} during the test", NoPeer { patience: PATIENCE });
            }
            Ok(recording)
        }
    }
}

/// A bus in lock step with the machine behind an interface.
pub(in crate::cli) fn lock_step(machine: &Machine, interface: &str) -> anyhow::Result<Lockstep<SocketCan>> {
    let bus = run::open(machine, interface, &[lockstep::MARKER])?;
    Lockstep::begin(bus, PATIENCE)
        .with_context(|| format!("{interface}: is `hil-sim --bus {interface} --pace virtual` running?"))
}

/// A test about to be run.
struct Run<'a> {
    began: Instant,
    machine: &'a Machine,
    request: &'a CircleRequest,
    test: &'a CircleTest,
    place: &'a Place<'a>,
    log: &'a Path,
    stop_wish: Arc<AtomicBool>,
}

impl Run<'_> {
    /// Runs it over commissioned drives, in a thread that was prepared for it or in any; `begin` tells the bus
    /// when moment zero is, on the monotonic clock. The bus comes back.
    fn on<B: Bus + Send + 'static>(
        self,
        mut bus: B,
        drives: Drives<Operational>,
        prepared: Option<Prepared<(Ending, B)>>,
        begin: impl FnOnce(&mut B, Moment),
    ) -> anyhow::Result<(Recording, B)> {
        let Self { began, machine, request, test, place, log, stop_wish } = self;
        let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
        let origin = Origin::soon();
        let header = header(machine, request, test, &origin, place);
        let (to_log, log_drain) = record_ring(RING_RECORDS);
        let (to_trace, trace_drain) = record_ring(RING_RECORDS);
        let (cycles, lost) = (Arc::clone(&log_drain.cycles), Arc::clone(&log_drain.lost));
        let writer = Writer::start(log, header.clone(), log_drain.ring, log_drain.inputs, log_drain.lost)?;
        let tracer = thread::spawn(move || Trace::from_records(records(trace_drain.ring)));
        let twin = {
            let (machine, test, stop) = (machine.clone().without_friction(), *test, Arc::clone(&stop_wish));
            let seed = place.seed;
            thread::spawn(move || twin(&machine, test, seed, stop))
        };

        let bar = ProgressWatch::start(cycles, test.duration_s(), machine.cycle.period);
        let mut orders = Procedure::new(*test, Arc::clone(&stop_wish));
        let period = machine.cycle.period;
        begin(&mut bus, origin.monotonic);
        let end = match prepared {
            Some(prepared) => {
                let conductor = prepared.thread.give(move || {
                    let mut records = Both(to_log, to_trace);
                    let mut grid = Wall::starting_at(origin.monotonic, period);
                    let last = conduct(&mut cycle, &mut bus, &mut grid, &mut orders, &mut records);
                    (orders.ending(&last), bus)
                });
                conductor.join().map(|end| end.context("the thread of the cycle ended without having run it"))
            }
            None => {
                let conductor = thread::Builder::new().name("cycle".to_owned()).spawn(move || {
                    let mut records = Both(Patient(to_log), Patient(to_trace));
                    let mut grid = Virtual::new(period);
                    let last = conduct(&mut cycle, &mut bus, &mut grid, &mut orders, &mut records);
                    (orders.ending(&last), bus)
                })?;
                conductor.join().map(Ok)
            }
        };
        bar.finish();
        // First of all what was recorded, also of a run that broke off.
        let log = writer.join();
        let (ending, bus) = end.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        let trace = joined(tracer).context("the run left no trace")?;
        let wall_s = began.elapsed().as_secs_f64();
        let recording = Recording {
            ending,
            twin: joined(twin)?,
            lost_records: lost.load(Ordering::Relaxed),
            machine_s: trace.len() as f64 * period.as_s(),
            trace,
            log,
            header,
            wall_s,
        };
        Ok((recording, bus))
    }
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

/// Records as they come, until their producer is gone.
fn records(mut ring: rtrb::Consumer<CycleRecord>) -> impl Iterator<Item = CycleRecord> {
    std::iter::from_fn(move || {
        loop {
            // Asked first, so that what the producer left behind is still taken.
            let is_over = ring.is_abandoned();
            match ring.pop() {
                Ok(record) => return Some(record),
                Err(_empty) if is_over => return None,
                // Well below the time in which even a cycle in virtual time fills the ring.
                Err(_empty) => thread::sleep(Duration::from_millis(2)),
            }
        }
    })
}

/// A thread's result; its panic goes on here.
pub(in crate::cli) fn joined<T>(thread: thread::JoinHandle<T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
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

/// A progress bar that looks at the cycle counter from time to time.
struct ProgressWatch {
    bar: ProgressBar,
    is_over: Arc<AtomicBool>,
    thread: thread::JoinHandle<()>,
}

impl ProgressWatch {
    fn start(cycles: Arc<AtomicU64>, expected_s: f64, period: Span) -> Self {
        let ms_per_cycle = period.as_us() * 1e-3;
        let bar = ProgressBar::new((expected_s * 1e3) as u64);
        let style = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} %  {prefix}  left {eta}");
        if let Ok(style) = style {
            bar.set_style(style);
        }
        bar.set_message("circular test");
        let is_over = Arc::new(AtomicBool::new(false));
        let (watched, over) = (bar.clone(), Arc::clone(&is_over));
        let thread = thread::spawn(move || {
            while !over.load(Ordering::Relaxed) {
                let machine_ms = cycles.load(Ordering::Relaxed) as f64 * ms_per_cycle;
                watched.set_position(machine_ms as u64);
                watched.set_prefix(format!("{:.1} s of {expected_s:.1} s", machine_ms * 1e-3));
                thread::sleep(Duration::from_millis(50));
            }
        });
        Self { bar, is_over, thread }
    }

    fn finish(self) {
        self.is_over.store(true, Ordering::Relaxed);
        joined(self.thread);
        self.bar.finish_and_clear();
    }
}
