//! The kinds of scripted faults, with their parameters.
//!
//! Invariant: every kind has one name, and [`Kind::ALL`] knows them all.

use crate::base::time::Span;
use crate::base::units::{Current, Position};
use crate::rt::bus::Id;
use crate::rt::bus::faulty::{Faults, Filter};
use crate::rt::wire::{Address, Node};

/// What goes wrong, without its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Frames do not arrive.
    LostFrames,
    /// Frames arrive so many periods late.
    LateFrames,
    /// Frames arrive twice.
    RepeatedFrames,
    /// Frames are overtaken by the next ones.
    ReorderedFrames,
    /// Frames arrive with an inverted bit that no checksum found.
    CorruptedFrames,
    /// The board repeats old encoder readings as if they were new.
    EncoderFrozen,
    /// The motor encoder's readings move by a way that the motor did not make.
    EncoderJump,
    /// The board says that it does not trust its encoder.
    EncoderError,
    /// The encoders' counters start so near their wrap that the motion crosses it.
    EncoderWrap,
    /// The board sends nothing.
    SilentBoard,
    /// The board restarts; its encoders keep their counts.
    BoardReset,
    /// The board loses its power and gets it back; its encoders count from zero.
    BoardPowerCycle,
    /// The drive finds a fault of its own.
    DriveFault,
    /// The drive gives no more than a part of its current.
    CurrentSaturation,
    /// The board's CAN controller is off the bus for a time.
    BoardBusOff,
    /// The board is of another type.
    WrongIdentity,
    /// The board runs with other settings than its sheet says.
    WrongFirmwareConfig,
    /// The table gets heavier or lighter.
    Load,
    /// The friction grows or falls.
    Friction,
    /// The screw gets play.
    Backlash,
    /// Another host talks on the bus.
    SecondHost,
    /// The host's own CAN controller leaves the bus and comes back.
    ControllerBusOff,
    /// The host's own CAN controller becomes error passive and recovers.
    ControllerErrorPassive,
}

/// When a kind of fault takes place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timing {
    /// From the start on, for good.
    Start,
    /// At a moment.
    Moment,
    /// From a moment on, for a time.
    Lasting,
}

impl Kind {
    /// Every kind.
    pub const ALL: [Self; 23] = [
        Self::LostFrames,
        Self::LateFrames,
        Self::RepeatedFrames,
        Self::ReorderedFrames,
        Self::CorruptedFrames,
        Self::EncoderFrozen,
        Self::EncoderJump,
        Self::EncoderError,
        Self::EncoderWrap,
        Self::SilentBoard,
        Self::BoardReset,
        Self::BoardPowerCycle,
        Self::DriveFault,
        Self::CurrentSaturation,
        Self::BoardBusOff,
        Self::WrongIdentity,
        Self::WrongFirmwareConfig,
        Self::Load,
        Self::Friction,
        Self::Backlash,
        Self::SecondHost,
        Self::ControllerBusOff,
        Self::ControllerErrorPassive,
    ];

