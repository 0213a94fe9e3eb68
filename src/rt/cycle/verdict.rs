//! From what a board said, or failed to say, to a fault.
//!
//! Invariant: silence is a fault like any other; a board that was never heard cannot be enabled.

use super::Settings;
use super::mode::Mode;
use crate::base::fault::{Fault, StopCategory};
use crate::base::record::Refusal;
use crate::base::sample::Freshness;
use crate::rt::control::Answer;
use crate::rt::drive::Observation;
use crate::rt::drive::state::DriveState;
use crate::rt::wire::feedback::BoardFlags;

/// What is wrong with the link to an axis and with its drive, the worst first. `commands` is what became
/// of the last commands, `is_lossy` whether too much feedback was missed lately.
pub(super) fn of_link(
    observation: &Observation,
    mode: Mode,
    commands: Refusal,
    is_lossy: bool,
    settings: &Settings,
) -> Option<Fault> {
    let (sample, events) = (&observation.sample, &observation.events);
    let flags = events.board_flags;
    let drive_is_in = |states: &[DriveState]| observation.drive.is_some_and(|drive| states.contains(&drive));
    let was_enabled = mode.is_energised();
    if events.is_board_reset {
        Some(Fault::BoardReset)
    } else if flags.contains(BoardFlags::ENCODER_ERROR) {
        Some(Fault::EncoderJump)
    } else if flags.contains(BoardFlags::WATCHDOG_TRIPPED) {
        Some(Fault::BoardWatchdog)
    } else if drive_is_in(&[DriveState::Fault, DriveState::FaultReactionActive]) || events.emergency.is_some()
    {
        Some(Fault::DriveFault)
    } else if events.is_second_host {
        Some(Fault::SecondHost)
    } else if events.is_bus_down || commands == Refusal::Down {
        Some(Fault::BusDown)
    } else if sample.freshness == Freshness::Never
        || sample.age_cycles > settings.stale_cycles_max
        || is_lossy
    {
        Some(Fault::FeedbackLost)
    } else if events.is_sync_refused || commands == Refusal::Full {
        Some(Fault::SendFailed)
    } else if was_enabled && !drive_is_in(&[DriveState::OperationEnabled]) {
        Some(Fault::DriveDropped)
    } else if events.heartbeat_age > settings.heartbeat_timeout {
        Some(Fault::HeartbeatLost)
    } else {
        None
    }
}

/// The fault to act on: the first, unless only the second is graver. A fault that can be cleared must
/// not hide one that loses the reference, nor one that is ramped out one that takes the current away.
pub(super) fn worst(first: Option<Fault>, second: Option<Fault>) -> Option<Fault> {
    let found = [first, second].into_iter().flatten();
    found.rev().max_by_key(|fault| (fault.loses_reference(), fault.stop() == StopCategory::Immediate))
}

/// What is wrong with an axis as such; `is_jump` and `violation` are what its loops find. A jump of the
/// position counts before all else, with or without current, because the position stays wrong; all else
/// concerns only an axis that is moved.
pub(super) fn of_axis(mode: Mode, is_jump: bool, answer: &Answer, violation: Option<Fault>) -> Option<Fault> {
    if is_jump {
        Some(Fault::EncoderJump)
    } else if mode.is_energised() {
        let broken = answer.is_not_a_number.then_some(Fault::NotANumber);
        broken.or(violation)
    } else {
        None
    }
}

/// Whether the drive says that it could not make the current it was asked for.
pub(super) fn is_saturated(observation: &Observation) -> bool {
    observation.events.board_flags.contains(BoardFlags::CURRENT_SATURATED)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;
    use crate::base::units::Acceleration;
    use crate::rt::cycle::bucket::BucketLimit;
    use crate::rt::cycle::mode::Patience;
    use crate::rt::drive::Events;

    const MOVING: Mode = Mode::Moving { over_since: None };
    const SETTINGS: Settings = Settings {
        position_every: 4,
        reply_window: Span::us(250),
        stale_cycles_max: 4,
        heartbeat_timeout: Span::ms(30),
        patience: Patience { enabling: Span::ms(1_000), stopping: Span::ms(1_000) },
        pause_cycles_max: 8,
        overruns: BucketLimit { misses_max: 2, drain_cycles: 100 },
        losses: BucketLimit { misses_max: 20, drain_cycles: 100 },
        stop_acceleration: Acceleration::m_per_s2(0.5),
    };

    #[test]
    fn a_failed_encoder_is_not_hidden_by_the_watchdog() {
        let board_flags = BoardFlags::WATCHDOG_TRIPPED.with(BoardFlags::ENCODER_ERROR);
        let events = Events { board_flags, ..Events::default() };
        let observation = Observation { events, ..Observation::default() };
        assert_eq!(
            of_link(&observation, Mode::Ready, Refusal::None, false, &SETTINGS),
            Some(Fault::EncoderJump)
        );
    }

    #[test]
    fn a_jump_is_not_hidden_by_what_is_not_a_number() {
        let broken = Answer { is_not_a_number: true, ..Answer::default() };
        let judge = |is_jump, mode| of_axis(mode, is_jump, &broken, Some(Fault::Overspeed));
        assert_eq!(judge(true, MOVING), Some(Fault::EncoderJump));
        assert_eq!(judge(false, MOVING), Some(Fault::NotANumber));
        assert_eq!(judge(true, Mode::Off), Some(Fault::EncoderJump));
        assert_eq!(judge(false, Mode::Off), None);
    }

    #[test]
    fn a_fault_to_ramp_out_hides_none_that_cuts() {
        let (ramp, cut) = (Some(Fault::HeartbeatLost), Some(Fault::Overspeed));
        assert_eq!(worst(ramp, cut), cut);
        assert_eq!(worst(cut, ramp), cut);
        assert_eq!(worst(None, ramp), ramp);
        assert_eq!(worst(cut, Some(Fault::NotANumber)), cut, "the link comes first");
        assert_eq!(worst(None, None), None);
    }

    #[test]
    fn a_fault_that_can_be_cleared_hides_none_that_loses_the_reference() {
        let lost = Some(Fault::EncoderJump);
        for other in Fault::ALL.into_iter().filter(|fault| !fault.loses_reference()) {
            assert_eq!(worst(Some(other), lost), lost, "{other} came first");
            assert_eq!(worst(lost, Some(other)), lost, "{other} came second");
        }
        assert_eq!(worst(Some(Fault::BoardReset), lost), Some(Fault::BoardReset), "the link comes first");
    }
}
