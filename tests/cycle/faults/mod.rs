//! Promise: every fault has a scenario that raises it through the bus, the board, the plant or the pace;
//! the current is gone within a bounded time and way, the axis stays faulted until it is cleared, and
//! (unless its reference is lost) it can be enabled again afterwards. Silence is a fault on both sides.

mod scenarios;
mod trouble;

use std::cell::Cell;
use std::rc::Rc;

use quadrant::base::fault::{Fault, StopCategory};
use quadrant::base::record::{ModeTag, Refusal};
use quadrant::base::sample::Freshness;
use quadrant::base::time::Span;
use quadrant::base::units::Position;
use quadrant::rt::bus::Bus;
use quadrant::rt::door::Order;
use quadrant::rt::drive::state::DriveState;
use quadrant::rt::wire::command::{self, RawCommand};
use quadrant::rt::wire::scaling::CurrentCounts;
use quadrant::rt::wire::{Address, state};
use rstest::rstest;

use scenarios::scenarios;
use trouble::{GENTLE, Scenario, Strikes, board, good_line, node};

use crate::common::{Fate, Rig, X, Y, machine_with};

/// Speed of the axes when things go wrong, mm/s.
const SPEED_MM_PER_S: f64 = 100.0;
/// So slow that an encoder may stop at once.
const CREEP_MM_PER_S: f64 = 3.0;

/// What came of a scenario.
struct Outcome {
    /// Periods until the fault had its name.
    named: u64,
    /// Periods until the drive gave no current.
    unpowered: u64,
    way_mm: f64,
    mode_at_fault: ModeTag,
}

fn is_unpowered(rig: &mut Rig) -> bool {
    let board = board(rig);
    board.drive() != DriveState::OperationEnabled || board.current_to_apply() == CurrentCounts::ZERO
}

/// Break it and watch X until its current is gone and it stands.
fn strike(rig: &mut Rig, scenario: &Scenario) -> Outcome {
    let start_mm = rig.state(X).motor_position.as_mm();
    let (mut named, mut unpowered, mut mode_at_fault) = (None, None, ModeTag::Off);
    let cycle_before = rig.last.cycle;
    (scenario.break_it)(rig);
    for _ in 0..20_000 {
        rig.step();
        let passed = rig.last.cycle - cycle_before;
        if named.is_none() && rig.axis(X).fault.is_some() {
            (named, mode_at_fault) = (Some(passed), rig.axis(X).mode);
        }
        let is_over = rig.axis(X).mode == ModeTag::Faulted && is_unpowered(rig);
        if is_over && unpowered.is_none() {
            unpowered = Some(passed);
        }
        let stands = rig.state(X).motor_velocity.as_mm_per_s().abs() < 1e-3;
        if is_over && stands && rig.axis(Y).mode == ModeTag::Faulted {
            break;
        }
    }
    let name = scenario.name;
    assert_eq!(rig.axis(X).fault, Some(scenario.fault), "{name}: modes {:?}", rig.modes());
    Outcome {
        named: named.unwrap_or_else(|| panic!("{name}: no fault")),
        unpowered: unpowered.unwrap_or_else(|| panic!("{name}: current still flows")),
        way_mm: (rig.state(X).motor_position.as_mm() - start_mm).abs(),
        mode_at_fault,
    }
}

fn prepared(machine: &str, scenario: &Scenario) -> Rig {
    let mut rig = Rig::new(machine_with(machine, scenario.edits), 4);
    rig.run(20);
    match scenario.strikes {
        Strikes::Enabling => rig.order(Order::Enable),
        Strikes::Creeping => {
            rig.enable();
            let order = rig.line_to(200.0, CREEP_MM_PER_S);
            rig.order(order);
            rig.run(1_400);
            assert_eq!(rig.axis(X).mode, ModeTag::Moving);
        }
        Strikes::Moving => {
            rig.enable();
            let order = rig.line_to(200.0, SPEED_MM_PER_S);
            rig.order(order);
            // Full speed, or as far as the travel of the scenario lets it come.
            rig.run(1_400);
            assert_eq!(rig.axis(X).mode, ModeTag::Moving);
        }
    }
    rig
}

/// Whatever is ordered, no current comes back before the fault is cleared.
fn stays_faulted(rig: &mut Rig, scenario: &Scenario) {
    let orders = [
        Order::Enable,
        Order::Stop,
        Order::UseGains(1),
        Order::Disable,
        rig.line_to(0.0, 10.0),
        Order::Enable,
    ];
    orders.into_iter().for_each(|order| rig.order(order));
    for _ in 0..400 {
        rig.step();
        assert_eq!(rig.axis(X).mode, ModeTag::Faulted, "{}: {:?}", scenario.name, rig.modes());
        assert!(is_unpowered(rig), "{}: current came back", scenario.name);
    }
}

