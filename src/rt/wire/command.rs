//! What the host says every cycle: one SYNC to all boards, then one command to each.
//!
//! SYNC, identifier `080h`, classic, 4 bytes: the number of the period on the host's grid, u32. It
//! jumps when periods are skipped; a simulated machine advances by as many periods as it jumps.
//!
//! Command, identifier `200h + n`, CAN FD, 12 bytes:
//!
//! | bytes | field | unit |
//! |---|---|---|
//! | 0..4 | current setpoint, i32 | 1 µA |
//! | 4..6 | control word (CiA 402 object 6040h), u16 | |
//! | 6..8 | low half of the cycle of the SYNC it belongs to, u16 | cycles |
//! | 8 | sequence, u8, wraps; only a new one feeds the board's watchdog | frames |
//! | 9 | mode of operation (object 6060h), i8: [`CYCLIC_SYNCHRONOUS_TORQUE`] | |
//! | 10..12 | reserved | |
//!
//! Invariant: `decode(encode(x)) == x` for every `x`.

use super::scaling::CurrentCounts;
use super::{Address, Malformed, Node, field, payload, put};
use crate::rt::bus::Frame;

/// Length of SYNC in bytes.
pub const SYNC_LENGTH: usize = 4;
/// Length of a command in bytes.
pub const LENGTH: usize = 12;
/// The one mode of operation we ask for (CiA 402: cyclic synchronous torque).
pub const CYCLIC_SYNCHRONOUS_TORQUE: i8 = 10;

/// A command as it travels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawCommand {
    /// Current asked for, in the drive's own sense.
    pub current: CurrentCounts,
    /// CiA 402 control word.
    pub control_word: u16,
    /// Low half of the cycle it belongs to.
    pub cycle: u16,
    /// Counts the commands to this board.
    pub sequence: u8,
    /// CiA 402 mode of operation.
    pub mode_of_operation: i8,
}

/// SYNC for one period of the grid.
pub fn encode_sync(cycle: u32) -> Frame {
    Frame::classic(Address::Sync.id(), cycle.to_le_bytes())
}

/// The period a SYNC stands for.
pub fn decode_sync(frame: &Frame) -> Result<u32, Malformed> {
    payload::<SYNC_LENGTH>(frame).map(|bytes| u32::from_le_bytes(*bytes))
}

/// The frame that carries `raw` to `node`.
pub fn encode(node: Node, raw: &RawCommand) -> Frame {
    let mut bytes = [0; LENGTH];
    put::<0, _, _>(&mut bytes, raw.current.as_ua().to_le_bytes());
    put::<4, _, _>(&mut bytes, raw.control_word.to_le_bytes());
    put::<6, _, _>(&mut bytes, raw.cycle.to_le_bytes());
    put::<8, _, _>(&mut bytes, raw.sequence.to_le_bytes());
    put::<9, _, _>(&mut bytes, raw.mode_of_operation.to_le_bytes());
    Frame::fd(Address::Command(node).id(), bytes)
}

/// What a command frame says.
pub fn decode(frame: &Frame) -> Result<RawCommand, Malformed> {
    let bytes: &[u8; LENGTH] = payload(frame)?;
    Ok(RawCommand {
        current: CurrentCounts::ua(i32::from_le_bytes(field::<0, _, _>(bytes))),
        control_word: u16::from_le_bytes(field::<4, _, _>(bytes)),
        cycle: u16::from_le_bytes(field::<6, _, _>(bytes)),
        sequence: u8::from_le_bytes(field::<8, _, _>(bytes)),
        mode_of_operation: i8::from_le_bytes(field::<9, _, _>(bytes)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bytes_are_these() {
        let raw = RawCommand {
            current: CurrentCounts::ua(-1_000_000),
            control_word: 0x000F,
            cycle: 0xBEEF,
            sequence: 255,
            mode_of_operation: CYCLIC_SYNCHRONOUS_TORQUE,
        };
        let frame = encode(Node::MAX, &raw);
        assert_eq!(frame.id().raw(), 0x27F);
        assert_eq!(frame.payload(), [0xC0, 0xBD, 0xF0, 0xFF, 0x0F, 0, 0xEF, 0xBE, 255, 10, 0, 0]);
        assert_eq!(decode(&frame), Ok(raw));
        assert_eq!(encode_sync(0x0102_0304).payload(), [4, 3, 2, 1]);
        assert_eq!(decode_sync(&encode_sync(u32::MAX)), Ok(u32::MAX));
    }

    #[test]
    fn another_length_is_refused() {
        let sync_with_counter = Frame::classic(Address::Sync.id(), [1]);
        assert_eq!(decode_sync(&sync_with_counter), Err(Malformed::Length { got: 1, expected: 4 }));
        let short = Frame::fd(Address::Command(Node::MAX).id(), [0; 8]);
        assert_eq!(decode(&short), Err(Malformed::Length { got: 8, expected: 12 }));
    }
}
