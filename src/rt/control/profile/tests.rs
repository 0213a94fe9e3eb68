//! Each motion is one curve, stops along its path and is refused where it would never end.

use super::*;
use crate::base::motion::Circle;
use crate::base::motion::Direction;
use crate::base::time::Span;

const TICK: Span = Span::us(500);

fn circle() -> CircleMotion {
    CircleMotion {
        circle: Circle {
            centre_x: Position::mm(10.0),
            centre_y: Position::mm(-5.0),
            radius: Position::mm(20.0),
            feed: Velocity::mm_per_min(6000.0),
            direction: Direction::Cw,
            start_angle_rad: 0.7,
            revolutions: 2,
        },
        run_in_s: 0.2,
        run_out_s: 0.1,
        acceleration: Acceleration::m_per_s2(0.5),
    }
}

fn at_start(motion: &CircleMotion) -> Profile {
    let mut profile = Profile::new(3);
    let (x, y) = motion.start();
    profile.stand(AxisId::X, x);
    profile.stand(AxisId::Y, y);
    profile
}

/// Every setpoint until the motion ends; each is checked to be one curve, whose acceleration may step
/// by `corner` between two ticks (a stop while the speed rises, the end of a very short move).
fn trail(
    mut profile: Profile,
    corner: Acceleration,
    mut at_tick: impl FnMut(i64, &mut Profile),
) -> Vec<PerAxis<Setpoint>> {
    let corner_m_per_s = corner.as_m_per_s2() * TICK.as_s();
    let mut trail = vec![*profile.setpoints()];
    let mut tick = 0;
    while profile.is_running() {
        tick += 1;
        at_tick(tick, &mut profile);
        profile.advance(Moment::ZERO + TICK * tick);
        trail.push(*profile.setpoints());
        assert!(tick < 100_000, "the motion does not end");
    }
    for pair in trail.windows(2) {
        for (axis, after) in pair[1].iter() {
            let before = pair[0][axis];
            let mean = (before.velocity + after.velocity) * 0.5;
            let step_m = (after.position - before.position).as_m();
            let off_m = step_m - mean.as_m_per_s() * TICK.as_s();
            assert!(
                off_m.abs() < 1e-9 + 0.25 * corner_m_per_s * TICK.as_s(),
                "axis {axis}: position and velocity differ by {off_m} m"
            );
            let change = (after.velocity - before.velocity).as_m_per_s();
            let accelerated = (before.acceleration + after.acceleration) * 0.5;
            let off = change - accelerated.as_m_per_s2() * TICK.as_s();
            assert!(
                off.abs() < 2e-6 + corner_m_per_s,
                "axis {axis}: velocity and acceleration differ by {off} m/s"
            );
        }
    }
    trail
}

#[test]
fn a_circle_keeps_radius_feed_and_acceleration() {
    let motion = circle();
    let mut profile = at_start(&motion);
    assert!(profile.start_circle(&motion, Moment::ZERO));
    let mut measured = 0;
    for setpoints in trail(profile, Acceleration::ZERO, |tick, p| {
        measured += i64::from(p.is_measured(Moment::ZERO + TICK * tick));
    }) {
        let [x, y, z] = [0, 1, 2].map(|axis| setpoints[AxisId::new(axis)]);
        let from_centre = (x.position - motion.circle.centre_x, y.position - motion.circle.centre_y);
        let radius_mm = from_centre.0.as_mm().hypot(from_centre.1.as_mm());
        assert!((radius_mm - 20.0).abs() < 1e-9, "radius {radius_mm} mm");
        let speed = x.velocity.as_m_per_s().hypot(y.velocity.as_m_per_s());
        assert!(speed < 0.1 + 1e-12, "{speed} m/s along the path");
        let acceleration = x.acceleration.as_m_per_s2().hypot(y.acceleration.as_m_per_s2());
        assert!(acceleration <= motion.acceleration_max().as_m_per_s2(), "{acceleration} m/s^2");
        assert_eq!(z, Setpoint::default(), "a third axis stands");
    }
    let turns_s = 2.0 * std::f64::consts::TAU * 0.02 / 0.1;
    assert!((measured as f64 * TICK.as_s() - turns_s).abs() <= TICK.as_s(), "{measured} cycles measured");
}

#[test]
fn the_evaluated_part_starts_at_its_angle() {
    let motion = circle();
    let mut profile = at_start(&motion);
    profile.start_circle(&motion, Moment::ZERO);
    profile.advance(Moment::ZERO + Span::s(motion.lead_in_s()));
    let y = (profile.setpoints()[AxisId::Y].position - motion.circle.centre_y).as_mm();
    let x = (profile.setpoints()[AxisId::X].position - motion.circle.centre_x).as_mm();
    // A nanosecond of the grid is 0.005 urad here.
    assert!((y.atan2(x) - 0.7).abs() < 1e-8, "{} rad", y.atan2(x));
}

#[test]
fn a_circle_that_would_jump_is_refused() {
    let mut profile = at_start(&circle());
    profile.stand(AxisId::X, circle().start().0 + Position::um(0.01));
    assert!(!profile.start_circle(&circle(), Moment::ZERO));
    assert!(!profile.is_running());
}

