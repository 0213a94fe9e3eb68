//! The feedback frame: what a board latched at a SYNC. Identifier `180h + n`, CAN FD, 24 bytes.
//!
//! | bytes | field | unit |
//! |---|---|---|
//! | 0..4 | motor encoder, u32, wraps | counts |
//! | 4..8 | table scale, u32, wraps | counts |
//! | 8..12 | motor current, i32 | 1 µA |
//! | 12..16 | board time at the latch, u32, wraps | 1 µs |
//! | 16..18 | low half of the cycle of the SYNC answered, u16 | cycles |
//! | 18..20 | status word (CiA 402 object 6041h), u16 | |
//! | 20 | sequence, u8, wraps | frames |
//! | 21 | [`BoardFlags`] | |
//! | 22..24 | reserved | |
//!
//! The cycle ties the frame to its SYNC, the sequence tells a new frame from a repeated one.
//! Invariant: `decode(encode(x)) == x` for every `x`.

use super::{Address, Malformed, Node, field, payload, put};
use crate::base::sample::RawFeedback;
use crate::rt::bus::Frame;

/// Length of the frame in bytes.
pub const LENGTH: usize = 24;

/// What a board says about itself with each feedback frame: a set of bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardFlags(u8);

impl BoardFlags {
    /// Nothing to report.
    pub const NONE: Self = Self(0);
    /// The board's watchdog tripped and holds the current at zero until it is told to disable.
    pub const WATCHDOG_TRIPPED: Self = Self(1);
    /// No fresh command came between the last SYNC and this one.
    pub const COMMAND_STALE: Self = Self(2);
    /// The last command asked for more than the peak current and was held there.
    pub const CURRENT_SATURATED: Self = Self(4);
    /// The board does not trust an encoder; the counts are the last ones it trusted.
    pub const ENCODER_ERROR: Self = Self(8);
    /// A table scale is connected; without it `table_counts` means nothing.
    pub const TABLE_SCALE: Self = Self(16);

    /// As sent.
    pub const fn bits(self) -> u8 {
        self.0
    }
    /// As received; bits of a newer board are kept.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
    }
    /// Both sets.
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
    /// `flag` if it is so.
    pub const fn when(is_so: bool, flag: Self) -> Self {
        if is_so { flag } else { Self::NONE }
    }
    /// Whether all of `other` is set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

/// The frame that carries `raw` from `node`.
pub fn encode(node: Node, raw: &RawFeedback) -> Frame {
    let mut bytes = [0; LENGTH];
    put::<0, _, _>(&mut bytes, raw.motor_counts.to_le_bytes());
    put::<4, _, _>(&mut bytes, raw.table_counts.to_le_bytes());
    put::<8, _, _>(&mut bytes, raw.current_ua.to_le_bytes());
    put::<12, _, _>(&mut bytes, raw.board_time_us.to_le_bytes());
    put::<16, _, _>(&mut bytes, raw.answers_cycle.to_le_bytes());
    put::<18, _, _>(&mut bytes, raw.status_word.to_le_bytes());
    put::<20, _, _>(&mut bytes, raw.sequence.to_le_bytes());
    put::<21, _, _>(&mut bytes, raw.board_flags.to_le_bytes());
    Frame::fd(Address::Feedback(node).id(), bytes)
}

/// What a feedback frame says.
pub fn decode(frame: &Frame) -> Result<RawFeedback, Malformed> {
    let bytes: &[u8; LENGTH] = payload(frame)?;
    Ok(RawFeedback {
        motor_counts: u32::from_le_bytes(field::<0, _, _>(bytes)),
        table_counts: u32::from_le_bytes(field::<4, _, _>(bytes)),
        current_ua: i32::from_le_bytes(field::<8, _, _>(bytes)),
        board_time_us: u32::from_le_bytes(field::<12, _, _>(bytes)),
        answers_cycle: u16::from_le_bytes(field::<16, _, _>(bytes)),
        status_word: u16::from_le_bytes(field::<18, _, _>(bytes)),
        sequence: u8::from_le_bytes(field::<20, _, _>(bytes)),
        board_flags: u8::from_le_bytes(field::<21, _, _>(bytes)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rt::bus::Id;

    #[test]
    fn the_bytes_are_these() {
        let raw = RawFeedback {
            motor_counts: 0x0403_0201,
            table_counts: 0x0807_0605,
            current_ua: -2,
            board_time_us: 0x100F_0E0D,
            answers_cycle: 0x1211,
            status_word: 0x1413,
            sequence: 0x15,
            board_flags: 0x16,
        };
        let frame = encode(Node::MAX, &raw);
        assert_eq!(frame.id(), Id::from_low_bits(0x1FF));
        assert_eq!(
            frame.payload(),
            [
                1, 2, 3, 4, 5, 6, 7, 8, 0xFE, 0xFF, 0xFF, 0xFF, 13, 14, 15, 16, 0x11, 0x12, 0x13, 0x14, 0x15,
                0x16, 0, 0
            ]
        );
        assert_eq!(decode(&frame), Ok(raw));
    }

    #[test]
    fn another_length_is_refused_with_both_lengths() {
        let short = Frame::fd(Address::Feedback(Node::MAX).id(), [0; 20]);
        assert_eq!(decode(&short), Err(Malformed::Length { got: 20, expected: 24 }));
    }
}
