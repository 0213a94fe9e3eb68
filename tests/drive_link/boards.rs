//! Commands, states and faults between the host and its boards.

use quadrant::base::axis::PerAxis;
use quadrant::base::command::Command;
use quadrant::base::sample::Freshness;
use quadrant::base::time::Moment;
use quadrant::base::units::Current;
use quadrant::rt::bus::Bus;
use quadrant::rt::bus::faulty::Faults;
use quadrant::rt::drive::sheet::{CommandApplies, Sheet};
use quadrant::rt::drive::state::{DriveState, Target};
use quadrant::rt::wire::Layout;
use quadrant::rt::wire::command::{self, RawCommand};
use quadrant::rt::wire::feedback::BoardFlags;
use quadrant::rt::wire::parameter::Object;
use quadrant::rt::wire::scaling::{CurrentCounts, TravelCounts};
use quadrant::rt::wire::state::Emergency;
use rstest::rstest;

use crate::rig::*;

#[rstest]
#[case(CommandApplies::OnReceipt)]
#[case(CommandApplies::OnNextSync)]
fn a_command_acts_when_the_sheet_says(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
    #[case] command_applies: CommandApplies,
) {
    let mut rig = Rig::new(layout, Sheet { command_applies, ..SHEET });
    let seen = rig.run(12, AMPERE, Target::Enabled);
    assert_eq!(seen.map(|_, o| o.drive).as_slice(), [Some(DriveState::OperationEnabled); 2]);
    assert_eq!((rig.applied(X), rig.applied(Y)), (AMPERE, AMPERE), "the sense of each axis cancels out");
    rig.dispatch(AMPERE * 2.0, Target::Enabled);
    let until = rig.until();
    rig.wired.machine.serve(until);
    let at_receipt = rig.applied(X);
    rig.collect();
    let at_next_sync = rig.applied(X);
    let expected = match command_applies {
        CommandApplies::OnReceipt => (AMPERE * 2.0, AMPERE * 2.0),
        CommandApplies::OnNextSync => (AMPERE, AMPERE * 2.0),
    };
    assert_eq!((at_receipt, at_next_sync), expected);
    assert_eq!(
        rig.collect()[Y].sample.current,
        AMPERE * 2.0,
        "the feedback tells it in the sense of the axis"
    );
}

#[rstest]
fn no_current_flows_unless_operation_is_enabled(#[values(Layout::Fd, Layout::Classic)] layout: Layout) {
    let mut rig = Rig::new(layout, SHEET);
    for target in [Target::Enabled, Target::QuickStop, Target::Enabled, Target::Disabled] {
        for _ in 0..10 {
            rig.run(1, AMPERE, target);
            let expected = if rig.state(X) == DriveState::OperationEnabled { AMPERE } else { Current::ZERO };
            assert_eq!(rig.applied(X), expected, "in {:?} on the way to {target:?}", rig.state(X));
        }
    }
    assert_eq!(rig.state(X), DriveState::SwitchOnDisabled);
}

#[rstest]
fn without_fresh_commands_the_board_takes_the_current_away_and_says_so(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
) {
    let mut rig = Rig::new(layout, SHEET);
    rig.run(10, AMPERE, Target::Enabled);
    let last_command = rig.until() - PERIOD;
    let mut emergency = None;
    while rig.applied(X) != Current::ZERO {
        let seen = rig.collect();
        assert!(
            seen[X].events.board_flags.contains(BoardFlags::COMMAND_STALE)
                || rig.until() - last_command == PERIOD
        );
        emergency = emergency.or(seen[X].events.emergency);
    }
    let after = rig.until() - last_command;
    assert!(
        after > SHEET.watchdog() && after <= SHEET.watchdog() + PERIOD * 2,
        "current gone {} us after the last command, watchdog {} us",
        after.as_us(),
        SHEET.watchdog().as_us()
    );
    let seen = rig.collect();
    emergency = emergency.or(seen[X].events.emergency);
    assert!(seen[X].events.board_flags.contains(BoardFlags::WATCHDOG_TRIPPED));
    assert_eq!(emergency.map(|e| e.code), Some(Emergency::CODE_WATCHDOG));
    assert_eq!(seen[X].drive, Some(DriveState::QuickStopActive));
}

