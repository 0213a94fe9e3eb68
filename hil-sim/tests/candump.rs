//! The boards behind a text of frames are those of the run in memory, frame for frame.

use std::fmt::Write;

use assert_cmd::Command;
use quadrant::base::record::CycleRecord;
use quadrant::base::time::Moment;
use quadrant::config;
use quadrant::rt::bus::{Bus, Format, Frame, Received, SendError};
use quadrant::rt::cycle::pace::{Pace, Virtual};
use quadrant::rt::cycle::{Cycle, pace};
use quadrant::rt::door::{Order, Orders};
use quadrant::rt::drive::commission::CommissionSettings;
use quadrant::sim::closed_loop::Wired;

/// A bus that writes down what crosses it.
struct Tapped {
    inner: Wired,
    sent: String,
    received: Vec<String>,
}

fn text(frame: &Frame) -> String {
    let separator = match frame.format() {
        Format::Classic => "#".to_owned(),
        Format::Report => unreachable!("a board reports through no controller"),
        // candump writes the FD flags as one digit: 4 is FDF, 1 is BRS.
        Format::Fd { bit_rate_switch } => format!("##{}", 4 + u8::from(bit_rate_switch)),
    };
    let payload: String = frame.payload().iter().fold(String::new(), |mut text, byte| {
        let _infallible = write!(text, "{byte:02X}");
        text
    });
    format!("{:03X}{separator}{payload}", frame.id().raw())
}

impl Bus for Tapped {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        let _infallible = writeln!(self.sent, "(1735270496.916858) vcan0 {}", text(frame));
        self.inner.send(frame)
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        let received = self.inner.receive(until)?;
        self.received.push(text(&received.frame));
        Some(received)
    }
}

/// Enables the axes, then does nothing.
struct Hold;

impl Orders for Hold {
    fn next(&mut self, last: &CycleRecord) -> Option<Order> {
        (last.cycle == 19).then_some(Order::Enable)
    }
    fn is_done(&self, _last: &CycleRecord) -> bool {
        false
    }
}

#[test]
fn a_session_as_text_gives_the_frames_of_the_run_in_memory() {
    let machine = config::load("reference").expect("the embedded machine checks");
    let mut bus = Tapped { inner: Wired::new(machine.rack(3)), sent: String::new(), received: Vec::new() };
    let mut now = 0;
    let clock = || {
        now += 1_000_000;
        Moment::ns(now)
    };
    let drives = machine.drives().expect("two nodes");
    let drives = drives.commission(&mut bus, CommissionSettings::default(), clock).expect("boards answer");
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let mut grid = Virtual::new(machine.cycle.period);
    for _ in 0..400 {
        let slot: pace::Slot = grid.wait();
        cycle.run(&mut bus, &mut Hold, &slot, &mut || slot.timing.scheduled);
    }
    assert!(bus.received.len() > 800, "{} frames from the boards", bus.received.len());

    let run = Command::cargo_bin("hil-sim")
        .expect("built")
        .args(["--machine", "reference", "--seed", "3"])
        .write_stdin(bus.sent)
        .assert()
        .success();
    let output = String::from_utf8(run.get_output().stdout.clone()).expect("text");
    let answered: Vec<&str> = output.lines().filter_map(|line| line.rsplit(' ').next()).collect();
    let count = bus.received.len();
    assert_eq!(answered[..count], bus.received[..], "frames of the boards");
}

#[test]
fn a_line_that_is_no_frame_is_named() {
    let run = Command::cargo_bin("hil-sim")
        .expect("built")
        .write_stdin("(1735270496.916858) vcan0 080#00000000\nnonsense\n")
        .assert()
        .code(2);
    let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(said.contains("line 2"), "{said}");
}
