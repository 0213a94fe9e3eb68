//! The cyclic frames on classic CAN, which carries 8 bytes: feedback in two frames, the command in one.
//! Everything else is the same on both.
//!
//! Feedback, first frame, 8 bytes, identifier `180h + n`:
//!
//! | bytes | field | unit |
//! |---|---|---|
//! | 0..4 | motor encoder, u32, wraps | counts |
//! | 4..6 | motor current, i16 | 1 mA |
//! | 6..8 | low half of the cycle of the SYNC answered, u16 | cycles |
//!
//! Feedback, second frame, 8 bytes, identifier `280h + n`:
//!
//! | bytes | field | unit |
//! |---|---|---|
//! | 0..4 | table scale, u32, wraps | counts |
//! | 4..6 | low half of the board time at the latch, u16 | 1 µs |
//! | 6 | low byte of the cycle of the SYNC answered | cycles |
//! | 7 | bits 0 to 4: [`BoardFlags`](super::feedback::BoardFlags); bits 5 to 7: state of the drive (CiA 402) | |
//!
//! Command, 7 bytes, identifier `200h + n`:
//!
//! | bytes | field | unit |
//! |---|---|---|
//! | 0..4 | current setpoint, i32 | 1 µA |
//! | 4 | low byte of the control word, which has all that this mode uses | |
//! | 5 | low byte of the cycle of the SYNC it belongs to | cycles |
//! | 6 | sequence, u8, wraps | frames |
//!
//! Its mode of operation is [`CYCLIC_SYNCHRONOUS_TORQUE`] without being told: the byte would make two axes
//! at 1 kHz take more than 90 % of the bus.
//!
//! Two frames belong together if they answer the same SYNC. A second frame that is a multiple of 256 cycles
//! late names the same byte; its board time then tells, see `rt/drive`. There is no sequence: what answers
//! this SYNC and was not here before is new. What is sent short (cycle, board time) the host completes by
//! what it knows.
//! Invariant: `join(halves(raw))` is `raw` but for what is too long for it, and the sequence, which is the
//! low byte of the cycle.

use super::command::{CYCLIC_SYNCHRONOUS_TORQUE, RawCommand};
use super::scaling::CurrentCounts;
use super::{Address, Malformed, Node, field, payload, put};
use crate::base::sample::RawFeedback;
use crate::rt::bus::Frame;

/// Length of each feedback frame in bytes.
pub const FEEDBACK_LENGTH: usize = 8;
/// Length of a command in bytes.
pub const COMMAND_LENGTH: usize = 7;

const FLAG_BITS: u8 = 5;
const FLAGS: u8 = (1 << FLAG_BITS) - 1;
/// Status words of the states, in order of the numbers they travel as: the state's bits and those that
/// follow from it.
pub const STATUS_WORDS: [u16; 8] = [0x0000, 0x0240, 0x0231, 0x0233, 0x1237, 0x0217, 0x020F, 0x0208];

/// The bits of a status word that tell the state of the drive (CiA 402). That of quick stop tells nothing
/// while the power stage is off or a fault is there.
const fn state_bits(status_word: u16) -> u16 {
    const READY_OR_FAULT: u16 = 0x09;
    const READY: u16 = 0x01;
    status_word & if status_word & READY_OR_FAULT == READY { 0x6F } else { 0x4F }
}

/// The first frame of a feedback.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotorHalf {
    motor_counts: u32,
    current_ma: i16,
    /// Low half of the cycle of the SYNC answered.
    pub cycle: u16,
}

/// The second frame of a feedback.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableHalf {
    table_counts: u32,
    /// Low half of the board time, µs.
    pub board_time_us: u16,
    /// Low byte of the cycle of the SYNC answered.
    pub cycle: u8,
    board_flags: u8,
    status_word: u16,
}

/// The frames that carry `raw` from `node`.
pub fn encode_feedback(node: Node, raw: &RawFeedback) -> [Frame; 2] {
    let current_ma = (f64::from(raw.current_ua) * 1e-3).round() as i16;
    let mut motor = [0; FEEDBACK_LENGTH];
    put::<0, _, _>(&mut motor, raw.motor_counts.to_le_bytes());
    put::<4, _, _>(&mut motor, current_ma.to_le_bytes());
    put::<6, _, _>(&mut motor, raw.answers_cycle.to_le_bytes());
    // A word the standard gives no meaning travels as the state in which nothing can be done.
    let is_state = |word: &u16| state_bits(*word) == state_bits(raw.status_word);
    let state = STATUS_WORDS.iter().position(is_state).unwrap_or(0) as u8;
    let mut table = [0; FEEDBACK_LENGTH];
    put::<0, _, _>(&mut table, raw.table_counts.to_le_bytes());
    put::<4, _, _>(&mut table, (raw.board_time_us as u16).to_le_bytes());
    put::<6, _, _>(&mut table, [raw.answers_cycle as u8, raw.board_flags & FLAGS | state << FLAG_BITS]);
    [
        Frame::classic(Address::Feedback(node).id(), motor),
        Frame::classic(Address::FeedbackTable(node).id(), table),
    ]
}

