//! Promise: the drives see of their boards what is true, or know that they do not. Boards of
//! `sim::board` stand at the other end of a memory bus, with faults in between.

use quadrant::base::axis::{AxisId, PerAxis};
use quadrant::base::command::Command;
use quadrant::base::sample::Freshness;
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Current, Position};
use quadrant::rt::bus::faulty::{Faults, Faulty};
use quadrant::rt::bus::{Bus, Frame, Id, Received, SendError, memory};
use quadrant::rt::drive::commission::{CommissionError, CommissionSettings};
use quadrant::rt::drive::sheet::{CommandApplies, Sheet};
use quadrant::rt::drive::state::{DriveState, Target, control_word};
use quadrant::rt::drive::velocity::VelocityEstimate;
use quadrant::rt::drive::{DriveSettings, Drives, Observation, Operational};
use quadrant::rt::wire::command::{self, RawCommand};
use quadrant::rt::wire::feedback::BoardFlags;
use quadrant::rt::wire::parameter::Object;
use quadrant::rt::wire::scaling::{
    AxisScale, CurrentCounts, EncoderCounts, ScaleSettings, Sense, TravelCounts,
};
use quadrant::rt::wire::state::Emergency;
use quadrant::rt::wire::{Address, Node};
use quadrant::sim::board::{Board, Measured};
use rstest::rstest;

const X: AxisId = AxisId::X;
const Y: AxisId = AxisId::Y;
const PERIOD: Span = Span::us(500);
/// Way of the motor encoders per period: 0.1 m/s at 9.5 nm per count would be 5243 counts.
const COUNTS_PER_PERIOD: i64 = 5_243;

const SHEET: Sheet = Sheet {
    vendor: 0x5144,
    product: 0x0402,
    revision: 1,
    heartbeat_period_ms: 10,
    watchdog_us: 5_000,
    command_applies: CommandApplies::OnReceipt,
    motor_counts_per_rev: 1 << 20,
    table_counts_per_mm: 100_000,
    peak_current_ma: 25_000,
    rated_current_ma: 10_000,
};

fn node(axis: AxisId) -> Node {
    Node::new(axis.index() as u8 + 1).expect("a node number")
}

fn scale(axis: AxisId) -> AxisScale {
    AxisScale::new(&ScaleSettings {
        lead: Position::mm(10.0),
        motor_counts_per_rev: SHEET.motor_counts_per_rev,
        // One of the axes counts backwards: signs must cancel out.
        motor_sense: if axis == Y { Sense::Against } else { Sense::Along },
        table_counts_per_mm: Some(SHEET.table_counts_per_mm),
        table_sense: Sense::Along,
    })
}

/// Two boards that move steadily, behind a bus whose `receive` lets them answer.
struct Machine {
    end: memory::End,
    boards: [Board; 2],
    cycle: u32,
}

impl Machine {
    /// Way of the motor encoder of `axis` since the boards had power.
    fn motor(&self, axis: AxisId) -> TravelCounts {
        TravelCounts::counts(i64::from(self.cycle) * COUNTS_PER_PERIOD * (1 - 2 * axis.index() as i64))
    }
    fn serve(&mut self, now: Moment) {
        while let Some(Received { frame, .. }) = self.end.receive(now) {
            if let Ok(cycle) = command::decode_sync(&frame) {
                self.cycle = cycle;
            }
            for axis in [X, Y] {
                let motor = self.motor(axis);
                let current = self.boards[axis.index()].current_to_apply();
                let measured = Measured { motor, table: motor, current };
                let board = &mut self.boards[axis.index()];
                match Address::of(frame.id()) {
                    Some(Address::Sync) => board.latch(self.cycle, measured, now),
                    _ => board.hear(&frame, now),
                }
            }
        }
        for board in &mut self.boards {
            board.advance(now);
            while let Some(frame) = board.speak() {
                // A host that does not listen loses frames, as on a real bus.
                let _lost_when_full = self.end.send(&frame);
            }
        }
    }
}

/// A bus with the machine at its other end.
struct Wired<B> {
    bus: B,
    machine: Machine,
}

impl<B: Bus> Bus for Wired<B> {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.bus.send(frame)
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        self.machine.serve(until);
        self.bus.receive(until)
    }
}

