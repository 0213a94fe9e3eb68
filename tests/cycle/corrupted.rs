//! Promise: what one wrong bit does, in any field of any frame, is what `docs/integrity.md` says. The bus's own
//! checksum may have let it through, or it came about behind it, in a board, an adapter or a driver.

use std::ops::Range;

use quadrant::base::fault::Fault;
use quadrant::base::time::Moment;
use quadrant::rt::bus::{Bus, Frame, Id, Received, SendError};
use quadrant::rt::drive::commission::CommissionError;
use quadrant::rt::wire::state::{Emergency, encode_emergency};
use quadrant::rt::wire::{Address, command, feedback};
use quadrant::sim::board::{Board, Measured};
use quadrant::sim::closed_loop::{Wired, commission};
use rstest::rstest;

/// What came of a run.
#[derive(Clone, Debug)]
struct Course {
    /// The first fault of X.
    fault: Option<Fault>,
    /// Frames of X that could not be used, and cycles without a sample of it.
    unusable: u32,
    missed: u32,
    /// Where a perfect encoder had its motor, um, cycle by cycle.
    positions_um: Vec<f64>,
    /// Highest current that its drive gave, A.
    current_a: f64,
}

impl Course {
    /// Furthest from where another run was, um.
    fn off_um(&self, other: &Self) -> f64 {
        let pairs = self.positions_um.iter().zip(&other.positions_um);
        pairs.map(|(one, other)| (one - other).abs()).fold(0.0, f64::max)
    }
}

/// Holds position, or moves at 30 mm/s, for 0.2 s; then one frame with this identifier is changed, to the host or
/// from it; and 0.3 s more, in which there is a heartbeat at least.
fn run(name: &str, is_moving: bool, id: u16, change: impl Fn(&mut Frame) + 'static) -> Course {
    let mut rig = Rig::new(machine(name), 3);
    rig.enable();
    if is_moving {
        rig.order(rig.line_to(50.0, 30.0));
    }
    rig.run(400);
    let before = rig.axis(X).link;
    let mut is_armed = true;
    let mut pass = move |frame: &mut Frame| {
        if frame.id().raw() == id && std::mem::take(&mut is_armed) {
            change(frame);
        }
        Fate::Pass
    };
    if id & 0x780 == 0x200 {
        rig.line.outgoing = Box::new(pass);
    } else {
        rig.line.incoming = Box::new(move |frame| pass(frame));
    }
    let mut course = Course { fault: None, unusable: 0, missed: 0, positions_um: Vec::new(), current_a: 0.0 };
    for _ in 0..600 {
        rig.step();
        course.fault = course.fault.or(rig.axis(X).fault);
        let truth = rig.line.wired.rack().truths()[X];
        course.positions_um.push(truth.position.as_um());
        course.current_a = course.current_a.max(truth.current.as_a().abs());
    }
    let after = rig.axis(X).link;
    course.unusable =
        after.late + after.repeated + after.malformed - before.late - before.repeated - before.malformed;
    course.missed = after.missed - before.missed;
    course
}

/// A part of a frame, and what comes of each of its bits.
struct Part {
    name: &'static str,
    bits: Range<usize>,
    comes: Comes,
}

#[derive(Clone, Copy, Debug)]
enum Comes {
    /// Nothing: the value is used, or not looked at.
    Nothing,
    /// The frame is not used, or the next one: one sample less.
    OneLess,
    /// This fault.
    A(Fault),
    /// This fault while the axis moves; nothing while it stands.
    Moving(Fault),
}

const fn part(name: &'static str, bits: Range<usize>, comes: Comes) -> Part {
    Part { name, bits, comes }
}

/// Each bit of the parts of a frame; the furthest that the axis was moved by one that no fault came of.
fn check(name: &str, id: u16, bits: usize, parts: &[Part]) -> f64 {
    let covered: Vec<usize> = parts.iter().flat_map(|part| part.bits.clone()).collect();
    assert_eq!(covered, (0..bits).collect::<Vec<_>>(), "{name} {id:03x}: each bit once");
    let mut off_um: f64 = 0.0;
    for is_moving in [false, true] {
        let clean = run(name, is_moving, 0x7FF, |_| ());
        assert_eq!((clean.fault, clean.missed, clean.unusable), (None, 0, 0));
        for Part { name: part, bits, comes } in parts {
            for bit in bits.clone() {
                let course = run(name, is_moving, id, move |frame| *frame = frame.with_flipped_bit(bit));
                let at = format!("{name} {id:03x}, {part}, bit {bit}, moving {is_moving}");
                let expected = match comes {
                    Comes::A(fault) => Some(*fault),
                    Comes::Moving(fault) => Some(*fault).filter(|_| is_moving),
                    Comes::Nothing | Comes::OneLess => None,
                };
                assert_eq!(course.fault, expected, "{at}");
                if expected.is_none() {
                    let lost = u32::from(matches!(comes, Comes::OneLess));
                    assert_eq!((course.missed, course.unusable), (lost, lost), "{at}");
                    off_um = off_um.max(course.off_um(&clean));
                }
            }
        }
    }
    off_um
}