fn recovers(rig: &mut Rig, scenario: &Scenario) {
    (scenario.mend_it)(rig);
    good_line(rig);
    rig.run(2_100);
    rig.order(Order::ClearFaults);
    rig.run(40);
    if scenario.afterwards.is_some() {
        rig.order(Order::Enable);
        rig.run(400);
        assert_eq!(rig.axis(X).fault, scenario.afterwards, "{}: cleared without a reference", scenario.name);
        return;
    }
    rig.enable();
    let before = rig.state(X).motor_position;
    rig.run(1_000);
    let moved_um = (rig.state(X).motor_position - before).as_um();
    // The screw winds up by 6 um under the integral; nothing else moves.
    assert!(moved_um.abs() < 20.0, "{}: moved by {moved_um} um when enabled again", scenario.name);
    assert_eq!(rig.axis(X).mode, ModeTag::Ready, "{}: {:?}", scenario.name, rig.modes());
}

#[rstest]
fn every_fault_is_raised_ends_without_current_and_is_cleared_by_order_only(
    #[values("reference", "classic")] machine: &str,
) {
    println!("| fault | scenario | named after | no current after | way |");
    println!("|---|---|---|---|---|");
    let all = scenarios();
    for scenario in &all {
        let mut rig = prepared(machine, scenario);
        let outcome = strike(&mut rig, scenario);
        let Outcome { named, unpowered, way_mm, mode_at_fault } = outcome;
        println!(
            "| {} | {} | {named} cycles | {unpowered} cycles | {way_mm:.2} mm |",
            scenario.fault, scenario.name
        );
        let wanted = match scenario.fault.stop() {
            StopCategory::Controlled => ModeTag::Stopping,
            StopCategory::Immediate => ModeTag::Faulted,
        };
        assert_eq!(mode_at_fault, wanted, "{}", scenario.name);
        assert!(
            unpowered <= scenario.cycles_max,
            "{}: {unpowered} cycles, bound {}",
            scenario.name,
            scenario.cycles_max
        );
        assert!(
            way_mm <= scenario.way_mm_max,
            "{}: {way_mm} mm, bound {} mm",
            scenario.name,
            scenario.way_mm_max
        );
        stays_faulted(&mut rig, scenario);
        recovers(&mut rig, scenario);
    }
    // The one fault that no machine can raise has its own test below.
    for fault in Fault::ALL.into_iter().filter(|fault| *fault != Fault::NotANumber) {
        assert!(all.iter().any(|scenario| scenario.fault == fault), "{fault} has no scenario");
    }
}

#[test]
fn a_loop_that_comes_to_nan_gives_no_current_and_faults() {
    let machine = machine_with("reference", &[]);
    let mut control = machine.control_settings();
    control[X].gain_sets[1].position.gain_per_s = f64::NAN;
    let mut rig = Rig::with_control(machine, &control, 4);
    rig.enable();
    let order = rig.line_to(50.0, SPEED_MM_PER_S);
    rig.order(order);
    rig.run(1_400);
    rig.order(Order::UseGains(1));
    for _ in 0..10 {
        rig.step();
        let row = rig.axis(X);
        assert!(row.command.current.is_finite(), "{row:?}");
        if row.mode == ModeTag::Faulted {
            break;
        }
    }
    assert_eq!(rig.axis(X).fault, Some(Fault::NotANumber));
    rig.run(4_000);
    assert!(is_unpowered(&mut rig));
    assert_eq!(rig.axis(Y).fault, Some(Fault::OtherAxis));
    assert_eq!(rig.axis(Y).mode, ModeTag::Faulted);
}

#[test]
fn what_the_bus_refused_is_recorded_with_its_axis() {
    let mut rig = prepared("reference", &GENTLE);
    rig.line.outgoing = Box::new(|frame| match Address::of(frame.id()) {
        Some(Address::Command(to)) if to == node(Y) => Fate::Refused,
        _ => Fate::Pass,
    });
    rig.step();
    assert_eq!((rig.axis(X).refusal, rig.axis(Y).refusal), (Refusal::None, Refusal::Full));
    rig.line.outgoing = Box::new(|frame| match Address::of(frame.id()) {
        Some(Address::Command(to)) if to == node(X) => Fate::Down,
        _ => Fate::Pass,
    });
    rig.step();
    assert_eq!((rig.axis(X).refusal, rig.axis(Y).refusal), (Refusal::Down, Refusal::None));
}