fn settings(sheet: Sheet) -> PerAxis<DriveSettings> {
    PerAxis::from_fn(2, |axis| DriveSettings {
        node: node(axis),
        sheet,
        serial: Some(100 + axis.index() as u32),
        scale: scale(axis),
        velocity_estimate: VelocityEstimate::Difference,
    })
}

/// Host, bus and machine, stepped one period at a time.
struct Rig {
    drives: Drives<Operational>,
    wired: Wired<Faulty<memory::End>>,
    cycle: u64,
    sent_control_word: [u16; 2],
    seen: PerAxis<Observation>,
}

fn wired(sheet: Sheet, capacity: usize, seed: u64) -> Wired<Faulty<memory::End>> {
    let (host, end) = memory::pair(capacity);
    // Encoders start just before their wrap.
    let boards = [X, Y].map(|axis| {
        let start = EncoderCounts::counts(if axis == X { u32::MAX - 9_000 } else { 9_000 });
        Board::new(node(axis), sheet, 100 + axis.index() as u32, start, start, Moment::ZERO)
    });
    let machine = Machine { end, boards, cycle: 0 };
    Wired { bus: Faulty::new(host, seed, Faults::NONE, Faults::NONE), machine }
}

fn commission<B: Bus>(wired: &mut Wired<B>, expected: Sheet) -> Result<Drives<Operational>, CommissionError> {
    let mut now = Moment::ZERO;
    let clock = || {
        now = now + Span::us(100);
        now
    };
    let patience = CommissionSettings { reply_timeout: Span::ms(5), tries: 2 };
    Drives::new(PERIOD, settings(expected)).expect("two nodes").commission(wired, patience, clock)
}

impl Rig {
    fn new(sheet: Sheet) -> Self {
        let mut wired = wired(sheet, 64, 7);
        let drives = commission(&mut wired, sheet).unwrap_or_else(|error| panic!("{error}"));
        // Cycles start after commissioning, on the same clock.
        Self {
            drives,
            wired,
            cycle: 1_000,
            sent_control_word: [0; 2],
            seen: PerAxis::filled(2, Observation::default()),
        }
    }
    fn until(&self) -> Moment {
        Moment::ZERO + PERIOD * self.cycle as i64
    }
    fn collect(&mut self) -> PerAxis<Observation> {
        self.cycle += 1;
        let until = self.until();
        self.seen = self.drives.collect(&mut self.wired, self.cycle, until);
        self.seen
    }
    fn dispatch(&mut self, current: Current, target: Target) {
        let seen = self.seen;
        let commands = PerAxis::from_fn(2, |axis| Command {
            current,
            control_word: control_word(seen[axis].drive, target, self.sent_control_word[axis.index()]),
            ..Command::default()
        });
        self.sent_control_word = [X, Y].map(|axis| commands[axis].control_word);
        self.drives.dispatch(&mut self.wired, &commands, self.cycle).expect("room for two frames");
    }
    /// Whole periods towards `target`.
    fn run(&mut self, periods: usize, current: Current, target: Target) -> PerAxis<Observation> {
        for _ in 0..periods {
            self.collect();
            self.dispatch(current, target);
        }
        self.collect()
    }
    fn board(&mut self, axis: AxisId) -> &mut Board {
        &mut self.wired.machine.boards[axis.index()]
    }
    fn state(&mut self, axis: AxisId) -> DriveState {
        self.board(axis).drive()
    }
    fn applied(&mut self, axis: AxisId) -> Current {
        scale(axis).current(self.board(axis).current_to_apply())
    }
}

const AMPERE: Current = Current::a(1.0);

// Commissioning.

#[test]
fn boards_that_are_what_their_sheets_say_are_accepted() {
    assert!(commission(&mut wired(SHEET, 64, 0), SHEET).is_ok());
}

#[rstest]
#[case(Object::Vendor, 7, "axis y: vendor (object 1018:1) of node 2 is 7, expected 20804")]
#[case(Object::Serial, 9, "axis y: serial (object 1018:4) of node 2 is 9, expected 101")]
fn a_wrong_board_is_named_with_both_values(
    #[case] object: Object,
    #[case] value: u32,
    #[case] message: &str,
) {
    let mut wired = wired(SHEET, 64, 0);
    wired.machine.boards[1].pretend(object, value);
    let error = commission(&mut wired, SHEET).expect_err("one board is wrong");
    assert_eq!(error.to_string(), message);
}

