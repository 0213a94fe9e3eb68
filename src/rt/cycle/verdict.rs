//! From what a board said, or failed to say, to a fault.
//!
//! Invariant: silence is a fault like any other; a board that was never heard cannot be enabled.

use super::Settings;
use super::mode::Mode;
use crate::base::fault::{Fault, StopCategory};
use crate::base::sample::Freshness;
use crate::rt::control::{Answer, AxisLoop};
use crate::rt::drive::Observation;
use crate::rt::drive::state::DriveState;
use crate::rt::wire::feedback::BoardFlags;

/// What is wrong with the link to an axis and with its drive, the worst first.
pub(super) fn of_link(
    observation: &Observation,
    mode: Mode,
    is_send_refused: bool,
    settings: &Settings,
) -> Option<Fault> {
    let (sample, events) = (&observation.sample, &observation.events);
    let flags = events.board_flags;
    let drive_is_in = |states: &[DriveState]| observation.drive.is_some_and(|drive| states.contains(&drive));
    let was_enabled = mode.is_energised();
    if events.is_board_reset {
        Some(Fault::BoardReset)
    } else if flags.contains(BoardFlags::WATCHDOG_TRIPPED) {
        Some(Fault::BoardWatchdog)
    } else if flags.contains(BoardFlags::ENCODER_ERROR) {
        Some(Fault::EncoderJump)
    } else if drive_is_in(&[DriveState::Fault, DriveState::FaultReactionActive]) || events.emergency.is_some()
    {
        Some(Fault::DriveFault)
    } else if sample.freshness == Freshness::Never || sample.age_cycles > settings.stale_cycles_max {
        Some(Fault::FeedbackLost)
    } else if events.is_sync_refused || is_send_refused {
        Some(Fault::SendFailed)
    } else if was_enabled && !drive_is_in(&[DriveState::OperationEnabled]) {
        Some(Fault::DriveDropped)
    } else if events.heartbeat_age > settings.heartbeat_timeout {
        Some(Fault::HeartbeatLost)
    } else {
        None
    }
}

/// The fault to act on: the first, unless only the second leaves nothing to control with. A fault that
/// is ramped out must not hide one that takes the current away.
pub(super) fn worst(first: Option<Fault>, second: Option<Fault>) -> Option<Fault> {
    let found = [first, second].into_iter().flatten();
    found.clone().find(|fault| fault.stop() == StopCategory::Immediate).or_else(|| found.clone().next())
}

/// What is wrong with an axis as such. A jump of the position counts with or without current, because
/// the position stays wrong; all else concerns only an axis that is moved.
pub(super) fn of_axis(
    observation: &Observation,
    mode: Mode,
    axis_loop: &AxisLoop,
    answer: &Answer,
) -> Option<Fault> {
    if mode.is_energised() {
        let broken = answer.is_not_a_number.then_some(Fault::NotANumber);
        broken.or_else(|| axis_loop.violation(&observation.sample))
    } else {
        axis_loop.limits().is_jump(&observation.sample).then_some(Fault::EncoderJump)
    }
}

/// Whether the drive says that it could not make the current it was asked for.
pub(super) fn is_saturated(observation: &Observation) -> bool {
    observation.events.board_flags.contains(BoardFlags::CURRENT_SATURATED)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_to_ramp_out_hides_none_that_cuts() {
        let (ramp, cut) = (Some(Fault::HeartbeatLost), Some(Fault::Overspeed));
        assert_eq!(worst(ramp, cut), cut);
        assert_eq!(worst(cut, ramp), cut);
        assert_eq!(worst(None, ramp), ramp);
        assert_eq!(worst(cut, Some(Fault::EncoderJump)), cut, "the link comes first");
        assert_eq!(worst(None, None), None);
    }
}
