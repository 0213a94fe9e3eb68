//! The layout of a log: one message per cycle on the topic [`TOPIC`], one nested message per axis. The other
//! topic, of what cycles were told, is [`super::input`]'s.
//!
//! The two tables below are the only list of fields. Schema text, encoder, decoder and the header
//! line of a CSV export all follow from them. A row reads
//! `name: wire type [unit] = place in the record, "meaning";` and the name ends in the unit.
//!
//! Invariant: a field is described exactly once. Changing a row changes [`VERSION`].

use crate::base::axis::{AXES_MAX, PerAxis};
use crate::base::command::Limits;
use crate::base::fault::Fault;
use crate::base::record::{AxisRecord, BusState, CycleRecord, ModeTag, Refusal};
use crate::base::sample::Freshness;
use crate::base::time::Moment;
use crate::base::units::{Acceleration, Current, Position, Torque, Velocity};

use super::cdr::{Decoder, Sink, Wire};

/// Version of the log format: of the tables in this file and of the header's keys.
pub const VERSION: u32 = 6;
/// Where the cycles are.
pub const TOPIC: &str = "/cycle";
/// Name of their schema.
pub const SCHEMA_NAME: &str = "quadrant/msg/Cycle";
/// How the schema is written.
pub const SCHEMA_ENCODING: &str = "ros2msg";
/// How the messages are written.
pub const MESSAGE_ENCODING: &str = "cdr";

/// One number of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name, ending in the unit.
    pub name: &'static str,
    /// Type in the schema.
    pub wire: &'static str,
    /// Unit, or `-`.
    pub unit: &'static str,
    /// What it tells.
    pub meaning: &'static str,
}

/// A value of a record as the number that stands for it.
trait Cell: Sized {
    type Number: Wire;
    fn to_number(self) -> Self::Number;
    /// `None` when no value has this number.
    fn from_number(number: Self::Number) -> Option<Self>;
}

macro_rules! plain_cell {
    ($($kind:ty),+) => {$(
        impl Cell for $kind {
            type Number = $kind;
            fn to_number(self) -> $kind { self }
            fn from_number(number: $kind) -> Option<Self> { Some(number) }
        }
    )+};
}
plain_cell!(u8, u16, u32, u64, i32, bool);

macro_rules! cell {
    ($($kind:ty as $number:ty: $to:expr, $from:expr;)+) => {$(
        impl Cell for $kind {
            type Number = $number;
            fn to_number(self) -> $number { $to(self) }
            fn from_number(number: $number) -> Option<Self> { $from(number) }
        }
    )+};
}
cell! {
    Position as f64: Position::as_m, |number| Some(Position::m(number));
    Velocity as f64: Velocity::as_m_per_s, |number| Some(Velocity::m_per_s(number));
    Acceleration as f64: Acceleration::as_m_per_s2, |number| Some(Acceleration::m_per_s2(number));
    Torque as f64: Torque::as_nm, |number| Some(Torque::nm(number));
    Current as f64: Current::as_a, |number| Some(Current::a(number));
    Moment as i64: Moment::as_ns, |number| Some(Moment::ns(number));
    ModeTag as u8: |mode| mode as u8, ModeTag::from_number;
    Option<Fault> as u8: |fault: Self| fault.map_or(0, Fault::number), fault_from_number;
    Freshness as u8: |freshness| freshness as u8, freshness_from_number;
    BusState as u8: |state| state as u8, bus_state_from_number;
    Refusal as u8: |refusal| refusal as u8, refusal_from_number;
    Limits as u8: Limits::bits, |bits| Some(Limits::from_bits(bits)).filter(|limits| limits.bits() == bits);
}

fn fault_from_number(number: u8) -> Option<Option<Fault>> {
    if number == 0 { Some(None) } else { Fault::from_number(number).map(Some) }
}

fn freshness_from_number(number: u8) -> Option<Freshness> {
    [Freshness::Never, Freshness::Fresh, Freshness::Stale].into_iter().find(|known| *known as u8 == number)
}

