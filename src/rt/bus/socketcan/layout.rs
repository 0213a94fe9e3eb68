//! A frame as the kernel moves it: `struct can_frame` and `struct canfd_frame` of `linux/can.h`, in the byte
//! order of the machine.
//!
//! | bytes | field |
//! |---|---|
//! | 0..4 | identifier, with the flags below |
//! | 4 | length of the payload |
//! | 5 | FD: flags, here the bit rate switch |
//! | 6..8 | reserved |
//! | 8.. | payload: 8 bytes classic, 64 bytes FD, zeros behind it |
//!
//! Only the size tells the two apart.
//! Invariant: `decode(encode(x)) == x` for every frame of the bus; a frame this bus cannot hold (29-bit
//! identifier, remote request) decodes to nothing.

use crate::rt::bus::{Format, Frame, Id};

/// Size of a classic frame, in bytes; also the MTU of an interface that carries no other.
pub(super) const CLASSIC_BYTES: usize = 16;
/// Size of an FD frame, in bytes; also the MTU that an interface needs for it.
pub(super) const FD_BYTES: usize = 72;

/// Flag: an identifier of 29 bits.
const EXTENDED: u32 = 0x8000_0000;
/// Flag: a request to be sent this identifier.
const REMOTE: u32 = 0x4000_0000;
/// Flag: no frame of the bus, but a report of the controller.
const REPORT: u32 = 0x2000_0000;
/// The 11 bits of an identifier.
const IDENTIFIER: u32 = 0x7FF;
/// Flag of FD: payload at the data bit rate.
const BIT_RATE_SWITCH: u8 = 0x01;

/// A frame in the kernel's layout.
#[derive(Clone, Copy, Debug)]
pub(super) struct Raw {
    pub(super) bytes: [u8; FD_BYTES],
    /// How many of them count.
    pub(super) length: usize,
}

impl Raw {
    /// Room for any frame.
    pub(super) const EMPTY: Self = Self { bytes: [0; FD_BYTES], length: 0 };
}

/// The kernel's layout of a frame; `None` for a report, which no bus carries.
pub(super) fn encode(frame: &Frame) -> Option<Raw> {
    let (length, flags) = match frame.format() {
        Format::Classic => (CLASSIC_BYTES, 0),
        Format::Fd { bit_rate_switch } => (FD_BYTES, if bit_rate_switch { BIT_RATE_SWITCH } else { 0 }),
        Format::Report => return None,
    };
    let mut raw = Raw { length, ..Raw::EMPTY };
    let (head, payload) = raw.bytes.split_at_mut(8);
    let [a, b, c, d] = u32::from(frame.id().raw()).to_ne_bytes();
    head.copy_from_slice(&[a, b, c, d, frame.length() as u8, flags, 0, 0]);
    payload.iter_mut().zip(frame.payload()).for_each(|(to, from)| *to = *from);
    Some(raw)
}

/// The kernel's layout of a report, as the driver of a controller hands it up; `None` for any other frame.
pub(super) fn encode_report(frame: &Frame) -> Option<Raw> {
    let details: &[u8; 8] = frame.payload_of().filter(|_| frame.format() == Format::Report)?;
    let mut raw = encode(&Frame::classic(frame.id(), *details))?;
    let flagged = (u32::from(frame.id().raw()) | REPORT).to_ne_bytes();
    raw.bytes.iter_mut().zip(flagged).for_each(|(to, from)| *to = from);
    Some(raw)
}

/// The frame in a layout of the kernel.
pub(super) fn decode(raw: &Raw) -> Option<Frame> {
    let (&[a, b, c, d, length, flags, _, _], payload) = raw.bytes.split_first_chunk()?;
    let identifier = u32::from_ne_bytes([a, b, c, d]);
    let payload = payload.get(..usize::from(length))?;
    let format = match (raw.length, identifier & (EXTENDED | REMOTE | REPORT)) {
        (CLASSIC_BYTES, REPORT) => Format::Report,
        (CLASSIC_BYTES, 0) => Format::Classic,
        (FD_BYTES, 0) => Format::Fd { bit_rate_switch: flags & BIT_RATE_SWITCH != 0 },
        _ => return None,
    };
    Frame::from_slice(Id::from_low_bits((identifier & IDENTIFIER) as u16), format, payload)
}

