//! Promise: an excited motion is a motion like others. The command never jumps, no limit is passed, a stop
//! takes it back along its path, a fault ends it, and what would not fit is not begun. What was excited stands
//! in the record.

use quadrant::base::axis::AxisId;
use quadrant::base::command::Limits;
use quadrant::base::fault::Fault;
use quadrant::base::order::ExcitedMotion;
use quadrant::base::record::{CycleRecord, ModeTag};
use quadrant::base::time::Span;
use quadrant::base::units::{Acceleration, Position, Velocity};
use quadrant::config::Machine;
use quadrant::rt::door::Order;
use rstest::rstest;

use crate::common::{Fate, Rig, X, Y, machine, machine_with};

/// Cycles until the evaluated part begins: rise of the speed, then two periods, at 2 kHz.
const FULL: u64 = 2_150;

fn started(machine: Machine) -> Rig {
    let mut rig = Rig::new(machine, 4);
    rig.enable();
    let order = Order::Excited(rig.excited_to(120.0, 20.0));
    rig.order(order);
    rig.run_until(ModeTag::Moving, 8);
    rig
}

/// Until no axis moves any more.
fn to_the_end(rig: &mut Rig, end: ModeTag) -> Vec<CycleRecord> {
    let mut rows = vec![rig.last];
    while rig.last.axes.as_slice().iter().any(|axis| axis.mode != end) {
        rows.push(*rig.step());
        assert!(rows.len() < 80_000, "{:?}", rig.modes());
    }
    rows
}

/// Largest change of what is excited from one cycle to the next, mm/s.
fn largest_step(rows: &[CycleRecord]) -> f64 {
    let excitation = |row: &CycleRecord| row.axes[X].command.terms.excitation.as_mm_per_s();
    rows.windows(2).map(|pair| (excitation(&pair[1]) - excitation(&pair[0])).abs()).fold(0.0, f64::max)
}

#[test]
fn an_excited_line_comes_in_and_goes_without_a_jump() {
    let mut rig = started(machine("reference"));
    let motion = rig.excited_to(120.0, 20.0);
    let rows = to_the_end(&mut rig, ModeTag::Ready);
    assert_eq!(rows.iter().filter(|row| row.stage.is_measured).count(), 2_000, "two periods of 0.5 s");
    assert_eq!(rows.last().map(|row| row.stage.motion), Some(1));
    // The steepest sum of the lines, in a tick.
    let bound = motion.excitation.acceleration_max().as_m_per_s2() * 0.5;
    let step = largest_step(&rows);
    assert!(step < bound, "steps of {step} mm/s, bound {bound} mm/s");
    let most = rows.iter().map(|row| row.axes[X].command.terms.excitation.as_mm_per_s()).fold(0.0, f64::max);
    assert!((1.0..motion.excitation.velocity_max().as_mm_per_s()).contains(&most), "{most} mm/s");
    for row in &rows {
        let (x, y) = (&row.axes[X], &row.axes[Y]);
        assert_eq!((x.fault, y.fault), (None, None));
        assert_eq!(y.command.terms.excitation, Velocity::ZERO);
        let acted = x.command.limits.with(y.command.limits);
        assert!(!acted.contains(Limits::VELOCITY) && !acted.contains(Limits::ACCELERATION), "{row:?}");
        let off_um = (x.sample.position - x.command.terms.expected_position).as_um().abs();
        assert!(off_um < 100.0, "{off_um} um from the expected response in cycle {}", row.cycle);
    }
    let [first, last] = [0, rows.len() - 1].map(|at| rows[at].axes[X].command.terms.excitation);
    assert_eq!((first, last), (Velocity::ZERO, Velocity::ZERO));
    // The table slides all the while: friction stays on its flat part.
    let slowest = rows.iter().filter(|row| row.stage.is_measured);
    let slowest = slowest.map(|row| row.axes[X].sample.velocity.as_mm_per_s()).fold(f64::MAX, f64::min);
    assert!(slowest > 10.0, "{slowest} mm/s");
}

