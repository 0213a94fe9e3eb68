//! Numbered faults. A number is forever: it is what the log, the board and the operator see, and
//! each has a page in `docs/faults/`.
//!
//! Invariant: a number is never given to another fault, and every fault has a way to stop.

use std::fmt;

/// Why an axis was stopped against its orders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Fault {
    /// No fresh feedback for longer than the machine file allows.
    FeedbackLost = 1,
    /// The drive reports its own fault state.
    DriveFault = 2,
    /// The axis left the response its loop should give by more than the limit.
    FollowingError = 3,
    /// The axis is outside its travel.
    Travel = 4,
    /// Measured velocity above the limit.
    Overspeed = 5,
    /// Measured current above the limit.
    Overcurrent = 6,
    /// The drive did not follow the enable sequence in time.
    EnableTimeout = 7,
    /// No heartbeat of the board for longer than the machine file allows.
    HeartbeatLost = 8,
    /// The board's own watchdog tripped: it had no fresh command and took the current away.
    BoardWatchdog = 9,
    /// The board restarted while the cycle ran.
    BoardReset = 10,
    /// The position moved further in one period than the axis can.
    EncoderJump = 11,
    /// A setpoint or command was not a number.
    NotANumber = 12,
    /// Another axis faulted, and this one was stopped with it.
    OtherAxis = 13,
    /// The drive left the enabled state without being told to.
    DriveDropped = 14,
    /// Commands could not be handed to the bus.
    SendFailed = 15,
    /// Too many periods were missed.
    Overrun = 16,
    /// The axis did not come to rest in the time that a stop may take.
    StopTimeout = 17,
    /// The CAN interface is down, or the host's controller has left the bus.
    BusDown = 18,
    /// Somebody else sends SYNC or commands on this bus.
    SecondHost = 19,
    /// The motor does not move as its current makes it.
    NoResponse = 20,
}

/// What an axis does on a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopCategory {
    /// Ramp the setpoint to rest under control, then take the current away
    /// (IEC 60204-1 stop category 1).
    Controlled,
    /// Take the current away at once; friction and brake hold (stop category 0). For faults that
    /// leave nothing to control with.
    Immediate,
}

impl Fault {
    /// Every fault, in order of the numbers.
    pub const ALL: [Self; 20] = [
        Self::FeedbackLost,
        Self::DriveFault,
        Self::FollowingError,
        Self::Travel,
        Self::Overspeed,
        Self::Overcurrent,
        Self::EnableTimeout,
        Self::HeartbeatLost,
        Self::BoardWatchdog,
        Self::BoardReset,
        Self::EncoderJump,
        Self::NotANumber,
        Self::OtherAxis,
        Self::DriveDropped,
        Self::SendFailed,
        Self::Overrun,
        Self::StopTimeout,
        Self::BusDown,
        Self::SecondHost,
        Self::NoResponse,
    ];

    /// The number that stands in the log.
    pub const fn number(self) -> u8 {
        self as u8
    }
    /// From a log; `None` for 0 (no fault) and for numbers this version does not know.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|fault| fault.number() == number)
    }
    /// Name in logs, JSON and page titles.
    pub const fn name(self) -> &'static str {
        match self {
            Self::FeedbackLost => "feedback-lost",
            Self::DriveFault => "drive-fault",
            Self::FollowingError => "following-error",
            Self::Travel => "travel",
            Self::Overspeed => "overspeed",
            Self::Overcurrent => "overcurrent",
            Self::EnableTimeout => "enable-timeout",
            Self::HeartbeatLost => "heartbeat-lost",
            Self::BoardWatchdog => "board-watchdog",
            Self::BoardReset => "board-reset",
            Self::EncoderJump => "encoder-jump",
            Self::NotANumber => "not-a-number",
            Self::OtherAxis => "other-axis",
            Self::DriveDropped => "drive-dropped",
            Self::SendFailed => "send-failed",
            Self::Overrun => "overrun",
            Self::StopTimeout => "stop-timeout",
            Self::BusDown => "bus-down",
            Self::SecondHost => "second-host",
            Self::NoResponse => "no-response",
        }
    }
    /// The page about it, from the top of the project.
    pub fn page(self) -> String {
        format!("docs/faults/{:02}-{}.md", self.number(), self.name())
    }
    /// How the axis comes to rest.
    pub const fn stop(self) -> StopCategory {
        match self {
            Self::Travel | Self::HeartbeatLost | Self::OtherAxis | Self::Overrun => StopCategory::Controlled,
            // An axis that left its response, or does not answer, has no control to ramp down with: behind a
            // frozen encoder the loop would accelerate it for as long as the ramp takes.
            Self::FeedbackLost
            | Self::DriveFault
            | Self::FollowingError
            | Self::Overspeed
            | Self::Overcurrent
            | Self::EnableTimeout
            | Self::BoardWatchdog
            | Self::BoardReset
            | Self::EncoderJump
            | Self::NotANumber
            | Self::DriveDropped
            | Self::SendFailed
            | Self::StopTimeout
            | Self::BusDown
            | Self::SecondHost
            | Self::NoResponse => StopCategory::Immediate,
        }
    }
    /// Whether the position counted so far is not to be trusted after it. Such a fault is never cleared:
    /// travel limits would stand at the wrong place until the host is started again. An encoder that did not
    /// show what the current did has not counted it either.
    pub const fn loses_reference(self) -> bool {
        matches!(self, Self::BoardReset | Self::EncoderJump | Self::NoResponse)
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "fault {} ({})", self.number(), self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_stable_and_unique() {
        for (index, fault) in Fault::ALL.into_iter().enumerate() {
            assert_eq!(usize::from(fault.number()), index + 1, "{fault}");
            assert_eq!(Fault::from_number(fault.number()), Some(fault));
        }
        assert_eq!(Fault::from_number(0), None);
        assert_eq!(Fault::from_number(200), None);
    }
}
