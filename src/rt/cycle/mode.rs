//! The state of one axis, and the one place that decides it.
//!
//! ```text
//!                 enable                drive enabled            motion starts
//!        ┌─────┐ ───────► ┌──────────┐ ─────────────► ┌───────┐ ──────────────► ┌────────┐
//!        │ Off │          │ Enabling │                │ Ready │                 │ Moving │
//!        └─────┘ ◄─────── └──────────┘                └───────┘ ◄────────────── └────────┘
//!           ▲     disable      │                       ▲  │  at rest, motion ended  │
//!           │                  │                at rest│  │disable                  │ stop, disable,
//!           │ at rest,         │ fault, timeout        │  ▼                         │ fault to ramp out
//!           │ was disabled     │                    ┌──────────┐                    │
//!           ├──────────────────┼────────────────────│ Stopping │ ◄──────────────────┘
//!           │ clear            ▼      at rest,      └──────────┘
//!           │            ┌─────────┐  was a fault        │ timeout, fault to cut off
//!           └────────────│ Faulted │ ◄───────────────────┘
//!                        └─────────┘ ◄─── fault to cut off: from Ready, Moving, Stopping
//! ```
//!
//! A motion that is over and does not come to rest within the time of a stop is a timeout too.
//! A fault that loses the reference of the encoder leads from every state, also from Off, to a Faulted
//! that is never cleared.
//! Invariant: `next` is pure and total; what a state needs lives in it; a fault never leads to a state
//! in which the axis still moves without an end.

use crate::base::fault::{Fault, StopCategory};
use crate::base::record::ModeTag;
use crate::base::time::{Moment, Span};

/// Where a stop ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rest {
    /// Holding position.
    Ready,
    /// Without current, as ordered.
    Off,
    /// Without current, by a fault.
    Faulted(Fault),
}

/// State of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// No current, drive disabled.
    Off,
    /// The drive is led to its enabled state.
    Enabling {
        /// Since when.
        since: Moment,
    },
    /// Enabled, holding position.
    Ready,
    /// Following a motion, and coming to rest at its end.
    Moving {
        /// Since when it is over, if it is.
        over_since: Option<Moment>,
    },
    /// Braking along the path.
    Stopping {
        /// Since when.
        since: Moment,
        /// What follows.
        then: Rest,
    },
    /// Stopped by a fault, no current.
    Faulted {
        /// Which.
        by: Fault,
    },
}

/// What the operator wants of the axes now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// Nothing new.
    Nothing,
    /// Current on.
    Enable,
    /// Come to rest, current off.
    Disable,
    /// Come to rest.
    Stop,
    /// Forget the fault.
    ClearFault,
}

/// What a decision looks at.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// The cycle's moment.
    pub now: Moment,
    /// The operator's wish.
    pub wish: Wish,
    /// The worst thing wrong in this cycle.
    pub fault: Option<Fault>,
    /// The drive reports operation enabled.
    pub drive_is_enabled: bool,
    /// A motion is under way.
    pub motion_is_running: bool,
    /// The axis stands, measured and expected.
    pub is_standing: bool,
}

/// How long a state may last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// For the drive to become enabled.
    pub enabling: Span,
    /// For the axis to come to rest.
    pub stopping: Span,
}