#[rstest]
fn a_tripped_watchdog_stays_tripped_until_it_is_told_to_disable(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
) {
    let mut rig = Rig::new(layout, SHEET);
    rig.run(10, AMPERE, Target::Enabled);
    (0..15).for_each(|_| _ = rig.collect());
    // A host that goes on as if nothing had happened.
    let enable = PerAxis::filled(2, Command { current: AMPERE, control_word: 0x0F, ..Command::default() });
    for _ in 0..10 {
        rig.drives.dispatch(&mut rig.wired, &enable, rig.cycle);
        let seen = rig.collect();
        assert!(seen[X].events.board_flags.contains(BoardFlags::WATCHDOG_TRIPPED));
        assert_eq!(rig.applied(X), Current::ZERO);
    }
    let seen = rig.run(2, AMPERE, Target::Disabled);
    assert!(!seen[X].events.board_flags.contains(BoardFlags::WATCHDOG_TRIPPED));
    rig.run(8, AMPERE, Target::Enabled);
    assert_eq!(rig.applied(X), AMPERE);
}

#[rstest]
fn a_repeated_command_does_not_feed_the_watchdog(#[values(Layout::Fd, Layout::Classic)] layout: Layout) {
    let mut rig = Rig::new(layout, SHEET);
    rig.run(10, AMPERE, Target::Enabled);
    let raw = RawCommand {
        current: CurrentCounts::ua(1_000_000),
        control_word: 0x0F,
        sequence: 77,
        mode_of_operation: command::CYCLIC_SYNCHRONOUS_TORQUE,
        ..RawCommand::default()
    };
    for _ in 0..15 {
        rig.wired.send(&layout.command(node(X), &raw)).expect("room for a frame");
        rig.collect();
    }
    assert_eq!(rig.applied(X), Current::ZERO);
    assert_eq!(rig.state(X), DriveState::QuickStopActive);
}

#[rstest]
fn a_drive_fault_is_told_with_its_code_and_left_by_a_reset_only(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
) {
    let mut rig = Rig::new(layout, SHEET);
    rig.run(10, AMPERE, Target::Enabled);
    rig.board(Y).trip_drive(Emergency::CODE_OVERCURRENT, 42);
    rig.dispatch(AMPERE, Target::Enabled);
    let emergency = rig.collect()[Y].events.emergency.expect("the emergency came with the next feedback");
    assert_eq!((emergency.code, emergency.detail), (Emergency::CODE_OVERCURRENT, 42));
    assert_eq!(rig.collect()[Y].events.emergency, None, "an event is told once");
    assert_eq!(rig.seen[Y].drive, Some(DriveState::Fault));
    assert_eq!((rig.applied(X), rig.applied(Y)), (AMPERE, Current::ZERO));
    assert_eq!(rig.run(10, AMPERE, Target::Enabled)[Y].drive, Some(DriveState::Fault));
    assert_eq!(rig.run(3, AMPERE, Target::FaultReset)[Y].drive, Some(DriveState::SwitchOnDisabled));
    assert_eq!(rig.run(10, AMPERE, Target::Enabled)[Y].drive, Some(DriveState::OperationEnabled));
}

#[rstest]
#[case::boot_up_message_heard(false)]
#[case::boot_up_message_lost(true)]
fn a_board_reset_is_told_once_and_leaves_no_current(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
    #[case] is_message_lost: bool,
) {
    let mut rig = Rig::new(layout, SHEET);
    rig.run(30, AMPERE, Target::Enabled);
    let now = rig.until();
    rig.board(X).set_silent(is_message_lost);
    rig.board(X).reset(now);
    rig.board(X).set_silent(false);
    assert_eq!(rig.applied(X), Current::ZERO);
    // The next heartbeat comes within 10 ms: 20 periods.
    let told = (0..25).filter(|_| rig.collect()[X].events.is_board_reset).count();
    assert_eq!((told, rig.drives.link_counts()[X].resets, rig.drives.link_counts()[Y].resets), (1, 1, 0));
    assert_eq!(rig.seen[X].drive, Some(DriveState::SwitchOnDisabled));
}

#[rstest]
#[case::boot_up_message_heard(false)]
#[case::boot_up_message_lost(true)]
fn a_loss_of_power_is_told_like_a_reset(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
    #[case] is_message_lost: bool,
) {
    let mut rig = Rig::new(layout, SHEET);
    // Only after its first second the board's uptime can be seen to go back.
    rig.run(1_100, AMPERE, Target::Enabled);
    let now = rig.until();
    rig.board(X).set_silent(is_message_lost);
    rig.board(X).power_cycle(now);
    rig.board(X).set_silent(false);
    assert_eq!(rig.applied(X), Current::ZERO);
    let told = (0..25).filter(|_| rig.collect()[X].events.is_board_reset).count();
    assert_eq!((told, rig.drives.link_counts()[X].resets, rig.drives.link_counts()[Y].resets), (1, 1, 0));
    assert_eq!(rig.seen[X].drive, Some(DriveState::SwitchOnDisabled));
}

