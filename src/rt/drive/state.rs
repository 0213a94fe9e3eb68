//! The state machine of CiA 402: the drive's side, the host's side, and the two words between them.
//!
//! The status word (6041h) says in which state a drive is, the control word (6040h) orders the
//! next one. Boards and their simulation use [`DriveState::next`], the host [`control_word`].
//! Numbers in the drawing are those of the standard's transitions.
//!
//! ```text
//!            ┌────────────────────────┐
//!            │ not ready to switch on │              any state
//!            └───────────┬────────────┘                  │ a fault of its own (13)
//!                        │ 1                 ┌───────────▼───────────┐
//!            ┌───────────▼────────────┐      │ fault reaction active │
//!       ┌───►│   switch on disabled   │◄──┐  └───────────┬───────────┘
//!       │    └───┬────────────────▲───┘   │              │ 14
//!       │      2 │ shutdown       │ 7     │      ┌───────▼──────┐
//!       │    ┌───▼────────────────┴───┐   └──────┤    fault     │
//!       │    │  ready to switch on    │◄──┐   15 └──────────────┘
//!       │    └───┬────────────────▲───┘   │    fault reset, rising
//!       │      3 │ switch on      │ 6     │
//!       │    ┌───▼────────────────┴───┐   │ 8
//!       │◄───┤      switched on       │   │
//!       │ 10 └───┬────────────────▲───┘   │
//!       │      4 │ enable         │ 5     │
//!       │    ┌───▼────────────────┴───┐   │
//!       │◄───┤   operation enabled    ├───┘
//!       │  9 └───┬────────────────▲───┘
//!       │     11 │ quick stop     │ 16 enable
//!       │    ┌───▼────────────────┴───┐
//!       └────┤   quick stop active    │
//!         12 └────────────────────────┘    7, 9, 10, 12: disable voltage (7 and 10 also quick stop)
//! ```
//!
//! Invariant: both functions are total; the drive gives current in one state only, operation
//! enabled, and no state but its neighbours leads there.

/// State of a drive (CiA 402).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriveState {
    /// The drive starts up.
    NotReadyToSwitchOn,
    /// Started; high voltage may be off.
    SwitchOnDisabled,
    /// High voltage may be on, the motor is not.
    ReadyToSwitchOn,
    /// The power stage is on and gives no current.
    SwitchedOn,
    /// Commands act.
    OperationEnabled,
    /// Stopped on order; our drives close no loop, so they give no current.
    QuickStopActive,
    /// A fault was seen, the drive reacts to it.
    FaultReactionActive,
    /// Stopped by a fault, until it is reset.
    Fault,
}

/// Bits of the status word beside the state.
pub mod status_bit {
    /// High voltage is on.
    pub const VOLTAGE_ENABLED: u16 = 1 << 4;
    /// The drive takes orders from the bus.
    pub const REMOTE: u16 = 1 << 9;
    /// A limit inside the drive acts: the current is saturated.
    pub const INTERNAL_LIMIT: u16 = 1 << 11;
    /// Cyclic mode: the drive follows the commanded value.
    pub const FOLLOWS_COMMAND: u16 = 1 << 12;
}

impl DriveState {
    /// Every state, from the start to the fault.
    pub const ALL: [Self; 8] = [
        Self::NotReadyToSwitchOn,
        Self::SwitchOnDisabled,
        Self::ReadyToSwitchOn,
        Self::SwitchedOn,
        Self::OperationEnabled,
        Self::QuickStopActive,
        Self::FaultReactionActive,
        Self::Fault,
    ];