    /// Name in scenarios and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::LostFrames => "lost-frames",
            Self::LateFrames => "late-frames",
            Self::RepeatedFrames => "repeated-frames",
            Self::ReorderedFrames => "reordered-frames",
            Self::CorruptedFrames => "corrupted-frames",
            Self::EncoderFrozen => "encoder-frozen",
            Self::EncoderJump => "encoder-jump",
            Self::EncoderError => "encoder-error",
            Self::EncoderWrap => "encoder-wrap",
            Self::SilentBoard => "silent-board",
            Self::BoardReset => "board-reset",
            Self::BoardPowerCycle => "board-power-cycle",
            Self::DriveFault => "drive-fault",
            Self::CurrentSaturation => "current-saturation",
            Self::BoardBusOff => "board-bus-off",
            Self::WrongIdentity => "wrong-identity",
            Self::WrongFirmwareConfig => "wrong-firmware-config",
            Self::Load => "load",
            Self::Friction => "friction",
            Self::Backlash => "backlash",
            Self::SecondHost => "second-host",
            Self::ControllerBusOff => "controller-bus-off",
            Self::ControllerErrorPassive => "controller-error-passive",
        }
    }

    /// When it takes place.
    pub const fn timing(self) -> Timing {
        match self {
            Self::EncoderWrap | Self::WrongIdentity | Self::WrongFirmwareConfig => Timing::Start,
            Self::EncoderJump
            | Self::BoardReset
            | Self::BoardPowerCycle
            | Self::DriveFault
            | Self::Load
            | Self::Friction
            | Self::Backlash => Timing::Moment,
            Self::LostFrames
            | Self::LateFrames
            | Self::RepeatedFrames
            | Self::ReorderedFrames
            | Self::CorruptedFrames
            | Self::EncoderFrozen
            | Self::EncoderError
            | Self::SilentBoard
            | Self::CurrentSaturation
            | Self::BoardBusOff
            | Self::SecondHost
            | Self::ControllerBusOff
            | Self::ControllerErrorPassive => Timing::Lasting,
        }
    }

    /// Whether it happens to an axis, not to the bus as such.
    pub const fn has_axis(self) -> bool {
        !matches!(self, Self::SecondHost | Self::ControllerBusOff | Self::ControllerErrorPassive)
    }
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effect {
    /// Frames do not arrive.
    LostFrames(Traffic),
    /// Frames arrive late.
    LateFrames {
        /// Which.
        traffic: Traffic,
        /// By so much.
        by: Span,
    },
    /// Frames arrive twice.
    RepeatedFrames(Traffic),
    /// Frames are overtaken by the next ones.
    ReorderedFrames(Traffic),
    /// Frames arrive with an inverted bit.
    CorruptedFrames(Traffic),
    /// Old readings as if they were new.
    EncoderFrozen,
    /// Readings move by a way.
    EncoderJump(Position),
    /// The board distrusts its encoder.
    EncoderError,
    /// The counters wrap after a way towards higher positions.
    EncoderWrap(Position),
    /// The board sends nothing.
    SilentBoard,
    /// The board restarts.
    BoardReset,
    /// The board loses its power.
    BoardPowerCycle,
    /// The drive finds a fault, with the error code of its emergency.
    DriveFault(u16),
    /// The drive gives at most so much.
    CurrentSaturation(Current),
    /// The board is off the bus.
    BoardBusOff,
    /// The board says that it is this product.
    WrongIdentity(u32),
    /// The board's watchdog has another time.
    WrongFirmwareConfig {
        /// That time, us.
        watchdog_us: u32,
    },
    /// Mass of the table, as a multiple of the machine file's.
    Load(f64),
    /// All forces of the friction law, as a multiple of the machine file's.
    Friction(f64),
    /// Play between screw and table.
    Backlash(Position),
    /// Another host sends this in each period.
    SecondHost(Sends),
    /// The host's controller is off the bus.
    ControllerBusOff,
    /// The host's controller is error passive.
    ControllerErrorPassive,
}

impl Effect {
    /// Its kind.
    pub const fn kind(&self) -> Kind {
        match self {
            Self::LostFrames(_) => Kind::LostFrames,
            Self::LateFrames { .. } => Kind::LateFrames,
            Self::RepeatedFrames(_) => Kind::RepeatedFrames,
            Self::ReorderedFrames(_) => Kind::ReorderedFrames,
            Self::CorruptedFrames(_) => Kind::CorruptedFrames,
            Self::EncoderFrozen => Kind::EncoderFrozen,
            Self::EncoderJump(_) => Kind::EncoderJump,
            Self::EncoderError => Kind::EncoderError,
            Self::EncoderWrap(_) => Kind::EncoderWrap,
            Self::SilentBoard => Kind::SilentBoard,
            Self::BoardReset => Kind::BoardReset,
            Self::BoardPowerCycle => Kind::BoardPowerCycle,
            Self::DriveFault(_) => Kind::DriveFault,
            Self::CurrentSaturation(_) => Kind::CurrentSaturation,
            Self::BoardBusOff => Kind::BoardBusOff,
            Self::WrongIdentity(_) => Kind::WrongIdentity,
            Self::WrongFirmwareConfig { .. } => Kind::WrongFirmwareConfig,
            Self::Load(_) => Kind::Load,
            Self::Friction(_) => Kind::Friction,
            Self::Backlash(_) => Kind::Backlash,
            Self::SecondHost(_) => Kind::SecondHost,
            Self::ControllerBusOff => Kind::ControllerBusOff,
            Self::ControllerErrorPassive => Kind::ControllerErrorPassive,
        }
    }

