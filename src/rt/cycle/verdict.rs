//! From what a board said, or failed to say, to a fault.
//!
//! Invariant: silence is a fault like any other; a board that was never heard cannot be enabled.

use super::Settings;
use super::mode::Mode;
use crate::base::fault::Fault;
use crate::base::sample::Freshness;
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
    } else if drive_is_in(&[DriveState::Fault, DriveState::FaultReactionActive]) || events.emergency.is_some()
    {
        Some(Fault::DriveFault)
    } else if sample.freshness == Freshness::Never || sample.age_cycles > settings.stale_cycles_max {
        Some(Fault::FeedbackLost)
    } else if flags.contains(BoardFlags::ENCODER_ERROR) {
        Some(Fault::EncoderJump)
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

/// Whether the drive says that it could not make the current it was asked for.
pub(super) fn is_saturated(observation: &Observation) -> bool {
    observation.events.board_flags.contains(BoardFlags::CURRENT_SATURATED)
}