#[test]
fn a_wrong_value_inside_a_board_is_found_by_the_hash_and_named() {
    let loose = Sheet { watchdog_us: 9_000, ..SHEET };
    let error = commission(&mut wired(loose, 64, 0), SHEET).expect_err("the watchdogs differ");
    assert_eq!(error.to_string(), "axis x: watchdog (object 2001:0) of node 1 is 9000 us, expected 5000 us");
}

#[test]
fn a_hash_that_differs_alone_is_refused_too() {
    let mut wired = wired(SHEET, 64, 0);
    wired.machine.boards[0].pretend(Object::FirmwareConfigHash, 0);
    let error = commission(&mut wired, SHEET).expect_err("the hash differs");
    assert!(matches!(error, CommissionError::HashDiffers { axis: X, got: 0, .. }), "{error}");
}

#[test]
fn a_silent_board_is_named_with_the_patience_it_was_given() {
    let mut wired = wired(SHEET, 64, 0);
    wired.machine.boards[1].set_silent(true);
    let error = commission(&mut wired, SHEET).expect_err("one board is silent");
    assert_eq!(
        error.to_string(),
        "axis y: node 2 did not tell vendor (object 1018:1), 2 times asked and 5 ms waited each time"
    );
}

#[test]
fn a_lost_reply_is_asked_for_again() {
    let mut wired = wired(SHEET, 64, 3);
    let lossy = Faults { drop: 0.2, ..Faults::NONE };
    wired.bus.set(lossy, lossy);
    let outcomes: Vec<_> = (0..20).map(|_| commission(&mut wired, SHEET)).collect();
    assert!(outcomes.iter().any(Result::is_ok), "a loss of 20 % must be survived at least once in 20");
    let (received, sent) = wired.bus.counts();
    assert!(received.dropped > 0 && sent.dropped > 0);
    assert!(outcomes.iter().all(|o| matches!(o, Ok(_) | Err(CommissionError::NoReply { .. }))));
}

#[test]
fn two_axes_on_one_board_are_refused() {
    let mut same = settings(SHEET);
    same[Y].node = same[X].node;
    let error = Drives::new(PERIOD, same).expect_err("one node for two axes");
    assert_eq!(error.to_string(), "axes x and y are both node 1");
}

// Samples.

/// Position of an axis `cycle` periods after power, relative to the cycle it was first heard in.
fn true_position(axis: AxisId, cycle: u64, first: u64) -> Position {
    let travel = (cycle - first) as i64 * COUNTS_PER_PERIOD * (1 - 2 * axis.index() as i64);
    scale(axis).motor_position(TravelCounts::counts(travel))
}

#[test]
fn positions_start_at_zero_and_go_on_over_the_wrap() {
    let mut rig = Rig::new(SHEET);
    let first = rig.cycle + 1;
    for _ in 0..20 {
        let seen = rig.collect();
        for (axis, observation) in seen.iter() {
            let sample = observation.sample;
            assert_eq!(sample.freshness, Freshness::Fresh);
            assert_eq!(sample.position, true_position(axis, rig.cycle, first), "axis {axis}");
            assert!(sample.position >= Position::ZERO, "both axes move upwards, one counts backwards");
        }
    }
    let velocity = rig.seen[Y].sample.velocity;
    assert!((velocity.as_m_per_s() - 0.1).abs() < 1e-4, "{velocity}, expected 0.1 m/s within 0.0001 m/s");
    assert_eq!(rig.seen[X].sample.table_position, Position::m(19.0 * COUNTS_PER_PERIOD as f64 * 1e-8));
}

