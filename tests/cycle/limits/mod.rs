//! Promise: on every cycle of whatever is ordered and whatever fails, each axis keeps its limits, says
//! which of them acted, lets no NaN out and no current flow that its mode does not allow. Enabling and
//! swapping gains are bumpless; orders that do not fit are ignored.

mod watch;

use proptest::prelude::*;
use proptest::test_runner::{RngSeed, TestCaseError};
use quadrant::base::axis::PerAxis;
use quadrant::base::command::Limits;
use quadrant::base::motion::Direction;
use quadrant::base::order::{Excitation, ExcitedMotion};
use quadrant::base::record::{CycleRecord, ModeTag};
use quadrant::base::time::Span;
use quadrant::base::units::{Acceleration, Position, Velocity};
use quadrant::rt::control::profile::LineMotion;
use quadrant::rt::door::Order;
use quadrant::rt::wire::Address;
use quadrant::rt::wire::scaling::TravelCounts;
use watch::Watch;

use crate::common::{Fate, Rig, X, Y, circle, machine_with};

/// Limits so tight that ordinary motions meet them.
const TIGHT: &[(&str, &str)] = &[
    ("velocity-mm-per-s = 250.0", "velocity-mm-per-s = 60.0"),
    ("acceleration-m-per-s2 = 5.0", "acceleration-m-per-s2 = 0.3"),
    ("current-a = 20.0", "current-a = 4.0"),
    ("travel-max-mm = 250.0", "travel-max-mm = 15.0"),
    ("following-error-mm = 1.0", "following-error-mm = 8.0"),
    ("positioning-feed-mm-per-min = 6000.0", "positioning-feed-mm-per-min = 3600.0"),
    ("path-acceleration-m-per-s2 = 0.5", "path-acceleration-m-per-s2 = 0.3"),
];

/// Something that happens to a machine, and for how many cycles it is watched then.
#[derive(Clone, Debug)]
enum Event {
    Order(u8, f64, f64),
    Fail(u8, bool),
    Skip(u64),
}

fn events() -> impl Strategy<Value = Vec<(Event, u64)>> {
    let odd =
        prop_oneof![4 => -40.0..40.0_f64, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY), 1 => Just(0.0)];
    let feed = prop_oneof![6 => 1.0..150.0_f64, 1 => Just(f64::NAN), 1 => Just(-5.0)];
    let event = prop_oneof![
        6 => (0_u8..9, odd, feed).prop_map(|(kind, place, feed)| Event::Order(kind, place, feed)),
        1 => (0_u8..6, any::<bool>()).prop_map(|(kind, on)| Event::Fail(kind, on)),
        1 => (1_u64..12).prop_map(Event::Skip),
    ];
    prop::collection::vec((event, 1_u64..400), 1..24)
}

fn order(rig: &Rig, kind: u8, place_mm: f64, feed_mm_per_s: f64) -> Order {
    match kind {
        0 => Order::Enable,
        1 => Order::Disable,
        2 => Order::Stop,
        3 => Order::ClearFaults,
        4 => Order::UseGains((place_mm.abs() as u8) % 4),
        5 => {
            let mut motion = circle(feed_mm_per_s * 60.0, Direction::Cw);
            let [x, y] = [X, Y].map(|axis| rig.axis(axis).setpoint.position);
            motion.circle.radius = Position::mm(place_mm.abs() * 0.5);
            // Put its start where the axes stand, so that it is not always refused.
            let (start_x, start_y) = motion.start();
            (motion.circle.centre_x, motion.circle.centre_y) = (x - start_x, y - start_y);
            Order::Circle(motion)
        }
        6 | 7 => Order::Line(line(rig, place_mm, feed_mm_per_s)),
        // Sometimes within the limits, sometimes not.
        _ => Order::Excited(ExcitedMotion {
            line: line(rig, place_mm, feed_mm_per_s.min(20.0)),
            excitation: Excitation {
                axis: [X, Y][usize::from(place_mm > 0.0)],
                amplitude: Velocity::mm_per_s(feed_mm_per_s * 0.05),
                period: Span::ms(50),
                harmonic_min: 1,
                harmonic_max: 4,
                lines: 3,
                repeats: 1,
            },
        }),
    }
}

