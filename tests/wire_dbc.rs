//! Promise: the frames we speak are those of `firmware-config/encoder-board.dbc`, on classic CAN those of
//! `encoder-board-classic.dbc`, signal by signal, in both directions.
//!
//! A DBC is parsed and applied bit by bit in f64 and integers, without any of our codec; the codec
//! is asked through its public functions. Values are random from a fixed seed, with the ends of each
//! range among them.

use std::collections::{BTreeMap, BTreeSet};

use can_dbc::{AttributeValue, ByteOrder, Dbc, Message, Signal, ValueType};
use quadrant::base::sample::RawFeedback;
use quadrant::base::units::Position;
use quadrant::rt::bus::{Format, Frame, Id};
use quadrant::rt::drive::state::DriveState;
use quadrant::rt::wire::command::{self, RawCommand};
use quadrant::rt::wire::feedback::{self, BoardFlags};
use quadrant::rt::wire::parameter::{self, Abort, Access, ObjectAddress};
use quadrant::rt::wire::scaling::{AxisScale, CurrentCounts, ScaleSettings, Sense};
use quadrant::rt::wire::state::{self, Emergency, Heartbeat};
use quadrant::rt::wire::{Address, Layout, Node, classic};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rstest::rstest;

const ROUNDS: usize = 2_000;

/// Raw values by the names of the DBC.
type Values = BTreeMap<String, i64>;