use Comes::{A, Moving, Nothing, OneLess};

use crate::common::{Fate, Rig, X, machine};

/// The lowest bit of the sequence makes it that of the frame before, or of the one behind, which then is not used.
#[test]
fn each_field_of_a_feedback() {
    let off_um = check(
        "reference",
        0x181,
        8 * feedback::LENGTH,
        &[
            part("motor encoder, to 1.2 um", 0..8, Nothing),
            part("motor encoder, from 2.4 um", 8..32, A(Fault::EncoderJump)),
            part("table scale", 32..64, Nothing),
            part("current, to 17 A", 64..89, Nothing),
            part("current, from 34 A", 89..96, A(Fault::Overcurrent)),
            part("board time, to 64 us", 96..103, Nothing),
            part("board time, to 256 us", 103..105, Moving(Fault::EncoderJump)),
            part("board time, from 512 us", 105..128, A(Fault::BoardReset)),
            part("cycle", 128..144, OneLess),
            part("state: not ready, not on, not enabled", 144..147, A(Fault::DriveDropped)),
            part("state: fault", 147..148, A(Fault::DriveFault)),
            part("voltage enabled", 148..149, Nothing),
            part("state: quick stop, disabled", 149..151, A(Fault::DriveDropped)),
            part("status bits that tell no state", 151..160, Nothing),
            part("sequence, lowest bit", 160..161, OneLess),
            part("sequence", 161..168, Nothing),
            part("flag: watchdog", 168..169, A(Fault::BoardWatchdog)),
            part("flags: stale command, saturated", 169..171, Nothing),
            part("flag: encoder error", 171..172, A(Fault::EncoderJump)),
            part("flags: table scale, none", 172..176, Nothing),
            part("reserved", 176..192, Nothing),
        ],
    );
    println!("feedback: moved by {off_um:.3} um at most");
    assert!(off_um < 0.4, "{off_um} um");
}

#[test]
fn each_field_of_a_feedback_in_two_frames() {
    let motor_um = check(
        "classic",
        0x181,
        64,
        &[
            part("motor encoder, to 4.9 um", 0..10, Nothing),
            part("motor encoder, from 9.8 um", 10..32, A(Fault::EncoderJump)),
            part("current, to 16 A", 32..47, Nothing),
            part("current, its sign", 47..48, A(Fault::Overcurrent)),
            part("cycle", 48..64, OneLess),
        ],
    );
    let table_um = check(
        "classic",
        0x281,
        64,
        &[
            part("table scale", 0..32, Nothing),
            part("board time, to 256 us", 32..41, Nothing),
            part("board time, 512 us", 41..42, Moving(Fault::EncoderJump)),
            part("board time, from 1024 us", 42..48, A(Fault::BoardReset)),
            part("cycle", 48..56, OneLess),
            part("flag: watchdog", 56..57, A(Fault::BoardWatchdog)),
            part("flags: stale command, saturated", 57..59, Nothing),
            part("flag: encoder error", 59..60, A(Fault::EncoderJump)),
            part("flag: table scale", 60..61, Nothing),
            part("state", 61..62, A(Fault::DriveDropped)),
            part("state", 62..63, A(Fault::DriveFault)),
            part("state", 63..64, A(Fault::DriveDropped)),
        ],
    );
    println!("feedback in two frames: moved by {motor_um:.3} um and {table_um:.3} um at most");
    assert!(motor_um < 0.95 && table_um < 4.4, "{motor_um} um, {table_um} um");
}

/// A wrong current is given for one period, up to the drive's peak, and then it is the right one again.
#[rstest]
#[case("reference", 11.0)]
#[case("classic", 31.0)]
fn each_field_of_a_command(#[case] name: &str, #[case] most_um: f64) {
    let control = [
        part("current", 0..32, Nothing),
        part("control: enable", 32..36, A(Fault::DriveDropped)),
        part("control: fault reset, none", 36..40, Nothing),
    ];
    let rest = match name {
        "reference" => {
            let bits = command::LENGTH * 8;
            [part("control, cycle, sequence, mode, reserved", 40..bits, Nothing)]
        }
        _ => [part("cycle, sequence", 40..56, Nothing)],
    };
    let bits = rest[0].bits.end;
    let parts: Vec<Part> = control.into_iter().chain(rest).collect();
    let off_um = check(name, 0x201, bits, &parts);
    println!("{name}, command: moved by {off_um:.1} um at most");
    assert!(off_um < most_um, "{off_um} um");
    let peak_a = f64::from(machine(name).axes[X].sheet.peak_current_ma) * 1e-3;
    let wrong = run(name, true, 0x201, |frame| *frame = frame.with_flipped_bit(30));
    assert!((wrong.current_a - peak_a).abs() < 1e-9, "{} A, peak {peak_a} A", wrong.current_a);
}

