//! The machine on a CAN interface, for one host after the other.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, ensure};
use nix::sys::prctl::set_pdeathsig;
use nix::sys::signal::Signal;
use nix::unistd::getppid;
use quadrant::base::time::{Moment, Span};
use quadrant::rt::bus::socketcan::{Settings, SocketCan};
use quadrant::rt::bus::{Bus, lockstep};
use quadrant::rt::clock::monotonic_now;
use quadrant::sim::session::{Counts, Session};

use crate::live;
use crate::simulated::Simulated;
use crate::truth::TruthFile;

/// How often a wait for frames looks whether a signal came.
const WAIT: Span = Span::ms(100);

/// How a machine is served.
pub(crate) struct Service<'a> {
    pub(crate) interface: &'a str,
    /// On the wall clock, otherwise in lock step.
    pub(crate) is_live: bool,
    pub(crate) truth: TruthFile,
    /// Whose end is also that of this process.
    pub(crate) parent: Option<i32>,
}

/// Open the interface and serve until a signal.
pub(crate) fn run(simulated: &Simulated, service: Service<'_>) -> anyhow::Result<()> {
    let Service { interface, is_live, mut truth, parent } = service;
    let is_over = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&is_over))?;
    }
    if let Some(parent) = parent {
        set_pdeathsig(Signal::SIGTERM).context("cannot end with the parent")?;
        // It may have ended before.
        ensure!(getppid().as_raw() == parent, "process {parent} is not the parent of this one, or has ended");
    }
    let mut identifiers = simulated.machine.identifiers();
    identifiers.push(lockstep::MARKER);
    let settings = Settings { interface, identifiers: &identifiers, is_fd: simulated.machine.is_fd() };
    let mut bus = SocketCan::open(&settings, Moment::ZERO)?;
    if simulated.has_controller_fault() {
        bus.play_controllers()?;
    }
    let pace = if is_live { "on the wall clock" } else { "in lock step" };
    // Said when it is true: a host that came before would wait in vain.
    let ready = |truth: &mut TruthFile| {
        eprintln!("{simulated}, on {interface}, {pace}: waiting for a host");
        truth.tell()
    };
    if is_live {
        live::run(simulated, bus, truth, &is_over, ready)
    } else {
        ready(&mut truth)?;
        in_lock_step(simulated, bus, truth, &is_over)
    }
}

/// Serve until told otherwise, and say what was served.
fn in_lock_step(
    simulated: &Simulated,
    mut bus: SocketCan,
    mut truth: TruthFile,
    is_over: &AtomicBool,
) -> anyhow::Result<()> {
    bus.leave_undated();
    let mut session = Session::new(|| simulated.rack());
    let mut busy = Busy::default();
    let mut until = Moment::ZERO;
    while !is_over.load(Ordering::Relaxed) {
        match bus.receive(until) {
            Some(received) => {
                busy.work_at(received.at);
                session.hear(&received.frame, &mut bus);
                truth.note(&received.frame, || session.rack().truths())?;
                // From when it came: the clock need not be read for each frame.
                until = received.at + WAIT;
            }
            None => {
                busy.rest();
                truth.tell()?;
                until = monotonic_now() + WAIT;
            }
        }
    }
    truth.tell()?;
    eprintln!("{}", summary(session.counts(), bus.dropped(), busy.sum.as_s()));
    Ok(())
}

/// How long frames came, without the time in which no host was there.
#[derive(Default)]
struct Busy {
    sum: Span,
    last: Option<Moment>,
}

impl Busy {
    fn work_at(&mut self, now: Moment) {
        if let Some(last) = self.last.replace(now) {
            self.sum = self.sum + (now - last);
        }
    }
    fn rest(&mut self) {
        self.last = None;
    }
}

fn summary(counts: Counts, dropped: u64, seconds: f64) -> String {
    let Counts { sessions, cycles, heard, said, refused } = counts;
    let frames = heard + said;
    let rate = if seconds > 0.0 { frames as f64 / seconds } else { 0.0 };
    let mut text = format!(
        "{sessions} sessions, {cycles} cycles, {frames} frames ({heard} in, {said} out), {rate:.0} frames per second"
    );
    for (count, what) in [(dropped, "frames dropped by the kernel"), (refused, "answers refused by the bus")]
    {
        if count > 0 {
            text += &format!("; {count} {what}");
        }
    }
    text
}
