//! The second topic of a log, [`TOPIC`]: what a cycle was told beside the feedback in its record, one message
//! per order or frame, ahead of the record of its cycle. They are rare: heartbeats, orders, trouble.
//!
//! Invariant: an input read is bit for bit the input written.

use crate::base::axis::{AXES_MAX, AxisId, PerAxis};
use crate::base::frame::{Format, Frame, Id, Received};
use crate::base::input::{Input, What};
use crate::base::motion::{Circle, Direction};
use crate::base::order::{CircleMotion, Excitation, ExcitedMotion, LineMotion, Order};
use crate::base::time::{Moment, Span};
use crate::base::units::{Acceleration, Position, Velocity};

use super::cdr::{Decoder, Sink};
use super::schema::DecodeError;

/// Where the inputs are.
pub const TOPIC: &str = "/input";
/// Name of their schema.
pub const SCHEMA_NAME: &str = "quadrant/msg/Input";
/// The schema, as `ros2msg` text.
pub const SCHEMA: &str = "\
# What a cycle was told, beside the feedback that stands in its record.
uint64 cycle  # [-] number of the cycle that took it
int64 at_ns  # [ns] frame: when it came, on the run's clock
uint64[8] payload  # [-] frame: its bytes, the first is the lowest of the first word
float64[16] values  # [-] order: line: axes, target in m (3), feed in m/s, acceleration in m/s^2; circle: centre in m (2), radius in m, feed in m/s, sign of rotation, start angle in rad, revolutions, run-in in s, run-out in s, acceleration in m/s^2; excited: as line, then axis, amplitude in m/s, period in ns, lowest and highest harmonic, lines, repeats; use-gains: number of the set
uint16 identifier  # [-] frame: identifier, of a report the error classes
uint8 kind  # [-] 0 frame, 1 enable, 2 disable, 3 stop, 4 clear-faults, 5 use-gains, 6 line, 7 circle, 8 heartbeat before the first cycle, 9 excited
uint8 place  # [-] frame: how many frames the cycle had received before it
uint8 format  # [-] frame: 0 classic, 1 FD, 2 FD with bit rate switch, 3 report of the own controller
uint8 length  # [-] frame: bytes of its payload
";

/// Length of a message in bytes.
pub(super) const MESSAGE_BYTES: usize = 4 + 2 * 8 + 8 * 8 + 16 * 8 + 2 + 4;

/// Kind of a frame that was heard before the first cycle.
const BEFORE: u8 = 8;
const WORDS: usize = 8;
const VALUES: usize = 16;
/// How many of them a line takes: axes, targets, feed, acceleration.
const LINE_VALUES: usize = 3 + AXES_MAX;

/// An input as numbers.
#[derive(Default)]
struct Row {
    at_ns: i64,
    words: [u64; WORDS],
    values: [f64; VALUES],
    identifier: u16,
    kind: u8,
    place: u8,
    format: u8,
    length: u8,
}

impl Row {
    fn of(what: &What) -> Self {
        match what {
            What::Frame { place, received } => Self::of_frame(*place, received),
            What::Before(received) => Self { kind: BEFORE, ..Self::of_frame(0, received) },
            What::Order(order) => Self::of_order(order),
        }
    }

    fn of_frame(place: u8, received: &Received) -> Self {
        let frame = &received.frame;
        let mut words = [0; WORDS];
        for (word, bytes) in words.iter_mut().zip(frame.payload().chunks(8)) {
            let mut whole = [0; 8];
            whole[..bytes.len()].copy_from_slice(bytes);
            *word = u64::from_le_bytes(whole);
        }
        let format = match frame.format() {
            Format::Classic => 0,
            Format::Fd { bit_rate_switch } => 1 + u8::from(bit_rate_switch),
            Format::Report => 3,
        };
        Self {
            at_ns: received.at.as_ns(),
            words,
            identifier: frame.id().raw(),
            place,
            format,
            length: frame.length() as u8,
            ..Self::default()
        }
    }