/// Filters of the kernel that let these identifiers pass and nothing else: pairs of identifier and mask
/// (`struct can_filter`).
#[cfg_attr(not(test), expect(clippy::disallowed_macros, reason = "made once, when a bus is opened"))]
pub(super) fn filters(identifiers: &[Id]) -> Box<[u8]> {
    let mut bytes = vec![0; identifiers.len() * 8].into_boxed_slice();
    for (filter, id) in bytes.chunks_exact_mut(8).zip(identifiers) {
        let (value, mask) = filter.split_at_mut(4);
        value.copy_from_slice(&u32::from(id.raw()).to_ne_bytes());
        mask.copy_from_slice(&(IDENTIFIER | EXTENDED | REMOTE).to_ne_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_of_the_bus_comes_back() {
        let ids = [0, 0x080, 0x7FF].map(Id::from_low_bits);
        let formats =
            [Format::Classic, Format::Fd { bit_rate_switch: true }, Format::Fd { bit_rate_switch: false }];
        let payload: [u8; 64] = std::array::from_fn(|at| at as u8 + 1);
        for (id, format) in ids.into_iter().flat_map(|id| formats.map(|format| (id, format))) {
            for frame in (0..=64).filter_map(|length| Frame::from_slice(id, format, &payload[..length])) {
                let raw = encode(&frame).unwrap();
                assert_eq!(raw.length, if format == Format::Classic { 16 } else { 72 });
                assert_eq!(decode(&raw), Some(frame));
            }
        }
    }

    #[test]
    fn the_bytes_are_those_of_the_kernel() {
        let raw = encode(&Frame::fd(Id::from_low_bits(0x182), [7; 3])).unwrap();
        let mut expected = [0_u8; 72];
        expected[..4].copy_from_slice(&0x182_u32.to_ne_bytes());
        (expected[4], expected[5]) = (3, 1);
        expected[8..11].copy_from_slice(&[7; 3]);
        assert_eq!(raw.bytes, expected);
        assert_eq!(filters(&[Id::from_low_bits(0x182)])[4..], 0xC000_07FF_u32.to_ne_bytes());
    }

    #[test]
    fn a_report_is_heard_and_sent_only_by_who_plays_a_controller() {
        let report = Frame::report(Id::from_low_bits(0x040), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert!(encode(&report).is_none());
        let mut raw = encode(&Frame::classic(report.id(), [1, 2, 3, 4, 5, 6, 7, 8])).unwrap();
        raw.bytes[..4].copy_from_slice(&(0x040 | REPORT).to_ne_bytes());
        assert_eq!(decode(&raw), Some(report));
        let played = encode_report(&report).unwrap();
        assert_eq!((played.bytes, played.length), (raw.bytes, raw.length));
        assert!(encode_report(&Frame::classic(report.id(), [0; 8])).is_none());
    }

    #[test]
    fn what_no_frame_of_ours_can_be_is_nothing() {
        let good = encode(&Frame::classic(Id::MAX, [1, 2])).unwrap();
        for flag in [EXTENDED, REMOTE, EXTENDED | REPORT] {
            let mut raw = good;
            raw.bytes[..4].copy_from_slice(&(0x123 | flag).to_ne_bytes());
            assert_eq!(decode(&raw), None, "flag {flag:#x}");
        }
        let mut too_long = good;
        too_long.bytes[4] = 9;
        assert_eq!(decode(&too_long), None);
        too_long.bytes[4] = 255;
        assert_eq!(decode(&Raw { length: FD_BYTES, ..too_long }), None);
        assert_eq!(decode(&Raw { length: 40, ..good }), None);
    }
}
