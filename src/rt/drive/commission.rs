//! From [`Configuring`] to [`Operational`]: every board is asked who it is and what it runs with,
//! and must be what its sheet says.
//!
//! Per axis: vendor, product, revision, serial where the settings name one, then the
//! firmware-config hash. If the hash differs, every value of the sheet is read to name the odd one.
//! No drive is enabled and nothing is written. The clock is the caller's: this runs before the
//! cycle, and in simulation the same call moves the simulated boards on.
//! Invariant: only this module makes a [`Drives<Operational>`].

use super::link::Link;
use super::sheet::SHEET;
use super::{Configuring, DriveSettings, Drives, Operational};
use crate::base::axis::{AXES_MAX, AxisId, PerAxis};
use crate::base::record::BusRecord;
use crate::base::time::{Moment, Span};
use crate::rt::bus::{Bus, Received, SendError};
use crate::rt::wire::parameter::{self, Abort, Access, Object};
use crate::rt::wire::{Address, Node};

/// How long is listened for another host before a board is asked: 40 periods at 2 kHz, 20 at 1 kHz.
const LISTEN: Span = Span::ms(20);

/// How patiently boards are asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommissionSettings {
    /// How long one request waits for its reply.
    pub reply_timeout: Span,
    /// How often one request is sent before the board counts as silent; at least 1.
    pub tries: u32,
}

impl Default for CommissionSettings {
    /// 100 ms is far beyond a board's answer on any bus; three tries outlive its reset.
    fn default() -> Self {
        Self { reply_timeout: Span::ms(100), tries: 3 }
    }
}

/// Why the drives cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CommissionError {
    /// The board did not answer.
    #[error(
        "axis {axis}: {node} did not tell {object}, {tries} times asked and {timeout_ms} ms waited each time",
        timeout_ms = .timeout.as_us() * 1e-3
    )]
    NoReply {
        /// Axis of the board.
        axis: AxisId,
        /// The board.
        node: Node,
        /// What was asked.
        object: Object,
        /// How often.
        tries: u32,
        /// How long each time.
        timeout: Span,
    },
    /// The request could not be sent.
    #[error("axis {axis}: could not ask {node} for {object}")]
    Unsent {
        /// Axis of the board.
        axis: AxisId,
        /// The board.
        node: Node,
        /// What was to be asked.
        object: Object,
        /// What the bus said.
        #[source]
        cause: SendError,
    },
    /// The board refused to tell.
    #[error("axis {axis}: {node} refused to tell {object}: {abort}")]
    Refused {
        /// Axis of the board.
        axis: AxisId,
        /// The board.
        node: Node,
        /// What was asked.
        object: Object,
        /// Why not.
        abort: Abort,
    },
    /// The board is not what the sheet says.
    #[error(
        "axis {axis}: {object} of {node} is {got}{space}{unit}, expected {expected}{space}{unit}",
        unit = .object.unit(), space = if .object.unit().is_empty() { "" } else { " " }
    )]
    Differs {
        /// Axis of the board.
        axis: AxisId,
        /// The board.
        node: Node,
        /// What differs.
        object: Object,
        /// What the sheet says, in the unit of the object.
        expected: u32,
        /// What the board says, in the unit of the object.
        got: u32,
    },
    /// Another host drives this bus.
    #[error("another host sends SYNC or commands on this bus: stop it first")]
    SecondHost,
    /// The hash differs and no single value does: the firmware hashes something else.
    #[error(
        "axis {axis}: firmware-config hash of {node} is {got:08x}h, expected {expected:08x}h, \
         though each value it tells agrees with its sheet"
    )]
    HashDiffers {
        /// Axis of the board.
        axis: AxisId,
        /// The board.
        node: Node,
        /// Hash of the sheet.
        expected: u32,
        /// Hash the board tells.
        got: u32,
    },
}

impl Drives<Configuring> {
    /// Compares every board with its sheet. `clock` tells the time and must advance from call to
    /// call where the bus itself does not wait.
    pub fn commission<B: Bus>(
        self,
        bus: &mut B,
        settings: CommissionSettings,
        clock: impl FnMut() -> Moment,
    ) -> Result<Drives<Operational>, CommissionError> {
        let Configuring { settings: drives, period } = self.phase;
        let links = drives.map(|_, drive| Link::new(drive, period));
        let mut inquiry = Inquiry { bus, clock, settings, links, heard: [None; AXES_MAX] };
        inquiry.listen()?;
        for (axis, drive) in drives.iter() {
            inquiry.check_identity(axis, drive)?;
            inquiry.check_firmware_config(axis, drive)?;
        }
        let Inquiry { links, heard, .. } = inquiry;
        Ok(operational(links, heard))
    }

    /// The drives as they were when a recorded run began: no board is asked, and `heard` are the heartbeats
    /// that were heard then. For a replay, which has no boards.
    pub fn resume(self, heard: impl IntoIterator<Item = Received>) -> Drives<Operational> {
        let Configuring { settings: drives, period } = self.phase;
        let mut links = drives.map(|_, drive| Link::new(drive, period));
        let mut kept = [None; AXES_MAX];
        for received in heard {
            take_heartbeat(&mut links, &mut kept, &received);
        }
        operational(links, kept)
    }
}