#[rstest]
#[case::drop(Faults { drop: 0.3, ..Faults::NONE })]
#[case::delay(Faults { delay: (0.3, Span::us(500)), ..Faults::NONE })]
#[case::long_delay(Faults { delay: (0.3, Span::us(3_500)), ..Faults::NONE })]
#[case::repeat(Faults { repeat: 0.5, ..Faults::NONE })]
#[case::reorder(Faults { reorder: 0.3, ..Faults::NONE })]
#[case::all(Faults { drop: 0.1, delay: (0.1, Span::us(1_000)), repeat: 0.1, reorder: 0.1, ..Faults::NONE })]
fn a_bad_bus_makes_samples_old_but_never_wrong(#[case] faults: Faults) {
    let mut rig = Rig::new(SHEET);
    let first = rig.cycle + 1;
    rig.collect();
    rig.wired.bus.set(faults, Faults { drop: faults.drop, ..Faults::NONE });
    let (mut stale, mut last) = ([0_u64; 2], rig.seen);
    for _ in 0..3_000 {
        let seen = rig.collect();
        for (axis, Observation { sample, .. }) in seen.iter() {
            match sample.freshness {
                Freshness::Fresh => {
                    assert_eq!(sample.position, true_position(axis, rig.cycle, first), "cycle {}", rig.cycle);
                    assert_eq!(sample.age_cycles, 0);
                }
                Freshness::Stale => {
                    stale[axis.index()] += 1;
                    assert_eq!(sample.age_cycles, last[axis].sample.age_cycles + 1, "ages by one a cycle");
                    assert_eq!(sample.raw, last[axis].sample.raw, "keeps the last values");
                    let heard = rig.cycle - u64::from(sample.age_cycles);
                    assert_eq!(
                        sample.position,
                        true_position(axis, heard, first),
                        "age tells when it was so"
                    );
                }
                Freshness::Never => panic!("axis {axis} was heard before"),
            }
            if rig.cycle > first {
                // One count in one period is 2e-5 m/s at 9.5 nm.
                let error_m_per_s = sample.velocity.as_m_per_s() - 0.1;
                assert!(
                    error_m_per_s.abs() < 1e-4 || sample.velocity.as_m_per_s() == 0.0,
                    "{error_m_per_s} m/s off"
                );
            }
        }
        last = seen;
    }
    let counts = rig.drives.counts();
    for (axis, counts) in counts.iter() {
        assert_eq!(counts.missed, stale[axis.index()], "axis {axis}");
        assert_eq!(counts.fresh + counts.missed, 3_001, "axis {axis}: every cycle is one or the other");
    }
    let happened = rig.wired.bus.counts().0;
    assert!(
        happened.dropped + happened.delayed + happened.repeated + happened.reordered > 300,
        "{happened:?}"
    );
    if faults.delay.0 > 0.2 {
        assert!(counts[X].late > 100, "{:?}", counts[X]);
    }
    if faults.repeat > 0.4 {
        assert!(counts[X].repeated > 100 && counts[X].missed == 0, "{:?}", counts[X]);
    }
}

#[test]
fn flipped_bits_are_survived_and_every_cycle_is_accounted_for() {
    let mut rig = Rig::new(SHEET);
    rig.wired.bus.set(Faults { flip_bit: 0.5, ..Faults::NONE }, Faults { flip_bit: 0.5, ..Faults::NONE });
    for _ in 0..3_000 {
        rig.collect();
        rig.dispatch(AMPERE, Target::Enabled);
    }
    let counts = rig.drives.counts()[X];
    assert_eq!(counts.fresh + counts.missed, 3_000);
    assert!(counts.late > 50, "a flipped cycle is an answer to another SYNC: {counts:?}");
}

#[test]
fn a_stale_sample_is_right_again_after_travel_of_nearly_half_the_range() {
    let mut rig = Rig::new(SHEET);
    let first = rig.cycle + 1;
    rig.collect();
    let gap = i64::from(i32::MAX) / COUNTS_PER_PERIOD;
    rig.cycle += gap as u64 - 1;
    let sample = rig.collect()[X].sample;
    assert_eq!(sample.position, true_position(X, first + gap as u64, first));
    let error_m_per_s = sample.velocity.as_m_per_s() - 0.1;
    assert!(error_m_per_s.abs() < 1e-4, "skipped periods count: {error_m_per_s} m/s off, bound 0.0001 m/s");
}

#[test]
fn before_the_first_answer_there_is_no_sample_and_waiting_has_an_age() {
    let mut rig = Rig::new(SHEET);
    rig.board(Y).set_silent(true);
    let seen = rig.run(9, Current::ZERO, Target::Disabled);
    assert_eq!((seen[Y].sample.freshness, seen[Y].sample.age_cycles), (Freshness::Never, 9));
    assert_eq!(seen[Y].drive, None);
    assert_eq!(seen[X].sample.freshness, Freshness::Fresh, "one silent board does not take the other along");
}