    /// What it does to a line, and to which traffic; `None` for what is not about frames.
    pub(super) fn faults(&self) -> Option<(Traffic, Faults)> {
        let none = Faults::NONE;
        match *self {
            Self::LostFrames(traffic) => Some((traffic, Faults { drop: traffic.chance, ..none })),
            Self::LateFrames { traffic, by } => {
                Some((traffic, Faults { delay: (traffic.chance, by), ..none }))
            }
            Self::RepeatedFrames(traffic) => Some((traffic, Faults { repeat: traffic.chance, ..none })),
            Self::ReorderedFrames(traffic) => Some((traffic, Faults { reorder: traffic.chance, ..none })),
            Self::CorruptedFrames(traffic) => Some((traffic, Faults { flip_bit: traffic.chance, ..none })),
            _ => None,
        }
    }
}

/// In which direction frames travel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// From boards to the host.
    FromBoards,
    /// From the host to boards.
    ToBoards,
    /// Both.
    Both,
}

/// Which frames of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frames {
    /// All; those of the whole bus where no axis is named, SYNC among them.
    All,
    /// SYNC, whatever the axis.
    Sync,
    /// Commands.
    Command,
    /// Feedback.
    Feedback,
    /// Heartbeats.
    Heartbeat,
}

/// Frames that something happens to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Traffic {
    /// On which way.
    pub way: Way,
    /// Which.
    pub frames: Frames,
    /// Chance for each of them, 0 to 1.
    pub chance: f64,
}

impl Traffic {
    /// Whether there are such frames from boards to the host.
    pub const fn is_from_boards(&self) -> bool {
        !matches!(self.way, Way::ToBoards) && !matches!(self.frames, Frames::Sync | Frames::Command)
    }
    /// Whether there are such frames from the host to boards.
    pub const fn is_to_boards(&self) -> bool {
        !matches!(self.way, Way::FromBoards) && !matches!(self.frames, Frames::Feedback | Frames::Heartbeat)
    }

    /// The identifiers of these frames, of one board or of all.
    pub(super) fn filters(&self, node: Option<Node>) -> [Filter; 2] {
        const WHOLE: u16 = Id::MAX.raw();
        const FUNCTION: u16 = 0x780;
        const NODE: u16 = 0x07F;
        let mask = if node.is_some() { WHOLE } else { FUNCTION };
        let node = node.unwrap_or(Node::MAX);
        let of = |address: Address, mask: u16| [Filter::new(address.id(), mask); 2];
        match self.frames {
            Frames::All if mask == FUNCTION => [Filter::ALL; 2],
            Frames::All => of(Address::Command(node), NODE),
            Frames::Sync => of(Address::Sync, WHOLE),
            Frames::Command => of(Address::Command(node), mask),
            Frames::Heartbeat => of(Address::Heartbeat(node), mask),
            // On classic CAN the feedback comes in two pieces.
            Frames::Feedback => [Address::Feedback(node), Address::FeedbackTable(node)]
                .map(|address| Filter::new(address.id(), mask)),
        }
    }
}

/// What another host sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sends {
    /// SYNC with a count of its own.
    Sync,
    /// Commands that take the current away, to every board.
    Commands,
    /// Both.
    Both,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_a_name_of_its_own() {
        for (index, kind) in Kind::ALL.into_iter().enumerate() {
            assert_eq!(kind as usize, index, "{}", kind.name());
            let same = Kind::ALL.into_iter().filter(|other| other.name() == kind.name()).count();
            assert_eq!(same, 1, "{}", kind.name());
        }
    }

    #[test]
    fn filters_know_the_frames_of_one_board_and_of_all() {
        let node = |number| Node::new(number).expect("a node");
        let hit = |frames, of: Option<Node>, address: Address| {
            let traffic = Traffic { way: Way::Both, frames, chance: 1.0 };
            traffic.filters(of).iter().any(|filter| filter.accepts(address.id()))
        };
        for address in [Address::Feedback(node(2)), Address::FeedbackTable(node(2))] {
            assert!(hit(Frames::Feedback, Some(node(2)), address));
            assert!(hit(Frames::Feedback, None, address) && hit(Frames::All, Some(node(2)), address));
            assert!(!hit(Frames::Feedback, Some(node(1)), address) && !hit(Frames::Heartbeat, None, address));
        }
        assert!(hit(Frames::All, None, Address::Sync) && !hit(Frames::All, Some(node(1)), Address::Sync));
        assert!(hit(Frames::Sync, Some(node(1)), Address::Sync));
        assert!(!hit(Frames::Sync, None, Address::Emergency(node(1))));
    }
}
