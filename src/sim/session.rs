//! A rack that is served from outside, frame by frame: what a simulated machine does behind a bus whose host
//! is another process.
//!
//! ```text
//!   frame in ──► rack ──► answers out          a marker comes back behind them (rt/bus/lockstep.rs)
//! ```
//!
//! A session begins with marker 0, or, for a host that knows no markers, with the SYNC of cycle 0 after
//! another SYNC: the machine is as at power-on again, with the same seed. So one run after the other gives
//! the same numbers.
//! Invariant: the same frames since the beginning of a session give the same answers, whenever they come.

use super::rack::Rack;
use crate::base::time::Moment;
use crate::rt::bus::lockstep::{BEGIN, number_of};
use crate::rt::bus::memory::{self, End};
use crate::rt::bus::{Bus, Frame};
use crate::rt::wire::{Address, command};

/// Frames between host and rack at once: more than all boards say to one frame.
const BUS_FRAMES: usize = 256;

/// What was served so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Sessions that came to a SYNC.
    pub sessions: u64,
    /// SYNCs.
    pub cycles: u64,
    /// Frames from the host, markers among them.
    pub heard: u64,
    /// Frames to the host, markers among them.
    pub said: u64,
    /// Times the bus refused some of them.
    pub refused: u64,
}

/// A machine for one host after the other.
#[derive(Debug)]
pub struct Session<F> {
    power_on: F,
    rack: Rack,
    to_rack: End,
    of_rack: End,
    has_cycled: bool,
    answers: Vec<Frame>,
    counts: Counts,
}

impl<F: Fn() -> Rack> Session<F> {
    /// A machine that `power_on` gives anew for each session.
    pub fn new(power_on: F) -> Self {
        let (to_rack, of_rack) = memory::pair(BUS_FRAMES);
        let rack = power_on();
        Self {
            power_on,
            rack,
            to_rack,
            of_rack,
            has_cycled: false,
            answers: Vec::new(),
            counts: Counts::default(),
        }
    }

    /// The machine as it stands.
    pub const fn rack(&self) -> &Rack {
        &self.rack
    }

    /// What was served so far.
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// The host sent this frame: the answers go to `bus`.
    pub fn hear(&mut self, frame: &Frame, bus: &mut impl Bus) {
        self.counts.heard += 1;
        self.answers.clear();
        match number_of(frame) {
            Some(BEGIN) => {
                self.power_on();
                self.answers.push(*frame);
            }
            // Behind all answers, which are out by now.
            Some(_) => self.answers.push(*frame),
            None => {
                if Address::of(frame.id()) == Some(Address::Sync) {
                    self.begin_cycle(frame);
                }
                self.ask_rack(frame);
            }
        }
        self.counts.said += self.answers.len() as u64;
        // As on a real bus, a frame that finds no room is lost, and the host sees it missing.
        self.counts.refused += u64::from(bus.send_all(&self.answers).is_err());
    }

    fn power_on(&mut self) {
        self.rack = (self.power_on)();
        self.has_cycled = false;
    }

    fn begin_cycle(&mut self, sync: &Frame) {
        if self.has_cycled && command::decode_sync(sync) == Ok(0) {
            self.power_on();
        }
        self.counts.sessions += u64::from(!self.has_cycled);
        self.counts.cycles += 1;
        self.has_cycled = true;
    }

    fn ask_rack(&mut self, frame: &Frame) {
        let _has_room = self.to_rack.send(frame);
        self.rack.serve(&mut self.of_rack);
        while let Some(answer) = self.to_rack.receive(Moment::ZERO) {
            self.answers.push(answer.frame);
        }
    }
}
