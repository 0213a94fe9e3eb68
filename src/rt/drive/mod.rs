//! The drives of the machine, seen from the host: frames in become [`Observation`]s, commands
//! become frames out. Between `rt/bus` with `rt/wire` below and `rt/cycle` above.
//!
//! Bring-up happens once and in order: [`Drives<Configuring>`] knows the settings;
//! [`commission`](Drives::commission) reads identity and firmware-config hash of every board and
//! gives [`Drives<Operational>`], which the cycle owns:
//!
//! ```text
//! collect:  SYNC out ─► feedback, heartbeats, emergencies in ─► one Observation per axis
//! dispatch: one Command per axis ─► command frames out
//! ```
//!
//! Invariant: what stands in a [`Sample`] as fresh was latched by this cycle's SYNC. After
//! commissioning nothing is allocated, and time comes as an argument.

pub mod bend;
mod board_clock;
pub mod commission;
mod halves;
mod link;
pub mod liveness;
pub mod sheet;
pub mod state;
pub mod velocity;

use self::link::Link;
pub use self::link::raw_command;
use self::sheet::Sheet;
use self::state::DriveState;
use self::velocity::VelocityEstimate;
use super::bus::{Bus, Format, PAYLOAD_BYTES_MAX, Received, SendError};
use super::wire::feedback::BoardFlags;
use super::wire::scaling::AxisScale;
use super::wire::state::Emergency;
use super::wire::{Address, Layout, Node, command, controller};
use crate::base::axis::{AXES_MAX, AxisId, PerAxis};
use crate::base::command::Command;
use crate::base::frame::{Frame, Id};
use crate::base::input::{Input, Inputs, What};
use crate::base::record::{Arrivals, BusRecord, BusState, LinkCounts, Refusal};
use crate::base::sample::Sample;
use crate::base::time::{Moment, Span};
use crate::base::units::Acceleration;

/// What the host must know of one drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveSettings {
    /// Its board's number on the bus.
    pub node: Node,
    /// How its cyclic frames travel.
    pub layout: Layout,
    /// What must be true inside the board.
    pub sheet: Sheet,
    /// Which board of this type it must be; `None`: any.
    pub serial: Option<u32>,
    /// Counts to quantities.
    pub scale: AxisScale,
    /// How velocity comes from positions.
    pub velocity_estimate: VelocityEstimate,
}

/// One axis in one cycle, as the control sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observation {
    /// What was measured; the last values if nothing fresh came.
    pub sample: Sample,
    /// The least with which the motor comes to a fresh position from the two before it.
    pub acceleration: Acceleration,
    /// How it came.
    pub arrivals: Arrivals,
    /// State of the drive when last heard; `None` before that, or if its status word means nothing.
    pub drive: Option<DriveState>,
    /// What may be a fault.
    pub events: Events,
}

/// What a board reported or failed to report; `rt/cycle` makes faults of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Events {
    /// What the board said about itself with its last feedback.
    pub board_flags: BoardFlags,
    /// The first error reported since the last cycle.
    pub emergency: Option<Emergency>,
    /// The board restarted since the last cycle.
    pub is_board_reset: bool,
    /// This cycle's SYNC could not be handed to the bus.
    pub is_sync_refused: bool,
    /// The interface is down, or the own controller has left the bus.
    pub is_bus_down: bool,
    /// Somebody else sent a SYNC or a command.
    pub is_second_host: bool,
    /// Time since the last heartbeat.
    pub heartbeat_age: Span,
}

/// Phase before commissioning: what the machine file says.
#[derive(Clone, Debug)]
pub struct Configuring {
    settings: PerAxis<DriveSettings>,
    period: Span,
}

/// Phase after commissioning: what changes from cycle to cycle.
#[derive(Clone, Debug)]
pub struct Operational {
    links: PerAxis<Link>,
    bus: BusRecord,
    is_second_host: bool,
    /// The own controller was off the bus when the cycle began.
    was_bus_off: bool,
    /// Heartbeats of the boards from before the first cycle, until it has told them.
    before: [Option<Received>; AXES_MAX],
}

