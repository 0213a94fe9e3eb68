//! What the loops alone tell: in which row they act, with which gains, and how they see the velocity.

use super::*;

#[test]
fn the_row_in_which_the_position_loop_acts_is_found() {
    for (name, feed_forward) in [("paper", 0.0), ("reference", 0.0), ("paper", 0.6)] {
        let mut machine = config::load(name).expect("a machine");
        machine.axes[AxisId::X].control.gain_sets[0].position.velocity_feed_forward = feed_forward;
        let plant = machine.axes[AxisId::X].plant;
        for phase in [0, 2] {
            let run = circle(&machine, &plant, "fast", [20.0, 1.6], 2, phase);
            let found = controller::explained(&machine, &[AxisId::X], &[run])[0][0][0];
            assert_eq!((found.gain_set, found.phase), (0, phase), "{name}, feed-forward {feed_forward}");
            // The noise alone is left.
            assert!(found.left_share < 0.1, "{name}, feed-forward {feed_forward}: {found:?}");
        }
    }
}

#[test]
fn a_delay_that_is_not_known_of_does_not_pass_for_another_row_of_the_position_loop() {
    let machine = config::load("paper").expect("a machine");
    let delay = entry("actuator-delay").expect("an effect");
    let late = machine.axes[AxisId::X].plant.with_effect(delay, [920.0, 0.0, 0.0]);
    for phase in [0, 2] {
        let run = circle(&machine, &late, "fast", [20.0, 1.6], 2, phase);
        let found = controller::explained(&machine, &[AxisId::X], &[run])[0][0][0];
        assert_eq!((found.phase, found.late), (phase, 2), "{found:?}");
        assert_eq!(found.velocity_estimate, machine.axes[AxisId::X].velocity_estimate);
    }
}

#[test]
fn nor_does_a_lag() {
    let mut machine = config::load("paper").expect("a machine");
    machine.axes[AxisId::X].control.gain_sets[0].position.velocity_feed_forward = 0.6;
    let lag = entry("current-loop-lag").expect("an effect");
    let slow = machine.axes[AxisId::X].plant.with_effect(lag, [1200.0, 0.0, 0.0]);
    for phase in [0, 2] {
        let run = circle(&machine, &slow, "fast", [20.0, 1.6], 2, phase);
        let found = controller::explained(&machine, &[AxisId::X], &[run])[0][0][0];
        assert_eq!(found.phase, phase, "{found:?}");
    }
}

#[test]
fn velocities_are_estimated_as_the_current_tells() {
    let filed = config::load("paper").expect("a machine");
    let plant = filed.axes[AxisId::X].plant;
    for (name, estimate) in VelocityEstimate::NAMED {
        let mut machine = filed.clone();
        machine.axes[AxisId::X].velocity_estimate = estimate;
        let runs = [circle(&machine, &plant, "fast", [20.0, 1.6], 2, 0)];
        let found = controller::explained(&filed, &[AxisId::X], &runs)[0][0][0];
        assert_eq!(found.velocity_estimate, estimate, "{found:?}");
        // What the integral is off by when a velocity is seen half a period earlier, the position makes up for.
        let left_m = |problem: &Problem<'_>| {
            let made = problem.simulated(0, &Model::new(plant)).following_error_m;
            let measured = &problem.data[0].measured.following_error_m;
            // Where it began with the noise of a current has faded.
            let off_m = measured.iter().zip(&made).skip(made.len() / 2).map(|(is, made)| (is - made).abs());
            off_m.fold(0.0, f64::max)
        };
        let problem = || problem_of(&filed, &runs, &repeats(&runs), AxisId::X, 0, &[0]);
        let seeing_m = left_m(&problem().seeing(found.velocity_estimate));
        assert!(seeing_m < 1e-9, "{name}: {seeing_m} m");
        let is_filed = estimate == filed.axes[AxisId::X].velocity_estimate;
        assert!(is_filed || left_m(&problem()) > 1e-6, "{name}: {} m", left_m(&problem()));
    }
}

#[test]
fn runs_with_other_gains_are_refused_by_name() {
    let machine = config::load("paper").expect("a machine");
    let request = Request { gains: Some("optimal".to_owned()), axes: Vec::new() };
    let refused = analyse(&machine, &runs(&machine, &[]), &request, &|_| ()).err().expect("a refusal");
    let GapError::OtherGains { asked, found, .. } = &refused else { panic!("{refused}") };
    assert_eq!((asked.as_str(), found.as_str()), ("optimal", "standard"));
}

#[test]
fn gains_that_nobody_names_are_those_of_the_current() {
    let machine = config::load("paper").expect("a machine");
    let runs = runs(&machine, &[]);
    let found =
        |machine: &Machine| controller::by_the_current(&controller::explained(machine, &[AxisId::X], &runs));
    assert_eq!(found(&machine), 0);
    let mut turned = machine.clone();
    turned.axes[AxisId::X].control.gain_sets.swap(0, 1);
    assert_eq!(found(&turned), 1);
    // What an axis lacks may hide it there.
    let mut explained = controller::explained(&turned, &[AxisId::X], &runs);
    let mut hidden = explained[0].clone();
    hidden.iter_mut().flatten().for_each(|found| found.left_share = 0.9);
    explained.insert(0, hidden);
    assert_eq!(controller::by_the_current(&explained), 1);
    // What says no more is no reason for another one than the first.
    turned.axes[AxisId::X].control.gain_sets[0] = turned.axes[AxisId::X].control.gain_sets[1];
    assert_eq!(found(&turned), 0);
}

#[test]
fn between_the_rows_of_a_log_that_has_not_every_cycle_the_loops_act_all_the_same() {
    let machine = config::load("paper").expect("a machine");
    let plant = machine.axes[AxisId::X].plant;
    for (every, phase) in [(2, 0), (2, 1), (3, 2)] {
        let whole = circle(&machine, &plant, "fast", [20.0, 1.6], 2, phase);
        let axis = &whole.axes[&AxisId::X];
        let of = |column: &Vec<f64>| column.iter().copied().step_by(every).collect::<Vec<f64>>();
        let thinned = AxisRun {
            setpoint_m: of(&axis.setpoint_m),
            position_m: of(&axis.position_m),
            table_m: axis.table_m.as_ref().map(of),
            current_a: of(&axis.current_a),
        };
        let run = Run {
            name: whole.name.clone(),
            start_s: 0.0,
            period_s: every as f64 / ROWS_PER_S,
            is_sound: vec![true; thinned.setpoint_m.len()],
            axes: BTreeMap::from([(AxisId::X, thinned)]),
        };
        let runs = [run];
        let found = controller::explained(&machine, &[AxisId::X], &runs)[0][0][0];
        assert_eq!((found.gain_set, found.phase), (0, phase), "every {every}: {found:?}");
        let problem = problem_of(&machine, &runs, &repeats(&runs), AxisId::X, 0, &[phase]);
        let made = problem.simulated(0, &Model::new(plant)).following_error_m;
        let measured = &problem.data[0].measured.following_error_m;
        assert_eq!(made.len(), measured.len());
        let half = made.len() / 2;
        let off_m = measured.iter().zip(&made).skip(half).map(|(is, made)| (is - made).abs());
        let furthest_m = off_m.fold(0.0, f64::max);
        assert!(furthest_m < 1e-9, "every {every}, phase {phase}: {furthest_m} m");
    }
}
