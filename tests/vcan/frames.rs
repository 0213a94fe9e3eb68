//! What crosses the interface, and what does not.

use std::io::Write;

use quadrant::base::time::{Moment, Span};
use quadrant::rt::bus::socketcan::{Settings, SocketCan};
use quadrant::rt::bus::{Bus, Format, Frame, Id, SendError};
use quadrant::rt::clock::monotonic_now;

use crate::rig::{Interface, classic_bytes, drain, ids, numbered};

/// Flags of an identifier in the kernel's layout.
const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
const REPORT: u32 = 0x2000_0000;

#[test]
fn frames_of_every_length_and_format_cross_both_ways() {
    let Some(interface) = Interface::new() else { return };
    let id = Id::from_low_bits(0x181);
    let payload: [u8; 64] = std::array::from_fn(|at| at as u8 ^ 0xA5);
    let formats =
        [Format::Classic, Format::Fd { bit_rate_switch: true }, Format::Fd { bit_rate_switch: false }];
    let frames: Vec<Frame> = formats
        .into_iter()
        .flat_map(|format| (0..=64).filter_map(move |n| Frame::from_slice(id, format, &payload[..n])))
        .collect();
    assert_eq!(frames.len(), 9 + 16 + 16);
    let (mut host, mut board) = (interface.bus(&[0x181]), interface.bus(&[0x181]));
    assert_eq!(host.send_all(&frames), Ok(()));
    assert_eq!(drain(&mut board).iter().map(|r| r.frame).collect::<Vec<_>>(), frames);
    for frame in &frames {
        assert_eq!(board.send(frame), Ok(()));
    }
    assert_eq!(drain(&mut host).iter().map(|r| r.frame).collect::<Vec<_>>(), frames);
}

#[test]
fn the_kernel_keeps_foreign_identifiers_and_own_frames_away() {
    let Some(interface) = Interface::new() else { return };
    let mut host = interface.bus(&[0x080, 0x181]);
    let mut other = interface.bus(&[0x080]);
    let mut raw = interface.socket();
    for foreign in [0x081, 0x180, 0x182, 0x7FF, 0x181 | EXTENDED, 0x181 | REMOTE, 0x080 | EXTENDED] {
        raw.write_all(&classic_bytes(foreign, [0; 8])).unwrap();
    }
    host.send(&numbered(0x080, 1)).unwrap();
    raw.write_all(&classic_bytes(0x181, [9; 8])).unwrap();
    let came: Vec<Frame> = drain(&mut host).iter().map(|r| r.frame).collect();
    assert_eq!(came, [Frame::classic(Id::from_low_bits(0x181), [9; 8])]);
    assert_eq!(drain(&mut other).len(), 1, "the host's own frame reaches the others");
}

#[test]
fn a_classic_bus_hears_no_fd_frame() {
    let Some(interface) = Interface::new() else { return };
    let settings = Settings { interface: &interface.name, identifiers: &ids(&[0x181]), is_fd: false };
    let mut classic = SocketCan::open(&settings, Moment::ZERO).unwrap();
    let mut other = interface.bus(&[0x181]);
    other.send_all(&[Frame::fd(Id::from_low_bits(0x181), [1; 8]), numbered(0x181, 2)]).unwrap();
    assert_eq!(drain(&mut classic).iter().map(|r| r.frame).collect::<Vec<_>>(), [numbered(0x181, 2)]);
    let fd = Frame::fd(Id::from_low_bits(0x181), [1; 8]);
    assert_eq!(classic.send(&fd), Err(SendError::Down));
    // What the kernel refuses in the middle of a batch does not keep the rest from being sent.
    let batch = [numbered(0x181, 1), fd, fd, numbered(0x181, 2), numbered(0x181, 3)];
    let mut refused = Vec::new();
    classic.send_each(&batch, &mut |place, why| refused.push((place, why)));
    assert_eq!(refused, [(1, SendError::Down), (2, SendError::Down)]);
    let came: Vec<Frame> = drain(&mut other).iter().map(|r| r.frame).collect();
    assert_eq!(came, [1, 2, 3].map(|number| numbered(0x181, number)));
}

#[test]
fn reports_of_the_controller_come_among_the_frames() {
    let Some(interface) = Interface::new() else { return };
    let mut host = interface.bus(&[0x181]);
    let mut raw = interface.socket();
    let details = [0, 0x30, 0, 0, 0, 0, 130, 0];
    raw.write_all(&classic_bytes(0x181, [1; 8])).unwrap();
    // Error passive with counters, lost arbitration, time-out of the driver, no acknowledge, bus-off,
    // bus error with protocol violation, restarted.
    for classes in [0x204, 0x002, 0x001, 0x020, 0x040, 0x088, 0x100] {
        raw.write_all(&classic_bytes(classes | REPORT, details)).unwrap();
    }
    let came: Vec<Frame> = drain(&mut host).iter().map(|r| r.frame).collect();
    let report = |classes| Frame::report(Id::from_low_bits(classes), details);
    let mut expected = vec![Frame::classic(Id::from_low_bits(0x181), [1; 8])];
    // Lost arbitration is no fault, and not asked for.
    expected.extend([0x204, 0x001, 0x020, 0x040, 0x088, 0x100].map(report));
    assert_eq!(came, expected);
}

#[test]
fn a_report_is_refused_and_keeps_no_frame_from_being_sent() {
    let Some(interface) = Interface::new() else { return };
    let (mut host, mut board) = (interface.bus(&[]), interface.bus(&[0x040, 0x201, 0x202]));
    let report = Frame::report(Id::from_low_bits(0x040), [0; 8]);
    let mut frames = vec![numbered(0x201, 1); 20];
    frames.extend([report, numbered(0x202, 2)]);
    let mut refused = Vec::new();
    host.send_each(&frames, &mut |place, why| refused.push((place, why)));
    assert_eq!(refused, [(20, SendError::Down)], "in the second batch");
    let came: Vec<Frame> = drain(&mut board).iter().map(|r| r.frame).collect();
    frames.remove(20);
    assert_eq!(came, frames);
    assert_eq!(host.receive(monotonic_now() + Span::ms(1)), None, "without identifiers nothing is heard");
}