fn line(rig: &Rig, place_mm: f64, feed_mm_per_s: f64) -> LineMotion {
    LineMotion {
        target: PerAxis::from_fn(rig.machine.axes.count(), |axis| {
            Position::mm(place_mm * [1.0, -0.4][axis.index() % 2])
        }),
        feed: Velocity::mm_per_s(feed_mm_per_s),
        acceleration: Acceleration::m_per_s2(0.5),
    }
}

fn happen(rig: &mut Rig, event: &Event) {
    match *event {
        Event::Order(kind, place_mm, feed_mm_per_s) => {
            let order = order(rig, kind, place_mm, feed_mm_per_s);
            rig.order(order);
        }
        Event::Skip(periods) => rig.skip(periods),
        Event::Fail(kind, is_on) => {
            let board = rig.line.wired.rack_mut().board_mut(X);
            match kind {
                0 => board.set_silent(is_on),
                1 => board.set_encoder_frozen(is_on),
                2 => board.trip_drive(0x2310, 0),
                3 => board.jump_encoder(TravelCounts::counts(if is_on { 900 } else { -40_000 })),
                4 => {
                    rig.line.outgoing = Box::new(move |frame| match Address::of(frame.id()) {
                        Some(Address::Command(_)) if is_on => Fate::Lost,
                        _ => Fate::Pass,
                    });
                }
                _ => {
                    let mut count = 0_u32;
                    rig.line.incoming = Box::new(move |_| {
                        count += 1;
                        if is_on && count.is_multiple_of(5) { Fate::Lost } else { Fate::Pass }
                    });
                }
            }
        }
    }
}

