//! The shipped cycle and a rack in one process: real frames through a memory bus, in virtual time or
//! on the wall clock.
//!
//! [`Wired`] is the host's end. When the host waits for a frame and none is there, the rack is served:
//! both sides take turns in one thread, so a run is the same to the bit for a seed.
//! Invariant: what crosses between the two sides are frames and nothing else.

use super::rack::Rack;
use crate::base::input::Inputs;
use crate::base::record::CycleRecord;
use crate::base::time::{Moment, Span};
use crate::rt::bus::memory::{self, End};
use crate::rt::bus::{Bus, Frame, Received, SendError};
use crate::rt::door::{RecordRing, Records};
use crate::rt::drive::commission::{CommissionError, CommissionSettings};
use crate::rt::drive::{Configuring, Drives, Operational};

/// Frames that the memory bus holds each way: several cycles of every axis.
const BUS_FRAMES: usize = 64;

/// The host's end of a bus with a rack at the other.
#[derive(Debug)]
pub struct Wired {
    host: End,
    machine: End,
    rack: Rack,
}

impl Wired {
    /// Wire a rack up.
    pub fn new(rack: Rack) -> Self {
        let (host, machine) = memory::pair(BUS_FRAMES);
        Self { host, machine, rack }
    }

    /// The machine at the other end.
    pub fn rack(&self) -> &Rack {
        &self.rack
    }

    /// The machine at the other end, to make it fail.
    pub fn rack_mut(&mut self) -> &mut Rack {
        &mut self.rack
    }

    /// The machine without its bus, to be wired otherwise.
    pub fn into_rack(self) -> Rack {
        self.rack
    }

    /// Commission drives over this bus, in virtual time.
    pub fn commission(
        &mut self,
        drives: Drives<Configuring>,
    ) -> Result<Drives<Operational>, CommissionError> {
        commission(self, drives)
    }
}

/// Commission drives over a bus in virtual time.
pub fn commission<B: Bus>(
    bus: &mut B,
    drives: Drives<Configuring>,
) -> Result<Drives<Operational>, CommissionError> {
    // The rack answers at once or never: a clock that jumps ends a wait without an answer soon.
    let mut now = Moment::ZERO;
    let clock = || {
        now = now + Span::ms(10);
        now
    };
    drives.commission(bus, CommissionSettings::default(), clock)
}

/// Records that are waited for: in virtual time nothing needs to be lost.
#[derive(Debug)]
pub struct Patient(pub RecordRing);

impl Records for Patient {
    fn put(&mut self, record: &CycleRecord, inputs: &Inputs) {
        while !self.0.has_room() && !self.0.is_abandoned() {
            std::thread::yield_now();
        }
        self.0.put(record, inputs);
    }
    fn lost(&self) -> u64 {
        self.0.lost()
    }
}

impl Bus for Wired {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.host.send(frame)
    }

    fn receive(&mut self, until: Moment) -> Option<Received> {
        self.host.receive(until).or_else(|| {
            self.rack.serve(&mut self.machine);
            self.host.receive(until)
        })
    }
}
