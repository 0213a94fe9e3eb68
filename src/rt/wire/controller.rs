//! What the host's own CAN controller reports of itself: error frames as Linux hands them out
//! (`linux/can/error.h`). They never were on the bus.
//!
//! The identifier is a set of error classes, the payload their details. Only what changes the state of
//! the controller is decoded; the rest is counted by whoever takes it.
//! Invariant: total, like every decoder here.

use super::{Malformed, payload};
use crate::base::record::BusState;
use crate::rt::bus::{Frame, Id};

/// Class: the state of the controller changed; details in byte 1.
pub const CLASS_CONTROLLER: u16 = 0x004;
/// Class: the controller has left the bus.
pub const CLASS_BUS_OFF: u16 = 0x040;
/// Class: the controller takes part again.
pub const CLASS_RESTARTED: u16 = 0x100;

const WARNING: u8 = 0x04 | 0x08;
const PASSIVE: u8 = 0x10 | 0x20;
const ACTIVE: u8 = 0x40;

/// What a report says about the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    classes: u16,
    controller: u8,
}

impl Report {
    /// State of the controller, which was `before`.
    pub const fn state_after(self, before: BusState) -> BusState {
        if self.classes & CLASS_BUS_OFF != 0 {
            BusState::BusOff
        } else if self.classes & CLASS_RESTARTED != 0 {
            BusState::ErrorActive
        } else if self.classes & CLASS_CONTROLLER == 0 {
            before
        } else if self.controller & PASSIVE != 0 {
            BusState::ErrorPassive
        } else if self.controller & WARNING != 0 {
            BusState::ErrorWarning
        } else if self.controller & ACTIVE != 0 {
            BusState::ErrorActive
        } else {
            before
        }
    }
}

/// The report of a controller in this state, as its driver would send it.
pub fn encode(state: BusState) -> Frame {
    let (classes, controller) = match state {
        BusState::ErrorActive => (CLASS_RESTARTED, 0),
        BusState::ErrorWarning => (CLASS_CONTROLLER, WARNING),
        BusState::ErrorPassive => (CLASS_CONTROLLER, PASSIVE),
        BusState::BusOff => (CLASS_BUS_OFF, 0),
    };
    Frame::report(Id::from_low_bits(classes), [0, controller, 0, 0, 0, 0, 0, 0])
}

/// What a report says.
pub fn decode(frame: &Frame) -> Result<Report, Malformed> {
    let details: &[u8; 8] = payload(frame)?;
    Ok(Report { classes: frame.id().raw(), controller: details[1] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_state_is_told_and_others_leave_it() {
        let after = |frame: &Frame, before| decode(frame).map(|report| report.state_after(before));
        for state in [BusState::ErrorActive, BusState::ErrorWarning, BusState::ErrorPassive, BusState::BusOff]
        {
            for before in [BusState::ErrorActive, BusState::BusOff] {
                assert_eq!(after(&encode(state), before), Ok(state));
            }
        }
        let lost_arbitration = Frame::report(Id::from_low_bits(0x002), [0; 8]);
        assert_eq!(after(&lost_arbitration, BusState::ErrorPassive), Ok(BusState::ErrorPassive));
        let active_again = Frame::report(Id::from_low_bits(CLASS_CONTROLLER), [0, ACTIVE, 0, 0, 0, 0, 0, 0]);
        assert_eq!(after(&active_again, BusState::ErrorPassive), Ok(BusState::ErrorActive));
    }
}