fn bus_state_from_number(number: u8) -> Option<BusState> {
    use BusState::{BusOff, ErrorActive, ErrorPassive, ErrorWarning};
    [ErrorActive, ErrorWarning, ErrorPassive, BusOff].into_iter().find(|known| *known as u8 == number)
}

fn refusal_from_number(number: u8) -> Option<Refusal> {
    use Refusal::{Down, Full, None, Unknown};
    [None, Full, Down, Unknown].into_iter().find(|known| *known as u8 == number)
}

/// A message that no record of this version encodes to.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DecodeError {
    /// Not the byte order or the length of this version.
    #[error("message of {bytes} bytes is no cycle of {axes} axes")]
    Shape {
        /// Length of the message.
        bytes: usize,
        /// Axes of the log.
        axes: usize,
    },
    /// Not an input of this version.
    #[error("message of {bytes} bytes is no input of a cycle")]
    Input {
        /// Length of the message.
        bytes: usize,
    },
    /// A number that stands for nothing.
    #[error("field `{field}` holds {value}, which this version does not know")]
    Value {
        /// Name of the field.
        field: &'static str,
        /// What it holds.
        value: String,
    },
}

macro_rules! table {
    ($record:ident as $fields:ident, $put:ident, $take:ident {
        $($name:ident: $wire:ident [$unit:literal] = $($place:ident).+, $meaning:literal;)+
    }) => {
        /// The fields, in order of the message.
        pub const $fields: &[Field] = &[$(
            Field { name: stringify!($name), wire: <$wire as Wire>::NAME, unit: $unit, meaning: $meaning },
        )+];

        fn $put(record: &$record, sink: &mut impl Sink) {
            $(sink.put::<$wire>(Cell::to_number(record.$($place).+));)+
        }

        /// `Ok(None)` when the message ends too early.
        fn $take(record: &mut $record, source: &mut Decoder<'_>) -> Result<Option<()>, DecodeError> {
            $(
                let Some(number) = source.take::<$wire>() else { return Ok(None) };
                record.$($place).+ = Cell::from_number(number).ok_or_else(|| DecodeError::Value {
                    field: stringify!($name),
                    value: format!("{number:?}"),
                })?;
            )+
            Ok(Some(()))
        }
    };
}

table!(CycleRecord as CYCLE_FIELDS, put_cycle, take_cycle {
    cycle: u64 ["-"] = cycle, "number of the period on the grid since start; gaps are skipped or lost periods";
    scheduled_ns: i64 ["ns"] = timing.scheduled, "when the grid wanted the cycle to start, on the run's clock";
    awaited_ns: i64 ["ns"] = timing.awaited, "the place on the grid that the thread slept for, before scheduled if it overslept whole periods";
    woke_ns: i64 ["ns"] = timing.woke, "when it started, on the run's clock";
    collected_ns: i64 ["ns"] = timing.collected, "when it had received all it would";
    decided_ns: i64 ["ns"] = timing.decided, "when its commands stood";
    previous_finished_ns: i64 ["ns"] = timing.previous_finished, "when the cycle before had finished";
    overruns: u64 ["-"] = overruns, "periods skipped since start because a cycle came late";
    lost_records: u64 ["-"] = lost_records, "records lost since start because the ring was full or the disk refused";
    motion: u32 ["-"] = stage.motion, "number of the motion in this run, see the header; 0 before the first";
    is_measured: bool ["-"] = stage.is_measured, "1 in the evaluated part of the motion";
    bus_state: u8 ["-"] = bus.state, "own controller: 0 error active, 1 error warning, 2 error passive, 3 bus-off";
    sync_refusal: u8 ["-"] = bus.sync, "what became of SYNC: 0 taken, 1 no room, 2 bus down, 3 not known";
    sent_crc: u32 ["-"] = bus.sent_crc, "CRC-32 over identifier and payload of each frame given to the bus";
    bus_reports: u32 ["-"] = bus.reports, "reports of the own controller since start";
    foreign_frames: u32 ["-"] = bus.foreign, "frames since start that belong to no axis or that only a host sends";
    dropped_frames: u32 ["-"] = bus.dropped, "frames since start that came and were dropped because nobody took them";
});