    /// The mask of the status word that tells this state, and what stands under it.
    const fn pattern(self) -> (u16, u16) {
        match self {
            Self::NotReadyToSwitchOn => (0x4F, 0x00),
            Self::SwitchOnDisabled => (0x4F, 0x40),
            Self::ReadyToSwitchOn => (0x6F, 0x21),
            Self::SwitchedOn => (0x6F, 0x23),
            Self::OperationEnabled => (0x6F, 0x27),
            Self::QuickStopActive => (0x6F, 0x07),
            Self::FaultReactionActive => (0x4F, 0x0F),
            Self::Fault => (0x4F, 0x08),
        }
    }
    /// State told by a status word; `None` for a word the standard gives no meaning.
    pub fn decode(status_word: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|state| {
            let (mask, bits) = state.pattern();
            status_word & mask == bits
        })
    }
    /// Status word of a drive in this state: its bits, and those that follow from it.
    pub const fn status_word(self) -> u16 {
        let (_, bits) = self.pattern();
        let beside = match self {
            Self::NotReadyToSwitchOn => 0,
            Self::SwitchOnDisabled | Self::FaultReactionActive | Self::Fault => status_bit::REMOTE,
            Self::ReadyToSwitchOn | Self::SwitchedOn | Self::QuickStopActive => {
                status_bit::REMOTE | status_bit::VOLTAGE_ENABLED
            }
            Self::OperationEnabled => {
                status_bit::REMOTE | status_bit::VOLTAGE_ENABLED | status_bit::FOLLOWS_COMMAND
            }
        };
        bits | beside
    }

    /// The drive's side: where a drive goes from here. `control_word` is the newest, `previous` the
    /// one before it (a fault reset is an edge), `has_fault` a fault of its own that is still there.
    pub const fn next(self, previous: u16, control_word: u16, has_fault: bool) -> Self {
        let order = Order::decode(control_word);
        let is_reset = control_word & !previous & control_bit::FAULT_RESET != 0;
        match self {
            Self::FaultReactionActive => Self::Fault,
            Self::Fault if is_reset && !has_fault => Self::SwitchOnDisabled,
            Self::Fault => Self::Fault,
            Self::NotReadyToSwitchOn
            | Self::SwitchOnDisabled
            | Self::ReadyToSwitchOn
            | Self::SwitchedOn
            | Self::OperationEnabled
            | Self::QuickStopActive
                if has_fault =>
            {
                Self::FaultReactionActive
            }
            Self::NotReadyToSwitchOn => Self::SwitchOnDisabled,
            Self::SwitchOnDisabled => match order {
                Order::Shutdown => Self::ReadyToSwitchOn,
                Order::DisableVoltage | Order::QuickStop | Order::SwitchOn | Order::Enable => self,
            },
            Self::ReadyToSwitchOn => match order {
                Order::SwitchOn | Order::Enable => Self::SwitchedOn,
                Order::DisableVoltage | Order::QuickStop => Self::SwitchOnDisabled,
                Order::Shutdown => self,
            },
            Self::SwitchedOn => match order {
                Order::Enable => Self::OperationEnabled,
                Order::Shutdown => Self::ReadyToSwitchOn,
                Order::DisableVoltage | Order::QuickStop => Self::SwitchOnDisabled,
                Order::SwitchOn => self,
            },
            Self::OperationEnabled => match order {
                Order::SwitchOn => Self::SwitchedOn,
                Order::Shutdown => Self::ReadyToSwitchOn,
                Order::DisableVoltage => Self::SwitchOnDisabled,
                Order::QuickStop => Self::QuickStopActive,
                Order::Enable => self,
            },
            Self::QuickStopActive => match order {
                Order::Enable => Self::OperationEnabled,
                Order::DisableVoltage => Self::SwitchOnDisabled,
                Order::Shutdown | Order::SwitchOn | Order::QuickStop => self,
            },
        }
    }
}

/// Bits of the control word.
pub mod control_bit {
    /// Switch on.
    pub const SWITCH_ON: u16 = 1 << 0;
    /// Enable voltage.
    pub const ENABLE_VOLTAGE: u16 = 1 << 1;
    /// Quick stop, when 0.
    pub const NO_QUICK_STOP: u16 = 1 << 2;
    /// Enable operation.
    pub const ENABLE_OPERATION: u16 = 1 << 3;
    /// Reset a fault, by its rising edge.
    pub const FAULT_RESET: u16 = 1 << 7;
}

