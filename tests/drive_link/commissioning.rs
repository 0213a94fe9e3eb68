//! A machine starts only with the boards its sheets describe.

use quadrant::rt::bus::Bus;
use quadrant::rt::bus::faulty::Faults;
use quadrant::rt::drive::Drives;
use quadrant::rt::drive::commission::CommissionError;
use quadrant::rt::drive::sheet::Sheet;
use quadrant::rt::wire::parameter::Object;
use quadrant::rt::wire::{Layout, command};
use rstest::rstest;

use crate::rig::*;

#[test]
fn boards_that_are_what_their_sheets_say_are_accepted() {
    assert!(commission(&mut wired(Layout::Fd, SHEET, 64, 0), SHEET).is_ok());
}

#[rstest]
#[case(Object::Vendor, 7, "axis y: vendor (object 1018:1) of node 2 is 7, expected 20804")]
#[case(Object::Serial, 9, "axis y: serial (object 1018:4) of node 2 is 9, expected 101")]
fn a_wrong_board_is_named_with_both_values(
    #[case] object: Object,
    #[case] value: u32,
    #[case] message: &str,
) {
    let mut wired = wired(Layout::Fd, SHEET, 64, 0);
    wired.machine.boards[1].pretend(object, value);
    let error = commission(&mut wired, SHEET).expect_err("one board is wrong");
    assert_eq!(error.to_string(), message);
}

#[test]
fn a_wrong_value_inside_a_board_is_found_by_the_hash_and_named() {
    let loose = Sheet { watchdog_us: 9_000, ..SHEET };
    let error = commission(&mut wired(Layout::Fd, loose, 64, 0), SHEET).expect_err("the watchdogs differ");
    assert_eq!(error.to_string(), "axis x: watchdog (object 2001:0) of node 1 is 9000 us, expected 5000 us");
}

#[test]
fn a_hash_that_differs_alone_is_refused_too() {
    let mut wired = wired(Layout::Fd, SHEET, 64, 0);
    wired.machine.boards[0].pretend(Object::FirmwareConfigHash, 0);
    let error = commission(&mut wired, SHEET).expect_err("the hash differs");
    assert!(matches!(error, CommissionError::HashDiffers { axis: X, got: 0, .. }), "{error}");
}

#[test]
fn a_silent_board_is_named_with_the_patience_it_was_given() {
    let mut wired = wired(Layout::Fd, SHEET, 64, 0);
    wired.machine.boards[1].set_silent(true);
    let error = commission(&mut wired, SHEET).expect_err("one board is silent");
    assert_eq!(
        error.to_string(),
        "axis y: node 2 did not tell vendor (object 1018:1), 2 times asked and 5 ms waited each time"
    );
}

#[test]
fn a_lost_reply_is_asked_for_again() {
    let mut wired = wired(Layout::Fd, SHEET, 64, 3);
    let lossy = Faults { drop: 0.2, ..Faults::NONE };
    wired.bus.set(lossy, lossy);
    let outcomes: Vec<_> = (0..20).map(|_| commission(&mut wired, SHEET)).collect();
    assert!(outcomes.iter().any(Result::is_ok), "a loss of 20 % must be survived at least once in 20");
    let (received, sent) = wired.bus.counts();
    assert!(received.dropped > 0 && sent.dropped > 0);
    assert!(outcomes.iter().all(|o| matches!(o, Ok(_) | Err(CommissionError::NoReply { .. }))));
}

#[test]
fn a_host_that_runs_already_is_heard_before_the_first_request() {
    for voice in [command::encode_sync(7), Layout::Fd.command(node(X), &command::RawCommand::default())] {
        let mut wired = wired(Layout::Fd, SHEET, 64, 0);
        wired.machine.end.send(&voice).expect("room for a frame");
        let error = commission(&mut wired, SHEET).expect_err("somebody else drives this bus");
        assert_eq!(error, CommissionError::SecondHost);
    }
}

#[test]
fn two_axes_on_one_board_are_refused() {
    let mut same = settings(Layout::Fd, SHEET);
    same[Y].node = same[X].node;
    let error = Drives::new(PERIOD, same).expect_err("one node for two axes");
    assert_eq!(error.to_string(), "axes x and y are both node 1");
}
