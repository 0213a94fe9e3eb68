//! `quadrant latency`: where the time of the periods went. Of a log, of the daemon that runs, or measured here
//! and now: the whole cycle on the wall clock against the simulated machine in this process, its thread prepared for real time
//! as the daemon's is.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde::{Deserialize, Serialize};

use super::{Outcome, machine, print_json, print_text, view};
use crate::base::input::Inputs;
use crate::base::record::CycleRecord;
use crate::base::time::Span;
use crate::config::Machine;
use crate::log::Reader;
use crate::log::header::IMPORTED;
use crate::log::timing::{Share, Timings};
use crate::offline::draw::latency::{bars, sheet};
use crate::rt::cycle::pace::{Wall, monotonic_now};
use crate::rt::cycle::standby::Standby;
use crate::rt::cycle::{Cycle, conduct};
use crate::rt::door::Records;
use crate::rt::thread::{Policy, Process, Settings, Thread};
use crate::sim::closed_loop::Wired;

/// Where the installed daemon keeps its status.
const STATUS_FILE: &str = "/run/quadrant/status.json";
/// From here to the first slot.
const LEAD: Span = Span::ms(20);
/// Characters of a bar with its numbers.
const WIDTH: usize = 78;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The log; without one the cycle runs here and now, against the simulated machine
    log: Option<PathBuf>,
    /// Of the daemon that runs, from its status file
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = STATUS_FILE, conflicts_with = "log")]
    live: Option<PathBuf>,
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(long, default_value = "reference", value_name = "FILE|NAME", conflicts_with_all = ["log", "live"])]
    machine: String,
    /// How long to measure
    #[arg(long, default_value_t = 10.0, value_name = "S", conflicts_with_all = ["log", "live"])]
    seconds: f64,
    /// Priority under SCHED_FIFO instead of the machine file's
    #[arg(long, value_name = "1..98", value_parser = clap::value_parser!(u8).range(1..=98), conflicts_with_all = ["log", "live"])]
    priority: Option<u8>,
    /// Processor of the cycle instead of the machine file's
    #[arg(long, value_name = "N", conflicts_with_all = ["log", "live"])]
    cpu: Option<u16>,
    /// Write every time that was seen with its count into this file: share, microseconds, cycles
    #[arg(long, value_name = "FILE.csv", conflicts_with = "live")]
    csv: Option<PathBuf>,
    /// Draw the histograms into this file
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// What is printed for programs.
#[derive(Debug, Serialize)]
struct Printed {
    source: String,
    period_us: f64,
    cycles: u64,
    overruns: u64,
    scheduling: Option<String>,
    shares: Vec<Share>,
}

/// A run's timing, wherever it came from.
struct Seen {
    source: String,
    period: Span,
    shares: Vec<Share>,
    /// The histograms to three digits, where they are at hand.
    timings: Option<Timings>,
    overruns: u64,
    /// How the thread was scheduled; logs and status files do not tell.
    scheduling: Option<String>,
}