/// What a control word orders, beside a fault reset: the standard's commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    DisableVoltage,
    QuickStop,
    Shutdown,
    /// Also "disable operation", which is the same word.
    SwitchOn,
    Enable,
}

impl Order {
    const fn decode(control_word: u16) -> Self {
        if control_word & control_bit::ENABLE_VOLTAGE == 0 {
            Self::DisableVoltage
        } else if control_word & control_bit::NO_QUICK_STOP == 0 {
            Self::QuickStop
        } else if control_word & control_bit::SWITCH_ON == 0 {
            Self::Shutdown
        } else if control_word & control_bit::ENABLE_OPERATION == 0 {
            Self::SwitchOn
        } else {
            Self::Enable
        }
    }
    const fn word(self) -> u16 {
        match self {
            Self::DisableVoltage => 0x00,
            Self::QuickStop => control_bit::ENABLE_VOLTAGE,
            Self::Shutdown => control_bit::ENABLE_VOLTAGE | control_bit::NO_QUICK_STOP,
            Self::SwitchOn => Self::Shutdown.word() | control_bit::SWITCH_ON,
            Self::Enable => Self::SwitchOn.word() | control_bit::ENABLE_OPERATION,
        }
    }
}

/// Where the host wants a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// In operation enabled, where commands act.
    Enabled,
    /// Without voltage, from every state at once. A fault stays.
    Disabled,
    /// In quick stop active if it was enabled, without voltage otherwise. A fault stays.
    QuickStop,
    /// Out of its fault, then without voltage.
    FaultReset,
}

