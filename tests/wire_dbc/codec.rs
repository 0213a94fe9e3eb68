//! The codec, asked by the names of the DBC.

use std::collections::BTreeMap;

use quadrant::base::sample::RawFeedback;
use quadrant::rt::bus::Frame;
use quadrant::rt::wire::command::{self, RawCommand};
use quadrant::rt::wire::feedback::{self, BoardFlags};
use quadrant::rt::wire::parameter::{self, Abort, Access, ObjectAddress};
use quadrant::rt::wire::scaling::CurrentCounts;
use quadrant::rt::wire::state::{self, Emergency, Heartbeat};
use quadrant::rt::wire::{Address, Layout, Node, classic};

/// Raw values by the names of the DBC.
pub(crate) type Values = BTreeMap<String, i64>;

/// What the codec reads in a frame.
pub(crate) fn told(layout: Layout, frame: &Frame) -> Values {
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
pub(crate) const UA_PER_MA: i64 = 1_000;

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
pub(crate) fn built(layout: Layout, address: Address, values: &Values) -> Frame {
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
