//! The record of one cycle: the cycle's working memory, the entry of the ring to the writer and
//! the row of the log are this one type.
//!
//! Invariant: everything a cycle read and decided stands in its record; a replay needs nothing else.

use super::axis::PerAxis;
use super::command::Command;
use super::fault::Fault;
use super::sample::Sample;
use super::setpoint::Setpoint;
use super::time::Moment;

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
}

impl ModeTag {
    /// Every mode, in order of the numbers.
    pub const ALL: [Self; 6] =
        [Self::Off, Self::Enabling, Self::Ready, Self::Moving, Self::Stopping, Self::Faulted];

    /// Name in logs and on the terminal.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Enabling => "enabling",
            Self::Ready => "ready",
            Self::Moving => "moving",
            Self::Stopping => "stopping",
            Self::Faulted => "faulted",
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
    /// When it started.
    pub woke: Moment,
    /// When the cycle before this one had finished.
    pub previous_finished: Moment,
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
    /// What was commanded.
    pub command: Command,
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
    /// Records lost since start because the ring was full or the disk refused.
    pub lost_records: u64,
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
            stage: Stage::default(),
            axes: PerAxis::filled(axes, AxisRecord::default()),
        }
    }
}