/// The host's side: the next control word towards `target`, given the state a drive was last seen
/// in (`None`: not known) and the control word sent before this one.
///
/// A fault is only reset by [`Target::FaultReset`], never on the way to another target.
pub const fn control_word(state: Option<DriveState>, target: Target, previous: u16) -> u16 {
    let order = match target {
        Target::Enabled => match state {
            Some(DriveState::SwitchOnDisabled) => Order::Shutdown,
            Some(DriveState::ReadyToSwitchOn) => Order::SwitchOn,
            Some(DriveState::SwitchedOn | DriveState::OperationEnabled) => Order::Enable,
            // A stop was ordered or forced: go all the way round, so that its latch opens.
            Some(DriveState::QuickStopActive) => Order::DisableVoltage,
            Some(DriveState::NotReadyToSwitchOn | DriveState::FaultReactionActive | DriveState::Fault)
            | None => Order::DisableVoltage,
        },
        Target::Disabled => Order::DisableVoltage,
        Target::QuickStop => Order::QuickStop,
        Target::FaultReset => {
            // Every second word has the bit, so that its edge comes again if a frame was lost.
            let is_edge =
                matches!(state, Some(DriveState::Fault)) && previous & control_bit::FAULT_RESET == 0;
            return if is_edge { control_bit::FAULT_RESET } else { Order::DisableVoltage.word() };
        }
    };
    order.word()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_states_of_classic_can_are_these() {
        assert_eq!(crate::rt::wire::classic::STATUS_WORDS, DriveState::ALL.map(DriveState::status_word));
    }

    #[test]
    fn every_status_word_tells_the_same_state_on_classic_can() {
        use crate::base::sample::RawFeedback;
        use crate::rt::wire::{Node, classic};
        for status_word in 0..=u16::MAX {
            let raw = RawFeedback { status_word, ..RawFeedback::default() };
            let [motor, table] = classic::encode_feedback(Node::MAX, &raw);
            let (motor, table) = (classic::decode_motor(&motor), classic::decode_table(&table));
            let told = classic::join(motor.unwrap(), table.unwrap(), 0).status_word;
            let expected = DriveState::decode(status_word).unwrap_or(DriveState::NotReadyToSwitchOn);
            assert_eq!(told, expected.status_word(), "status word {status_word:04x}h");
        }
    }

    #[test]
    fn each_state_is_told_by_its_word_and_no_two_by_one() {
        for state in DriveState::ALL {
            assert_eq!(DriveState::decode(state.status_word()), Some(state));
            assert_eq!(DriveState::decode(state.status_word() | status_bit::INTERNAL_LIMIT), Some(state));
        }
        for word in 0..=u16::MAX {
            let told = DriveState::ALL.into_iter().filter(|s| word & s.pattern().0 == s.pattern().1).count();
            assert!(told <= 1, "status word {word:04x}h tells {told} states");
        }
        assert_eq!(DriveState::decode(0x0001), None);
    }

    /// States a drive goes through when the host leads it to `target`, without delay.
    fn way(from: DriveState, target: Target) -> Vec<DriveState> {
        let (mut state, mut previous, mut way) = (from, 0, vec![]);
        for _ in 0..8 {
            let word = control_word(Some(state), target, previous);
            let next = state.next(previous, word, false);
            previous = word;
            if next != state {
                way.push(next);
            }
            state = next;
        }
        way
    }

    #[test]
    fn the_host_leads_a_drive_where_it_wants_it() {
        use DriveState::*;
        assert_eq!(
            way(NotReadyToSwitchOn, Target::Enabled),
            [SwitchOnDisabled, ReadyToSwitchOn, SwitchedOn, OperationEnabled]
        );
        assert_eq!(
            way(QuickStopActive, Target::Enabled),
            [SwitchOnDisabled, ReadyToSwitchOn, SwitchedOn, OperationEnabled]
        );
        assert_eq!(way(OperationEnabled, Target::QuickStop), [QuickStopActive]);
        assert_eq!(way(SwitchedOn, Target::QuickStop), [SwitchOnDisabled]);
        for state in [ReadyToSwitchOn, SwitchedOn, OperationEnabled, QuickStopActive] {
            assert_eq!(way(state, Target::Disabled), [SwitchOnDisabled]);
        }
    }

    #[test]
    fn only_a_fault_reset_leaves_a_fault_and_only_when_its_cause_is_gone() {
        use DriveState::*;
        for target in [Target::Enabled, Target::Disabled, Target::QuickStop] {
            assert_eq!(way(FaultReactionActive, target), [Fault], "{target:?}");
        }
        assert_eq!(way(Fault, Target::FaultReset), [SwitchOnDisabled]);
        assert_eq!(Fault.next(0, control_bit::FAULT_RESET, true), Fault);
        let held = control_bit::FAULT_RESET;
        assert_eq!(Fault.next(held, held, false), Fault, "a level is no edge");
        for state in DriveState::ALL {
            let word = control_word(Some(state), Target::FaultReset, control_bit::FAULT_RESET);
            assert_eq!(word, 0, "{state:?}: the bit must fall before it can rise");
        }
    }

    #[test]
    fn a_fault_of_its_own_leaves_every_state() {
        for state in DriveState::ALL {
            for word in 0..=0xFF {
                let next = state.next(0, word, true);
                assert!(
                    matches!(next, DriveState::FaultReactionActive | DriveState::Fault),
                    "{state:?} with control word {word:02x}h went to {next:?}"
                );
            }
        }
    }

    #[test]
    fn operation_is_enabled_from_its_neighbours_only_and_only_by_the_enable_order() {
        for state in DriveState::ALL {
            for word in 0..=0xFF {
                if state.next(0, word, false) == DriveState::OperationEnabled {
                    assert_eq!(word & 0x0F, 0x0F, "{state:?} enabled by {word:02x}h");
                    assert!(matches!(
                        state,
                        DriveState::SwitchedOn | DriveState::OperationEnabled | DriveState::QuickStopActive
                    ));
                }
            }
        }
    }
}