table!(AxisRecord as AXIS_FIELDS, put_axis, take_axis {
    setpoint_position_m: f64 ["m"] = setpoint.position, "where the axis should be";
    setpoint_velocity_m_per_s: f64 ["m/s"] = setpoint.velocity, "how fast it should move there";
    setpoint_acceleration_m_per_s2: f64 ["m/s^2"] = setpoint.acceleration, "how its speed should change";
    sample_position_m: f64 ["m"] = sample.position, "motor encoder in travel of the axis";
    sample_velocity_m_per_s: f64 ["m/s"] = sample.velocity, "velocity as the velocity loop sees it";
    sample_table_position_m: f64 ["m"] = sample.table_position, "table scale; NaN where there is none";
    sample_current_a: f64 ["A"] = sample.current, "motor current";
    command_current_a: f64 ["A"] = command.current, "current asked of the drive";
    following_error_m: f64 ["m"] = command.terms.following_error, "setpoint minus motor position";
    expected_position_m: f64 ["m"] = command.terms.expected_position, "where the axis would be without friction";
    expected_velocity_m_per_s: f64 ["m/s"] = command.terms.expected_velocity, "velocity of that response, without the excitation";
    velocity_command_m_per_s: f64 ["m/s"] = command.terms.velocity_command, "output of the position loop";
    excitation_m_per_s: f64 ["m/s"] = command.terms.excitation, "added to it in an excited motion";
    proportional_nm: f64 ["N m"] = command.terms.proportional, "proportional part of the velocity loop";
    integral_nm: f64 ["N m"] = command.terms.integral, "integral part of the velocity loop";
    friction_nm: f64 ["N m"] = command.terms.friction, "feed-forward of the friction law";
    inertia_nm: f64 ["N m"] = command.terms.inertia, "feed-forward of the moved inertia";
    motor_arrived_ns: i64 ["ns"] = arrivals.motor.at, "when the last fresh sample came, on the run's clock; classic CAN: its frame of the motor";
    table_arrived_ns: i64 ["ns"] = arrivals.table.at, "the same; classic CAN: its frame of the table";
    age_cycles: u32 ["cycles"] = sample.age_cycles, "cycles since the last fresh sample";
    raw_motor_counts: u32 ["counts"] = sample.raw.motor_counts, "motor encoder as received, wraps at 2^32";
    raw_table_counts: u32 ["counts"] = sample.raw.table_counts, "table scale as received, wraps at 2^32";
    raw_current_ua: i32 ["uA"] = sample.raw.current_ua, "motor current as received";
    raw_board_time_us: u32 ["us"] = sample.raw.board_time_us, "board clock at the latch, wraps at 2^32";
    fresh_frames: u32 ["-"] = link.fresh, "feedback used, since start";
    missed_frames: u32 ["-"] = link.missed, "cycles without fresh feedback, since start";
    late_frames: u32 ["-"] = link.late, "feedback that answered another cycle, since start";
    repeated_frames: u32 ["-"] = link.repeated, "feedback that had been there before, since start";
    malformed_frames: u32 ["-"] = link.malformed, "frames that could not be read, since start";
    heartbeats: u32 ["-"] = link.heartbeats, "heartbeats of the board since start";
    emergencies: u32 ["-"] = link.emergencies, "emergencies of the board since start";
    resets: u32 ["-"] = link.resets, "restarts of the board since start";
    raw_answers_cycle: u16 ["-"] = sample.raw.answers_cycle, "low 16 bits of the number of the SYNC answered";
    raw_status_word: u16 ["-"] = sample.raw.status_word, "CiA 402 status word (object 6041h)";
    control_word: u16 ["-"] = command.control_word, "CiA 402 control word (object 6040h)";
    command_refusal: u8 ["-"] = refusal, "what became of the command: 0 taken, 1 no room, 2 bus down, 3 not known";
    raw_sequence: u8 ["-"] = sample.raw.sequence, "counts feedback frames, wraps at 256";
    raw_board_flags: u8 ["-"] = sample.raw.board_flags, "flags of the board";
    motor_place: u8 ["-"] = arrivals.motor.place, "how many frames that cycle had received before it; classic CAN: before its frame of the motor";
    table_place: u8 ["-"] = arrivals.table.place, "the same; classic CAN: before its frame of the table";
    freshness: u8 ["-"] = sample.freshness, "0 never heard, 1 fresh, 2 stale";
    mode: u8 ["-"] = mode, "0 off, 1 enabling, 2 ready, 3 moving, 4 stopping, 5 faulted, 6 not known";
    fault: u8 ["-"] = fault, "number of the fault, 0 none, or not known with the mode; see docs/faults";
    gain_set: u8 ["-"] = gain_set, "which gain set acts, by its place in the machine file; 255 not known";
    limits: u8 ["-"] = command.limits, "bits: 1 travel, 2 velocity, 4 acceleration, 8 current, 16 drive";
});

