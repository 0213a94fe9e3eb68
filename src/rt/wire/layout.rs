//! How the cyclic frames travel: whole on CAN FD, or in pieces of 8 bytes on classic CAN.
//!
//! Invariant: a machine has one layout; frames of the other are not understood.

use super::command::RawCommand;
use super::{Malformed, Node, classic, command, feedback};
use crate::base::sample::RawFeedback;
use crate::rt::bus::Frame;

/// The layout of feedback and command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layout {
    /// One FD frame each ([`feedback`], [`command`]).
    #[default]
    Fd,
    /// Classic frames ([`classic`]).
    Classic,
}

impl Layout {
    /// The frames that carry feedback from `node`, in order.
    pub fn feedback(self, node: Node, raw: &RawFeedback) -> impl Iterator<Item = Frame> + use<> {
        let frames = match self {
            Self::Fd => [Some(feedback::encode(node, raw)), None],
            Self::Classic => classic::encode_feedback(node, raw).map(Some),
        };
        frames.into_iter().flatten()
    }
    /// The frame that carries a command to `node`.
    pub fn command(self, node: Node, raw: &RawCommand) -> Frame {
        match self {
            Self::Fd => command::encode(node, raw),
            Self::Classic => classic::encode_command(node, raw),
        }
    }
    /// What a command frame says.
    pub fn decode_command(self, frame: &Frame) -> Result<RawCommand, Malformed> {
        match self {
            Self::Fd => command::decode(frame),
            Self::Classic => classic::decode_command(frame),
        }
    }
}