fn operational(mut links: PerAxis<Link>, before: [Option<Received>; AXES_MAX]) -> Drives<Operational> {
    links.as_mut_slice().iter_mut().for_each(Link::start);
    Drives {
        phase: Operational {
            links,
            bus: BusRecord::default(),
            is_second_host: false,
            was_bus_off: false,
            before,
        },
    }
}

/// The reset count before the cycle is what a later one is compared with; the last heartbeat of each board
/// is kept for the record.
fn take_heartbeat(links: &mut PerAxis<Link>, kept: &mut [Option<Received>], received: &Received) {
    let sender = Address::of(received.frame.id()).and_then(Address::sender);
    for (link, kept) in links.as_mut_slice().iter_mut().zip(kept) {
        if Some(link.node()) == sender {
            link.take_heartbeat(received);
            *kept = Some(*received);
        }
    }
}

/// Boards being asked.
struct Inquiry<'bus, B, C> {
    bus: &'bus mut B,
    clock: C,
    settings: CommissionSettings,
    links: PerAxis<Link>,
    heard: [Option<Received>; AXES_MAX],
}

impl<B: Bus, C: FnMut() -> Moment> Inquiry<'_, B, C> {
    /// A host that runs already would be cut off by our first cycle, and its axes with it.
    fn listen(&mut self) -> Result<(), CommissionError> {
        let deadline = (self.clock)() + LISTEN;
        loop {
            let now = (self.clock)();
            match self.bus.receive(deadline) {
                Some(received) => self.note(&received)?,
                None if now >= deadline => return Ok(()),
                None => {}
            }
        }
    }

    /// Takes what is no reply: a heartbeat, or the voice of another host.
    fn note(&mut self, received: &Received) -> Result<(), CommissionError> {
        match Address::of(received.frame.id()) {
            Some(Address::Sync | Address::Command(_)) => return Err(CommissionError::SecondHost),
            Some(Address::Heartbeat(_)) => take_heartbeat(&mut self.links, &mut self.heard, received),
            Some(_) | None => {}
        }
        Ok(())
    }

    fn check_identity(&mut self, axis: AxisId, drive: &DriveSettings) -> Result<(), CommissionError> {
        for object in [Object::Vendor, Object::Product, Object::Revision, Object::Serial] {
            let expected = drive.sheet.value(object).or(drive.serial);
            if let Some(expected) = expected {
                self.check(axis, drive.node, object, expected)?;
            }
        }
        Ok(())
    }

    fn check_firmware_config(&mut self, axis: AxisId, drive: &DriveSettings) -> Result<(), CommissionError> {
        let node = drive.node;
        let expected = drive.sheet.firmware_config_hash();
        let got = self.read(axis, node, Object::FirmwareConfigHash)?;
        if got == expected {
            return Ok(());
        }
        for object in SHEET {
            if let Some(value) = drive.sheet.value(object) {
                self.check(axis, node, object, value)?;
            }
        }
        Err(CommissionError::HashDiffers { axis, node, expected, got })
    }

    fn check(
        &mut self,
        axis: AxisId,
        node: Node,
        object: Object,
        expected: u32,
    ) -> Result<(), CommissionError> {
        let got = self.read(axis, node, object)?;
        if got == expected {
            Ok(())
        } else {
            Err(CommissionError::Differs { axis, node, object, expected, got })
        }
    }

    fn read(&mut self, axis: AxisId, node: Node, object: Object) -> Result<u32, CommissionError> {
        let CommissionSettings { reply_timeout: timeout, tries } = self.settings;
        let request = parameter::encode_request(node, object.address(), Access::Read);
        for _ in 0..tries {
            if let Err(cause) = self.bus.send(&request) {
                return Err(CommissionError::Unsent { axis, node, object, cause });
            }
            if let Some(outcome) = self.reply(node, object)? {
                return outcome.map_err(|abort| CommissionError::Refused { axis, node, object, abort });
            }
        }
        Err(CommissionError::NoReply { axis, node, object, tries, timeout })
    }

    /// Waits for the reply about `object`; what else comes meanwhile is heard and dropped.
    fn reply(&mut self, node: Node, object: Object) -> Result<Option<Result<u32, Abort>>, CommissionError> {
        let deadline = (self.clock)() + self.settings.reply_timeout;
        loop {
            let now = (self.clock)();
            let Some(received) = self.bus.receive(deadline) else {
                if now >= deadline {
                    return Ok(None);
                }
                continue;
            };
            match Address::of(received.frame.id()) {
                Some(Address::ParameterReply(from)) if from == node => {
                    match parameter::decode_reply(&received.frame) {
                        Ok((address, outcome)) if address == object.address() => return Ok(Some(outcome)),
                        // The answer to an earlier request, or not readable: ours may still come.
                        Ok(_) | Err(_) => {}
                    }
                }
                Some(_) | None => self.note(&received)?,
            }
        }
    }
}
