//! The machine on a CAN interface, for one host after the other.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use quadrant::base::time::{Moment, Span};
use quadrant::config::Machine;
use quadrant::rt::bus::socketcan::{Settings, SocketCan};
use quadrant::rt::bus::{Bus, lockstep};
use quadrant::rt::clock::monotonic_now;
use quadrant::sim::session::{Counts, Session};

use crate::live;

/// How often a wait for frames looks whether a signal came.
const WAIT: Span = Span::ms(100);

/// Open the interface and serve until a signal, in lock step or on the wall clock.
pub(crate) fn run(machine: &Machine, seed: u64, interface: &str, is_live: bool) -> anyhow::Result<()> {
    let is_over = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&is_over))?;
    }
    let mut identifiers = machine.identifiers();
    identifiers.push(lockstep::MARKER);
    let settings = Settings { interface, identifiers: &identifiers, is_fd: machine.is_fd() };
    let bus = SocketCan::open(&settings, Moment::ZERO)?;
    let pace = if is_live { "on the wall clock" } else { "in lock step" };
    eprintln!("machine {}, seed {seed}, on {interface}, {pace}: waiting for a host", machine.name);
    if is_live {
        live::run(machine, seed, bus, &is_over);
    } else {
        in_lock_step(machine, seed, bus, &is_over);
    }
    Ok(())
}

/// Serve until told otherwise, and say what was served.
fn in_lock_step(machine: &Machine, seed: u64, mut bus: SocketCan, is_over: &AtomicBool) {
    let mut session = Session::new(|| machine.rack(seed));
    let mut busy = Busy::default();
    let mut until = Moment::ZERO;
    while !is_over.load(Ordering::Relaxed) {
        match bus.receive(until) {
            Some(received) => {
                busy.work_at(received.at);
                session.hear(&received.frame, &mut bus);
                // From when it came: the clock need not be read for each frame.
                until = received.at + WAIT;
            }
            None => {
                busy.rest();
                until = monotonic_now() + WAIT;
            }
        }
    }
    eprintln!("{}", summary(session.counts(), bus.dropped(), busy.sum.as_s()));
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