/// The drives of the machine in one phase of their bring-up.
#[derive(Clone, Debug)]
pub struct Drives<Phase> {
    phase: Phase,
}

/// Settings that cannot be right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SettingsError {
    /// Two axes on one board.
    #[error("axes {first} and {second} are both {node}")]
    SameNode {
        /// One axis.
        first: AxisId,
        /// The other.
        second: AxisId,
        /// The board they share.
        node: Node,
    },
}

impl Drives<Configuring> {
    /// Drives as the machine file describes them, sampled every `period`.
    pub fn new(period: Span, settings: PerAxis<DriveSettings>) -> Result<Self, SettingsError> {
        for (second, drive) in settings.iter() {
            let same = |other: &(AxisId, &DriveSettings)| other.0 < second && other.1.node == drive.node;
            if let Some((first, _)) = settings.iter().find(same) {
                return Err(SettingsError::SameNode { first, second, node: drive.node });
            }
        }
        Ok(Self { phase: Configuring { settings, period } })
    }
}

/// Most frames one cycle reads per axis. A flooded bus ends the collection instead of the deadline,
/// because frames already received are handed out even after it.
const FRAMES_PER_AXIS_MAX: u8 = 32;

impl Drives<Operational> {
    /// Sends SYNC for `cycle` and receives until every axis answered it or the moment `until` has
    /// come; [`observations`](Self::observations) are then those of the cycle. Frames behind the last answer stay in the bus for the next cycle. What is not fresh
    /// feedback goes to the `inputs`.
    pub fn collect<B: Bus>(&mut self, bus: &mut B, cycle: u64, until: Moment, inputs: &mut Inputs) {
        let sync = command::encode_sync(cycle as u32);
        self.phase.bus.sync = refusal(bus.send(&sync));
        self.phase.is_second_host = false;
        self.phase.was_bus_off = self.phase.bus.state == BusState::BusOff;
        for received in self.phase.before.iter_mut().filter_map(Option::take) {
            inputs.push(Input { cycle, what: What::Before(received) });
        }
        for (_, link) in self.phase.links.iter_mut() {
            link.begin(cycle, until);
        }
        let mut awaited = self.phase.links.count();
        for place in 0..FRAMES_PER_AXIS_MAX * self.phase.links.count() as u8 {
            if awaited == 0 {
                break;
            }
            let Some(received) = bus.receive(until) else { break };
            match self.take(&received, place, cycle) {
                Taken::Fresh => awaited -= 1,
                Taken::Held => {}
                Taken::Aside => inputs.push(Input { cycle, what: What::Frame { place, received } }),
            }
        }
        self.phase.bus.dropped = u32::try_from(bus.dropped()).unwrap_or(u32::MAX);
        let Operational { bus: now, is_second_host, .. } = self.phase;
        let is_bus_down = now.state == BusState::BusOff || now.sync == Refusal::Down;
        for (_, link) in self.phase.links.iter_mut() {
            link.end(cycle, until, inputs);
            let events = &mut link.observation.events;
            events.is_sync_refused = now.sync != Refusal::None;
            events.is_bus_down = is_bus_down;
            events.is_second_host = is_second_host;
        }
    }

    /// Each axis as the last collection left it.
    pub fn observations(&self) -> PerAxis<&Observation> {
        self.phase.links.map(|_, link| &link.observation)
    }

    /// How the link to each board has fared.
    pub fn link_counts(&self) -> PerAxis<&LinkCounts> {
        self.phase.links.map(|_, link| link.counts())
    }

