//! Promise: the frames we speak are those of `firmware-config/encoder-board.dbc`, signal by signal,
//! in both directions.
//!
//! The DBC is parsed and applied bit by bit in f64 and integers, without any of our codec; the codec
//! is asked through its public functions. Values are random from a fixed seed, with the ends of each
//! range among them.

use std::collections::{BTreeMap, BTreeSet};

use can_dbc::{AttributeValue, ByteOrder, Dbc, Message, Signal, ValueType};
use quadrant::base::sample::RawFeedback;
use quadrant::base::units::Position;
use quadrant::rt::bus::{Format, Frame, Id};
use quadrant::rt::wire::command::{self, RawCommand};
use quadrant::rt::wire::feedback::{self, BoardFlags};
use quadrant::rt::wire::parameter::{self, Abort, Access, ObjectAddress};
use quadrant::rt::wire::scaling::{AxisScale, CurrentCounts, ScaleSettings, Sense};
use quadrant::rt::wire::state::{self, Emergency, Heartbeat};
use quadrant::rt::wire::{Address, Node};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const DBC: &str = include_str!("../firmware-config/encoder-board.dbc");
const ROUNDS: usize = 2_000;

/// Raw values by the names of the DBC.
type Values = BTreeMap<String, i64>;

fn dbc() -> Dbc {
    Dbc::try_from(DBC).expect("the DBC parses")
}

fn address(message: &Message) -> Address {
    let id = Id::new(message.id.raw() as u16).expect("an 11-bit identifier");
    Address::of(id)
        .unwrap_or_else(|| panic!("{} has identifier {:03x}h, which is none of ours", message.name, id.raw()))
}