impl Mode {
    /// The state of the next cycle.
    #[must_use]
    pub fn next(self, sight: &Sight, patience: &Patience) -> Self {
        if let Some(fault) = sight.fault.filter(|fault| fault.loses_reference()) {
            return self.without_reference(fault);
        }
        match self {
            Self::Off => match (sight.wish, sight.fault) {
                (Wish::Enable, None) => Self::Enabling { since: sight.now },
                (Wish::Enable, Some(fault)) => Self::Faulted { by: fault },
                (Wish::Nothing | Wish::Disable | Wish::Stop | Wish::ClearFault, _) => Self::Off,
            },
            Self::Enabling { since } => self.enabling(since, sight, patience),
            Self::Ready => match sight.fault {
                Some(fault) => Self::on_fault(fault, sight.now),
                None if sight.wish == Wish::Disable => Self::Stopping { since: sight.now, then: Rest::Off },
                None if sight.motion_is_running => Self::Moving { over_since: None },
                None => Self::Ready,
            },
            Self::Moving { over_since } => match (sight.fault, sight.wish) {
                (Some(fault), _) => Self::on_fault(fault, sight.now),
                (None, Wish::Disable) => Self::Stopping { since: sight.now, then: Rest::Off },
                (None, Wish::Stop) => Self::Stopping { since: sight.now, then: Rest::Ready },
                (None, Wish::Nothing | Wish::Enable | Wish::ClearFault) => {
                    Self::moving(over_since, sight, patience)
                }
            },
            Self::Stopping { since, then } => self.stopping(since, then, sight, patience),
            Self::Faulted { by } if by.loses_reference() => self,
            Self::Faulted { .. } => match (sight.wish, sight.fault) {
                // The drive's own fault is reset on the way through Off.
                (Wish::ClearFault, None | Some(Fault::DriveFault | Fault::BoardWatchdog)) => Self::Off,
                (Wish::ClearFault | Wish::Nothing | Wish::Enable | Wish::Disable | Wish::Stop, _) => self,
            },
        }
    }

    /// Whatever it did, the axis does not know where it is any more.
    fn without_reference(self, fault: Fault) -> Self {
        match self {
            Self::Faulted { by } if by.loses_reference() => self,
            Self::Off
            | Self::Enabling { .. }
            | Self::Ready
            | Self::Moving { .. }
            | Self::Stopping { .. }
            | Self::Faulted { .. } => Self::Faulted { by: fault },
        }
    }

    fn enabling(self, since: Moment, sight: &Sight, patience: &Patience) -> Self {
        if let Some(fault) = sight.fault {
            Self::Faulted { by: fault }
        } else if matches!(sight.wish, Wish::Disable | Wish::Stop) {
            Self::Off
        } else if sight.drive_is_enabled {
            Self::Ready
        } else if sight.now - since > patience.enabling {
            Self::Faulted { by: Fault::EnableTimeout }
        } else {
            self
        }
    }

    /// A loop that oscillates never stands, whatever it follows.
    fn moving(over_since: Option<Moment>, sight: &Sight, patience: &Patience) -> Self {
        let since = over_since.unwrap_or(sight.now);
        if sight.motion_is_running {
            Self::Moving { over_since: None }
        } else if sight.is_standing {
            Self::Ready
        } else if sight.now - since > patience.stopping {
            Self::Faulted { by: Fault::StopTimeout }
        } else {
            Self::Moving { over_since: Some(since) }
        }
    }

    fn stopping(self, since: Moment, then: Rest, sight: &Sight, patience: &Patience) -> Self {
        // The first fault keeps its name, but a worse one cuts the current, and so does a stop that is not
        // under control: it may have no time of its own.
        let overruns = matches!(then, Rest::Faulted(_)) && sight.fault == Some(Fault::Overrun);
        let then = match (then, sight.fault) {
            (Rest::Ready | Rest::Off, Some(fault)) => Rest::Faulted(fault),
            (Rest::Ready, None) if sight.wish == Wish::Disable => Rest::Off,
            (Rest::Ready | Rest::Off | Rest::Faulted(_), _) => then,
        };
        let must_cut = overruns || sight.fault.is_some_and(|fault| fault.stop() == StopCategory::Immediate);
        let is_at_rest = !sight.motion_is_running && sight.is_standing;
        let is_late = sight.now - since > patience.stopping;
        match then {
            Rest::Faulted(by) if must_cut || is_at_rest || is_late => Self::Faulted { by },
            Rest::Ready if is_at_rest => Self::Ready,
            Rest::Off if is_at_rest => Self::Off,
            Rest::Ready | Rest::Off if is_late => Self::Faulted { by: Fault::StopTimeout },
            Rest::Ready | Rest::Off | Rest::Faulted(_) => Self::Stopping { since, then },
        }
    }