#[test]
fn frames_of_strangers_are_counted_and_change_nothing() {
    let mut rig = Rig::new(SHEET);
    let before = rig.collect();
    let stranger = Node::new(9).expect("a node number");
    for frame in [
        command::encode(stranger, &RawCommand::default()),
        Frame::classic(Address::Feedback(stranger).id(), [0; 8]),
        Frame::classic(Id::from_low_bits(0x000), [1, 0]),
    ] {
        rig.wired.machine.end.send(&frame).expect("room for a frame");
    }
    rig.wired
        .machine
        .end
        .send(&Frame::classic(Address::Feedback(node(X)).id(), [0; 8]))
        .expect("room for a frame");
    let seen = rig.collect();
    assert_eq!(rig.drives.foreign_frames(), 3);
    assert_eq!(rig.drives.counts()[X].malformed, 1, "a feedback frame of 8 bytes");
    assert_eq!(seen[X].sample.raw.sequence, before[X].sample.raw.sequence + 1);
}

/// A bus on which a stranger never stops talking.
struct Flooded;

impl Bus for Flooded {
    fn send(&mut self, _: &Frame) -> Result<(), SendError> {
        Ok(())
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        Some(Received { frame: Frame::classic(Id::MAX, []), at: until })
    }
}

#[test]
fn a_flooded_bus_cannot_hold_the_cycle() {
    let mut drives = Rig::new(SHEET).drives;
    let seen = drives.collect(&mut Flooded, 1, Moment::ZERO);
    assert_eq!(seen[X].sample.freshness, Freshness::Never);
    assert_eq!(drives.foreign_frames(), 64, "32 frames an axis");
}

#[test]
fn a_sync_the_bus_refuses_is_reported_on_every_axis() {
    let mut rig = Rig::new(SHEET);
    rig.collect();
    let filler = Frame::classic(Id::MAX, []);
    while rig.wired.bus.send(&filler).is_ok() {}
    let seen = rig.collect();
    assert!(seen[X].events.is_sync_refused && seen[Y].events.is_sync_refused);
    assert_eq!(seen[X].sample.freshness, Freshness::Stale);
    assert!(!rig.collect()[X].events.is_sync_refused, "the bus has room again");
}

// Drives and their boards.

