//! The daemon around the cycle: start-up in order, a real-time thread, its log, and an orderly end.
//!
//! ```text
//!   machine file ─► readiness ─► commission ─► log ─► cycle ─┬─ watch: cycles advance, losses, overruns
//!                   (or the end)                             └─ a signal: come to rest, current off
//! ```
//!
//! It runs on the wall clock, on a CAN interface or against the simulated machine in its own process. It
//! gives no motion of its own: axes are without current, or hold their position with `--hold`.
//! Invariant: the cycle thread ends only with every axis at rest; a signal asks it to.

mod notify;
mod status;
mod watch;

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use anyhow::Context;
use clap::Parser;
use nix::errno::Errno;
use tracing::{error, info, warn};

use crate::base::record::CycleRecord;
use crate::base::time::Moment;
use crate::config::{self, Machine};
use crate::log::{self, Pace, WriteOutcome, Writer, header};
use crate::rt::bus::Bus;
use crate::rt::bus::socketcan::SocketCan;
use crate::rt::cycle::pace::Wall;
use crate::rt::cycle::standby::Standby;
use crate::rt::cycle::{Cycle, conduct};
use crate::rt::door::{Both, record_ring};
use crate::rt::drive::{Drives, Operational};
use crate::rt::thread::PageFaults;
use crate::run::readiness::Check;
use crate::run::{self, Origin, Place, Prepared, VERSION};
use crate::sim::closed_loop::Wired;

use notify::Supervisor;
use status::StatusFile;

/// Records on their way to the disk: four seconds of a cycle at 2 kHz.
const RING_RECORDS: usize = 8_192;

/// The control cycle as a service: on a CAN interface, or against a simulated machine in this process.
#[derive(Debug, Parser)]
#[command(name = "quadrantd", version = VERSION, about, max_term_width = 100)]
#[command(after_help = "Exit codes: 0 ended at rest, and all is in the log; 1 an axis faulted, or records \
were lost; 2 not started. With --check: 0 fit for real time; 1 something is missing; 2 could not tell.")]
struct Arguments {
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(long, default_value = "reference", value_name = "FILE|NAME")]
    machine: String,
    /// CAN interface; without one the machine is simulated in this process
    #[arg(long, value_name = "IFACE")]
    bus: Option<String>,
    /// Folder for logs
    #[arg(long, default_value = "quadrant-out", value_name = "FOLDER")]
    logs: PathBuf,
    /// Enable the axes and hold their position
    #[arg(long)]
    hold: bool,
    /// Where the status is kept, for `quadrant latency --live` [default: status.json in the runtime folder
    /// of the service, if there is one]
    #[arg(long, value_name = "FILE")]
    status: Option<PathBuf>,
    /// Seed of the simulated machine
    #[arg(long, default_value_t = 1, value_name = "N", conflicts_with = "bus")]
    seed: u64,
    /// Drive a real machine from a computer that is not fit for real time: at a desk only
    #[arg(long)]
    allow_jitter: bool,
    /// Say whether this computer is fit for real time, and end
    #[arg(long)]
    check: bool,
    /// With --check: print one JSON object
    #[arg(long, requires = "check")]
    json: bool,
}

/// Entry point of `quadrantd`.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_unset| tracing_subscriber::EnvFilter::new("info"));
    // Nobody may be left to read: a line that cannot be written must neither end the daemon nor hold it up.
    let (lines, _rest) = tracing_appender::non_blocking(std::io::stderr());
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(lines)
        .log_internal_errors(false)
        .init();
    if let Err(errno) = log::size_limit::is_an_error() {
        warn!("a log that reaches the size limit of files would end the daemon: {errno}");
    }
    let outcome = if arguments.check { check(&arguments) } else { serve(&arguments) };
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(cause) => {
            error!("{cause:#}");
            ExitCode::from(2)
        }
    }
}

/// Whether this computer is fit for real time.
fn check(arguments: &Arguments) -> anyhow::Result<bool> {
    let machine = config::load(&arguments.machine)?;
    let checks = Prepared::<()>::new(&machine, arguments.bus.as_deref())?.checks;
    let is_fit = !checks.iter().any(Check::is_missing);
    let text = if arguments.json {
        serde_json::json!({ "machine": machine.name, "is_fit": is_fit, "checks": checks }).to_string()
    } else {
        checks.iter().map(Check::to_string).collect::<Vec<_>>().join("\n")
    };
    writeln!(std::io::stdout(), "{text}").context("cannot print")?;
    Ok(is_fit)
}

/// What the threads share with the watch.
struct Shared {
    stop_wish: Arc<AtomicBool>,
    cycles: Arc<AtomicU64>,
    lost: Arc<AtomicU64>,
    overruns: Arc<AtomicU64>,
    wake_error_ns_max: Arc<AtomicU64>,
}

/// What the thread of the cycle leaves.
struct End {
    last: CycleRecord,
    page_faults: Result<PageFaults, Errno>,
}