/// What is read of a status file.
#[derive(Debug, Deserialize)]
struct Status {
    machine: String,
    period_us: f64,
    overruns: u64,
    shares: Vec<Share>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let seen = match (&arguments.log, &arguments.live) {
        (Some(log), _) => of_log(log)?,
        (None, Some(status)) => of_daemon(status)?,
        (None, None) => measured(arguments)?,
    };
    let shares = &seen.shares;
    let cycles = shares.first().map_or(0, |share| share.percentiles.count);
    if let (Some(path), Some(timings)) = (&arguments.csv, &seen.timings) {
        std::fs::write(path, timings.table()).with_context(|| format!("cannot write {}", path.display()))?;
    }
    if let Some(path) = &arguments.svg {
        let title = format!("{}, period {} us", seen.source, seen.period.as_us());
        std::fs::write(path, sheet(&title, shares))
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    if arguments.json {
        print_json(&Printed {
            source: seen.source,
            period_us: seen.period.as_us(),
            cycles,
            overruns: seen.overruns,
            scheduling: seen.scheduling,
            shares: seen.shares,
        })?;
        return Ok(Outcome::Done);
    }
    let drawn: String = shares.iter().map(|share| bars(share, WIDTH) + "\n").collect();
    let scheduling = seen.scheduling.map_or(String::new(), |scheduling| format!(", {scheduling}"));
    print_text(&format!(
        "{}: {} cycles of {} us, {} periods skipped{scheduling}\n\n{}\n\n{drawn}",
        seen.source,
        cycles,
        seen.period.as_us(),
        seen.overruns,
        view::latency_table(shares),
    ))?;
    Ok(Outcome::Done)
}

fn of_log(path: &Path) -> anyhow::Result<Seen> {
    let mut log = Reader::open(path)?;
    if log.header().extra.contains_key(IMPORTED) {
        anyhow::bail!(
            "{}: imported from a text of candump, in which nobody says when a cycle woke",
            path.display()
        );
    }
    let (period, mut timings, mut overruns) = (log.header().period, Timings::default(), 0);
    for record in &mut log {
        let record = record?;
        timings.add(&record);
        overruns = record.overruns;
    }
    Ok(Seen {
        source: path.display().to_string(),
        period,
        shares: timings.shares(),
        timings: Some(timings),
        overruns,
        scheduling: None,
    })
}

fn of_daemon(path: &Path) -> anyhow::Result<Seen> {
    let text = std::fs::read(path).with_context(|| {
        format!("no daemon keeps its status in {} (see `quadrantd --status`)", path.display())
    })?;
    let status: Status =
        serde_json::from_slice(&text).with_context(|| format!("{} is no status file", path.display()))?;
    Ok(Seen {
        source: format!("machine {}, since its daemon started", status.machine),
        period: Span::s(status.period_us * 1e-6),
        shares: status.shares,
        timings: None,
        overruns: status.overruns,
        scheduling: None,
    })
}

/// Counts records in the thread of the cycle: what they cost is in the total.
#[derive(Default)]
struct Counted {
    timings: Timings,
    overruns: u64,
}

impl Records for Counted {
    fn put(&mut self, record: &CycleRecord, _inputs: &Inputs) {
        self.timings.add(record);
        self.overruns = record.overruns;
    }
    fn lost(&self) -> u64 {
        0
    }
}

fn measured(arguments: &Arguments) -> anyhow::Result<Seen> {
    let machine = machine(&arguments.machine)?;
    let settings = Settings {
        priority: arguments.priority.unwrap_or(machine.real_time.priority),
        cpu: arguments.cpu.or(machine.real_time.cpu),
    };
    let _process = Process::prepare();
    let stop_wish = Arc::new(AtomicBool::new(false));
    let stopping = Arc::clone(&stop_wish);
    let period = machine.cycle.period;
    let source = format!("machine {} in this process", machine.name);
    let cycle = std::thread::Builder::new().name("cycle".to_owned());
    let cycle = cycle.spawn(move || cycles(&machine, settings, stopping))?;
    watch(arguments.seconds, &stop_wish, || cycle.is_finished());
    stop_wish.store(true, Ordering::Relaxed);
    let (counted, scheduling) = cycle.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
    let Counted { timings, overruns } = counted;
    let shares = timings.shares();
    Ok(Seen { source, period, shares, timings: Some(timings), overruns, scheduling: Some(scheduling) })
}

/// Hold position until told to stop; what was counted, and how the thread was scheduled.
fn cycles(
    machine: &Machine,
    settings: Settings,
    stop_wish: Arc<AtomicBool>,
) -> anyhow::Result<(Counted, String)> {
    let mut bus = Wired::new(machine.rack(1));
    let drives = bus.commission(machine.drives()?)?;
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let mut orders = Standby::new(true, stop_wish);
    let mut counted = Counted::default();
    let thread = Thread::prepare(&settings);
    let mut pace = Wall::starting_at(monotonic_now() + LEAD, machine.cycle.period);
    conduct(&mut cycle, &mut bus, &mut pace, &mut orders, &mut counted);
    let scheduling = match thread.scheduling {
        Ok(scheduling) if scheduling.policy == Policy::Fifo => {
            format!("SCHED_FIFO {}", scheduling.priority)
        }
        Ok(_) | Err(_) => "not real time (see `quadrantd --check`)".to_owned(),
    };
    Ok((counted, scheduling))
}

/// Wait, and show how long still.
fn watch(seconds: f64, stop_wish: &AtomicBool, is_over: impl Fn() -> bool) {
    let bar = ProgressBar::new((seconds * 10.0) as u64);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} left {eta}") {
        bar.set_style(style);
    }
    bar.set_message("measuring");
    let until = Instant::now() + Duration::from_secs_f64(seconds.max(0.0));
    while Instant::now() < until && !stop_wish.load(Ordering::Relaxed) && !is_over() {
        std::thread::sleep(Duration::from_millis(100));
        bar.inc(1);
    }
    bar.finish_and_clear();
}
