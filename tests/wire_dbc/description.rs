//! The DBC, applied by hand.

use can_dbc::{AttributeValue, ByteOrder, Dbc, Message, Signal, ValueType};
use quadrant::rt::bus::Id;
use quadrant::rt::wire::{Address, Layout};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

pub(crate) fn dbc(layout: Layout) -> Dbc {
    let text = match layout {
        Layout::Fd => include_str!("../../firmware-config/encoder-board.dbc"),
        Layout::Classic => include_str!("../../firmware-config/encoder-board-classic.dbc"),
    };
    Dbc::try_from(text).expect("the DBC parses")
}

pub(crate) fn address(message: &Message) -> Address {
    let id = Id::new(message.id.raw() as u16).expect("an 11-bit identifier");
    Address::of(id)
        .unwrap_or_else(|| panic!("{} has identifier {:03x}h, which is none of ours", message.name, id.raw()))
}

/// Whether the DBC says that a message is CAN FD with bit rate switch.
pub(crate) fn is_fd(dbc: &Dbc, message: &Message) -> bool {
    let value = |name| dbc.message_attribute(message.id, name);
    let frame_format = value("VFrameFormat") == Some(&AttributeValue::Uint(14));
    let bit_rate_switch = value("CANFD_BRS") == Some(&AttributeValue::Uint(1));
    assert_eq!(
        frame_format, bit_rate_switch,
        "{}: we send every FD frame with bit rate switch",
        message.name
    );
    frame_format
}

pub(crate) fn bits(signal: &Signal) -> std::ops::Range<usize> {
    assert_eq!(signal.byte_order, ByteOrder::LittleEndian, "{}", signal.name);
    signal.start_bit as usize..(signal.start_bit + signal.size) as usize
}

pub(crate) fn read(signal: &Signal, payload: &[u8]) -> i64 {
    let raw =
        bits(signal).rev().fold(0_i64, |raw, bit| raw << 1 | i64::from(payload[bit / 8] >> (bit % 8) & 1));
    match signal.value_type {
        ValueType::Unsigned => raw,
        ValueType::Signed => raw << (64 - signal.size) >> (64 - signal.size),
    }
}

pub(crate) fn write(signal: &Signal, payload: &mut [u8], raw: i64) {
    for (place, bit) in bits(signal).enumerate() {
        payload[bit / 8] = payload[bit / 8] & !(1 << (bit % 8)) | ((raw >> place & 1) as u8) << (bit % 8);
    }
}

/// A random raw value: any bits, or for a signal that must be one of a list, one of those.
pub(crate) fn random(dbc: &Dbc, message: &Message, signal: &Signal, chance: &mut Pcg64Mcg) -> i64 {
    if signal.name == "Specifier" {
        let listed =
            dbc.value_descriptions_for_signal(message.id, &signal.name).expect("specifiers are listed");
        return listed[chance.random_range(0..listed.len())].id;
    }
    let unsigned = match chance.random_range(0..10) {
        0 => 0,
        1 => u64::MAX,
        2 => 1 << (signal.size - 1),
        _ => chance.random::<u64>(),
    };
    let mut payload = [0; 64];
    write(signal, &mut payload, unsigned as i64);
    read(signal, &payload)
}
