//! Promise: what noise of the torque does to the mean of a table that sticks is no gap.

use super::*;

/// Noise of the torque as a share of the friction, and for how long it is remembered.
const SHARE: f64 = 0.025;
const MEMORY_S: f64 = 0.02;

/// A run of axis x with a torque that shakes.
fn shaken(machine: &Machine, name: &str, seconds: f64, place_m: impl Fn(f64) -> f64, seed: u64) -> Run {
    let rows = (seconds * ROWS_PER_S) as usize;
    let mut run = commanded(name, rows, |row| place_m(row as f64 / ROWS_PER_S));
    let axis = &machine.axes[AxisId::X];
    let friction =
        axis.plant.actuator.current(axis.plant.mechanics.torque_for_force(axis.plant.friction.sliding));
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let noise = Normal::new(0.0, 1.0).expect("a width");
    let forgets = 1.0 / (ROWS_PER_S * MEMORY_S);
    let loudness = SHARE * ((2.0 - forgets) / forgets).sqrt();
    let mut at = 0.0;
    let course = Course::new(&run, machine, AxisId::X, 0, 0.0).expect("an axis");
    let made = course.run_shaken(axis, machine.cycle.position_every, 0, &axis.plant, || {
        at += (noise.sample(&mut random) - at) * forgets;
        friction * (loudness * at)
    });
    let recorded = logged(&run.axes[&AxisId::X].setpoint_m, &made, &mut random);
    run.axes.insert(AxisId::X, recorded);
    run
}

#[test]
fn a_table_that_breaks_away_sooner_for_its_motor_shakes_leaves_noise() {
    let machine = config::load("paper").expect("a machine");
    let wide = |time_s: f64| 1e-2 * (TAU * time_s / 2.0).sin() * time_s.min(1.0);
    let narrow = |time_s: f64| 3e-5 * (TAU * time_s).sin() * time_s.min(1.0);
    let runs =
        [shaken(&machine, "circle", 7.0, wide, 1), shaken(&machine, "small-reversals", 12.0, narrow, 2)];
    let problem = problem_of(&machine, &runs, &repeats(&runs), AxisId::X, 0, &[0, 0]);
    let model = Model::new(machine.axes[AxisId::X].plant);
    // Of the machine as it is, by a row of noise: following error and deflection of the small reversals.
    let left = |problem: &Problem<'_>| -> Vec<f64> {
        let mean = |signal: &Vec<f64>| signal.iter().map(|row| row * row).sum::<f64>() / signal.len() as f64;
        problem.residual(1, &model, Part::Fit)[..2].iter().map(mean).collect()
    };
    let (without, with) = (left(&problem), left(&problem.with_means_about(&model)));
    assert!(without.iter().all(|left| *left > 1.3), "it would be no gap without: {without:?}");
    assert!(with.iter().all(|left| *left < 1.1), "{with:?}, and {without:?} without");
}