    /// Gives a frame to its axis; whether it was the answer the axis was waiting for.
    fn take(&mut self, received: &Received, place: u8, cycle: u64) -> Taken {
        let frame = &received.frame;
        if frame.format() == Format::Report {
            let bus = &mut self.phase.bus;
            bus.reports = bus.reports.saturating_add(1);
            bus.state = controller::decode(frame).map_or(bus.state, |report| report.state_after(bus.state));
            return Taken::Aside;
        }
        if self.phase.was_bus_off && self.phase.bus.state == BusState::BusOff {
            // Who hears a frame takes part again: an interface that was set down and up does not say so. In the
            // cycle that learns of bus-off, frames from before it may still be under way.
            self.phase.bus.state = BusState::ErrorActive;
        }
        let address = Address::of(frame.id());
        // A host of our own makes it to be the only one.
        self.phase.is_second_host |= matches!(address, Some(Address::Sync | Address::Command(_)));
        let link = address.and_then(Address::sender).and_then(|node| self.link_of(node));
        match (address, link) {
            (Some(Address::Feedback(_) | Address::FeedbackTable(_)), Some(link)) => {
                return link.take_feedback(received, place, cycle);
            }
            (Some(Address::Heartbeat(_)), Some(link)) => link.take_heartbeat(received),
            (Some(Address::Emergency(_)), Some(link)) => link.take_emergency(frame),
            // Of no axis, or what only hosts send, or a reply that comes after we stopped asking.
            _ => self.phase.bus.foreign = self.phase.bus.foreign.saturating_add(1),
        }
        Taken::Aside
    }

    fn link_of(&mut self, node: Node) -> Option<&mut Link> {
        self.phase.links.as_mut_slice().iter_mut().find(|link| link.node() == node)
    }

    /// Sends each axis its command of `cycle`, and says what became of it. An axis whose frame is refused
    /// does not keep the others from getting theirs.
    pub fn dispatch<B: Bus>(
        &mut self,
        bus: &mut B,
        commands: &PerAxis<Command>,
        cycle: u64,
    ) -> PerAxis<Refusal> {
        let mut frames = [Frame::classic(Id::MAX, []); AXES_MAX];
        let axes = self.phase.links.as_mut_slice().iter_mut().zip(commands.as_slice());
        let mut count = 0;
        for (slot, (link, command)) in frames.iter_mut().zip(axes) {
            *slot = link.command_frame(command, cycle);
            count += 1;
        }
        let frames = frames.get(..count).unwrap_or(&frames);
        self.phase.bus.sent_crc = checksum(cycle, frames);
        let mut refusals = PerAxis::filled(count, Refusal::None);
        bus.send_each(frames, &mut |place, why| {
            if let Some(of_axis) = refusals.as_mut_slice().get_mut(place) {
                *of_axis = refusal(Err(why));
            }
        });
        refusals
    }

    /// How the bus fares.
    pub const fn bus(&self) -> &BusRecord {
        &self.phase.bus
    }
}

/// What became of a frame that a cycle received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Taken {
    /// The answer that an axis was waiting for, or the last piece of it.
    Fresh,
    /// A piece of an answer; the link keeps it until the rest comes or the cycle ends.
    Held,
    /// Anything else.
    Aside,
}

/// CRC-32 over identifiers and payloads of the SYNC of `cycle` and of commands: what the record tells of the
/// frames that a cycle sent.
pub fn checksum<'a>(cycle: u64, commands: impl IntoIterator<Item = &'a Frame>) -> u32 {
    // Collected first: a CRC costs by the piece more than by the byte.
    let mut bytes = [0; (AXES_MAX + 1) * (size_of::<u32>() + PAYLOAD_BYTES_MAX)];
    let mut length = 0;
    let mut put = |frame: &Frame| {
        for piece in [&frame.id().raw().to_le_bytes(), frame.payload()] {
            if let Some(place) = bytes.get_mut(length..length + piece.len()) {
                place.copy_from_slice(piece);
                length += piece.len();
            }
        }
    };
    put(&command::encode_sync(cycle as u32));
    commands.into_iter().for_each(put);
    crc32fast::hash(bytes.get(..length).unwrap_or(&bytes))
}

const fn refusal(outcome: Result<(), SendError>) -> Refusal {
    match outcome {
        Ok(()) => Refusal::None,
        Err(SendError::Full) => Refusal::Full,
        Err(SendError::Down) => Refusal::Down,
    }
}
