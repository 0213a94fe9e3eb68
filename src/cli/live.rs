//! Runs a programme: the cycle on its thread, the log on another, and this one shows the progress.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};

use super::Outcome;
use crate::base::record::CycleRecord;
use crate::base::time::{Moment, Span};
use crate::config::Machine;
use crate::log::header::file_stamp;
use crate::log::{Header, Pace, WriteOutcome, Writer};
use crate::rt::bus::Bus;
use crate::rt::bus::lockstep::{self, Lockstep, NoPeer};
use crate::rt::bus::socketcan::SocketCan;
use crate::rt::cycle::pace::{Virtual, Wall};
use crate::rt::cycle::procedure::{Ending, Procedure, Programme};
use crate::rt::cycle::{Cycle, conduct};
use crate::rt::door::{Both, RecordRing, record_ring};
use crate::rt::drive::{Drives, Operational};
use crate::run::{self, Origin, Place, Prepared};
use crate::sim::closed_loop::{Patient, Wired, commission};

/// Records on their way to the disk: seconds of a cycle at 2 kHz, so that a slow disk loses nothing.
pub(super) const RING_RECORDS: usize = 8_192;
/// How long a machine in another process may be silent: far beyond a busy desk.
pub(super) const PATIENCE: Span = Span::ms(2_000);

/// Now, as a part of a file name.
pub(super) fn stamp_now() -> String {
    file_stamp(run::wall_now_ns())
}

/// Where a machine file as it was is kept.
pub(super) fn beside(path: &Path, stamp: &str) -> PathBuf {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{name}.before-{stamp}.toml"))
}

/// The folder that was asked for, or one of this name under `quadrant-out`; it is there.
pub(super) fn out_folder(asked: Option<&Path>, name: &str) -> anyhow::Result<PathBuf> {
    let folder = asked.map_or_else(|| Path::new("quadrant-out").join(name), Path::to_owned);
    std::fs::create_dir_all(&folder)
        .with_context(|| format!("cannot create the output folder {}", folder.display()))?;
    Ok(folder)
}

/// A programme and where it is to run.
pub(super) struct Job<'a> {
    pub(super) machine: &'a Machine,
    /// Behind the boards, where the machine is simulated in this process.
    pub(super) plant: &'a Machine,
    pub(super) programme: Programme,
    pub(super) place: &'a Place<'a>,
    pub(super) allow_jitter: bool,
    /// Ends it early, with the axes at rest.
    pub(super) stop_wish: Arc<AtomicBool>,
    pub(super) log: &'a Path,
    /// Beside the progress.
    pub(super) title: &'a str,
    /// How long it will take, s.
    pub(super) duration_s: f64,
}

/// Whether real axes may move at a place.
pub(super) fn moves_a_machine(place: &Place<'_>) -> bool {
    place.interface.is_some() && place.pace == Pace::Realtime
}

/// A wish to stop, for a run at a place: a second signal ends the tool at once only where nothing real moves.
pub(super) fn stop_wish(place: &Place<'_>) -> anyhow::Result<Arc<AtomicBool>> {
    Ok(run::stop_wish(!moves_a_machine(place))?)
}

/// What a run left behind.
pub(super) struct Recorded {
    pub(super) ending: Ending,
    pub(super) cycles: u64,
    pub(super) lost_records: u64,
    pub(super) log: WriteOutcome,
    pub(super) header: Header,
    /// How long it took, s.
    pub(super) wall_s: f64,
}

impl Job<'_> {
    /// Runs it. `header` says what the log tells of it; `beside` is called when all is ready to start, with the
    /// wish to stop, to start what shall go on meanwhile; if it wants the records too, it gives a ring for them.
    pub(super) fn run<T>(
        self,
        header: impl FnOnce(&Origin) -> Header,
        beside: impl FnOnce(&Arc<AtomicBool>) -> (Option<RecordRing>, T),
    ) -> anyhow::Result<(Recorded, T)> {
        let Self { machine, place, allow_jitter, .. } = self;
        let run = Run { began: Instant::now(), job: self, header, beside };
        match (place.interface, place.pace) {
            (None, pace) => {
                let prepared = (pace == Pace::Realtime).then(|| Prepared::new(machine, None)).transpose()?;
                let mut bus = Wired::new(run.job.plant.rack(place.seed));
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
                let (recorded, bus) = run.on(bus, drives, None, |_, _| ())?;
                if bus.is_peer_lost() {
                    eprintln!("{interface}: {} during the test", NoPeer { patience: PATIENCE });
                }
                Ok(recorded)
            }
        }
    }
}

/// Whether the boards of a machine answer and are what their sheets say, and on a real bus whether this computer is
/// fit for real time. No axis is enabled.
pub(super) fn greet(
    machine: &Machine,
    plant: &Machine,
    place: &Place<'_>,
    allow_jitter: bool,
) -> anyhow::Result<()> {
    let drives = machine.drives()?;
    let _operational = match (place.interface, place.pace) {
        (None, _) => Wired::new(plant.rack(place.seed)).commission(drives)?,
        (Some(interface), Pace::Realtime) => {
            let prepared = Prepared::<()>::new(machine, Some(interface))?;
            let mut bus = run::open(machine, interface, &[])?;
            prepared.judge(allow_jitter)?;
            run::commission(&mut bus, drives)?
        }
        (Some(interface), Pace::Virtual) => commission(&mut lock_step(machine, interface)?, drives)?,
    };
    Ok(())
}