#[rstest]
#[case::stopped(Order::Stop, ModeTag::Ready)]
#[case::disabled(Order::Disable, ModeTag::Off)]
fn a_stop_in_the_middle_takes_it_back_with_the_speed(#[case] order: Order, #[case] end: ModeTag) {
    let mut rig = started(machine("reference"));
    rig.run(FULL + 400);
    assert!(rig.last.stage.is_measured);
    let share = rig.excited_to(120.0, 20.0).excitation.acceleration_max().as_m_per_s2() * 0.5;
    rig.order(order);
    let rows = to_the_end(&mut rig, end);
    // 20 mm/s at 0.5 m/s^2 as a raised cosine: 63 ms; then the axis settles.
    let still_excited = rows.iter().filter(|row| row.axes[X].command.terms.excitation != Velocity::ZERO);
    let still_excited = still_excited.count();
    assert!((100..140).contains(&still_excited), "{still_excited} cycles of 0.5 ms");
    // With a sixth of the time left the speed is 6 % of what it was, and so is the strength.
    let late = rows.iter().take(still_excited).skip(still_excited - 20);
    let left = late.map(|row| row.axes[X].command.terms.excitation.as_mm_per_s().abs()).fold(0.0, f64::max);
    assert!(left < 0.3, "{left} mm/s left");
    let step = largest_step(&rows);
    assert!(step < 1.2 * share, "steps of {step} mm/s, in the motion at most {share} mm/s");
    let on_path = rows.iter().filter(|row| row.axes[X].mode != ModeTag::Off);
    let setpoints: Vec<f64> = on_path.map(|row| row.axes[X].setpoint.position.as_mm()).collect();
    assert!(setpoints.is_sorted(), "along the path");
    assert!(rows.iter().skip(8).all(|row| !row.stage.is_measured && row.axes[X].fault.is_none()));
}

#[test]
fn a_fault_in_the_middle_ends_it_and_nothing_is_left_for_the_next_motion() {
    let mut rig = started(machine("reference"));
    rig.run(FULL + 400);
    rig.line.wired.rack_mut().board_mut(Y).trip_drive(0x2310, 0);
    let rows = to_the_end(&mut rig, ModeTag::Faulted);
    assert_eq!(rig.axis(Y).fault, Some(Fault::DriveFault));
    assert_eq!(rig.axis(X).fault, Some(Fault::OtherAxis));
    let step = largest_step(&rows[..rows.len() - 1]);
    assert!(step < 3.0, "x is ramped out with steps of {step} mm/s");
    rig.run(200);
    assert_eq!(rig.axis(X).command.terms.excitation, Velocity::ZERO);
    rig.order(Order::ClearFaults);
    rig.run_until(ModeTag::Off, 2_000);
    rig.run(200);
    rig.enable();
    let order = rig.line_to(60.0, 40.0);
    rig.order(order);
    rig.run_until(ModeTag::Moving, 8);
    let rows = to_the_end(&mut rig, ModeTag::Ready);
    assert!(rows.iter().all(|row| row.axes[X].command.terms.excitation == Velocity::ZERO));
}

#[test]
fn periods_that_are_lost_make_no_jump() {
    let mut rig = started(machine("reference"));
    rig.run(FULL);
    let mut frames = 0_u32;
    rig.line.incoming = Box::new(move |_| {
        frames += 1;
        if frames.is_multiple_of(151) { Fate::Lost } else { Fate::Pass }
    });
    let limit = rig.machine.axes[X].control.limits.acceleration.as_m_per_s2();
    for turn in 0..300 {
        rig.skip(u64::from(turn % 60 == 0) * 3);
        let before = rig.axis(X).command.terms.excitation;
        rig.step();
        let step = (rig.axis(X).command.terms.excitation - before).as_mm_per_s().abs();
        // At most three skipped, one lost and the present one.
        assert!(step <= limit * 0.5 * 5.0, "{step} mm/s in turn {turn}");
        assert_eq!(rig.axis(X).fault, None, "turn {turn}");
    }
}