#[rstest]
fn each_field_of_a_heartbeat_and_an_emergency(#[values("reference", "classic")] name: &str) {
    check(
        name,
        0x701,
        32,
        &[
            part("state", 0..8, Nothing),
            part("reset count", 8..16, A(Fault::BoardReset)),
            part("seconds since boot", 16..32, A(Fault::BoardReset)),
        ],
    );
    // An emergency in the place of a heartbeat: that an error is gone, and which came.
    for code in [Emergency::CODE_NONE, Emergency::CODE_OVERCURRENT] {
        for bit in 0..64 {
            let node = machine(name).axes[X].node;
            let course = run(name, false, 0x701, move |frame| {
                let emergency = Emergency { code, ..Emergency::default() };
                *frame = encode_emergency(node, &emergency).with_flipped_bit(bit);
            });
            let is_error = code != Emergency::CODE_NONE || bit < 16;
            assert_eq!(course.fault, is_error.then_some(Fault::DriveFault), "{name}, {code:04x}, bit {bit}");
        }
    }
}

/// A frame under a wrong identifier is not that of its sender, and seldom that of another.
#[rstest]
fn each_bit_of_an_identifier(#[values("reference", "classic")] name: &str) {
    for bit in 0..11 {
        let course = run(name, false, 0x181, move |frame| {
            let id = Id::from_low_bits(frame.id().raw() ^ 1 << bit);
            *frame = Frame::from_slice(id, frame.format(), frame.payload()).expect("as long as it was");
        });
        assert!(course.missed >= 1, "{name}, bit {bit}: it was used");
        // 081h is the emergency of the same board, which on classic CAN is as long as its feedback.
        let is_emergency = bit == 8 && name == "classic";
        assert_eq!(course.fault, is_emergency.then_some(Fault::DriveFault), "{name}, bit {bit}");
    }
}

#[test]
fn each_bit_of_sync() {
    let machine = machine("reference");
    let axis = &machine.axes[X];
    let answered = |cycle: u32| {
        let counts = quadrant::rt::wire::scaling::EncoderCounts::counts(0);
        let mut board =
            Board::new(axis.node, machine.bus.layout, axis.sheet, 0, counts, counts, Moment::ZERO);
        board.latch(cycle, Measured::default(), Moment::ZERO);
        std::iter::from_fn(|| board.speak())
            .find_map(|frame| feedback::decode(&frame).ok())
            .expect("an answer")
    };
    let sync = command::encode_sync(0x0012_3456);
    for bit in 0..32 {
        let cycle = command::decode_sync(&sync.with_flipped_bit(bit)).expect("as long as it was");
        // The host uses what names its own cycle; the boards know the low half only.
        assert_eq!(answered(cycle).answers_cycle == 0x3456, bit >= 16, "bit {bit}");
    }
}

/// Boards of whose first reply a bit is wrong.
struct Misheard {
    wired: Wired,
    bit: Option<usize>,
}

impl Bus for Misheard {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.wired.send(frame)
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        let mut received = self.wired.receive(until)?;
        if matches!(Address::of(received.frame.id()), Some(Address::ParameterReply(_)))
            && let Some(bit) = self.bit.take()
        {
            received.frame = received.frame.with_flipped_bit(bit);
        }
        Some(received)
    }
}

#[test]
fn each_bit_of_a_parameter_reply() {
    let machine = machine("reference");
    for bit in 0..64 {
        let mut bus = Misheard { wired: Wired::new(machine.rack(3)), bit: Some(bit) };
        let outcome = commission(&mut bus, machine.drives().expect("each axis has its board"));
        match outcome {
            // Another object, or no value: it is asked again.
            Ok(_) => assert!(bit < 32, "bit {bit} was believed"),
            Err(CommissionError::Differs { expected, got, .. }) => {
                assert_eq!(expected ^ got, 1 << (bit - 32), "bit {bit}");
            }
            // 43h, a value, is one bit from C3h and others that are not spoken, and from none that is.
            Err(other) => panic!("bit {bit}: {other}"),
        }
    }
}
