//! The record of one cycle: the cycle's working memory, the entry of the ring to the writer and
//! the row of the log are this one type.
//!
//! Invariant: everything a cycle read and decided stands in its record or in its inputs
//! ([`super::input`]); a replay needs nothing else.

use super::axis::PerAxis;
use super::command::Command;
use super::fault::Fault;
use super::sample::Sample;
use super::setpoint::Setpoint;
use super::time::{Moment, Span};

/// State of an axis without its inner data: what the log and the operator see.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum ModeTag {
    /// No current, drive disabled.
    #[default]
    Off = 0,
    /// The drive is being led to its enabled state.
    Enabling = 1,
    /// Enabled and standing, holding position.
    Ready = 2,
    /// Following a motion.
    Moving = 3,
    /// Coming to rest.
    Stopping = 4,
    /// Stopped by a fault; no current.
    Faulted = 5,
    /// Not told: what was imported from the traffic of a bus knows no modes.
    Unknown = 6,
}

impl ModeTag {
    /// Every mode, in order of the numbers.
    pub const ALL: [Self; 7] =
        [Self::Off, Self::Enabling, Self::Ready, Self::Moving, Self::Stopping, Self::Faulted, Self::Unknown];

    /// Name in logs and on the terminal.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Enabling => "enabling",
            Self::Ready => "ready",
            Self::Moving => "moving",
            Self::Stopping => "stopping",
            Self::Faulted => "faulted",
            Self::Unknown => "unknown",
        }
    }
    /// From a log.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.get(usize::from(number)).copied()
    }
}

/// Clock reads around one cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timing {
    /// When the grid wanted the cycle to start.
    pub scheduled: Moment,
    /// The place on the grid that the thread slept for: before `scheduled` if it overslept whole periods.
    pub awaited: Moment,
    /// When it started.
    pub woke: Moment,
    /// When it had received all it would.
    pub collected: Moment,
    /// When its commands stood.
    pub decided: Moment,
    /// When the cycle before this one had finished.
    pub previous_finished: Moment,
}

impl Timing {
    /// How long after the place on the grid that it slept for the thread ran, whole periods included.
    pub fn wake_error(&self) -> Span {
        self.woke - self.awaited
    }

    /// A cycle that takes no time, as in virtual time.
    pub const fn at(scheduled: Moment) -> Self {
        Self {
            scheduled,
            awaited: scheduled,
            woke: scheduled,
            collected: scheduled,
            decided: scheduled,
            previous_finished: scheduled,
        }
    }
}

/// Frames of one board, counted since the cycle started; wraps at 2^32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounts {
    /// Feedback used.
    pub fresh: u32,
    /// Cycles that ended without fresh feedback.
    pub missed: u32,
    /// Feedback frames that answered another cycle's SYNC, came after the reply window, or answered this one's a
    /// second time.
    pub late: u32,
    /// Feedback frames that had been there before.
    pub repeated: u32,
    /// Frames with an identifier of this board that could not be read.
    pub malformed: u32,
    /// Heartbeats.
    pub heartbeats: u32,
    /// Emergencies, with those that report the end of an error.
    pub emergencies: u32,
    /// Restarts of the board.
    pub resets: u32,
}

/// How a frame came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Arrival {
    /// How many frames its cycle had received before it.
    pub place: u8,
    /// When.
    pub at: Moment,
}

/// How the feedback of an axis came, the last that was used. On CAN FD one frame is both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Arrivals {
    /// The frame with the motor encoder.
    pub motor: Arrival,
    /// The frame with the table scale.
    pub table: Arrival,
}

/// What a bus said to a frame that was handed to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Refusal {
    /// Taken.
    #[default]
    None = 0,
    /// No room.
    Full = 1,
    /// The bus is down.
    Down = 2,
    /// Not told: in the imported traffic of a bus the frame is missing.
    Unknown = 3,
}

/// State of the host's own CAN controller (ISO 11898-1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum BusState {
    /// It takes part, and says aloud when a frame is wrong.
    #[default]
    ErrorActive = 0,
    /// It still takes part as before; its error counters have risen.
    ErrorWarning = 1,
    /// It takes part, but may not disturb others' frames any more.
    ErrorPassive = 2,
    /// It has left the bus.
    BusOff = 3,
}

/// The bus in one cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusRecord {
    /// State of the host's own controller.
    pub state: BusState,
    /// What became of SYNC.
    pub sync: Refusal,
    /// CRC-32 over all frames that the cycle gave to the bus, taken or not: identifiers and payloads.
    pub sent_crc: u32,
    /// Reports of the own controller, since start.
    pub reports: u32,
    /// Frames that belong to no axis, or that only a host sends, since start.
    pub foreign: u32,
    /// Frames that the receiving end dropped because nobody took them in time, since start.
    pub dropped: u32,
}

/// One axis in one cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisRecord {
    /// State after this cycle's decision.
    pub mode: ModeTag,
    /// Why it is stopping or faulted.
    pub fault: Option<Fault>,
    /// Which gain set acts, by its place in the machine file.
    pub gain_set: u8,
    /// What was wanted.
    pub setpoint: Setpoint,
    /// What was measured.
    pub sample: Sample,
    /// How it came.
    pub arrivals: Arrivals,
    /// How the link to the board fared.
    pub link: LinkCounts,
    /// What was commanded.
    pub command: Command,
    /// What the bus said to it.
    pub refusal: Refusal,
}

/// Which part of a procedure a cycle belongs to, so that an analysis finds its stretch of the log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stage {
    /// Counts the motions ordered in this run; 0 before the first.
    pub motion: u32,
    /// Whether the motion is in its evaluated part: a circle after its run-in and before its run-out.
    pub is_measured: bool,
}

/// One cycle of the machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CycleRecord {
    /// Number of the period on the grid since start; gaps are skipped periods.
    pub cycle: u64,
    /// Clock reads.
    pub timing: Timing,
    /// Periods skipped since start because a cycle came late.
    pub overruns: u64,
    /// Records and inputs lost since start because a ring was full or the disk refused.
    pub lost_records: u64,
    /// The bus.
    pub bus: BusRecord,
    /// What the cycle was part of.
    pub stage: Stage,
    /// Each axis.
    pub axes: PerAxis<AxisRecord>,
}

impl CycleRecord {
    /// A record of `axes` axes in which nothing has happened yet.
    pub fn empty(axes: usize) -> Self {
        Self {
            cycle: 0,
            timing: Timing::default(),
            overruns: 0,
            lost_records: 0,
            bus: BusRecord::default(),
            stage: Stage::default(),
            axes: PerAxis::filled(axes, AxisRecord::default()),
        }
    }

    /// How many cycles were run until then, this one among them: a skipped period is none.
    pub const fn cycles_run(&self) -> u64 {
        (self.cycle + 1).saturating_sub(self.overruns)
    }

    /// What became of the commands: the first refusal among them.
    pub fn commands(&self) -> Refusal {
        let mut refusals = self.axes.as_slice().iter().map(|axis| axis.refusal);
        refusals.find(|refusal| *refusal != Refusal::None).unwrap_or_default()
    }
}