/// A bus in lock step with the machine behind an interface.
pub(super) fn lock_step(machine: &Machine, interface: &str) -> anyhow::Result<Lockstep<SocketCan>> {
    let bus = run::open(machine, interface, &[lockstep::MARKER])?;
    Lockstep::begin(bus, PATIENCE)
        .with_context(|| format!("{interface}: is `hil-sim --bus {interface} --pace virtual` running?"))
}

/// A job about to be run.
struct Run<'a, H, F> {
    began: Instant,
    job: Job<'a>,
    header: H,
    beside: F,
}

impl<H, F, T> Run<'_, H, F>
where
    H: FnOnce(&Origin) -> Header,
    F: FnOnce(&Arc<AtomicBool>) -> (Option<RecordRing>, T),
{
    /// Runs it over commissioned drives, in a thread that was prepared for it or in any; `begin` tells the bus
    /// when moment zero is, on the monotonic clock. The bus comes back.
    fn on<B: Bus + Send + 'static>(
        self,
        mut bus: B,
        drives: Drives<Operational>,
        prepared: Option<Prepared<(Ending, u64, B)>>,
        begin: impl FnOnce(&mut B, Moment),
    ) -> anyhow::Result<((Recorded, T), B)> {
        let Self { began, job, header, beside } = self;
        let machine = job.machine;
        let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
        let origin = Origin::soon();
        let header = header(&origin);
        let (to_log, log_drain) = record_ring(RING_RECORDS);
        let (cycles, lost) = (Arc::clone(&log_drain.cycles), Arc::clone(&log_drain.lost));
        let writer =
            Writer::start(job.log, header.clone(), log_drain.ring, log_drain.inputs, log_drain.lost)?;
        let (to_other, beside) = beside(&job.stop_wish);

        let period = machine.cycle.period;
        let bar = ProgressWatch::start(job.title, Arc::clone(&cycles), job.duration_s, period);
        let mut orders = Procedure::new(job.programme, job.stop_wish);
        begin(&mut bus, origin.monotonic);
        let end = match prepared {
            Some(prepared) => {
                let conductor = prepared.thread.give(move || {
                    let mut records = Both(to_log, to_other);
                    let mut grid = Wall::starting_at(origin.monotonic, period);
                    let last = conduct(&mut cycle, &mut bus, &mut grid, &mut orders, &mut records);
                    (orders.ending(&last), last.cycles_run(), bus)
                });
                conductor.join().map(|end| end.context("the thread of the cycle ended without having run it"))
            }
            None => {
                let conductor = thread::Builder::new().name("cycle".to_owned()).spawn(move || {
                    let mut records = Both(Patient(to_log), to_other.map(Patient));
                    let mut grid = Virtual::new(period);
                    let last = conduct(&mut cycle, &mut bus, &mut grid, &mut orders, &mut records);
                    (orders.ending(&last), last.cycles_run(), bus)
                })?;
                conductor.join().map(Ok)
            }
        };
        bar.finish();
        // First of all what was recorded, also of a run that broke off.
        let log = writer.join();
        let (ending, cycles, bus) = end.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        let lost_records = lost.load(Ordering::Relaxed);
        let wall_s = began.elapsed().as_secs_f64();
        Ok(((Recorded { ending, cycles, lost_records, log, header, wall_s }, beside), bus))
    }
}

/// Records as they come, until their producer is gone.
pub(super) fn records(mut ring: rtrb::Consumer<CycleRecord>) -> impl Iterator<Item = CycleRecord> {
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

/// What an ending is to the caller; one that was not complete is said.
pub(super) fn outcome_of(ending: &Ending) -> Outcome {
    match ending {
        Ending::Complete => return Outcome::Done,
        Ending::Interrupted => eprintln!("interrupted: the axes were stopped along their path and disabled"),
        Ending::Faulted(axis, fault) => eprintln!("axis {axis}: {fault}; see {}", fault.page()),
        Ending::Refused => {
            eprintln!("the cycle did not begin a motion that it was ordered; the axes were disabled");
        }
    }
    Outcome::NotDone
}

/// The outcome with what the log lost, said aloud.
pub(super) fn with_losses(outcome: Outcome, log: &WriteOutcome, lost_records: u64) -> Outcome {
    if let Some(error) = &log.first_error {
        eprintln!("error: {error}");
    }
    if lost_records > 0 {
        eprintln!("error: {lost_records} records are not in the log {}", log.path.display());
    }
    let is_whole = lost_records == 0 && log.is_complete && log.first_error.is_none();
    if outcome == Outcome::Done && !is_whole { Outcome::Incomplete } else { outcome }
}

/// A thread's result; its panic goes on here.
pub(super) fn joined<T>(thread: thread::JoinHandle<T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// A progress bar that looks at the cycle counter from time to time.
struct ProgressWatch {
    bar: ProgressBar,
    is_over: Arc<AtomicBool>,
    thread: thread::JoinHandle<()>,
}

impl ProgressWatch {
    fn start(title: &str, cycles: Arc<AtomicU64>, expected_s: f64, period: Span) -> Self {
        let ms_per_cycle = period.as_us() * 1e-3;
        let bar = ProgressBar::new((expected_s * 1e3) as u64);
        let style = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} %  {prefix}  left {eta}");
        if let Ok(style) = style {
            bar.set_style(style);
        }
        bar.set_message(title.to_owned());
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
