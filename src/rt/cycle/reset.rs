//! Reset of a drive's own fault while its axis is off. A reset belongs to an order: to the start of the run,
//! or to the operator's. A fault that stays after a few is left to be seen.
//!
//! Invariant: no drive is reset more often than [`RESETS_MAX`] times for one order.

use crate::rt::drive::state::{DriveState, Target};

/// A frame may be lost, and a drive may need a moment.
pub(super) const RESETS_MAX: u8 = 3;
/// From one to the next.
const CYCLES_BETWEEN: u32 = 100;

/// Resets that an axis may still give.
#[derive(Clone, Copy, Debug)]
pub(super) struct Resets {
    left: u8,
    wait_cycles: u32,
}

impl Default for Resets {
    fn default() -> Self {
        Self { left: RESETS_MAX, wait_cycles: 0 }
    }
}

impl Resets {
    /// Where to lead a drive, last seen in this state, of an axis that is off.
    pub(super) fn target(&mut self, drive: Option<DriveState>) -> Target {
        self.wait_cycles = self.wait_cycles.saturating_sub(1);
        if drive != Some(DriveState::Fault) || self.left == 0 || self.wait_cycles > 0 {
            return Target::Disabled;
        }
        self.left -= 1;
        self.wait_cycles = CYCLES_BETWEEN;
        Target::FaultReset
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_that_stays_is_reset_three_times_and_then_left() {
        let mut resets = Resets::default();
        let given: Vec<usize> =
            (0..1_000).filter(|_| resets.target(Some(DriveState::Fault)) == Target::FaultReset).collect();
        assert_eq!(given, [0, 100, 200]);
    }

    #[test]
    fn a_drive_without_a_fault_is_not_reset() {
        let mut resets = Resets::default();
        for drive in [None, Some(DriveState::SwitchOnDisabled), Some(DriveState::FaultReactionActive)] {
            assert_eq!(resets.target(drive), Target::Disabled, "{drive:?}");
        }
    }
}
