//! CAN and CAN FD frames, as they travel and as they are logged; what they mean is for `rt/wire`.
//!
//! Invariant: a [`Frame`] always has a length its format can carry, and zeros behind it.

use super::time::Moment;

/// An 11-bit CAN identifier; the lower one wins the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Id(u16);

impl Id {
    /// Highest identifier of the base format (ISO 11898-1).
    pub const MAX: Self = Self(0x7FF);

    /// `None` above [`Id::MAX`].
    pub const fn new(raw: u16) -> Option<Self> {
        if raw <= Self::MAX.0 { Some(Self(raw)) } else { None }
    }
    /// From the low 11 bits of `raw`.
    pub const fn from_low_bits(raw: u16) -> Self {
        Self(raw & Self::MAX.0)
    }
    /// The identifier as a number.
    pub const fn raw(self) -> u16 {
        self.0
    }
}

/// How a frame travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Classic CAN: 0 to 8 bytes.
    Classic,
    /// CAN FD: 0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes.
    Fd {
        /// Payload at the data bit rate instead of the nominal one.
        bit_rate_switch: bool,
    },
    /// Not from the bus: what the own CAN controller reports of itself, as an error frame of SocketCAN
    /// (`linux/can/error.h`). The identifier holds the error classes, the 8 bytes their details.
    Report,
}

impl Format {
    /// Whether a frame of this format can have `length` bytes.
    pub const fn carries(self, length: usize) -> bool {
        match self {
            Self::Classic => length <= 8,
            Self::Report => length == 8,
            Self::Fd { .. } => length <= 8 || matches!(length, 12 | 16 | 20 | 24 | 32 | 48 | 64),
        }
    }
}

/// Longest payload of CAN FD, in bytes.
pub const PAYLOAD_BYTES_MAX: usize = 64;

/// One CAN or CAN FD frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    id: Id,
    format: Format,
    length: u8,
    bytes: [u8; PAYLOAD_BYTES_MAX],
}

impl Frame {
    /// A classic frame; more than 8 bytes do not compile.
    pub fn classic<const N: usize>(id: Id, payload: [u8; N]) -> Self {
        const { assert!(Format::Classic.carries(N), "no length of classic CAN") };
        Self::of(id, Format::Classic, payload)
    }
    /// An FD frame with bit rate switch; a length FD does not have does not compile.
    pub fn fd<const N: usize>(id: Id, payload: [u8; N]) -> Self {
        const FORMAT: Format = Format::Fd { bit_rate_switch: true };
        const { assert!(FORMAT.carries(N), "no length of CAN FD") };
        Self::of(id, FORMAT, payload)
    }
    /// A report of the own controller: its error classes and their details.
    pub fn report(classes: Id, details: [u8; 8]) -> Self {
        Self::of(classes, Format::Report, details)
    }
    /// From bytes whose number is known only now; `None` if `format` cannot carry them.
    pub fn from_slice(id: Id, format: Format, payload: &[u8]) -> Option<Self> {
        if !format.carries(payload.len()) {
            return None;
        }
        let mut bytes = [0; PAYLOAD_BYTES_MAX];
        bytes.get_mut(..payload.len())?.copy_from_slice(payload);
        Some(Self { id, format, length: payload.len() as u8, bytes })
    }
    fn of<const N: usize>(id: Id, format: Format, payload: [u8; N]) -> Self {
        let mut bytes = [0; PAYLOAD_BYTES_MAX];
        bytes[..N].copy_from_slice(&payload);
        Self { id, format, length: N as u8, bytes }
    }

    /// Who and what: see `rt::wire::Address`.
    pub const fn id(&self) -> Id {
        self.id
    }
    /// How it travels.
    pub const fn format(&self) -> Format {
        self.format
    }
    /// Length of the payload in bytes.
    pub const fn length(&self) -> usize {
        self.length as usize
    }
    /// The payload.
    pub fn payload(&self) -> &[u8] {
        self.bytes.get(..self.length()).unwrap_or(&self.bytes)
    }
    /// The payload if it has exactly `N` bytes.
    pub fn payload_of<const N: usize>(&self) -> Option<&[u8; N]> {
        if self.length() == N { self.bytes.first_chunk() } else { None }
    }
    /// The same frame with one bit of its payload inverted; bit 0 is the lowest of the first byte.
    /// A bit behind the payload changes nothing.
    pub fn with_flipped_bit(mut self, bit: usize) -> Self {
        let length = self.length();
        if let Some(byte) = self.bytes.get_mut(..length).and_then(|payload| payload.get_mut(bit / 8)) {
            *byte ^= 1 << (bit % 8);
        }
        self
    }
}

/// A frame and when it came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// What came.
    pub frame: Frame,
    /// When, on the clock of the cycle.
    pub at: Moment,
}

#[cfg(test)]
mod tests {
    use super::*;

    const FD: Format = Format::Fd { bit_rate_switch: true };

    #[test]
    fn only_lengths_of_the_format_can_be_built() {
        let lengths = |format| {
            (0..=70)
                .filter(|&n| Frame::from_slice(Id::MAX, format, &[1; 70][..n]).is_some())
                .collect::<Vec<_>>()
        };
        assert_eq!(lengths(Format::Classic), (0..=8).collect::<Vec<_>>());
        assert_eq!(lengths(Format::Report), [8]);
        assert_eq!(lengths(FD), [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64]);
        assert_eq!(Id::new(0x800), None);
    }

    #[test]
    fn both_ways_to_build_give_the_same_frame() {
        let id = Id::from_low_bits(0x181);
        assert_eq!(Some(Frame::fd(id, [7; 24])), Frame::from_slice(id, FD, &[7; 24]));
        assert_eq!(Some(Frame::classic(id, [7; 3])), Frame::from_slice(id, Format::Classic, &[7; 3]));
        assert_eq!(Frame::fd(id, [7; 24]).payload_of::<23>(), None);
    }

    #[test]
    fn a_flipped_bit_changes_the_payload_and_nothing_behind_it() {
        let frame = Frame::classic(Id::MAX, [0, 0]);
        assert_eq!(frame.with_flipped_bit(9).payload(), [0, 2]);
        assert_eq!(frame.with_flipped_bit(16), frame);
    }
}
