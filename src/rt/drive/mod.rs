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

pub mod commission;
mod link;
pub mod liveness;
pub mod sheet;
pub mod state;
pub mod velocity;

use self::link::Link;
use self::liveness::LinkCounts;
use self::sheet::Sheet;
use self::state::DriveState;
use self::velocity::VelocityEstimate;
use super::bus::{Bus, Received, SendError};
use super::wire::feedback::BoardFlags;
use super::wire::scaling::AxisScale;
use super::wire::state::Emergency;
use super::wire::{Address, Node, command};
use crate::base::axis::{AxisId, PerAxis};
use crate::base::command::Command;
use crate::base::sample::Sample;
use crate::base::time::{Moment, Span};

/// What the host must know of one drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveSettings {
    /// Its board's number on the bus.
    pub node: Node,
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
    foreign_frames: u64,
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
const FRAMES_PER_AXIS_MAX: usize = 32;

impl Drives<Operational> {
    /// Sends SYNC for `cycle` and receives until every axis answered it or the moment `until` has
    /// come. Frames behind the last answer stay in the bus for the next cycle.
    pub fn collect<B: Bus>(&mut self, bus: &mut B, cycle: u64, until: Moment) -> PerAxis<Observation> {
        let is_sync_refused = bus.send(&command::encode_sync(cycle as u32)).is_err();
        for (_, link) in self.phase.links.iter_mut() {
            link.begin(cycle, until, is_sync_refused);
        }
        let mut awaited = self.phase.links.count();
        for _ in 0..FRAMES_PER_AXIS_MAX * self.phase.links.count() {
            if awaited == 0 {
                break;
            }
            let Some(received) = bus.receive(until) else { break };
            awaited -= usize::from(self.take(&received, cycle));
        }
        for (_, link) in self.phase.links.iter_mut() {
            link.end(cycle, until);
        }
        self.phase.links.map(|_, link| link.observation)
    }

    /// Gives a frame to its axis; whether it was the answer the axis was waiting for.
    fn take(&mut self, received: &Received, cycle: u64) -> bool {
        let frame = &received.frame;
        match Address::of(frame.id()) {
            Some(Address::Feedback(node)) => match self.link_of(node) {
                Some(link) => return link.take_feedback(frame, cycle),
                None => self.phase.foreign_frames += 1,
            },
            Some(Address::Heartbeat(node)) => match self.link_of(node) {
                Some(link) => link.take_heartbeat(received),
                None => self.phase.foreign_frames += 1,
            },
            Some(Address::Emergency(node)) => match self.link_of(node) {
                Some(link) => link.take_emergency(frame),
                None => self.phase.foreign_frames += 1,
            },
            // What only hosts send, or a reply that comes after we stopped asking.
            Some(
                Address::Sync
                | Address::Command(_)
                | Address::ParameterReply(_)
                | Address::ParameterRequest(_),
            )
            | None => self.phase.foreign_frames += 1,
        }
        false
    }

    fn link_of(&mut self, node: Node) -> Option<&mut Link> {
        self.phase.links.as_mut_slice().iter_mut().find(|link| link.node() == node)
    }

    /// Sends each axis its command of `cycle`. An axis whose frame is refused does not keep the
    /// others from getting theirs; the first refusal is reported.
    pub fn dispatch<B: Bus>(
        &mut self,
        bus: &mut B,
        commands: &PerAxis<Command>,
        cycle: u64,
    ) -> Result<(), SendError> {
        let mut outcome = Ok(());
        for (link, command) in self.phase.links.as_mut_slice().iter_mut().zip(commands.as_slice()) {
            outcome = outcome.and(bus.send(&link.command_frame(command, cycle)));
        }
        outcome
    }

    /// What was counted of each axis since the cycle started.
    pub fn counts(&self) -> PerAxis<LinkCounts> {
        self.phase.links.map(|_, link| link.counts())
    }
    /// Frames that belong to no axis, or that only a host sends: somebody else speaks on this bus.
    pub const fn foreign_frames(&self) -> u64 {
        self.phase.foreign_frames
    }
}
