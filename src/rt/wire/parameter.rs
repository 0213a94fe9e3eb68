//! Access to a board's parameters, used before the cycle starts. Request `600h + n`, reply
//! `580h + n`, classic, 8 bytes: the expedited transfer of CiA 301, every object 32 bits wide.
//!
//! | bytes | field |
//! |---|---|
//! | 0 | command specifier: read `40h`, write `23h`, value `43h`, abort `80h` |
//! | 1..3 | object index, u16 |
//! | 3 | sub-index, u8 |
//! | 4..8 | value or abort code, u32 |
//!
//! [`Object`] is the dictionary: every parameter a board has, with its key in the board's sheet,
//! unit and range. Boards refuse every write: what is in them is flashed, not sent.
//! Invariant: an [`Object`] and its address belong together one to one.

use std::fmt;
use std::ops::RangeInclusive;

use super::{Address, Malformed, Node, field, payload, put};
use crate::rt::bus::Frame;

/// Length of request and reply in bytes.
pub const LENGTH: usize = 8;

const READ: u8 = 0x40;
const WRITE: u8 = 0x23;
const VALUE: u8 = 0x43;
const ABORT: u8 = 0x80;

/// Where a parameter stands in a board's dictionary; prints as `2001:0`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ObjectAddress {
    /// Index of the object.
    pub index: u16,
    /// Sub-index within it.
    pub sub: u8,
}

impl fmt::Display for ObjectAddress {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{:04x}:{}", self.index, self.sub)
    }
}

/// A parameter of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Object {
    /// How often the board says that it is alive.
    HeartbeatPeriod,
    /// Who made the board.
    Vendor,
    /// What it is.
    Product,
    /// Which firmware it runs.
    Revision,
    /// Which one of its kind it is.
    Serial,
    /// CRC-32 over the values that must be true inside the board, see `rt::drive::sheet`.
    FirmwareConfigHash,
    /// The longest time without a fresh command before the board takes the current away.
    Watchdog,
    /// When a command acts: 0 on receipt, 1 at the next SYNC.
    CommandApplies,
    /// Motor encoder counts per revolution.
    MotorCountsPerRev,
    /// Table scale counts per millimetre; 0 without a table scale.
    TableCountsPerMm,
    /// The most current the drive gives.
    PeakCurrent,
    /// The current the motor bears for ever.
    RatedCurrent,
}

impl Object {
    /// Every parameter, in order of the addresses.
    pub const ALL: [Self; 12] = [
        Self::HeartbeatPeriod,
        Self::Vendor,
        Self::Product,
        Self::Revision,
        Self::Serial,
        Self::FirmwareConfigHash,
        Self::Watchdog,
        Self::CommandApplies,
        Self::MotorCountsPerRev,
        Self::TableCountsPerMm,
        Self::PeakCurrent,
        Self::RatedCurrent,
    ];

    /// Where it stands. The standard ones are those of CiA 301 and 402, `2000h` and up are ours.
    pub const fn address(self) -> ObjectAddress {
        let (index, sub) = match self {
            Self::HeartbeatPeriod => (0x1017, 0),
            Self::Vendor => (0x1018, 1),
            Self::Product => (0x1018, 2),
            Self::Revision => (0x1018, 3),
            Self::Serial => (0x1018, 4),
            Self::FirmwareConfigHash => (0x2000, 1),
            Self::Watchdog => (0x2001, 0),
            Self::CommandApplies => (0x2002, 0),
            Self::MotorCountsPerRev => (0x2003, 0),
            Self::TableCountsPerMm => (0x2004, 0),
            Self::PeakCurrent => (0x2005, 0),
            Self::RatedCurrent => (0x6075, 0),
        };
        ObjectAddress { index, sub }
    }
    /// What stands there, if anything.
    pub fn at(address: ObjectAddress) -> Option<Self> {
        Self::ALL.into_iter().find(|object| object.address() == address)
    }
    /// Key in a board's sheet and name in messages.
    pub const fn key(self) -> &'static str {
        match self {
            Self::HeartbeatPeriod => "heartbeat-period",
            Self::Vendor => "vendor",
            Self::Product => "product",
            Self::Revision => "revision",
            Self::Serial => "serial",
            Self::FirmwareConfigHash => "firmware-config-hash",
            Self::Watchdog => "watchdog",
            Self::CommandApplies => "command-applies",
            Self::MotorCountsPerRev => "motor-encoder",
            Self::TableCountsPerMm => "table-scale",
            Self::PeakCurrent => "peak-current",
            Self::RatedCurrent => "rated-current",
        }
    }
    /// Unit of the value; empty for a bare number.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::HeartbeatPeriod => "ms",
            Self::Watchdog => "us",
            Self::MotorCountsPerRev => "counts/rev",
            Self::TableCountsPerMm => "counts/mm",
            Self::PeakCurrent | Self::RatedCurrent => "mA",
            Self::Vendor
            | Self::Product
            | Self::Revision
            | Self::Serial
            | Self::FirmwareConfigHash
            | Self::CommandApplies => "",
        }
    }
    /// Values that make sense.
    pub const fn range(self) -> RangeInclusive<u32> {
        match self {
            // Slower than 10 s tells nothing; the board counts in 16 bits (CiA 301).
            Self::HeartbeatPeriod => 1..=10_000,
            Self::Watchdog => 100..=1_000_000,
            Self::CommandApplies => 0..=1,
            Self::MotorCountsPerRev => 1..=u32::MAX,
            // What fits a frame: micro-amperes in an i32.
            Self::PeakCurrent | Self::RatedCurrent => 1..=2_147_483,
            Self::TableCountsPerMm
            | Self::Vendor
            | Self::Product
            | Self::Revision
            | Self::Serial
            | Self::FirmwareConfigHash => 0..=u32::MAX,
        }
    }
}

