//! The machine on a CAN interface, on the wall clock: the plants go on whether or not a host speaks, and what
//! the boards measure is dated by the kernel's stamp of the SYNC.
//!
//! An answer that leaves later than the host waits is this program's fault and not the machine's: it is
//! counted and told, so that a slow simulator is not taken for a slow host.

use std::sync::atomic::{AtomicBool, Ordering};

use quadrant::base::time::{Moment, Span};
use quadrant::rt::bus::socketcan::SocketCan;
use quadrant::rt::bus::{Bus, Frame, Received, SendError};
use quadrant::rt::clock::monotonic_now;
use quadrant::rt::thread::{self, Process, Thread};
use quadrant::rt::wire::{Address, command};

use crate::simulated::Simulated;
use crate::truth::TruthFile;

/// How often heartbeats and watchdogs are looked after while no frame comes.
const WAIT: Span = Span::ms(1);
/// How often late answers are told.
const TELL: Span = Span::ms(1_000);

/// Below the cycle of a daemon on the same computer, above everything that is not real time.
const REAL_TIME: thread::Settings = thread::Settings { priority: 60, cpu: None };

/// Serve until told otherwise, and say what was served; `ready` says when a host is heard.
pub(crate) fn run(
    simulated: &Simulated,
    bus: SocketCan,
    truth: TruthFile,
    is_over: &AtomicBool,
    ready: impl FnOnce(&mut TruthFile) -> anyhow::Result<()> + Send,
) -> anyhow::Result<()> {
    let _process = Process::prepare();
    // In a thread of its own: the one that calls is left to the signals.
    std::thread::scope(|scope| {
        let served = scope.spawn(|| serve(simulated, bus, truth, is_over, ready)).join();
        served.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

fn serve(
    simulated: &Simulated,
    bus: SocketCan,
    mut truth: TruthFile,
    is_over: &AtomicBool,
    ready: impl FnOnce(&mut TruthFile) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    if let Err(errno) = Thread::prepare(&REAL_TIME).fifo {
        eprintln!("hil-sim: runs without real time ({errno}), so answers may be late");
    }
    let began = monotonic_now();
    let mut bus = Watched::new(bus, simulated.machine.cycle.reply_window, began);
    let mut rack = simulated.live_rack(Moment::ZERO);
    let mut told = Moment::ZERO;
    ready(&mut truth)?;
    while !is_over.load(Ordering::Relaxed) {
        let now = bus.now();
        let until = now + WAIT;
        while let Some(received) = bus.receive(until) {
            rack.answer(&received, &mut bus);
            truth.note(&received.frame, || rack.truths(received.at))?;
        }
        rack.speak(until, &mut bus);
        truth.tell()?;
        if now - told >= TELL {
            bus.tell_late();
            told = now;
        }
    }
    bus.tell_late();
    eprintln!("{}", bus.summary());
    Ok(())
}

/// The interface, with an eye on how long answers take.
struct Watched {
    bus: SocketCan,
    reply_window: Span,
    began: Moment,
    /// When the last SYNC came, and its cycle.
    sync: Option<(Moment, u32)>,
    cycles: u64,
    frames: u64,
    refused: u64,
    late: u64,
    late_told: u64,
    slowest: Span,
    slowest_cycle: u32,
}

impl Watched {
    fn new(mut bus: SocketCan, reply_window: Span, began: Moment) -> Self {
        bus.set_origin(began);
        Self {
            bus,
            reply_window,
            began,
            sync: None,
            cycles: 0,
            frames: 0,
            refused: 0,
            late: 0,
            late_told: 0,
            slowest: Span::ZERO,
            slowest_cycle: 0,
        }
    }

    /// In time of this run.
    fn now(&self) -> Moment {
        Moment::ZERO + (monotonic_now() - self.began)
    }

    fn time_answer(&mut self) {
        let Some((came, cycle)) = self.sync else { return };
        let took = self.now() - came;
        self.late += u64::from(took > self.reply_window);
        if took > self.slowest {
            (self.slowest, self.slowest_cycle) = (took, cycle);
        }
    }

    fn tell_late(&mut self) {
        let late = self.late - std::mem::replace(&mut self.late_told, self.late);
        if late > 0 {
            eprintln!(
                "hil-sim: {late} answers left later than {} us after their SYNC: the simulator was slow, not the host",
                self.reply_window.as_us()
            );
        }
    }

    fn summary(&self) -> String {
        format!(
            "{} cycles, {} frames; {} answers late by the simulator's own fault, slowest {:.0} us (cycle {}); {} \
             frames dropped by the kernel, {} refused by the bus",
            self.cycles,
            self.frames,
            self.late,
            self.slowest.as_us(),
            self.slowest_cycle,
            self.bus.dropped(),
            self.refused
        )
    }
}

impl Bus for Watched {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        let outcome = self.bus.send(frame);
        self.frames += 1;
        self.refused += u64::from(outcome.is_err());
        if matches!(Address::of(frame.id()), Some(Address::Feedback(_) | Address::FeedbackTable(_))) {
            self.time_answer();
        }
        outcome
    }

    fn receive(&mut self, until: Moment) -> Option<Received> {
        let received = self.bus.receive(until)?;
        self.frames += 1;
        if let Ok(cycle) = command::decode_sync(&received.frame)
            && Address::of(received.frame.id()) == Some(Address::Sync)
        {
            self.sync = Some((received.at, cycle));
            self.cycles += 1;
        }
        Some(received)
    }
}
