//! Promise: a log and the text of candump tell the same of a bus. What a log is exported to is what a listener
//! at the host's end of the bus wrote, frame for frame, whatever happened.

mod common;
#[path = "common/eventful.rs"]
mod eventful;

use std::fmt::Write;

use common::machine;
use eventful::{Kept, eventful};
use quadrant::base::input::What;
use quadrant::offline::traffic::export::Export;
use quadrant::rt::bus::{Format, Frame};
use rstest::rstest;

const WALL_AT_ZERO_NS: i64 = 1_800_000_000_123_456_789;

/// A frame as candump writes it, without the code under test.
fn text(frame: &Frame) -> String {
    let id = frame.id().raw();
    let mut text = match frame.format() {
        Format::Classic => format!("{id:03X}#"),
        Format::Fd { bit_rate_switch: true } => format!("{id:03X}##5"),
        Format::Fd { bit_rate_switch: false } => format!("{id:03X}##4"),
        Format::Report => format!("{:08X}#", 0x2000_0000 + u32::from(id)),
    };
    for byte in frame.payload() {
        let _infallible = write!(text, "{byte:02X}");
    }
    text
}

fn exported(name: &str, kept: &Kept) -> String {
    let mut text = Vec::new();
    let mut export = Export::new(&machine(name), WALL_AT_ZERO_NS, "can7", &mut text);
    for (record, inputs) in kept {
        export.cycle(record, inputs).expect("memory takes it");
    }
    String::from_utf8(text).expect("ASCII")
}

#[rstest]
fn an_export_is_what_a_listener_wrote(#[values("reference", "classic")] name: &str) {
    let (mut refused, mut reports) = (0, 0);
    for seed in 0..12 {
        let (kept, crossed) = eventful(name, seed);
        let exported = exported(name, &kept);
        // What commissioning left to the first cycle was heard before it.
        let heard = kept[0].1.iter().filter(|input| matches!(input.what, What::Before(_))).count();
        let frames: Vec<&str> =
            exported.lines().skip(heard).filter_map(|line| line.split(' ').nth(2)).collect();
        assert_eq!(frames.len(), crossed.len(), "seed {seed}: frames");
        for (place, (line, frame)) in frames.iter().zip(&crossed).enumerate() {
            assert_eq!(*line, text(frame), "seed {seed}: frame {place} of the text");
        }
        let commands = 2 * kept.len();
        let sent = crossed.iter().filter(|frame| frame.id().raw() & 0x780 == 0x200).count();
        refused += commands.saturating_sub(sent);
        reports += crossed.iter().filter(|frame| frame.format() == Format::Report).count();
    }
    assert!(refused > 5 && reports > 100, "{refused} commands refused, {reports} reports");
}