    fn on_fault(fault: Fault, now: Moment) -> Self {
        match fault.stop() {
            StopCategory::Controlled => Self::Stopping { since: now, then: Rest::Faulted(fault) },
            StopCategory::Immediate => Self::Faulted { by: fault },
        }
    }

    /// Why it stops or stands, if by a fault.
    pub const fn fault(self) -> Option<Fault> {
        match self {
            Self::Faulted { by } | Self::Stopping { then: Rest::Faulted(by), .. } => Some(by),
            Self::Off | Self::Enabling { .. } | Self::Ready | Self::Moving { .. } | Self::Stopping { .. } => {
                None
            }
        }
    }

    /// Whether the loops act and current may flow.
    pub const fn is_energised(self) -> bool {
        matches!(self, Self::Ready | Self::Moving { .. } | Self::Stopping { .. })
    }

    /// Whether the drive should be enabled.
    pub const fn wants_drive(self) -> bool {
        matches!(self, Self::Enabling { .. }) || self.is_energised()
    }

    /// As logged.
    pub const fn tag(self) -> ModeTag {
        match self {
            Self::Off => ModeTag::Off,
            Self::Enabling { .. } => ModeTag::Enabling,
            Self::Ready => ModeTag::Ready,
            Self::Moving { .. } => ModeTag::Moving,
            Self::Stopping { .. } => ModeTag::Stopping,
            Self::Faulted { .. } => ModeTag::Faulted,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE: Patience = Patience { enabling: Span::ms(500), stopping: Span::ms(2000) };
    const MOVING: Mode = Mode::Moving { over_since: None };
    const CALM: Sight = Sight {
        now: Moment::ns(0),
        wish: Wish::Nothing,
        fault: None,
        drive_is_enabled: true,
        motion_is_running: false,
        is_standing: true,
    };

    fn late(ms: i64) -> Sight {
        Sight { now: Moment::ZERO + Span::ms(ms), ..CALM }
    }

    #[test]
    fn a_stop_that_overruns_again_is_not_under_control() {
        let overrun = Sight { fault: Some(Fault::Overrun), is_standing: false, ..CALM };
        let moving = Sight { is_standing: false, ..CALM };
        let stopping = MOVING.next(&overrun, &PATIENCE);
        assert_eq!(stopping, Mode::Stopping { since: Moment::ZERO, then: Rest::Faulted(Fault::Overrun) });
        let braking = stopping.next(&moving, &PATIENCE);
        assert_eq!(braking, stopping);
        assert_eq!(braking.next(&overrun, &PATIENCE), Mode::Faulted { by: Fault::Overrun });
        // The first overrun in a stop that was ordered is the fault, the second cuts.
        let ordered = Mode::Stopping { since: Moment::ZERO, then: Rest::Off };
        let named = ordered.next(&overrun, &PATIENCE);
        assert_eq!(named, stopping);
    }

    #[test]
    fn an_axis_is_enabled_moved_and_disabled() {
        let mut mode = Mode::Off;
        let mut go = |sight: Sight| {
            mode = mode.next(&sight, &PATIENCE);
            mode.tag()
        };
        assert_eq!(go(Sight { wish: Wish::Enable, drive_is_enabled: false, ..CALM }), ModeTag::Enabling);
        assert_eq!(go(Sight { drive_is_enabled: false, ..CALM }), ModeTag::Enabling);
        assert_eq!(go(CALM), ModeTag::Ready);
        assert_eq!(go(Sight { motion_is_running: true, ..CALM }), ModeTag::Moving);
        assert_eq!(go(Sight { is_standing: false, ..CALM }), ModeTag::Moving, "it still settles");
        assert_eq!(go(CALM), ModeTag::Ready);
        assert_eq!(go(Sight { wish: Wish::Disable, ..CALM }), ModeTag::Stopping);
        assert_eq!(go(CALM), ModeTag::Off);
    }

    #[test]
    fn every_fault_ends_without_current() {
        for fault in Fault::ALL {
            for start in [Mode::Ready, MOVING, Mode::Enabling { since: Moment::ZERO }] {
                let mut mode = start;
                let moving = Sight { motion_is_running: true, is_standing: false, ..CALM };
                mode = mode.next(&Sight { fault: Some(fault), ..moving }, &PATIENCE);
                if fault.stop() == StopCategory::Immediate {
                    assert_eq!(mode, Mode::Faulted { by: fault }, "from {start:?}");
                }
                // Even if the axis never comes to rest.
                mode = mode.next(&Sight { now: Moment::ZERO + Span::ms(2001), ..moving }, &PATIENCE);
                assert_eq!(mode, Mode::Faulted { by: fault }, "{fault} from {start:?}");
                assert!(!mode.is_energised() && !mode.wants_drive());
            }
        }
    }

    #[test]
    fn timeouts_take_the_current_away() {
        let enabling = Mode::Enabling { since: Moment::ZERO };
        let silent = Sight { drive_is_enabled: false, ..late(501) };
        assert_eq!(enabling.next(&silent, &PATIENCE), Mode::Faulted { by: Fault::EnableTimeout });
        let stopping = Mode::Stopping { since: Moment::ZERO, then: Rest::Ready };
        let running = Sight { is_standing: false, ..late(2001) };
        assert_eq!(stopping.next(&running, &PATIENCE), Mode::Faulted { by: Fault::StopTimeout });
    }

    #[test]
    fn a_motion_that_is_over_must_come_to_rest_in_time() {
        let restless = |ms| Sight { is_standing: false, ..late(ms) };
        let long = MOVING.next(&Sight { motion_is_running: true, ..restless(10_000) }, &PATIENCE);
        assert_eq!(long, MOVING, "a motion may take its time");
        let over = long.next(&restless(10_001), &PATIENCE);
        assert_eq!(over.next(&restless(12_001), &PATIENCE), over);
        assert_eq!(over.next(&late(12_001), &PATIENCE), Mode::Ready);
        assert_eq!(over.next(&restless(12_002), &PATIENCE), Mode::Faulted { by: Fault::StopTimeout });
        let again = over.next(&Sight { motion_is_running: true, ..restless(11_000) }, &PATIENCE);
        assert_eq!(again, MOVING, "the next motion begins anew");
    }

    #[test]
    fn a_fault_is_cleared_only_when_its_cause_is_gone() {
        let faulted = Mode::Faulted { by: Fault::FeedbackLost };
        let clear = Sight { wish: Wish::ClearFault, ..CALM };
        let still = Sight { fault: Some(Fault::FeedbackLost), ..clear };
        assert_eq!(faulted.next(&still, &PATIENCE), faulted);
        assert_eq!(faulted.next(&clear, &PATIENCE), Mode::Off);
        assert_eq!(faulted.next(&Sight { wish: Wish::Enable, ..CALM }, &PATIENCE), faulted);
    }

    #[test]
    fn a_worse_fault_while_stopping_cuts_the_current_and_the_first_keeps_its_name() {
        let stopping = Mode::Stopping { since: Moment::ZERO, then: Rest::Faulted(Fault::Travel) };
        let worse = Sight { fault: Some(Fault::Overspeed), is_standing: false, ..CALM };
        assert_eq!(stopping.next(&worse, &PATIENCE), Mode::Faulted { by: Fault::Travel });
    }

    #[test]
    fn a_lost_reference_is_noticed_in_every_state_and_never_cleared() {
        let stopping = Mode::Stopping { since: Moment::ZERO, then: Rest::Faulted(Fault::Travel) };
        for mode in [Mode::Off, Mode::Ready, stopping, Mode::Faulted { by: Fault::DriveFault }] {
            let mut mode = mode.next(&Sight { fault: Some(Fault::BoardReset), ..CALM }, &PATIENCE);
            assert_eq!(mode, Mode::Faulted { by: Fault::BoardReset });
            for wish in [Wish::ClearFault, Wish::Enable, Wish::Disable] {
                mode = mode.next(&Sight { wish, ..CALM }, &PATIENCE);
            }
            assert_eq!(mode, Mode::Faulted { by: Fault::BoardReset }, "the count is wrong until a restart");
        }
    }
}