#[test]
fn a_short_move_never_reaches_its_feed_and_ends_at_its_target() {
    for target_mm in [0.001, 1.0, 300.0] {
        let target = PerAxis::from_fn(2, |axis| Position::mm(target_mm * [0.6, -0.8][axis.index()]));
        let line =
            LineMotion { target, feed: Velocity::m_per_s(0.25), acceleration: Acceleration::m_per_s2(1.0) };
        let mut profile = Profile::new(2);
        profile.start_line(&line, Moment::ZERO);
        let trail = trail(profile, line.acceleration, |_, _| ());
        let end = trail[trail.len() - 1];
        for (axis, setpoint) in end.iter() {
            assert!((setpoint.position - target[axis]).abs() < Position::um(1e-6), "{axis}: {setpoint:?}");
            assert_eq!(setpoint.velocity, Velocity::ZERO);
        }
    }
}

#[test]
fn a_stop_at_any_moment_brakes_along_the_path() {
    let motion = circle();
    for stop_tick in [1, 100, 400, 3000, 5500] {
        let mut profile = at_start(&motion);
        profile.start_circle(&motion, Moment::ZERO);
        let mut speed_before = 0.0;
        let trail = trail(profile, Acceleration::m_per_s2(2.5), |tick, profile| {
            if tick == stop_tick {
                let now = Moment::ZERO + TICK * (tick - 1);
                let [x, y] = [AxisId::X, AxisId::Y].map(|axis| profile.setpoints()[axis].velocity);
                speed_before = x.as_m_per_s().hypot(y.as_m_per_s());
                profile.stop(Acceleration::m_per_s2(2.0), now);
            }
        });
        let braked_s = (trail.len() as i64 - stop_tick) as f64 * TICK.as_s();
        let expected_s = rise_s(speed_before, Acceleration::m_per_s2(2.0));
        assert!(braked_s <= expected_s + 2.0 * TICK.as_s(), "braking took {braked_s} s of {expected_s} s");
    }
}

#[test]
fn a_line_for_another_number_of_axes_is_refused() {
    for count in [1, 3] {
        let line = LineMotion {
            target: PerAxis::filled(count, Position::mm(10.0)),
            feed: Velocity::m_per_s(0.1),
            acceleration: Acceleration::m_per_s2(1.0),
        };
        let mut profile = Profile::new(2);
        assert!(!profile.start_line(&line, Moment::ZERO) && !profile.is_running(), "{count} axes");
    }
}

#[test]
fn a_motion_that_would_never_end_is_refused() {
    let good = LineMotion {
        target: PerAxis::filled(2, Position::mm(10.0)),
        feed: Velocity::m_per_s(0.1),
        acceleration: Acceleration::m_per_s2(1.0),
    };
    let bad = [f64::NAN, f64::INFINITY].map(Position::m).map(|place| PerAxis::filled(2, place));
    let speeds = [f64::NAN, -0.1, 0.0].map(Velocity::m_per_s);
    let rises = [f64::NAN, -1.0, 0.0].map(Acceleration::m_per_s2);
    let lines = bad
        .map(|target| LineMotion { target, ..good })
        .into_iter()
        .chain(speeds.into_iter().map(|feed| LineMotion { feed, ..good }))
        .chain(rises.map(|acceleration| LineMotion { acceleration, ..good }));
    for line in lines {
        let mut profile = Profile::new(2);
        assert!(!profile.start_line(&line, Moment::ZERO) && !profile.is_running(), "{line:?}");
    }
    for (radius_mm, feed, run_in_s) in
        [(f64::NAN, 0.1, 0.2), (20.0, -0.1, 0.2), (20.0, 0.1, f64::NAN), (20.0, 0.1, f64::INFINITY)]
    {
        let mut motion = circle();
        motion.circle.radius = Position::mm(radius_mm);
        motion.circle.feed = Velocity::m_per_s(feed);
        motion.run_in_s = run_in_s;
        let mut profile = at_start(&motion);
        assert!(!profile.start_circle(&motion, Moment::ZERO), "{motion:?}");
    }
}

#[test]
fn a_stop_never_leads_past_the_end_of_the_motion() {
    let target = PerAxis::filled(2, Position::mm(100.0));
    let line = LineMotion { target, feed: Velocity::m_per_s(0.2), acceleration: Acceleration::m_per_s2(1.0) };
    for stop_tick in (1..1600).step_by(50) {
        let mut profile = Profile::new(2);
        assert!(profile.start_line(&line, Moment::ZERO));
        let trail = trail(profile, Acceleration::m_per_s2(1.0), |tick, profile| {
            if tick == stop_tick {
                profile.stop(Acceleration::m_per_s2(0.5), Moment::ZERO + TICK * (tick - 1));
            }
        });
        let furthest_mm = trail.iter().map(|at| at[AxisId::X].position.as_mm()).fold(0.0, f64::max);
        assert!(furthest_mm < 100.0 + 1e-9, "stopped at tick {stop_tick}: {furthest_mm} mm of 100 mm");
    }
}