/// Whether the DBC says that a message is CAN FD with bit rate switch.
fn is_fd(dbc: &Dbc, message: &Message) -> bool {
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

// The DBC, applied by hand.

fn bits(signal: &Signal) -> std::ops::Range<usize> {
    assert_eq!(signal.byte_order, ByteOrder::LittleEndian, "{}", signal.name);
    signal.start_bit as usize..(signal.start_bit + signal.size) as usize
}

fn read(signal: &Signal, payload: &[u8]) -> i64 {
    let raw =
        bits(signal).rev().fold(0_i64, |raw, bit| raw << 1 | i64::from(payload[bit / 8] >> (bit % 8) & 1));
    match signal.value_type {
        ValueType::Unsigned => raw,
        ValueType::Signed => raw << (64 - signal.size) >> (64 - signal.size),
    }
}

fn write(signal: &Signal, payload: &mut [u8], raw: i64) {
    for (place, bit) in bits(signal).enumerate() {
        payload[bit / 8] = payload[bit / 8] & !(1 << (bit % 8)) | ((raw >> place & 1) as u8) << (bit % 8);
    }
}

/// A random raw value: any bits, or for a signal that must be one of a list, one of those.
fn random(dbc: &Dbc, message: &Message, signal: &Signal, chance: &mut Pcg64Mcg) -> i64 {
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

// The codec, asked by the names of the DBC.

/// What the codec reads in a frame.
fn told(frame: &Frame) -> Values {
    let readable = "the codec reads a frame of the DBC's length";
    let pairs: Vec<(&str, i64)> = match Address::of(frame.id()).expect("one of our identifiers") {
        Address::Sync => vec![("SyncCycle", command::decode_sync(frame).expect(readable).into())],
        Address::Emergency(_) => {
            let Emergency { code, register, detail, counter } =
                state::decode_emergency(frame).expect(readable);
            vec![
                ("ErrorCode", code.into()),
                ("ErrorRegister", register.into()),
                ("ErrorDetail", detail.into()),
                ("EmergencyCounter", counter.into()),
            ]
        }
        Address::Feedback(_) => told_feedback(&feedback::decode(frame).expect(readable)),
        Address::FeedbackTable(_) => panic!("classic CAN has its own DBC"),
        Address::Command(_) => {
            let raw = command::decode(frame).expect(readable);
            vec![
                ("CurrentSetpoint", raw.current.as_ua().into()),
                ("ControlWord", raw.control_word.into()),
                ("CommandCycle", raw.cycle.into()),
                ("CommandSequence", raw.sequence.into()),
                ("ModeOfOperation", raw.mode_of_operation.into()),
            ]
        }
        Address::ParameterRequest(_) => {
            let (object, access) = parameter::decode_request(frame).expect(readable);
            let (specifier, value) = match access {
                Access::Read => (0x40, None),
                Access::Write(value) => (0x23, Some(value)),
                Access::Other(other) => (other.into(), None),
            };
            told_object(specifier, object, value)
        }
        Address::ParameterReply(_) => {
            let (object, outcome) = parameter::decode_reply(frame).expect(readable);
            match outcome {
                Ok(value) => told_object(0x43, object, Some(value)),
                Err(Abort(code)) => told_object(0x80, object, Some(code)),
            }
        }
        Address::Heartbeat(_) => {
            let Heartbeat { state, reset_count, uptime_s } = state::decode_heartbeat(frame).expect(readable);
            vec![
                ("NetworkState", state.into()),
                ("ResetCount", reset_count.into()),
                ("Uptime", uptime_s.into()),
            ]
        }
    };
    pairs.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

const FLAGS: [(&str, BoardFlags); 5] = [
    ("WatchdogTripped", BoardFlags::WATCHDOG_TRIPPED),
    ("CommandStale", BoardFlags::COMMAND_STALE),
    ("CurrentSaturated", BoardFlags::CURRENT_SATURATED),
    ("EncoderError", BoardFlags::ENCODER_ERROR),
    ("TableScale", BoardFlags::TABLE_SCALE),
];

fn told_feedback(raw: &RawFeedback) -> Vec<(&'static str, i64)> {
    let flags = BoardFlags::from_bits(raw.board_flags);
    let mut pairs = vec![
        ("MotorCounts", raw.motor_counts.into()),
        ("TableCounts", raw.table_counts.into()),
        ("MotorCurrent", raw.current_ua.into()),
        ("BoardTime", raw.board_time_us.into()),
        ("AnswersCycle", raw.answers_cycle.into()),
        ("StatusWord", raw.status_word.into()),
        ("FeedbackSequence", raw.sequence.into()),
    ];
    pairs.extend(FLAGS.map(|(name, flag)| (name, flags.contains(flag).into())));
    pairs
}

fn told_object(specifier: i64, object: ObjectAddress, value: Option<u32>) -> Vec<(&'static str, i64)> {
    let mut pairs = vec![
        ("Specifier", specifier),
        ("ObjectIndex", object.index.into()),
        ("ObjectSubIndex", object.sub.into()),
    ];
    // A read request carries no value: the codec does not tell one.
    pairs.extend(value.map(|value| ("ObjectValue", value.into())));
    pairs
}

/// The frame the codec builds from values. Casts cannot lose: values come from signals of the width.
fn built(address: Address, values: &Values) -> Frame {
    let of = |name: &str| values[name];
    let object = || ObjectAddress { index: of("ObjectIndex") as u16, sub: of("ObjectSubIndex") as u8 };
    let value = || of("ObjectValue") as u32;
    match address {
        Address::Sync => command::encode_sync(of("SyncCycle") as u32),
        Address::Emergency(node) => {
            let emergency = Emergency {
                code: of("ErrorCode") as u16,
                register: of("ErrorRegister") as u8,
                detail: of("ErrorDetail") as u16,
                counter: of("EmergencyCounter") as u8,
            };
            state::encode_emergency(node, &emergency)
        }
        Address::Feedback(node) => {
            let flags = FLAGS.iter().fold(BoardFlags::NONE, |flags, (name, flag)| {
                flags.with(BoardFlags::when(of(name) == 1, *flag))
            });
            let raw = RawFeedback {
                motor_counts: of("MotorCounts") as u32,
                table_counts: of("TableCounts") as u32,
                current_ua: of("MotorCurrent") as i32,
                board_time_us: of("BoardTime") as u32,
                answers_cycle: of("AnswersCycle") as u16,
                status_word: of("StatusWord") as u16,
                sequence: of("FeedbackSequence") as u8,
                board_flags: flags.bits(),
            };
            feedback::encode(node, &raw)
        }
        Address::FeedbackTable(_) => panic!("classic CAN has its own DBC"),
        Address::Command(node) => {
            let raw = RawCommand {
                current: CurrentCounts::ua(of("CurrentSetpoint") as i32),
                control_word: of("ControlWord") as u16,
                cycle: of("CommandCycle") as u16,
                sequence: of("CommandSequence") as u8,
                mode_of_operation: of("ModeOfOperation") as i8,
            };
            command::encode(node, &raw)
        }
        Address::ParameterRequest(node) => {
            let access = if of("Specifier") == 0x40 { Access::Read } else { Access::Write(value()) };
            parameter::encode_request(node, object(), access)
        }
        Address::ParameterReply(node) => {
            let outcome = if of("Specifier") == 0x43 { Ok(value()) } else { Err(Abort(value())) };
            parameter::encode_reply(node, object(), outcome)
        }
        Address::Heartbeat(node) => {
            let heartbeat = Heartbeat {
                state: of("NetworkState") as u8,
                reset_count: of("ResetCount") as u8,
                uptime_s: of("Uptime") as u16,
            };
            state::encode_heartbeat(node, &heartbeat)
        }
    }
}

#[test]
fn the_dbc_has_every_frame_of_the_codec_and_no_other() {
    let described: BTreeSet<u32> = dbc().messages.iter().map(|message| message.id.raw()).collect();
    let nodes = [1, 2].map(|number| Node::new(number).expect("a node number"));
    let spoken = nodes.into_iter().flat_map(|node| {
        [
            Address::Sync,
            Address::Emergency(node),
            Address::Feedback(node),
            Address::Command(node),
            Address::ParameterReply(node),
            Address::ParameterRequest(node),
            Address::Heartbeat(node),
        ]
    });
    assert_eq!(described, spoken.map(|address| u32::from(address.id().raw())).collect());
}

#[test]
fn what_the_dbc_writes_the_codec_reads() {
    let dbc = dbc();
    let mut chance = Pcg64Mcg::seed_from_u64(1);
    for message in &dbc.messages {
        let fd = Format::Fd { bit_rate_switch: true };
        let format = if is_fd(&dbc, message) { fd } else { Format::Classic };
        for round in 0..ROUNDS {
            // Bits that belong to no signal are noise, which the codec must ignore.
            let mut payload: Vec<u8> = (0..message.size).map(|_| chance.random()).collect();
            let mut values = Values::new();
            for signal in &message.signals {
                let raw = random(&dbc, message, signal, &mut chance);
                write(signal, &mut payload, raw);
                values.insert(signal.name.clone(), raw);
            }
            if values.get("Specifier") == Some(&0x40) {
                values.remove("ObjectValue");
            }
            let frame = Frame::from_slice(address(message).id(), format, &payload).unwrap_or_else(|| {
                panic!("{}: {} bytes fit no {format:?} frame", message.name, message.size)
            });
            assert_eq!(told(&frame), values, "{}, round {round}: codec left, DBC right", message.name);
        }
    }
}

#[test]
fn what_the_codec_writes_the_dbc_reads() {
    let dbc = dbc();
    let mut chance = Pcg64Mcg::seed_from_u64(2);
    for message in &dbc.messages {
        let mut described_bits = vec![false; 8 * message.size as usize];
        for bit in message.signals.iter().flat_map(bits) {
            assert!(!std::mem::replace(&mut described_bits[bit], true), "{}: bit {bit} twice", message.name);
        }
        for round in 0..ROUNDS {
            let mut values: Values = (message.signals.iter())
                .map(|signal| (signal.name.clone(), random(&dbc, message, signal, &mut chance)))
                .collect();
            let frame = built(address(message), &values);
            if values.get("Specifier") == Some(&0x40) {
                values.insert("ObjectValue".to_owned(), 0);
            }
            assert_eq!(frame.length(), message.size as usize, "{}: bytes", message.name);
            assert_eq!(frame.format() != Format::Classic, is_fd(&dbc, message), "{}: FD", message.name);
            let read: Values = (message.signals.iter())
                .map(|signal| (signal.name.clone(), read(signal, frame.payload())))
                .collect();
            assert_eq!(read, values, "{}, round {round}: DBC left, codec right", message.name);
            for (bit, _) in described_bits.iter().enumerate().filter(|(_, described)| !**described) {
                assert_eq!(
                    frame.payload()[bit / 8] >> (bit % 8) & 1,
                    0,
                    "{}: reserved bit {bit}",
                    message.name
                );
            }
        }
    }
}

#[test]
fn quantities_of_the_dbc_are_those_of_the_scaling() {
    let scale = AxisScale::new(&ScaleSettings {
        lead: Position::mm(10.0),
        motor_counts_per_rev: 1 << 20,
        motor_sense: Sense::Along,
        table_counts_per_mm: None,
        table_sense: Sense::Along,
    });
    let mut currents = 0;
    for signal in dbc().messages.iter().flat_map(|message| &message.signals) {
        assert_eq!(signal.offset, 0.0, "{}", signal.name);
        match signal.unit.as_str() {
            "A" => {
                currents += 1;
                for ua in [i32::MIN, -1, 0, 1, 1_234_567, i32::MAX] {
                    let by_dbc = f64::from(ua) * signal.factor;
                    assert_eq!(scale.current(CurrentCounts::ua(ua)).as_a(), by_dbc, "{} in A", signal.name);
                }
            }
            "s" if signal.name == "BoardTime" => assert_eq!(signal.factor, 1e-6, "board time counts in us"),
            _ => assert_eq!(signal.factor, 1.0, "{}", signal.name),
        }
    }
    assert_eq!(currents, 4, "current signals of two nodes");
}
