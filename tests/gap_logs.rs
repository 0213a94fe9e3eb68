//! Promise: a log of ours is a run like any other: what the machine of its file, from the command alone, makes of it
//! is what was logged, and rows in which its loops did not act are no part of it.
#![cfg(feature = "offline")]

use std::f64::consts::FRAC_PI_4;
use std::sync::Arc;

use quadrant::base::axis::AxisId;
use quadrant::base::motion::{Circle, Direction};
use quadrant::base::units::{Position, Velocity};
use quadrant::config::plan::CircleRequest;
use quadrant::config::{self, Machine};
use quadrant::offline::circle::MeasuringPoint;
use quadrant::offline::gap::analysis::{Request, analyse};
use quadrant::offline::gap::measure::forward::{Course, Signals, without_counts};
use quadrant::offline::gap::runs::SETTLE_S;
use quadrant::offline::gap::runs::logged;
use quadrant::offline::gap::runs::refused::RunError;
use quadrant::offline::gap::show::contour::point;
use quadrant::offline::simulated;
use quadrant::offline::trace::{Trace, Tracing};

/// A circle, as its log has it.
fn logged(machine: &Machine) -> Trace {
    let circle = Circle {
        centre_x: Position::ZERO,
        centre_y: Position::ZERO,
        radius: Position::mm(4.0),
        feed: Velocity::mm_per_min(4_000.0),
        direction: Direction::Ccw,
        start_angle_rad: FRAC_PI_4,
        revolutions: 1,
    };
    let request = CircleRequest { gains: "standard".to_owned(), circle, directions: vec![circle.direction] };
    let test = machine.circle_test(&request).expect("a test");
    let mut tracing = Tracing::default();
    simulated::run(machine, machine, test, 1, &Arc::default(), &mut tracing).expect("a run");
    tracing.finish().expect("a trace")
}

#[test]
fn a_log_is_what_its_machine_makes_of_the_command() {
    let machine = config::load("paper").expect("a machine");
    let trace = logged(&machine);
    let intake = logged::of_trace("log", &trace, &machine).expect("runs");
    let [run] = intake.runs.as_slice() else { panic!("{} runs", intake.runs.len()) };
    assert!(run.len() < trace.len(), "with the rows without current: {} of {}", run.len(), trace.len());
    for (id, measured) in &run.axes {
        let axis = without_counts(&machine.axes[*id]);
        let every = machine.cycle.position_every;
        let measured = Signals::measured(measured);
        let off_um = |phase: usize| {
            let course = Course::new(run, &machine, *id, phase, 0.0).expect("an axis");
            let made = course.run(&axis, every, 0, &axis.plant);
            let settled = (SETTLE_S / run.period_s) as usize;
            let both = made.following_error_m.iter().zip(&measured.following_error_m).skip(settled);
            both.fold(0.0, |most: f64, (made, logged)| most.max((made - logged).abs() * 1e6))
        };
        // The log does not tell which of its rows were ticks of the position loop.
        let least_um = (0..every as usize).map(off_um).fold(f64::INFINITY, f64::min);
        assert!(least_um < 0.3, "axis {id}: {least_um} um off");
    }
}

#[test]
fn the_circles_of_a_log_are_judged_as_measured_and_as_simulated() {
    let machine = config::load("paper").expect("a machine");
    let intake = logged::of_trace("log", &logged(&machine), &machine).expect("runs");
    let request = Request { gains: Some("standard".to_owned()), axes: Vec::new() };
    let analysis = analyse(&machine, &intake.runs, &request, &|_| ()).expect("an analysis");
    let [circle] = analysis.contours.as_slice() else { panic!("{} circles", analysis.contours.len()) };
    let (measured, [before, _]) = (&circle.measured, &circle.simulated);
    assert_eq!((measured.radius_mm, measured.feed_mm_per_min), (4.0, 4_000.0));
    assert!(measured.revolutions > 1, "with the turns of its run-in");
    let (measured, before) = (point(measured), point(before));
    assert_eq!(measured.point, MeasuringPoint::Table);
    let apart_um = (measured.circular_deviation_um - before.circular_deviation_um).abs();
    assert!(measured.circular_deviation_um > 5.0 && apart_um < 0.3, "G is {apart_um} um off");
    assert!(circle.contour_um[0] < 0.3, "{circle:?}");
}

#[test]
fn rows_without_current_or_under_excitation_part_a_log() {
    let machine = config::load("paper").expect("a machine");
    let mut trace = logged(&machine);
    let middle = trace.len() / 2;
    for row in middle..middle + 10 {
        trace.axes[AxisId::Y.index()].excitation_m_per_s[row] = 1e-3;
    }
    let intake = logged::of_trace("log", &trace, &machine).expect("runs");
    let names: Vec<&str> = intake.runs.iter().map(|run| run.name.as_str()).collect();
    assert_eq!(names, ["log, stretch 1", "log, stretch 2"]);
    for axis in &mut trace.axes {
        axis.mode.fill(quadrant::base::record::ModeTag::Off);
    }
    let refused = logged::of_trace("log", &trace, &machine).expect_err("a refusal");
    assert!(matches!(refused, RunError::TooShort { .. }), "{refused}");
}