/// Run until a signal; whether everything is in the log and no axis faulted.
fn serve(arguments: &Arguments) -> anyhow::Result<bool> {
    let machine = config::load(&arguments.machine)?;
    let prepared = Prepared::new(&machine, arguments.bus.as_deref())?;
    match &arguments.bus {
        Some(interface) => {
            let mut bus = run::open(&machine, interface, &[])?;
            prepared.judge(arguments.allow_jitter)?;
            let drives = run::commission(&mut bus, machine.drives()?)?;
            conduct_on(arguments, &machine, prepared, drives, bus, SocketCan::set_origin)
        }
        None => {
            prepared.judge(arguments.allow_jitter)?;
            let mut bus = Wired::new(machine.rack(arguments.seed));
            let drives = bus.commission(machine.drives()?)?;
            conduct_on(arguments, &machine, prepared, drives, bus, |_, _| ())
        }
    }
}

/// Run the cycle on a bus; `begin` tells the bus when the run begins, on the monotonic clock.
fn conduct_on<B: Bus + Send + 'static>(
    arguments: &Arguments,
    machine: &Machine,
    prepared: Prepared<End>,
    drives: Drives<Operational>,
    mut bus: B,
    begin: impl FnOnce(&mut B, Moment),
) -> anyhow::Result<bool> {
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    info!(machine = machine.name, axes = machine.axes.count(), "boards answer and match their sheets");

    let (to_log, log_drain) = record_ring(RING_RECORDS);
    let (to_status, status_drain) = record_ring(RING_RECORDS);
    let shared = Shared {
        // Before anything runs: from here on a signal is a wish to stop, not the end.
        stop_wish: run::stop_wish(false)?,
        cycles: Arc::clone(&log_drain.cycles),
        lost: Arc::clone(&log_drain.lost),
        overruns: Arc::clone(&log_drain.overruns),
        wake_error_ns_max: Arc::clone(&log_drain.wake_error_ns_max),
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let origin = Origin::soon();
    let path = log_path(arguments, &origin)?;
    let place = Place { pace: Pace::Realtime, interface: arguments.bus.as_deref(), seed: arguments.seed };
    let header = run::header(machine, &place, &origin, "quadrantd");
    let writer = Writer::start(&path, header, log_drain.ring, log_drain.inputs, log_drain.lost)?;
    info!(log = %path.display(), "logging every cycle");
    let mut status =
        StatusFile::new(machine, status_drain, path.display().to_string(), status_path(arguments));

    let mut orders = Standby::new(arguments.hold, Arc::clone(&shared.stop_wish));
    let period = machine.cycle.period;
    begin(&mut bus, origin.monotonic);
    let conductor = prepared.thread.give(move || {
        let mut records = Both(to_log, to_status);
        let before = PageFaults::of_this_thread();
        let mut pace = Wall::starting_at(origin.monotonic, period);
        let last = conduct(&mut cycle, &mut bus, &mut pace, &mut orders, &mut records);
        let since = |before| PageFaults::of_this_thread().map(|after| after.since(before));
        End { last, page_faults: before.and_then(since) }
    });
    let supervisor = Supervisor::from_environment();
    runtime.block_on(async {
        tokio::select! {
            () = watch::until(&shared.stop_wish) => info!("a signal: coming to rest"),
            () = watch::run(&shared, period, &supervisor, &mut status, || conductor.is_finished()) => {}
        }
    });
    shared.stop_wish.store(true, Ordering::Relaxed);
    supervisor.stopping();
    let end = conductor.join();
    status.update();
    // First of all what was recorded, also of a run that broke off.
    let log = writer.join();
    let end = end.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    let end = end.context("the thread of the cycle ended without having run it")?;
    Ok(report(&end, &log, &shared))
}

/// Where the status goes, if anywhere.
fn status_path(arguments: &Arguments) -> Option<PathBuf> {
    let of_service =
        || std::env::var_os("RUNTIME_DIRECTORY").map(|folder| Path::new(&folder).join(status::FILE));
    arguments.status.clone().or_else(of_service)
}

fn log_path(arguments: &Arguments, origin: &Origin) -> anyhow::Result<PathBuf> {
    let folder: &Path = &arguments.logs;
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot create the log folder {}", folder.display()))?;
    Ok(folder.join(format!("quadrantd-{}.mcap", header::file_stamp(origin.wall_ns))))
}

fn report(end: &End, log: &WriteOutcome, shared: &Shared) -> bool {
    let lost = shared.lost.load(Ordering::Relaxed);
    let mut is_well = lost == 0 && log.is_complete;
    for (axis, row) in end.last.axes.iter() {
        if let Some(fault) = row.fault {
            error!(%axis, "{fault}; see {}", fault.page());
            is_well = false;
        }
    }
    if let Some(cause) = &log.first_error {
        error!("log: {cause}");
        is_well = false;
    }
    if let Ok(PageFaults { minor, major }) = end.page_faults {
        info!(minor, major, "page faults of the cycle");
    }
    let skipped = shared.overruns.load(Ordering::Relaxed);
    let latest_wake_up_us = shared.wake_error_ns_max.load(Ordering::Relaxed) / 1_000;
    info!(records = log.written, lost, skipped, latest_wake_up_us, log = %log.path.display(), "stopped");
    is_well
}