#[rstest]
#[case(CommandApplies::OnReceipt)]
#[case(CommandApplies::OnNextSync)]
fn a_command_acts_when_the_sheet_says(#[case] command_applies: CommandApplies) {
    let mut rig = Rig::new(Sheet { command_applies, ..SHEET });
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

#[test]
fn no_current_flows_unless_operation_is_enabled() {
    let mut rig = Rig::new(SHEET);
    for target in [Target::Enabled, Target::QuickStop, Target::Enabled, Target::Disabled] {
        for _ in 0..10 {
            rig.run(1, AMPERE, target);
            let expected = if rig.state(X) == DriveState::OperationEnabled { AMPERE } else { Current::ZERO };
            assert_eq!(rig.applied(X), expected, "in {:?} on the way to {target:?}", rig.state(X));
        }
    }
    assert_eq!(rig.state(X), DriveState::SwitchOnDisabled);
}

#[test]
fn without_fresh_commands_the_board_takes_the_current_away_and_says_so() {
    let mut rig = Rig::new(SHEET);
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

#[test]
fn a_tripped_watchdog_stays_tripped_until_it_is_told_to_disable() {
    let mut rig = Rig::new(SHEET);
    rig.run(10, AMPERE, Target::Enabled);
    (0..15).for_each(|_| _ = rig.collect());
    // A host that goes on as if nothing had happened.
    let enable = PerAxis::filled(2, Command { current: AMPERE, control_word: 0x0F, ..Command::default() });
    for _ in 0..10 {
        rig.drives.dispatch(&mut rig.wired, &enable, rig.cycle).expect("room for two frames");
        let seen = rig.collect();
        assert!(seen[X].events.board_flags.contains(BoardFlags::WATCHDOG_TRIPPED));
        assert_eq!(rig.applied(X), Current::ZERO);
    }
    let seen = rig.run(2, AMPERE, Target::Disabled);
    assert!(!seen[X].events.board_flags.contains(BoardFlags::WATCHDOG_TRIPPED));
    rig.run(8, AMPERE, Target::Enabled);
    assert_eq!(rig.applied(X), AMPERE);
}

#[test]
fn a_repeated_command_does_not_feed_the_watchdog() {
    let mut rig = Rig::new(SHEET);
    rig.run(10, AMPERE, Target::Enabled);
    let raw = RawCommand {
        current: CurrentCounts::ua(1_000_000),
        control_word: 0x0F,
        sequence: 77,
        mode_of_operation: command::CYCLIC_SYNCHRONOUS_TORQUE,
        ..RawCommand::default()
    };
    for _ in 0..15 {
        rig.wired.send(&command::encode(node(X), &raw)).expect("room for a frame");
        rig.collect();
    }
    assert_eq!(rig.applied(X), Current::ZERO);
    assert_eq!(rig.state(X), DriveState::QuickStopActive);
}

#[test]
fn a_drive_fault_is_told_with_its_code_and_left_by_a_reset_only() {
    let mut rig = Rig::new(SHEET);
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
fn a_board_reset_is_told_once_and_leaves_no_current(#[case] is_message_lost: bool) {
    let mut rig = Rig::new(SHEET);
    rig.run(30, AMPERE, Target::Enabled);
    let now = rig.until();
    rig.board(X).set_silent(is_message_lost);
    rig.board(X).reset(now);
    rig.board(X).set_silent(false);
    assert_eq!(rig.applied(X), Current::ZERO);
    // The next heartbeat comes within 10 ms: 20 periods.
    let told = (0..25).filter(|_| rig.collect()[X].events.is_board_reset).count();
    assert_eq!((told, rig.drives.counts()[X].resets, rig.drives.counts()[Y].resets), (1, 1, 0));
    assert_eq!(rig.seen[X].drive, Some(DriveState::SwitchOnDisabled));
}

#[test]
fn a_silent_board_ages_in_feedback_and_heartbeat() {
    let mut rig = Rig::new(SHEET);
    rig.run(40, Current::ZERO, Target::Disabled);
    let age = rig.seen[X].events.heartbeat_age;
    assert!(age <= SHEET.heartbeat_period() + PERIOD * 2, "heartbeat {} us old while it beats", age.as_us());
    rig.board(X).set_silent(true);
    let seen = rig.run(39, Current::ZERO, Target::Disabled);
    assert_eq!((seen[X].sample.freshness, seen[X].sample.age_cycles), (Freshness::Stale, 40));
    assert!(seen[X].events.heartbeat_age >= PERIOD * 40, "{} us", seen[X].events.heartbeat_age.as_us());
    assert!(seen[Y].events.heartbeat_age <= SHEET.heartbeat_period() + PERIOD * 2);
}

#[test]
fn a_current_above_the_peak_is_held_there_and_flagged() {
    let mut rig = Rig::new(SHEET);
    let seen = rig.run(10, Current::a(26.0), Target::Enabled);
    assert!(seen[X].events.board_flags.contains(BoardFlags::CURRENT_SATURATED));
    assert_eq!(rig.applied(X), Current::a(25.0));
    assert!(
        !rig.run(2, AMPERE, Target::Enabled)[X].events.board_flags.contains(BoardFlags::CURRENT_SATURATED)
    );
}

#[test]
fn an_encoder_error_is_flagged_and_its_counts_stand_still() {
    let mut rig = Rig::new(SHEET);
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

#[test]
fn a_frozen_encoder_stands_still_and_a_jump_shows_in_one_period() {
    let mut rig = Rig::new(SHEET);
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
    let mut rig = Rig::new(SHEET);
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

#[test]
fn the_same_faults_give_the_same_observations() {
    let run = || {
        let mut rig = Rig::new(SHEET);
        rig.wired.bus.set(Faults { drop: 0.2, repeat: 0.2, ..Faults::NONE }, Faults::NONE);
        (0..500).map(|_| rig.collect()).collect::<Vec<_>>()
    };
    assert!(run() == run(), "two runs with one seed differ");
}