/// Hands every value of `record` to `sink`, in order of the message.
pub(super) fn put(record: &CycleRecord, sink: &mut impl Sink) {
    put_cycle(record, sink);
    for axis in record.axes.as_slice() {
        put_axis(axis, sink);
    }
}

/// The first field in which two records differ to the bit, named as in a table, and both values as text.
pub fn difference(
    one: &CycleRecord,
    other: &CycleRecord,
    axes: &[String],
) -> Option<(String, String, String)> {
    let [mut bytes, mut other_bytes] = [(); 2].map(|()| super::cdr::Encoder::default());
    bytes.restart();
    other_bytes.restart();
    put(one, &mut bytes);
    put(other, &mut other_bytes);
    if bytes.bytes() == other_bytes.bytes() {
        return None;
    }
    let [mut cells, mut other_cells] = [(); 2].map(|()| Cells::default());
    put(one, &mut cells);
    put(other, &mut other_cells);
    let pairs = cells.0.into_iter().zip(other_cells.0);
    let differs = columns(axes).into_iter().zip(pairs).filter(|(_, (one, other))| one.0 != other.0);
    // The checksum follows from the rest; alone it tells that the encoding differs.
    let (column, (one, other)) = differs.min_by_key(|(column, _)| column == SENT_CRC)?;
    Some((column, one.1, other.1))
}

/// Name of the checksum over what was sent.
const SENT_CRC: &str = "sent_crc";

/// The bytes of each value, and its text.
#[derive(Default)]
struct Cells(Vec<(Vec<u8>, String)>);

impl Sink for Cells {
    fn put<W: Wire>(&mut self, value: W) {
        let (mut bytes, mut text) = (Vec::new(), Vec::new());
        value.append(&mut bytes);
        value.append_text(&mut text);
        self.0.push((bytes, String::from_utf8_lossy(&text).into_owned()));
    }
}

/// The record of `axes` axes that a message holds.
pub(super) fn decode(message: &[u8], axes: usize) -> Result<CycleRecord, DecodeError> {
    let shape = || DecodeError::Shape { bytes: message.len(), axes };
    let mut source = Decoder::new(message).ok_or_else(shape)?;
    let mut record = CycleRecord::empty(axes);
    take_cycle(&mut record, &mut source)?.ok_or_else(shape)?;
    for axis in record.axes.as_mut_slice() {
        take_axis(axis, &mut source)?.ok_or_else(shape)?;
    }
    if source.is_at_end() { Ok(record) } else { Err(shape()) }
}

/// How many axes a message of this length has, if any.
pub(super) fn axes_of(message_bytes: usize) -> Option<usize> {
    (1..=AXES_MAX).find(|axes| {
        let mut encoder = super::cdr::Encoder::default();
        encoder.restart();
        put(
            &CycleRecord { axes: PerAxis::filled(*axes, AxisRecord::default()), ..CycleRecord::empty(*axes) },
            &mut encoder,
        );
        encoder.bytes().len() == message_bytes
    })
}