    fn of_order(order: &Order) -> Self {
        let mut values = [0.0; VALUES];
        let kind = match order {
            Order::Enable => 1,
            Order::Disable => 2,
            Order::Stop => 3,
            Order::ClearFaults => 4,
            Order::UseGains(set) => {
                values[0] = f64::from(*set);
                5
            }
            Order::Line(line) => {
                put_line(line, &mut values);
                6
            }
            Order::Circle(CircleMotion { circle, run_in_s, run_out_s, acceleration }) => {
                let numbers = [
                    circle.centre_x.as_m(),
                    circle.centre_y.as_m(),
                    circle.radius.as_m(),
                    circle.feed.as_m_per_s(),
                    circle.direction.sign(),
                    circle.start_angle_rad,
                    f64::from(circle.revolutions),
                    *run_in_s,
                    *run_out_s,
                    acceleration.as_m_per_s2(),
                ];
                values[..numbers.len()].copy_from_slice(&numbers);
                7
            }
            Order::Excited(ExcitedMotion { line, excitation }) => {
                put_line(line, &mut values);
                let numbers = [
                    excitation.axis.index() as f64,
                    excitation.amplitude.as_m_per_s(),
                    excitation.period.as_ns() as f64,
                    f64::from(excitation.harmonic_min),
                    f64::from(excitation.harmonic_max),
                    f64::from(excitation.lines),
                    f64::from(excitation.repeats),
                ];
                values[LINE_VALUES..LINE_VALUES + numbers.len()].copy_from_slice(&numbers);
                9
            }
        };
        Self { kind, values, ..Self::default() }
    }

    fn what(&self) -> Option<What> {
        match self.kind {
            0 => self.received().map(|received| What::Frame { place: self.place, received }),
            BEFORE => self.received().map(What::Before),
            _ => self.order().map(What::Order),
        }
    }

    fn received(&self) -> Option<Received> {
        let format = match self.format {
            0 => Format::Classic,
            1 | 2 => Format::Fd { bit_rate_switch: self.format == 2 },
            3 => Format::Report,
            _ => return None,
        };
        let bytes: Vec<u8> = self.words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let payload = bytes.get(..usize::from(self.length))?;
        let frame = Frame::from_slice(Id::new(self.identifier)?, format, payload)?;
        Some(Received { frame, at: Moment::ns(self.at_ns) })
    }

    fn order(&self) -> Option<Order> {
        let value = |place: usize| self.values[place];
        Some(match self.kind {
            1 => Order::Enable,
            2 => Order::Disable,
            3 => Order::Stop,
            4 => Order::ClearFaults,
            5 => Order::UseGains(value(0) as u8),
            6 => Order::Line(self.line()?),
            7 => Order::Circle(CircleMotion {
                circle: Circle {
                    centre_x: Position::m(value(0)),
                    centre_y: Position::m(value(1)),
                    radius: Position::m(value(2)),
                    feed: Velocity::m_per_s(value(3)),
                    direction: if value(4) < 0.0 { Direction::Cw } else { Direction::Ccw },
                    start_angle_rad: value(5),
                    revolutions: value(6) as u32,
                },
                run_in_s: value(7),
                run_out_s: value(8),
                acceleration: Acceleration::m_per_s2(value(9)),
            }),
            9 => {
                let line = self.line()?;
                let value = |place: usize| self.values[LINE_VALUES + place];
                let axis = AxisId::new(Some(value(0) as usize).filter(|axis| *axis < AXES_MAX)?);
                Order::Excited(ExcitedMotion {
                    line,
                    excitation: Excitation {
                        axis,
                        amplitude: Velocity::m_per_s(value(1)),
                        period: Span::ns(value(2) as i64),
                        harmonic_min: value(3) as u32,
                        harmonic_max: value(4) as u32,
                        lines: value(5) as u8,
                        repeats: value(6) as u32,
                    },
                })
            }
            _ => return None,
        })
    }

    fn line(&self) -> Option<LineMotion> {
        let axes = self.values[0] as usize;
        if !(1..=AXES_MAX).contains(&axes) {
            return None;
        }
        let mut target = PerAxis::filled(axes, Position::ZERO);
        for (slot, m) in target.as_mut_slice().iter_mut().zip(&self.values[1..]) {
            *slot = Position::m(*m);
        }
        Some(LineMotion {
            target,
            feed: Velocity::m_per_s(self.values[1 + AXES_MAX]),
            acceleration: Acceleration::m_per_s2(self.values[2 + AXES_MAX]),
        })
    }
}

fn put_line(line: &LineMotion, values: &mut [f64; VALUES]) {
    values[0] = line.target.count() as f64;
    for (value, target) in values[1..].iter_mut().zip(line.target.as_slice()) {
        *value = target.as_m();
    }
    values[1 + AXES_MAX] = line.feed.as_m_per_s();
    values[2 + AXES_MAX] = line.acceleration.as_m_per_s2();
}

