//! The bus beside can-utils: they read what we send, and we read what they send.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use quadrant::base::time::Span;
use quadrant::rt::bus::{Bus, Format, Frame, Id, Received};
use quadrant::rt::clock::monotonic_now;

use crate::rig::{CAN_UTILS, Interface, drain};

const FD: Format = Format::Fd { bit_rate_switch: true };

fn frames() -> Vec<(Frame, &'static str)> {
    let frame =
        |id, format, payload: &[u8]| Frame::from_slice(Id::from_low_bits(id), format, payload).unwrap();
    vec![
        (frame(0x080, Format::Classic, &[4, 3, 2, 1]), "080#04030201"),
        (frame(0x701, Format::Classic, &[]), "701#"),
        (frame(0x201, FD, &[0xC0; 12]), "201##1C0C0C0C0C0C0C0C0C0C0C0C0"),
        (frame(0x182, Format::Fd { bit_rate_switch: false }, &[0xAB]), "182##0AB"),
    ]
}

#[test]
fn candump_reads_our_frames() {
    let Some(interface) = Interface::new() else { return };
    let mut host = interface.bus(&[]);
    let mut candump = Command::new("candump")
        .args(["-L", "-n", &frames().len().to_string(), &interface.name])
        .stdout(Stdio::piped())
        .spawn()
        .expect(CAN_UTILS);
    // It says nothing when it is ready.
    thread::sleep(Duration::from_millis(300));
    let (ours, expected): (Vec<Frame>, Vec<&str>) = frames().into_iter().unzip();
    host.send_all(&ours).unwrap();
    let lines: Vec<String> =
        BufReader::new(candump.stdout.take().unwrap()).lines().map(|line| line.unwrap()).collect();
    assert!(candump.wait().unwrap().success());
    let texts: Vec<&str> = lines.iter().map(|line| line.rsplit(' ').next().unwrap()).collect();
    // candump of newer versions shows the flag of FD itself, 4, beside that of the bit rate switch, 1.
    let plain: Vec<String> =
        texts.iter().map(|text| text.replace("##5", "##1").replace("##4", "##0")).collect();
    assert_eq!(plain, expected);
}

#[test]
fn we_read_the_frames_of_cansend() {
    let Some(interface) = Interface::new() else { return };
    let mut host = interface.bus(&[0x080, 0x701, 0x201, 0x182]);
    for (frame, text) in frames() {
        assert!(Command::new("cansend").args([&interface.name, text]).status().expect(CAN_UTILS).success());
        assert_eq!(host.receive(monotonic_now() + Span::s(5.0)).map(|r| r.frame), Some(frame));
    }
}

#[test]
fn random_traffic_of_every_kind_is_taken_and_none_of_it_breaks_the_bus() {
    let Some(interface) = Interface::new() else { return };
    // The kernel takes up to 512 filters.
    let many: Vec<u16> = (0..=0x7FF).step_by(5).collect();
    let mut host = interface.bus(&many);
    const FRAMES: usize = 5_000;
    let random = ["-m", "-g", "0", "-n", &FRAMES.to_string(), &interface.name].map(str::to_owned);
    assert!(Command::new("cangen").args(random).status().expect(CAN_UTILS).success());
    let came = drain(&mut host);
    // A fifth of the identifiers, and of them neither those of 29 bits nor requests to be sent one.
    assert!((100..FRAMES / 5).contains(&came.len()), "{} of {FRAMES} frames", came.len());
    for Received { frame, .. } in &came {
        assert!(many.contains(&frame.id().raw()) && frame.format() != Format::Report, "{frame:?}");
        assert!(frame.format().carries(frame.length()), "{frame:?}");
    }
    assert!(
        came.iter().any(|r| r.frame.length() > 8) && came.iter().any(|r| r.frame.format() == Format::Classic)
    );
    assert_eq!(host.dropped(), 0);
}
