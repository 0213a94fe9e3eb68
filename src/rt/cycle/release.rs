//! The end of a run: the order to let go of the current acts at a later SYNC, so a run that ended with
//! the order would leave the axes to the watchdogs of their boards.
//!
//! Invariant: waits for drives that can obey, and never for one that is not heard.

use crate::base::record::{AxisRecord, CycleRecord, ModeTag};
use crate::base::sample::Freshness;
use crate::rt::drive::state::DriveState;

/// Ticks of the position loop that a drive has to let go of the current, once it is told to.
pub(super) const TICKS_MAX: u32 = 50;

/// Drives on their way to let go.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Release {
    ticks: u32,
}

impl Release {
    /// A tick of the position loop since the order.
    pub(super) fn tick(&mut self) {
        self.ticks = self.ticks.saturating_add(1);
    }

    /// Whether every axis is at rest without current, or would not let go in time.
    pub(super) fn is_over(&self, last: &CycleRecord) -> bool {
        let is_at_rest = |axis: &AxisRecord| matches!(axis.mode, ModeTag::Off | ModeTag::Faulted);
        // A board that is not heard, or does not obey, is left to its watchdog after all.
        let is_released = |axis: &AxisRecord| {
            axis.sample.freshness != Freshness::Fresh
                || DriveState::decode(axis.sample.raw.status_word) != Some(DriveState::OperationEnabled)
        };
        let axes = last.axes.as_slice();
        axes.iter().all(is_at_rest) && (axes.iter().all(is_released) || self.ticks > TICKS_MAX)
    }
}

/// Whether every axis is in one of these modes.
pub(super) fn is_everywhere(last: &CycleRecord, modes: &[ModeTag]) -> bool {
    last.axes.as_slice().iter().all(|axis| modes.contains(&axis.mode))
}