/// Hands the numbers of `input` to `sink`, in order of the message.
pub(super) fn put(input: &Input, sink: &mut impl Sink) {
    let row = Row::of(&input.what);
    sink.put(input.cycle);
    sink.put(row.at_ns);
    row.words.into_iter().for_each(|word| sink.put(word));
    row.values.into_iter().for_each(|value| sink.put(value));
    sink.put(row.identifier);
    [row.kind, row.place, row.format, row.length].into_iter().for_each(|byte| sink.put(byte));
}

/// The input that a message holds.
pub(super) fn decode(message: &[u8]) -> Result<Input, DecodeError> {
    let shape = || DecodeError::Input { bytes: message.len() };
    let (cycle, row) = take(message).ok_or_else(shape)?;
    let what = row.what().ok_or_else(|| DecodeError::Value {
        field: "kind",
        value: format!("{} with format {} and length {}", row.kind, row.format, row.length),
    })?;
    Ok(Input { cycle, what })
}

fn take(message: &[u8]) -> Option<(u64, Row)> {
    let mut source = Decoder::new(message)?;
    let cycle = source.take()?;
    let mut row = Row { at_ns: source.take()?, ..Row::default() };
    for word in &mut row.words {
        *word = source.take()?;
    }
    for value in &mut row.values {
        *value = source.take()?;
    }
    row.identifier = source.take()?;
    for byte in [&mut row.kind, &mut row.place, &mut row.format, &mut row.length] {
        *byte = source.take()?;
    }
    source.is_at_end().then_some((cycle, row))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::log::cdr::Encoder;

    /// One of each kind.
    pub(in crate::log) fn examples() -> Vec<Input> {
        let circle = CircleMotion {
            circle: Circle {
                centre_x: Position::m(0.1),
                centre_y: Position::m(-0.2),
                radius: Position::m(1.0 / 3.0),
                feed: Velocity::m_per_s(0.03),
                direction: Direction::Cw,
                start_angle_rad: 0.7,
                revolutions: 3,
            },
            run_in_s: 0.25,
            run_out_s: f64::MIN_POSITIVE,
            acceleration: Acceleration::m_per_s2(0.5),
        };
        let mut target = PerAxis::filled(2, Position::ZERO);
        target.as_mut_slice().copy_from_slice(&[Position::m(0.1), Position::m(-1e-9)]);
        let line = LineMotion { target, feed: circle.circle.feed, acceleration: circle.acceleration };
        let excitation = Excitation {
            axis: AxisId::Y,
            amplitude: Velocity::m_per_s(0.1 / 3.0),
            period: Span::ns(999_999_500),
            harmonic_min: 4,
            harmonic_max: u32::MAX,
            lines: 255,
            repeats: 7,
        };
        let orders = [
            Order::Enable,
            Order::Disable,
            Order::Stop,
            Order::ClearFaults,
            Order::UseGains(255),
            Order::Line(line),
            Order::Circle(circle),
            Order::Excited(ExcitedMotion { line, excitation }),
        ];
        let id = Id::from_low_bits(0x701);
        let every_byte = std::array::from_fn::<u8, 64, _>(|byte| 255 - byte as u8);
        let frames = [
            Frame::classic(id, []),
            Frame::classic(id, [1, 2, 3]),
            Frame::fd(id, every_byte),
            Frame::report(id, [9; 8]),
        ];
        let orders = orders.into_iter().map(What::Order);
        let frames = frames
            .into_iter()
            .map(|frame| What::Frame { place: 7, received: Received { frame, at: Moment::ns(-5) } });
        let before = Received { frame: Frame::classic(id, [5; 8]), at: Moment::ns(9) };
        orders
            .chain(frames)
            .chain([What::Before(before)])
            .zip(1_u64 << 40..)
            .map(|(what, cycle)| Input { cycle, what })
            .collect()
    }

    #[test]
    fn every_input_comes_back_and_has_the_one_length() {
        for input in examples() {
            let mut encoder = Encoder::default();
            encoder.restart();
            put(&input, &mut encoder);
            assert_eq!(encoder.bytes().len(), MESSAGE_BYTES);
            assert_eq!(decode(encoder.bytes()), Ok(input));
            assert!(decode(&encoder.bytes()[..MESSAGE_BYTES - 1]).is_err());
        }
    }

    #[test]
    fn an_unknown_kind_is_refused_by_name() {
        let mut encoder = Encoder::default();
        encoder.restart();
        put(&examples()[0], &mut encoder);
        let mut message = encoder.bytes().to_vec();
        message[MESSAGE_BYTES - 4] = 10;
        let refusal = decode(&message).unwrap_err().to_string();
        assert!(refusal.contains("`kind` holds 10"), "{refusal}");
    }
}