fn dbc(layout: Layout) -> Dbc {
    let text = match layout {
        Layout::Fd => include_str!("../firmware-config/encoder-board.dbc"),
        Layout::Classic => include_str!("../firmware-config/encoder-board-classic.dbc"),
    };
    Dbc::try_from(text).expect("the DBC parses")
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
fn told(layout: Layout, frame: &Frame) -> Values {
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
        Address::Feedback(_) => match layout {
            Layout::Fd => told_feedback(&feedback::decode(frame).expect(readable)),
            Layout::Classic => {
                let half = classic::decode_motor(frame).expect(readable);
                let raw = classic::join(half, blank_halves().1, 0);
                vec![
                    ("MotorCounts", raw.motor_counts.into()),
                    ("MotorCurrent", i64::from(raw.current_ua) / UA_PER_MA),
                    ("AnswersCycle", raw.answers_cycle.into()),
                ]
            }
        },
        Address::FeedbackTable(_) => {
            let half = classic::decode_table(frame).expect(readable);
            let raw = classic::join(blank_halves().0, half, half.board_time_us.into());
            let state = classic::STATUS_WORDS.iter().position(|word| *word == raw.status_word);
            let mut pairs = vec![
                ("TableCounts", raw.table_counts.into()),
                ("BoardTime", raw.board_time_us.into()),
                ("AnswersCycle", half.cycle.into()),
                ("DriveState", state.expect("the status word of a state") as i64),
            ];
            pairs.extend(told_flags(&raw));
            pairs
        }
        Address::Command(_) => {
            let raw = layout.decode_command(frame).expect(readable);
            let mut pairs = vec![
                ("CurrentSetpoint", raw.current.as_ua().into()),
                ("ControlWord", raw.control_word.into()),
                ("CommandCycle", raw.cycle.into()),
                ("CommandSequence", raw.sequence.into()),
            ];
            match layout {
                Layout::Fd => pairs.push(("ModeOfOperation", raw.mode_of_operation.into())),
                Layout::Classic => assert_eq!(raw.mode_of_operation, command::CYCLIC_SYNCHRONOUS_TORQUE),
            }
            pairs
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

/// The current of the feedback counts in mA on classic CAN.
const UA_PER_MA: i64 = 1_000;

/// Halves of a feedback in which every bit is zero, to put the other half to.
fn blank_halves() -> (classic::MotorHalf, classic::TableHalf) {
    let node = Node::MAX;
    let blank = |address: Address| Frame::classic(address.id(), [0; classic::FEEDBACK_LENGTH]);
    let motor = classic::decode_motor(&blank(Address::Feedback(node)));
    let table = classic::decode_table(&blank(Address::FeedbackTable(node)));
    (motor.expect("8 bytes"), table.expect("8 bytes"))
}

fn told_flags(raw: &RawFeedback) -> impl Iterator<Item = (&'static str, i64)> {
    let flags = BoardFlags::from_bits(raw.board_flags);
    FLAGS.into_iter().map(move |(name, flag)| (name, flags.contains(flag).into()))
}

fn told_feedback(raw: &RawFeedback) -> Vec<(&'static str, i64)> {
    let mut pairs = vec![
        ("MotorCounts", raw.motor_counts.into()),
        ("TableCounts", raw.table_counts.into()),
        ("MotorCurrent", raw.current_ua.into()),
        ("BoardTime", raw.board_time_us.into()),
        ("AnswersCycle", raw.answers_cycle.into()),
        ("StatusWord", raw.status_word.into()),
        ("FeedbackSequence", raw.sequence.into()),
    ];
    pairs.extend(told_flags(raw));
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
fn built(layout: Layout, address: Address, values: &Values) -> Frame {
    let of = |name: &str| values[name];
    let flags = || {
        let set = FLAGS.iter().filter(|(name, _)| of(name) == 1);
        set.fold(BoardFlags::NONE, |flags, (_, flag)| flags.with(*flag)).bits()
    };
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
            let motor = RawFeedback {
                motor_counts: of("MotorCounts") as u32,
                current_ua: of("MotorCurrent") as i32,
                answers_cycle: of("AnswersCycle") as u16,
                ..RawFeedback::default()
            };
            match layout {
                Layout::Fd => feedback::encode(
                    node,
                    &RawFeedback {
                        table_counts: of("TableCounts") as u32,
                        board_time_us: of("BoardTime") as u32,
                        status_word: of("StatusWord") as u16,
                        sequence: of("FeedbackSequence") as u8,
                        board_flags: flags(),
                        ..motor
                    },
                ),
                Layout::Classic => {
                    let current_ua = (of("MotorCurrent") * UA_PER_MA) as i32;
                    let [frame, _] = classic::encode_feedback(node, &RawFeedback { current_ua, ..motor });
                    frame
                }
            }
        }
        Address::FeedbackTable(node) => {
            let raw = RawFeedback {
                table_counts: of("TableCounts") as u32,
                board_time_us: of("BoardTime") as u32,
                answers_cycle: of("AnswersCycle") as u16,
                status_word: classic::STATUS_WORDS[of("DriveState") as usize],
                board_flags: flags(),
                ..RawFeedback::default()
            };
            let [_, frame] = classic::encode_feedback(node, &raw);
            frame
        }
        Address::Command(node) => {
            let raw = RawCommand {
                current: CurrentCounts::ua(of("CurrentSetpoint") as i32),
                control_word: of("ControlWord") as u16,
                cycle: of("CommandCycle") as u16,
                sequence: of("CommandSequence") as u8,
                mode_of_operation: match layout {
                    Layout::Fd => of("ModeOfOperation") as i8,
                    Layout::Classic => command::CYCLIC_SYNCHRONOUS_TORQUE,
                },
            };
            layout.command(node, &raw)
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

#[rstest]
#[case::fd(Layout::Fd)]
#[case::classic(Layout::Classic)]
fn the_dbc_has_every_frame_of_the_codec_and_no_other(#[case] layout: Layout) {
    let described: BTreeSet<u32> = dbc(layout).messages.iter().map(|message| message.id.raw()).collect();
    let nodes = [1, 2].map(|number| Node::new(number).expect("a node number"));
    let spoken = nodes.into_iter().flat_map(|node| {
        let rare = [
            Address::Sync,
            Address::Emergency(node),
            Address::ParameterReply(node),
            Address::ParameterRequest(node),
            Address::Heartbeat(node),
        ];
        let feedback = layout.feedback(node, &RawFeedback::default());
        let cyclic = feedback.chain([layout.command(node, &RawCommand::default())]);
        rare.map(Address::id).into_iter().chain(cyclic.map(|frame| frame.id()))
    });
    assert_eq!(described, spoken.map(|id| u32::from(id.raw())).collect());
}

#[rstest]
#[case::fd(Layout::Fd)]
#[case::classic(Layout::Classic)]
fn what_the_dbc_writes_the_codec_reads(#[case] layout: Layout) {
    let dbc = dbc(layout);
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
            assert_eq!(
                told(layout, &frame),
                values,
                "{}, round {round}: codec left, DBC right",
                message.name
            );
        }
    }
}

#[rstest]
#[case::fd(Layout::Fd)]
#[case::classic(Layout::Classic)]
fn what_the_codec_writes_the_dbc_reads(#[case] layout: Layout) {
    let dbc = dbc(layout);
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
            let frame = built(layout, address(message), &values);
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

#[rstest]
#[case::fd(Layout::Fd)]
#[case::classic(Layout::Classic)]
fn quantities_of_the_dbc_are_those_of_the_scaling(#[case] layout: Layout) {
    let scale = AxisScale::new(&ScaleSettings {
        lead: Position::mm(10.0),
        motor_counts_per_rev: 1 << 20,
        motor_sense: Sense::Along,
        table_counts_per_mm: None,
        table_sense: Sense::Along,
    });
    let mut currents = 0;
    for signal in dbc(layout).messages.iter().flat_map(|message| &message.signals) {
        assert_eq!(signal.offset, 0.0, "{}", signal.name);
        match signal.unit.as_str() {
            "A" => {
                currents += 1;
                let ua_per_count = if signal.size == 16 { UA_PER_MA } else { 1 };
                let end = 1_i64 << (signal.size - 1);
                for counts in [-end, -1, 0, 1, 12_345, end - 1] {
                    let by_dbc = counts as f64 * signal.factor;
                    let ours = scale.current(CurrentCounts::ua((counts * ua_per_count) as i32)).as_a();
                    // Neither factor is a binary number: each product is off by a rounding.
                    let bound = by_dbc.abs() * f64::EPSILON;
                    assert!((ours - by_dbc).abs() <= bound, "{}: {ours} A, DBC {by_dbc} A", signal.name);
                }
            }
            "s" if signal.name == "BoardTime" => assert_eq!(signal.factor, 1e-6, "board time counts in us"),
            _ => assert_eq!(signal.factor, 1.0, "{}", signal.name),
        }
    }
    assert_eq!(currents, 4, "current signals of two nodes");
}

#[test]
fn the_drive_states_of_the_dbc_are_those_of_the_state_machine() {
    let dbc = dbc(Layout::Classic);
    let mut described = 0;
    for message in dbc.messages.iter().filter(|message| message.name.starts_with("FeedbackTable")) {
        let states = dbc.value_descriptions_for_signal(message.id, "DriveState").expect("states are listed");
        let named: Vec<(i64, String)> =
            states.iter().map(|state| (state.id, state.description.clone())).collect();
        let ours = classic::STATUS_WORDS.map(|word| {
            let name = format!("{:?}", DriveState::decode(word).expect("the word of a state"));
            name.chars().fold(String::new(), |text, c| {
                let gap = if c.is_uppercase() && !text.is_empty() { " " } else { "" };
                text + gap + &c.to_lowercase().to_string()
            })
        });
        assert_eq!(named, (0..).zip(ours).collect::<Vec<_>>(), "{}", message.name);
        described += 1;
    }
    assert_eq!(described, 2, "second frames of two nodes");
}