/// What a first frame says.
pub fn decode_motor(frame: &Frame) -> Result<MotorHalf, Malformed> {
    let bytes: &[u8; FEEDBACK_LENGTH] = payload(frame)?;
    Ok(MotorHalf {
        motor_counts: u32::from_le_bytes(field::<0, _, _>(bytes)),
        current_ma: i16::from_le_bytes(field::<4, _, _>(bytes)),
        cycle: u16::from_le_bytes(field::<6, _, _>(bytes)),
    })
}

/// What a second frame says.
pub fn decode_table(frame: &Frame) -> Result<TableHalf, Malformed> {
    let bytes: &[u8; FEEDBACK_LENGTH] = payload(frame)?;
    Ok(TableHalf {
        table_counts: u32::from_le_bytes(field::<0, _, _>(bytes)),
        board_time_us: u16::from_le_bytes(field::<4, _, _>(bytes)),
        cycle: bytes[6],
        board_flags: bytes[7] & FLAGS,
        status_word: STATUS_WORDS[usize::from(bytes[7] >> FLAG_BITS)],
    })
}

/// Both halves of an answer, and the board time that the second is short for.
pub fn join(motor: MotorHalf, table: TableHalf, board_time_us: u32) -> RawFeedback {
    RawFeedback {
        motor_counts: motor.motor_counts,
        table_counts: table.table_counts,
        current_ua: i32::from(motor.current_ma) * 1_000,
        board_time_us,
        answers_cycle: motor.cycle,
        status_word: table.status_word,
        sequence: motor.cycle as u8,
        board_flags: table.board_flags,
    }
}

/// The frame that carries `raw` to `node`.
pub fn encode_command(node: Node, raw: &RawCommand) -> Frame {
    let mut bytes = [0; COMMAND_LENGTH];
    put::<0, _, _>(&mut bytes, raw.current.as_ua().to_le_bytes());
    put::<4, _, _>(&mut bytes, [raw.control_word as u8, raw.cycle as u8, raw.sequence]);
    Frame::classic(Address::Command(node).id(), bytes)
}

/// What a command frame says.
pub fn decode_command(frame: &Frame) -> Result<RawCommand, Malformed> {
    let bytes: &[u8; COMMAND_LENGTH] = payload(frame)?;
    Ok(RawCommand {
        current: CurrentCounts::ua(i32::from_le_bytes(field::<0, _, _>(bytes))),
        control_word: u16::from(bytes[4]),
        cycle: u16::from(bytes[5]),
        sequence: bytes[6],
        mode_of_operation: CYCLIC_SYNCHRONOUS_TORQUE,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw() -> RawFeedback {
        RawFeedback {
            motor_counts: 0x0403_0201,
            table_counts: 0x0807_0605,
            current_ua: -258_000,
            board_time_us: 0x100F_0E0D,
            answers_cycle: 0x1211,
            status_word: STATUS_WORDS[4],
            sequence: 0x11,
            board_flags: 0x16,
        }
    }

    #[test]
    fn the_bytes_are_these() {
        let [motor, table] = encode_feedback(Node::MAX, &raw());
        assert_eq!((motor.id().raw(), table.id().raw()), (0x1FF, 0x2FF));
        assert_eq!(motor.payload(), [1, 2, 3, 4, 0xFE, 0xFE, 0x11, 0x12]);
        assert_eq!(table.payload(), [5, 6, 7, 8, 0x0D, 0x0E, 0x11, 0x96]);
        let command = RawCommand {
            current: CurrentCounts::ua(-1_000_000),
            control_word: 0x008F,
            cycle: 0xBEEF,
            sequence: 255,
            mode_of_operation: CYCLIC_SYNCHRONOUS_TORQUE,
        };
        let frame = encode_command(Node::MAX, &command);
        assert_eq!(frame.payload(), [0xC0, 0xBD, 0xF0, 0xFF, 0x8F, 0xEF, 255]);
        assert_eq!(decode_command(&frame), Ok(RawCommand { cycle: 0xEF, ..command }));
    }

    #[test]
    fn halves_join_to_what_they_came_from_in_every_state() {
        for status_word in STATUS_WORDS {
            let raw = RawFeedback { status_word, ..raw() };
            let [motor, table] = encode_feedback(Node::MAX, &raw);
            let halves = (decode_motor(&motor), decode_table(&table));
            let (Ok(motor), Ok(table)) = halves else { panic!("{halves:?}") };
            assert_eq!(join(motor, table, raw.board_time_us), raw);
        }
    }

    #[test]
    fn a_current_beyond_the_range_travels_as_the_end_of_it() {
        for (current_ua, expected_ua) in [(i32::MAX, 32_767_000), (i32::MIN, -32_768_000), (1_499, 1_000)] {
            let [motor, table] = encode_feedback(Node::MAX, &RawFeedback { current_ua, ..raw() });
            let (motor, table) = (decode_motor(&motor).unwrap(), decode_table(&table).unwrap());
            assert_eq!(join(motor, table, 0).current_ua, expected_ua);
        }
    }

    #[test]
    fn another_length_is_refused() {
        let seven = Frame::classic(Address::Feedback(Node::MAX).id(), [0; 7]);
        assert_eq!(decode_motor(&seven), Err(Malformed::Length { got: 7, expected: 8 }));
        assert_eq!(decode_table(&seven), Err(Malformed::Length { got: 7, expected: 8 }));
        let eight = Frame::classic(Address::Command(Node::MAX).id(), [0; 8]);
        assert_eq!(decode_command(&eight), Err(Malformed::Length { got: 8, expected: 7 }));
    }
}