/// The schema of a machine with these axes, as `ros2msg` text.
pub fn text(axes: &[String]) -> String {
    let mut text = String::from("# One cycle of the machine: what it read, computed and sent.\n");
    CYCLE_FIELDS.iter().for_each(|field| text.push_str(&line(field)));
    for axis in axes {
        text.push_str(&format!("quadrant/Axis {axis}\n"));
    }
    text.push_str(&"=".repeat(80));
    text.push_str("\nMSG: quadrant/Axis\n# One axis in one cycle. Positions are travel of the axis.\n");
    AXIS_FIELDS.iter().for_each(|field| text.push_str(&line(field)));
    text
}

fn line(field: &Field) -> String {
    format!("{} {}  # [{}] {}\n", field.wire, field.name, field.unit, field.meaning)
}

/// Name of every column of a record, in order: `cycle`, ..., `x.setpoint_position_m`, ...
pub fn columns(axes: &[String]) -> Vec<String> {
    let cycle = CYCLE_FIELDS.iter().map(|field| field.name.to_owned());
    let axis =
        axes.iter().flat_map(|axis| AXIS_FIELDS.iter().map(move |field| format!("{axis}.{}", field.name)));
    cycle.chain(axis).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::cdr::Encoder;

    fn axis_names() -> Vec<String> {
        vec!["x".to_owned(), "y".to_owned()]
    }

    #[test]
    fn a_field_of_a_dimension_ends_in_its_unit() {
        let suffixes = [
            ("m", "_m"),
            ("m/s", "_m_per_s"),
            ("m/s^2", "_m_per_s2"),
            ("A", "_a"),
            ("N m", "_nm"),
            ("ns", "_ns"),
            ("us", "_us"),
            ("uA", "_ua"),
            ("counts", "_counts"),
            ("cycles", "_cycles"),
            ("-", ""),
        ];
        for field in CYCLE_FIELDS.iter().chain(AXIS_FIELDS) {
            let (_, suffix) = suffixes.iter().find(|(unit, _)| *unit == field.unit).unwrap();
            assert!(field.name.ends_with(suffix), "{} is in {}", field.name, field.unit);
        }
    }

    #[test]
    fn the_text_describes_every_column_once() {
        let text = text(&axis_names());
        for field in CYCLE_FIELDS.iter().chain(AXIS_FIELDS) {
            let declared = format!("{} {}  # [", field.wire, field.name);
            assert_eq!(text.matches(&declared).count(), 1, "{declared}");
        }
        assert_eq!(columns(&axis_names()).len(), CYCLE_FIELDS.len() + 2 * AXIS_FIELDS.len());
    }

    #[test]
    fn the_length_of_a_message_tells_its_axes() {
        for axes in 1..=AXES_MAX {
            let mut encoder = Encoder::default();
            encoder.restart();
            put(&CycleRecord::empty(axes), &mut encoder);
            assert_eq!(axes_of(encoder.bytes().len()), Some(axes));
            assert_eq!(axes_of(encoder.bytes().len() + 1), None);
        }
    }

    #[test]
    fn an_unknown_number_is_refused_by_the_name_of_its_field() {
        let mut encoder = Encoder::default();
        encoder.restart();
        put(&CycleRecord::empty(1), &mut encoder);
        let mut message = encoder.bytes().to_vec();
        assert!(matches!(decode(&message, 2), Err(DecodeError::Shape { axes: 2, .. })));
        assert!(matches!(decode(&message[..40], 1), Err(DecodeError::Shape { bytes: 40, axes: 1 })));
        let fault = message.len() - 3; // last four: mode, fault, gain set, limits
        message[fault] = 99;
        let error = decode(&message, 1).unwrap_err();
        assert_eq!(error, DecodeError::Value { field: "fault", value: "99".to_owned() });
    }
}
