//! What a board says about its own life: heartbeat and emergency.
//!
//! Heartbeat, identifier `700h + n`, classic, 4 bytes (CiA 301 has the first only): state u8,
//! reset count u8, seconds since boot u16 (stays at its maximum). State 0 is the boot-up message,
//! sent once after every reset.
//!
//! Emergency, identifier `080h + n`, classic, 8 bytes in the layout of CiA 301: error code u16,
//! error register u8, then the manufacturer's five: detail u16, counter u8, two reserved.
//! Invariant: `decode(encode(x)) == x` for every `x`.

use super::{Address, Malformed, Node, field, payload, put};
use crate::rt::bus::Frame;

/// Length of a heartbeat in bytes.
pub const HEARTBEAT_LENGTH: usize = 4;
/// Length of an emergency in bytes.
pub const EMERGENCY_LENGTH: usize = 8;

/// A sign of life.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Heartbeat {
    /// Network state as CiA 301 numbers it, see the constants.
    pub state: u8,
    /// Resets since the board got power, wraps.
    pub reset_count: u8,
    /// Seconds since the last reset; stays at 65535.
    pub uptime_s: u16,
}

impl Heartbeat {
    /// State of the boot-up message.
    pub const BOOT_UP: u8 = 0x00;
    /// State of a board that works.
    pub const OPERATIONAL: u8 = 0x05;
}

/// A board reports that an error came or went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Emergency {
    /// Error code of CiA 301 and 402; 0: the last error is gone.
    pub code: u16,
    /// Error register (object 1001h).
    pub register: u8,
    /// The firmware's own number for the cause.
    pub detail: u16,
    /// Counts the emergencies since boot, wraps.
    pub counter: u8,
}

impl Emergency {
    /// No error any more.
    pub const CODE_NONE: u16 = 0x0000;
    /// Over-current in the drive's output.
    pub const CODE_OVERCURRENT: u16 = 0x2310;
    /// First incremental encoder (the motor's).
    pub const CODE_ENCODER: u16 = 0x7305;
    /// The partner's life signs are missing: the board's watchdog.
    pub const CODE_WATCHDOG: u16 = 0x8130;
    /// The board's CAN controller was off the bus and takes part again.
    pub const CODE_BUS_OFF_RECOVERED: u16 = 0x8140;
    /// Error register: any error.
    pub const REGISTER_GENERIC: u8 = 0x01;
}

/// The frame that carries `heartbeat` from `node`.
pub fn encode_heartbeat(node: Node, heartbeat: &Heartbeat) -> Frame {
    let mut bytes = [0; HEARTBEAT_LENGTH];
    put::<0, _, _>(&mut bytes, heartbeat.state.to_le_bytes());
    put::<1, _, _>(&mut bytes, heartbeat.reset_count.to_le_bytes());
    put::<2, _, _>(&mut bytes, heartbeat.uptime_s.to_le_bytes());
    Frame::classic(Address::Heartbeat(node).id(), bytes)
}

/// What a heartbeat frame says.
pub fn decode_heartbeat(frame: &Frame) -> Result<Heartbeat, Malformed> {
    let bytes: &[u8; HEARTBEAT_LENGTH] = payload(frame)?;
    Ok(Heartbeat {
        state: u8::from_le_bytes(field::<0, _, _>(bytes)),
        reset_count: u8::from_le_bytes(field::<1, _, _>(bytes)),
        uptime_s: u16::from_le_bytes(field::<2, _, _>(bytes)),
    })
}

/// The frame that carries `emergency` from `node`.
pub fn encode_emergency(node: Node, emergency: &Emergency) -> Frame {
    let mut bytes = [0; EMERGENCY_LENGTH];
    put::<0, _, _>(&mut bytes, emergency.code.to_le_bytes());
    put::<2, _, _>(&mut bytes, emergency.register.to_le_bytes());
    put::<3, _, _>(&mut bytes, emergency.detail.to_le_bytes());
    put::<5, _, _>(&mut bytes, emergency.counter.to_le_bytes());
    Frame::classic(Address::Emergency(node).id(), bytes)
}

/// What an emergency frame says.
pub fn decode_emergency(frame: &Frame) -> Result<Emergency, Malformed> {
    let bytes: &[u8; EMERGENCY_LENGTH] = payload(frame)?;
    Ok(Emergency {
        code: u16::from_le_bytes(field::<0, _, _>(bytes)),
        register: u8::from_le_bytes(field::<2, _, _>(bytes)),
        detail: u16::from_le_bytes(field::<3, _, _>(bytes)),
        counter: u8::from_le_bytes(field::<5, _, _>(bytes)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bytes_are_these() {
        let beat = Heartbeat { state: Heartbeat::OPERATIONAL, reset_count: 2, uptime_s: 0x0403 };
        let frame = encode_heartbeat(Node::MAX, &beat);
        assert_eq!((frame.id().raw(), frame.payload()), (0x77F, [5, 2, 3, 4].as_slice()));
        assert_eq!(decode_heartbeat(&frame), Ok(beat));

        let emergency =
            Emergency { code: Emergency::CODE_WATCHDOG, register: 0x11, detail: 0x0605, counter: 7 };
        let frame = encode_emergency(Node::MAX, &emergency);
        assert_eq!(
            (frame.id().raw(), frame.payload()),
            (0x0FF, [0x30, 0x81, 0x11, 5, 6, 7, 0, 0].as_slice())
        );
        assert_eq!(decode_emergency(&frame), Ok(emergency));
    }
}
