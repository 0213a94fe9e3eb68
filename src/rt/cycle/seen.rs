//! What an order waits for, as the record of the last cycle shows it.
//!
//! Invariant: an axis of which nothing fresh is known is ready for nothing.

use crate::base::record::{AxisRecord, CycleRecord, ModeTag};
use crate::base::sample::Freshness;
use crate::rt::drive::state::DriveState;
use crate::rt::wire::feedback::BoardFlags;

/// Whether every axis is in one of these modes.
pub(super) fn is_everywhere(last: &CycleRecord, modes: &[ModeTag]) -> bool {
    last.axes.as_slice().iter().all(|axis| modes.contains(&axis.mode))
}

/// Ticks of the position loop in which boards may become ready. What still lacks then is told by the fault
/// that enabling meets.
const TICKS_MAX: u32 = 250;

/// The wait before axes are enabled: meanwhile they are off, where faults of the drives are reset.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Admission {
    ticks: u32,
}

impl Admission {
    /// A tick of the position loop: whether to enable now.
    pub(super) fn is_given(&mut self, last: &CycleRecord) -> bool {
        self.ticks = self.ticks.saturating_add(1);
        is_everywhere(last, &[ModeTag::Off])
            && (last.axes.as_slice().iter().all(can_be_enabled) || self.ticks > TICKS_MAX)
    }
}

fn can_be_enabled(axis: &AxisRecord) -> bool {
    let raw = &axis.sample.raw;
    let is_ready = matches!(
        DriveState::decode(raw.status_word),
        Some(DriveState::SwitchOnDisabled | DriveState::ReadyToSwitchOn | DriveState::SwitchedOn)
    );
    let flags = BoardFlags::from_bits(raw.board_flags);
    axis.sample.freshness == Freshness::Fresh && is_ready && !flags.contains(BoardFlags::WATCHDOG_TRIPPED)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;

    fn ready() -> CycleRecord {
        let mut last = CycleRecord::empty(2);
        for (_, axis) in last.axes.iter_mut() {
            axis.sample.freshness = Freshness::Fresh;
            axis.sample.raw.status_word = DriveState::SwitchOnDisabled.status_word();
        }
        last
    }

    #[test]
    fn axes_are_enabled_once_all_of_them_are_ready() {
        assert!(Admission::default().is_given(&ready()));
        let spoilt: [fn(&mut AxisRecord); 5] = [
            |axis| axis.sample.freshness = Freshness::Stale,
            |axis| axis.sample.raw.status_word = DriveState::Fault.status_word(),
            |axis| axis.sample.raw.status_word = DriveState::QuickStopActive.status_word(),
            |axis| axis.sample.raw.board_flags = BoardFlags::WATCHDOG_TRIPPED.bits(),
            |axis| axis.mode = ModeTag::Faulted,
        ];
        for (number, spoil) in spoilt.into_iter().enumerate() {
            let mut last = ready();
            spoil(&mut last.axes[AxisId::Y]);
            assert!(!Admission::default().is_given(&last), "{number}: {:?}", last.axes[AxisId::Y]);
        }
    }

    #[test]
    fn an_axis_that_does_not_become_ready_shall_say_why() {
        let (mut admission, last) = (Admission::default(), CycleRecord::empty(2));
        assert_eq!((0..1_000).filter(|_| admission.is_given(&last)).count(), 750);
    }
}