/// One line so slow and strong that the axis is driven 0.8 mm to each side: more than the usual distance from
/// a response that would not know of it.
fn wide(rig: &Rig) -> ExcitedMotion {
    let mut motion = rig.excited_to(200.0, 12.0);
    motion.excitation.amplitude = Velocity::mm_per_s(7.5);
    motion.excitation.period = Span::ms(1_000);
    (motion.excitation.harmonic_min, motion.excitation.harmonic_max) = (2, 2);
    motion.excitation.lines = 1;
    motion
}

#[test]
fn the_following_error_is_that_of_the_excited_response() {
    // 7.5 mm/s at 2 Hz are 0.6 mm to each side; the limit is 0.61 mm.
    let tight = machine_with("reference", &[("following-error-mm = 1.0", "following-error-mm = 0.61")]);
    let mut rig = Rig::new(tight, 4);
    rig.enable();
    let order = Order::Excited(wide(&rig));
    rig.order(order);
    rig.run_until(ModeTag::Moving, 8);
    let rows = to_the_end(&mut rig, ModeTag::Ready);
    let off = |row: &CycleRecord| row.axes[X].sample.position - row.axes[X].command.terms.expected_position;
    let worst_um = rows.iter().map(|row| off(row).as_um().abs()).fold(0.0, f64::max);
    assert!(worst_um < 150.0, "{worst_um} um from the response that is expected");

    // And it is no cover for an axis that does not follow.
    let order = Order::Excited(ExcitedMotion { line: rig.excited_to(-150.0, 12.0).line, ..wide(&rig) });
    rig.order(order);
    rig.run_until(ModeTag::Moving, 8);
    rig.run(4_000);
    rig.line.wired.rack_mut().board_mut(X).set_encoder_frozen(true);
    let frozen_at = rig.state(X).motor_position;
    while rig.axis(X).fault.is_none() {
        rig.step();
        let gone_mm = (rig.state(X).motor_position - frozen_at).as_mm().abs();
        assert!(gone_mm < 0.61, "{gone_mm} mm gone behind a frozen encoder");
    }
    assert!(
        matches!(rig.axis(X).fault, Some(Fault::FollowingError | Fault::NoResponse)),
        "{:?}",
        rig.modes()
    );
}

#[test]
fn what_would_break_a_limit_is_not_begun() {
    let mut rig = Rig::new(machine("reference"), 4);
    rig.enable();
    let good = rig.excited_to(120.0, 20.0);
    type Spoil = fn(&mut ExcitedMotion);
    let bad: [(&str, Spoil); 8] = [
        ("velocity", |motion| {
            motion.line.feed = Velocity::mm_per_s(245.0);
            motion.line.target[X] = Position::mm(240.0);
            motion.line.acceleration = Acceleration::m_per_s2(5.0);
            motion.excitation.period = Span::ms(100);
            motion.excitation.repeats = 1;
        }),
        ("acceleration", |motion| motion.excitation.amplitude = Velocity::mm_per_s(1.0)),
        ("displacement and current", |motion| {
            motion.excitation.lines = 1;
            motion.excitation.harmonic_max = 4;
            motion.excitation.amplitude = Velocity::mm_per_s(60.0);
        }),
        ("half of the rate", |motion| motion.excitation.harmonic_max = 500),
        ("ticks", |motion| motion.excitation.period = Span::us(500_100)),
        ("way too short", |motion| motion.line.target[X] = Position::mm(40.0)),
        ("no such axis", |motion| motion.excitation.axis = AxisId::new(2)),
        ("no way", |motion| motion.line.target[X] = Position::ZERO),
    ];
    for (what, spoil) in bad {
        let mut motion = good;
        motion.line.target[Y] = rig.axis(Y).setpoint.position;
        spoil(&mut motion);
        rig.order(Order::Excited(motion));
        rig.run(40);
        assert_eq!((rig.last.stage.motion, rig.axis(X).mode), (0, ModeTag::Ready), "{what}");
    }
    rig.order(Order::Excited(good));
    rig.run_until(ModeTag::Moving, 8);
    assert_eq!(rig.last.stage.motion, 1);
}