#[rstest]
fn a_silent_board_ages_in_feedback_and_heartbeat(#[values(Layout::Fd, Layout::Classic)] layout: Layout) {
    let mut rig = Rig::new(layout, SHEET);
    rig.run(40, Current::ZERO, Target::Disabled);
    let age = rig.seen[X].events.heartbeat_age;
    assert!(age <= SHEET.heartbeat_period() + PERIOD * 2, "heartbeat {} us old while it beats", age.as_us());
    rig.board(X).set_silent(true);
    let seen = rig.run(39, Current::ZERO, Target::Disabled);
    assert_eq!((seen[X].sample.freshness, seen[X].sample.age_cycles), (Freshness::Stale, 40));
    assert!(seen[X].events.heartbeat_age >= PERIOD * 40, "{} us", seen[X].events.heartbeat_age.as_us());
    assert!(seen[Y].events.heartbeat_age <= SHEET.heartbeat_period() + PERIOD * 2);
}

#[rstest]
fn a_current_above_the_peak_is_held_there_and_flagged(#[values(Layout::Fd, Layout::Classic)] layout: Layout) {
    let mut rig = Rig::new(layout, SHEET);
    let seen = rig.run(10, Current::a(26.0), Target::Enabled);
    assert!(seen[X].events.board_flags.contains(BoardFlags::CURRENT_SATURATED));
    assert_eq!(rig.applied(X), Current::a(25.0));
    assert!(
        !rig.run(2, AMPERE, Target::Enabled)[X].events.board_flags.contains(BoardFlags::CURRENT_SATURATED)
    );
}

#[rstest]
fn an_encoder_error_is_flagged_and_its_counts_stand_still(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
) {
    let mut rig = Rig::new(layout, SHEET);
    let before = rig.run(3, Current::ZERO, Target::Disabled)[X].sample.position;
    rig.board(X).set_encoder_error(true);
    let seen = rig.run(2, Current::ZERO, Target::Disabled);
    assert!(seen[X].events.board_flags.contains(BoardFlags::ENCODER_ERROR));
    assert_eq!(seen[X].sample.position, before);
    assert_eq!(
        seen[X].sample.freshness,
        Freshness::Fresh,
        "the frame is new, its counts are not to be trusted"
    );
}

#[rstest]
fn a_frozen_encoder_stands_still_and_a_jump_shows_in_one_period(
    #[values(Layout::Fd, Layout::Classic)] layout: Layout,
) {
    let mut rig = Rig::new(layout, SHEET);
    let before = rig.run(3, Current::ZERO, Target::Disabled)[X].sample.position;
    rig.board(X).set_encoder_frozen(true);
    assert_eq!(rig.collect()[X].sample.position, before);
    rig.board(X).jump_encoder(TravelCounts::counts(1 << 20));
    let jump = rig.collect()[X].sample.position - before;
    assert!((jump.as_mm() - 10.0).abs() < 1e-9, "{} mm, expected one lead of 10 mm", jump.as_mm());
}

#[test]
fn writing_to_a_board_and_reading_what_it_has_not_are_refused_with_the_code_of_the_standard() {
    use quadrant::rt::wire::parameter::{Abort, Access, ObjectAddress, decode_reply, encode_request};
    let mut rig = Rig::new(Layout::Fd, SHEET);
    let known = Object::Watchdog.address();
    for (address, access, abort) in [
        (known, Access::Write(1), Abort::READ_ONLY),
        (known, Access::Other(0x60), Abort::UNKNOWN_SPECIFIER),
        (ObjectAddress { sub: 9, ..known }, Access::Read, Abort::NO_SUB_INDEX),
        (ObjectAddress { index: 0x3000, sub: 0 }, Access::Read, Abort::NO_OBJECT),
    ] {
        let board = rig.board(X);
        while board.speak().is_some() {}
        board.hear(&encode_request(node(X), address, access), Moment::ZERO);
        let reply = board.speak().expect("every request is answered");
        assert_eq!(decode_reply(&reply), Ok((address, Err(abort))));
    }
}

#[rstest]
fn the_same_faults_give_the_same_observations(#[values(Layout::Fd, Layout::Classic)] layout: Layout) {
    let run = || {
        let mut rig = Rig::new(layout, SHEET);
        rig.wired.bus.set(Faults { drop: 0.2, repeat: 0.2, ..Faults::NONE }, Faults::NONE);
        (0..500).map(|_| rig.collect()).collect::<Vec<_>>()
    };
    assert!(run() == run(), "two runs with one seed differ");
}
