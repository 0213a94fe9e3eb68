//! Bytes and their meaning: the protocol between the host and the boards, both directions for
//! every frame. Between `rt/bus` (moves frames) and `rt/drive` (acts on them).
//!
//! Identifiers are those of CANopen (CiA 301), the board being node `n`:
//!
//! | identifier | from | frame | module |
//! |---|---|---|---|
//! | `080h` | host | SYNC: the boards latch | [`command`] |
//! | `080h + n` | board | emergency | [`state`] |
//! | `180h + n` | board | feedback | [`feedback`], on classic CAN [`classic`] |
//! | `200h + n` | host | command | [`command`], on classic CAN [`classic`] |
//! | `280h + n` | board | second frame of the feedback on classic CAN | [`classic`] |
//! | `580h + n` | board | parameter reply | [`parameter`] |
//! | `600h + n` | host | parameter request | [`parameter`] |
//! | `700h + n` | board | heartbeat, boot-up | [`state`] |
//!
//! All numbers are little endian; reserved bytes are sent as zero and ignored when read. The same
//! layout stands in `firmware-config/encoder-board.dbc`, for classic CAN in `encoder-board-classic.dbc`;
//! `tests/wire_dbc` holds them together.
//! No frame has a checksum of its own: `docs/integrity.md` says what stands against a wrong bit in each field,
//! and `tests/cycle/corrupted.rs` holds it to that.
//! There is no network management: a board that has booted is operational, and the state machine
//! of CiA 402 keeps its drive safe.
//! Invariant: a decoder is total. Whatever bytes come, it gives a value or [`Malformed`].

pub mod classic;
pub mod command;
pub mod controller;
pub mod feedback;
mod layout;
pub mod parameter;
pub mod scaling;
pub mod state;

pub use layout::Layout;

use super::bus::{Frame, Id};
use crate::base::sample::RawFeedback;

/// A board's number on the bus: 1 to 127.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Node(u8);

impl Node {
    /// Highest node number of CiA 301.
    pub const MAX: Self = Self(127);

    /// `None` for 0 and above [`Node::MAX`].
    pub const fn new(number: u8) -> Option<Self> {
        if number != 0 && number <= Self::MAX.0 { Some(Self(number)) } else { None }
    }
    /// The node as a number.
    pub const fn number(self) -> u8 {
        self.0
    }
}

impl std::fmt::Display for Node {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "node {}", self.0)
    }
}

/// What an identifier says about its frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Address {
    /// From the host to all boards: latch.
    Sync,
    /// A board reports an error.
    Emergency(Node),
    /// A board's answer to SYNC.
    Feedback(Node),
    /// The second frame of it, on classic CAN.
    FeedbackTable(Node),
    /// From the host to one board.
    Command(Node),
    /// A board's answer to a parameter request.
    ParameterReply(Node),
    /// The host asks one board for a parameter.
    ParameterRequest(Node),
    /// A board is alive.
    Heartbeat(Node),
}

impl Address {
    /// The identifier.
    pub const fn id(self) -> Id {
        let (function, node) = match self {
            Self::Sync => (0x080, 0),
            Self::Emergency(node) => (0x080, node.0),
            Self::Feedback(node) => (0x180, node.0),
            Self::Command(node) => (0x200, node.0),
            Self::FeedbackTable(node) => (0x280, node.0),
            Self::ParameterReply(node) => (0x580, node.0),
            Self::ParameterRequest(node) => (0x600, node.0),
            Self::Heartbeat(node) => (0x700, node.0),
        };
        Id::from_low_bits(function | node as u16)
    }
    /// The board that sends frames of this kind; `None` for what a host sends.
    pub const fn sender(self) -> Option<Node> {
        match self {
            Self::Emergency(node)
            | Self::Feedback(node)
            | Self::FeedbackTable(node)
            | Self::ParameterReply(node)
            | Self::Heartbeat(node) => Some(node),
            Self::Sync | Self::Command(_) | Self::ParameterRequest(_) => None,
        }
    }
    /// What an identifier says; `None` if it is none of ours.
    pub const fn of(id: Id) -> Option<Self> {
        let function = id.raw() & 0x780;
        let Some(node) = Node::new((id.raw() & 0x7F) as u8) else {
            return if function == 0x080 { Some(Self::Sync) } else { None };
        };
        match function {
            0x080 => Some(Self::Emergency(node)),
            0x180 => Some(Self::Feedback(node)),
            0x200 => Some(Self::Command(node)),
            0x280 => Some(Self::FeedbackTable(node)),
            0x580 => Some(Self::ParameterReply(node)),
            0x600 => Some(Self::ParameterRequest(node)),
            0x700 => Some(Self::Heartbeat(node)),
            _ => None,
        }
    }
}

/// The frames of one cycle and axis, for the load they put on the bus.
#[derive(Clone, Copy, Debug)]
pub struct CycleFrames {
    /// Once for all axes.
    pub sync: Frame,
    /// For each axis.
    pub feedback: [Option<Frame>; 2],
    /// For each axis.
    pub command: Frame,
}

impl CycleFrames {
    /// Of a layout.
    pub fn of(layout: Layout) -> Self {
        let raw = RawFeedback::default();
        let mut feedback = layout.feedback(Node::MAX, &raw);
        Self {
            sync: command::encode_sync(0),
            feedback: [feedback.next(), feedback.next()],
            command: layout.command(Node::MAX, &command::RawCommand::default()),
        }
    }
}

/// Why a frame with one of our identifiers means nothing to us.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// Too short or too long.
    #[error("frame has {got} bytes, expected {expected}")]
    Length {
        /// Length of the frame, in bytes.
        got: usize,
        /// Length of this kind of frame, in bytes.
        expected: usize,
    },
    /// A parameter frame of a kind that is not spoken here.
    #[error("parameter frame has command specifier {got:02x}h, which is not spoken here")]
    Specifier {
        /// First byte of the frame.
        got: u8,
    },
}

/// The payload of a frame that must have `N` bytes.
fn payload<const N: usize>(frame: &Frame) -> Result<&[u8; N], Malformed> {
    frame.payload_of().ok_or(Malformed::Length { got: frame.length(), expected: N })
}

/// The `N` bytes of `payload` from `AT` on; a field that does not fit does not compile.
fn field<const AT: usize, const N: usize, const LENGTH: usize>(payload: &[u8; LENGTH]) -> [u8; N] {
    const { assert!(AT + N <= LENGTH, "field beyond the frame") };
    std::array::from_fn(|byte| payload[AT + byte])
}

/// Writes `value` into `payload` from `AT` on; a field that does not fit does not compile.
fn put<const AT: usize, const N: usize, const LENGTH: usize>(payload: &mut [u8; LENGTH], value: [u8; N]) {
    const { assert!(AT + N <= LENGTH, "field beyond the frame") };
    payload[AT..AT + N].copy_from_slice(&value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_identifier_is_ours_and_back_or_foreign() {
        let ours = (0..=0x7FF)
            .map(Id::from_low_bits)
            .filter_map(|id| Address::of(id).map(|address| assert_eq!(address.id(), id)))
            .count();
        assert_eq!(ours, 1 + 7 * 127);
        assert_eq!(Address::of(Id::from_low_bits(0x000)), None);
        assert_eq!(Address::of(Id::from_low_bits(0x182)).map(|a| a.id().raw()), Some(0x182));
    }
}