#[rstest]
fn single_lost_frames_are_borne_and_never_used_as_fresh(#[values("reference", "classic")] machine: &str) {
    let mut rig = prepared(machine, &GENTLE);
    let count = Rc::new(Cell::new(0_u32));
    let seen = Rc::clone(&count);
    rig.line.incoming = Box::new(move |frame| {
        let is_feedback = matches!(Address::of(frame.id()), Some(Address::Feedback(_)));
        seen.set(seen.get() + u32::from(is_feedback));
        if is_feedback && seen.get().is_multiple_of(201) { Fate::Lost } else { Fate::Pass }
    });
    let mut stale = 0;
    for _ in 0..2_000 {
        let before = rig.axis(X).command;
        rig.step();
        let row = rig.axis(X);
        assert_eq!(row.fault, None, "{row:?}");
        if row.sample.freshness != Freshness::Fresh {
            stale += 1;
            assert_eq!(row.command.terms, before.terms, "the loops stepped on a stale sample");
            assert_eq!(row.command.current, before.current);
        }
    }
    assert!(stale >= 9, "{stale} stale samples");
}

/// The pauses that began the stop go on: what is called control has no time of its own.
#[rstest]
fn a_stop_that_pauses_again_loses_its_current(#[values("reference", "classic")] machine: &str) {
    let mut rig = prepared(machine, &GENTLE);
    let pause = u64::from(rig.machine.supervision.pause_cycles_max) + 1;
    for mode in [ModeTag::Stopping, ModeTag::Faulted] {
        rig.skip(pause);
        rig.run(3);
        assert_eq!(rig.axis(X).mode, mode);
        assert_eq!(rig.axis(X).fault, Some(Fault::Overrun));
    }
    assert!(is_unpowered(&mut rig));
    // One within the limit is borne also while stopping.
    let mut rig = prepared(machine, &GENTLE);
    rig.skip(pause);
    rig.run(3);
    rig.skip(pause - 1);
    rig.run(3);
    assert_eq!(rig.axis(X).mode, ModeTag::Stopping);
}

/// Without its answer in time a cycle has no fresh sample, whoever was late.
#[rstest]
fn feedback_after_the_reply_window_is_late(#[values("reference", "classic")] machine: &str) {
    let mut rig = prepared(machine, &GENTLE);
    rig.line.behind = Span::us(1);
    let late_before = rig.axis(X).link.late;
    rig.step();
    let row = rig.axis(X);
    assert_eq!(row.sample.freshness, Freshness::Stale, "{row:?}");
    assert!(row.link.late > late_before, "{row:?}");
    rig.line.behind = Span::ZERO;
    rig.step();
    assert_eq!(rig.axis(X).sample.freshness, Freshness::Fresh, "at the end of the window it is in time");
}

#[rstest]
fn when_the_host_dies_the_board_takes_the_current_away(#[values("reference", "classic")] machine: &str) {
    let mut rig = prepared(machine, &GENTLE);
    assert!(!is_unpowered(&mut rig));
    let start = rig.state(X).motor_position;
    // The next that is heard of any host is a SYNC a second later.
    let died_at = rig.last.cycle as u32;
    rig.line.wired.send(&command::encode_sync(died_at + 2_000)).expect("room on the bus");
    let until = rig.last.timing.scheduled;
    let mut tripped = false;
    while let Some(received) = rig.line.wired.receive(until) {
        if let Ok(emergency) = state::decode_emergency(&received.frame) {
            tripped |= emergency.code == state::Emergency::CODE_WATCHDOG;
        }
    }
    assert!(tripped, "the board does not say that its watchdog tripped");
    assert_eq!(board(&mut rig).drive(), DriveState::QuickStopActive);
    let way: Position = rig.state(X).motor_position - start;
    let state = rig.state(X);
    assert!(state.is_stuck && state.current.as_a().abs() < 1e-6, "{state:?}");
    assert!(way.as_mm() < 20.0, "{} mm after the host died", way.as_mm());
    println!("host dead: {:.2} mm to rest", way.as_mm());
}

/// Commands that wait for a SYNC do not act; hearing them must not keep an old current alive.
#[rstest]
fn commands_that_never_act_do_not_feed_the_board_watchdog(#[values("reference", "classic")] machine: &str) {
    let mut rig = prepared(machine, &GENTLE);
    let layout = rig.machine.bus.layout;
    let mut at = rig.last.timing.scheduled;
    for sequence in 1..=42 {
        at = at + rig.machine.cycle.period;
        let raw = RawCommand {
            sequence: sequence + 100,
            mode_of_operation: command::CYCLIC_SYNCHRONOUS_TORQUE,
            ..RawCommand::default()
        };
        board(&mut rig).hear(&layout.command(node(X), &raw), at);
    }
    assert_eq!(board(&mut rig).drive(), DriveState::QuickStopActive, "21 ms without a SYNC");
}