impl fmt::Display for Object {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{} (object {})", self.key(), self.address())
    }
}

/// Why a board refuses an access: an abort code of CiA 301.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Abort(pub u32);

impl Abort {
    /// The board does not speak this command specifier.
    pub const UNKNOWN_SPECIFIER: Self = Self(0x0504_0001);
    /// The object cannot be written.
    pub const READ_ONLY: Self = Self(0x0601_0002);
    /// There is no such object.
    pub const NO_OBJECT: Self = Self(0x0602_0000);
    /// The object has no such sub-index.
    pub const NO_SUB_INDEX: Self = Self(0x0609_0011);
}

impl fmt::Display for Abort {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let meaning = match *self {
            Self::UNKNOWN_SPECIFIER => "unknown command specifier",
            Self::READ_ONLY => "object cannot be written",
            Self::NO_OBJECT => "no such object",
            Self::NO_SUB_INDEX => "no such sub-index",
            _ => "see CiA 301",
        };
        write!(out, "abort code {:08x}h, {meaning}", self.0)
    }
}

/// What the host wants with an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// To know its value.
    Read,
    /// To change its value.
    Write(u32),
    /// Something that is not spoken here: the command specifier.
    Other(u8),
}

/// The frame that asks `node` for access to an object.
pub fn encode_request(node: Node, object: ObjectAddress, access: Access) -> Frame {
    let (specifier, value) = match access {
        Access::Read => (READ, 0),
        Access::Write(value) => (WRITE, value),
        Access::Other(specifier) => (specifier, 0),
    };
    Frame::classic(Address::ParameterRequest(node).id(), bytes(specifier, object, value))
}

/// What a request asks for.
pub fn decode_request(frame: &Frame) -> Result<(ObjectAddress, Access), Malformed> {
    let (specifier, object, value) = parts(payload(frame)?);
    let access = match specifier {
        READ => Access::Read,
        WRITE => Access::Write(value),
        other => Access::Other(other),
    };
    Ok((object, access))
}

/// The frame in which `node` answers with a value or refuses.
pub fn encode_reply(node: Node, object: ObjectAddress, outcome: Result<u32, Abort>) -> Frame {
    let (specifier, value) = match outcome {
        Ok(value) => (VALUE, value),
        Err(Abort(code)) => (ABORT, code),
    };
    Frame::classic(Address::ParameterReply(node).id(), bytes(specifier, object, value))
}

/// What a reply says about which object.
pub fn decode_reply(frame: &Frame) -> Result<(ObjectAddress, Result<u32, Abort>), Malformed> {
    let (specifier, object, value) = parts(payload(frame)?);
    match specifier {
        VALUE => Ok((object, Ok(value))),
        ABORT => Ok((object, Err(Abort(value)))),
        got => Err(Malformed::Specifier { got }),
    }
}

fn bytes(specifier: u8, object: ObjectAddress, value: u32) -> [u8; LENGTH] {
    let mut bytes = [specifier; LENGTH];
    put::<1, _, _>(&mut bytes, object.index.to_le_bytes());
    put::<3, _, _>(&mut bytes, object.sub.to_le_bytes());
    put::<4, _, _>(&mut bytes, value.to_le_bytes());
    bytes
}

fn parts(bytes: &[u8; LENGTH]) -> (u8, ObjectAddress, u32) {
    let index = u16::from_le_bytes(field::<1, _, _>(bytes));
    let sub = u8::from_le_bytes(field::<3, _, _>(bytes));
    (bytes[0], ObjectAddress { index, sub }, u32::from_le_bytes(field::<4, _, _>(bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_stand_in_order_at_addresses_of_their_own() {
        assert!(Object::ALL.map(Object::address).is_sorted_by(|one, next| one < next));
        for object in Object::ALL {
            assert_eq!(Object::at(object.address()), Some(object));
        }
        assert_eq!(Object::at(ObjectAddress { index: 0x2001, sub: 1 }), None);
    }

    #[test]
    fn the_bytes_are_these() {
        let object = Object::Revision.address();
        let request = encode_request(Node::MAX, object, Access::Read);
        assert_eq!(
            (request.id().raw(), request.payload()),
            (0x67F, [0x40, 0x18, 0x10, 3, 0, 0, 0, 0].as_slice())
        );
        assert_eq!(decode_request(&request), Ok((object, Access::Read)));

        let reply = encode_reply(Node::MAX, object, Err(Abort::NO_OBJECT));
        assert_eq!(
            (reply.id().raw(), reply.payload()),
            (0x5FF, [0x80, 0x18, 0x10, 3, 0, 0, 2, 6].as_slice())
        );
        assert_eq!(decode_reply(&reply), Ok((object, Err(Abort::NO_OBJECT))));
    }

    #[test]
    fn access_and_outcome_survive_the_wire() {
        let object = ObjectAddress { index: 0xABCD, sub: 0xEF };
        for access in [Access::Read, Access::Write(0x0102_0304), Access::Other(0x60)] {
            assert_eq!(decode_request(&encode_request(Node::MAX, object, access)), Ok((object, access)));
        }
        for outcome in [Ok(u32::MAX), Err(Abort::READ_ONLY)] {
            assert_eq!(decode_reply(&encode_reply(Node::MAX, object, outcome)), Ok((object, outcome)));
        }
    }

    #[test]
    fn a_reply_of_another_kind_is_refused() {
        let segmented = Frame::classic(Address::ParameterReply(Node::MAX).id(), [0x41, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(decode_reply(&segmented), Err(Malformed::Specifier { got: 0x41 }));
    }
}