fn keeps_its_limits(happenings: &[(Event, u64)]) -> Result<(), TestCaseError> {
    let mut rig = Rig::new(machine_with("reference", TIGHT), 6);
    let mut watches = [Watch::new(); 2];
    rig.enable();
    for axis in [X, Y] {
        watches[axis.index()].before = *rig.axis(axis);
        watches[axis.index()].place = rig.axis(axis).sample.position;
    }
    for (event, cycles) in happenings {
        happen(&mut rig, event);
        for _ in 0..*cycles {
            let before = rig.last.cycle;
            rig.step();
            let record: CycleRecord = rig.last;
            for (axis, row) in record.axes.iter() {
                watches[axis.index()].check(&rig, axis, row, record.cycle - before)?;
            }
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 256,
        rng_seed: RngSeed::Fixed(2_026),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn every_cycle_keeps_every_limit_whatever_happens(happenings in events()) {
        keeps_its_limits(&happenings)?;
    }
}

#[test]
fn an_ordinary_motion_meets_each_limit_and_each_reports_itself() {
    let mut rig = Rig::new(machine_with("reference", TIGHT), 6);
    rig.enable();
    let order = rig.line_to(40.0, 150.0);
    rig.order(order);
    let mut seen = Limits::NONE;
    for _ in 0..6_000 {
        seen = seen.with(rig.step().axes[X].command.limits);
    }
    for limit in [Limits::TRAVEL, Limits::VELOCITY, Limits::ACCELERATION] {
        assert!(seen.contains(limit), "{:?} never acted", limit.names().collect::<Vec<_>>());
    }
    let place_mm = rig.state(X).motor_position.as_mm();
    assert!(place_mm < 15.1, "{place_mm} mm, the travel ends at 15 mm: {:?}", rig.modes());
}

#[test]
fn an_axis_is_enabled_where_it_stands_outside_its_travel_and_comes_back() {
    // No machine file may say so; an axis comes there by being pushed out of its travel.
    let mut machine = machine_with("reference", &[]);
    for (_, axis) in machine.axes.iter_mut() {
        axis.control.limits.travel_min = Position::mm(10.0);
        axis.control.limits.travel_margin = Position::mm(1.0);
    }
    let mut rig = Rig::new(machine, 6);
    rig.enable();
    rig.run(2_000);
    assert_eq!(rig.axis(X).mode, ModeTag::Ready, "{:?}", rig.modes());
    let moved_um = rig.state(X).motor_position.as_um();
    assert!(moved_um.abs() < 1.0, "enabling moved it by {moved_um} um");
    let further = rig.line_to(-5.0, 20.0);
    rig.order(further);
    rig.run_until_moved();
    let place_mm = rig.state(X).motor_position.as_mm();
    assert!(place_mm > -0.1, "it went further out, to {place_mm} mm");
    let back = rig.line_to(30.0, 50.0);
    rig.order(back);
    rig.run_until_moved();
    rig.run(1_000);
    assert_eq!(rig.axis(X).fault, None);
    let place_mm = rig.state(X).motor_position.as_mm();
    assert!((place_mm - 30.0).abs() < 0.05, "{place_mm} mm of 30 mm");
}

/// A machine whose drives tripped in motion and that is ordered on again before it has come to rest.
fn enabled_while_coasting(feed_mm_per_s: f64) -> Rig {
    let mut rig = Rig::new(machine_with("reference", &[]), 6);
    rig.enable();
    let order = rig.line_to(200.0, feed_mm_per_s);
    rig.order(order);
    rig.run(1_200);
    for axis in [X, Y] {
        rig.line.wired.rack_mut().board_mut(axis).trip_drive(0x2310, 0);
    }
    rig.run(8);
    rig.order(Order::ClearFaults);
    rig.order(Order::Enable);
    rig
}

#[test]
fn an_axis_that_coasts_is_enabled_without_a_jerk() {
    let mut rig = enabled_while_coasting(60.0);
    let mut speed_mm_per_s = 0.0;
    while rig.axis(X).mode != ModeTag::Ready {
        speed_mm_per_s = rig.state(X).motor_velocity.as_mm_per_s();
        rig.step();
        assert!(rig.last.cycle < 2_000, "{:?}", rig.modes());
    }
    assert!(speed_mm_per_s > 20.0, "it coasts at {speed_mm_per_s} mm/s");
    let first_a = rig.axis(X).command.current.as_a();
    println!("enabled at {speed_mm_per_s:.1} mm/s with {first_a:.3} A");
    assert!(first_a.abs() < 1.0, "{first_a} A at once; stopping dead would take the limit of 20 A");
    let mut before_a = first_a;
    for _ in 0..400 {
        let current_a = rig.step().axes[X].command.current.as_a();
        let step_a = (current_a - before_a).abs();
        // The velocity command may step by 5 m/s^2 * 2 ms: 6.3 rad/s and 9.5 N m.
        assert!(step_a < 12.0, "a step of {step_a} A while it is brought to rest");
        before_a = current_a;
    }
    rig.run(2_000);
    assert_eq!(rig.axis(X).mode, ModeTag::Ready, "{:?}", rig.modes());
}

#[test]
fn axes_enabled_during_the_brake_of_an_old_motion_stay_where_they_are() {
    let mut rig = enabled_while_coasting(40.0);
    rig.run_until(ModeTag::Ready, 100);
    let motion = rig.last.stage.motion;
    let place = rig.axis(X).setpoint.position;
    for _ in 0..2_000 {
        let row = rig.step().axes[X];
        assert_eq!(row.setpoint.position, place, "the old path pulls at the setpoint");
    }
    assert_eq!(rig.last.stage.motion, motion);
}

/// Largest step of the current from cycle to cycle, A, around an exchange of gain sets, and without it.
fn swap_steps_a(feed_mm_per_s: f64) -> (f64, f64) {
    let stiff =
        "v-i = 2.596\nvelocity-feed-forward = 0.5\nfriction-feed-forward = 1.0\ninertia-feed-forward = 1.0";
    let edits = [
        ("kp-per-s = 8.55\nv-p = 99.522", "kp-per-s = 16.0\nv-p = 130.0"),
        (
            "v-i = 2.596\nvelocity-feed-forward = 0.0\nfriction-feed-forward = 0.0\ninertia-feed-forward = 0.0",
            stiff,
        ),
    ];
    let mut rig = Rig::new(machine_with("paper", &edits), 6);
    rig.enable();
    if feed_mm_per_s > 0.0 {
        let order = rig.line_to(200.0, feed_mm_per_s);
        rig.order(order);
        rig.run(2_400);
    } else {
        // At rest after a move: the integral holds the wound-up screw.
        let order = rig.line_to(20.0, 50.0);
        rig.order(order);
        rig.run_until_moved();
        rig.run(1_000);
        let held_a = rig.axis(X).command.current.as_a();
        assert!(held_a.abs() > 0.1, "{held_a} A at rest");
    }
    let mut largest_a = |cycles: u32| {
        let mut before_a = rig.axis(X).command.current.as_a();
        (0..cycles).fold(0.0, |largest: f64, _| {
            let current_a = rig.step().axes[X].command.current.as_a();
            let step_a = (current_a - std::mem::replace(&mut before_a, current_a)).abs();
            largest.max(step_a)
        })
    };
    let quiet_a = largest_a(40);
    rig.order(Order::UseGains(1));
    let mut before_a = rig.axis(X).command.current.as_a();
    let mut swap_a: f64 = 0.0;
    for _ in 0..40 {
        let current_a = rig.step().axes[X].command.current.as_a();
        swap_a = swap_a.max((current_a - before_a).abs());
        before_a = current_a;
    }
    assert_eq!(rig.axis(X).gain_set, 1);
    rig.run(1_000);
    assert_eq!(rig.axis(X).fault, None);
    (swap_a, quiet_a)
}

#[test]
fn gains_are_swapped_without_a_step_in_the_current() {
    // A bare exchange at 50 mm/s would step the velocity command by 69 mm/s: 84 N m, if the axis had
    // them. What is left fades that step away at 1.1 m/s^2, fed forward with 5 N m.
    for (feed_mm_per_s, bound_a) in [(50.0, 7.0), (0.0, 0.3)] {
        let (swap_a, quiet_a) = swap_steps_a(feed_mm_per_s);
        println!("{feed_mm_per_s} mm/s: steps of {swap_a:.3} A around the swap, {quiet_a:.3} A before");
        assert!(swap_a < quiet_a + bound_a, "{swap_a} A from cycle to cycle, {quiet_a} A before the swap");
    }
}

#[test]
fn orders_that_do_not_fit_are_ignored() {
    let mut rig = Rig::new(machine_with("reference", &[]), 6);
    let line = rig.line_to(20.0, 20.0);
    let odd = [
        Order::Stop,
        Order::Disable,
        Order::ClearFaults,
        line,
        Order::Circle(circle(2000.0, Direction::Cw)),
        Order::UseGains(99),
    ];
    odd.into_iter().for_each(|order| rig.order(order));
    rig.run(60);
    assert_eq!(rig.axis(X).mode, ModeTag::Off);
    assert_eq!((rig.last.stage.motion, rig.axis(X).gain_set), (0, 0));
    rig.enable();
    // Not at the start of the circle.
    let odd = [
        Order::Enable,
        Order::ClearFaults,
        Order::Stop,
        Order::Circle(circle(2000.0, Direction::Cw)),
        Order::UseGains(99),
    ];
    odd.into_iter().for_each(|order| rig.order(order));
    rig.run(60);
    assert_eq!(rig.axis(X).mode, ModeTag::Ready);
    assert_eq!((rig.last.stage.motion, rig.axis(X).gain_set), (0, 0));
    rig.order(line);
    rig.run_until(ModeTag::Moving, 8);
    let elsewhere = rig.line_to(-20.0, 20.0);
    [Order::Enable, Order::ClearFaults, elsewhere].into_iter().for_each(|order| rig.order(order));
    rig.run_until(ModeTag::Ready, 10_000);
    rig.run(1_000);
    assert_eq!(rig.last.stage.motion, 1);
    let place_mm = rig.state(X).motor_position.as_mm();
    assert!((place_mm - 20.0).abs() < 0.05, "{place_mm} mm of 20 mm");
}
