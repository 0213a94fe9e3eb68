//! The figures that the machine of the known answers must give: protrusions, radius, energy, breakaway, decay.

use hidden::axis::{Axis, MOTOR, MOTOR_SPEED, Push, State, TABLE, TABLE_SPEED};
use hidden::controller::PERIOD;
use hidden::features::Features;
use hidden::machine::Machine;
use hidden::path::{Motion, Run};
use hidden::plant::Plant;
use hidden::rig::{Conditions, Row, STEPS, run};

const RADIUS: f64 = 0.15;
const FEED: f64 = 2.0 / 60.0;

/// The first `turns` of the reference circle, with the integral gain of `v_i`.
fn circle(change: impl Fn(&mut Plant), v_p: f64, v_i: f64, turns: f64, steps: usize) -> Vec<Row> {
    let mut machine = Machine::paper();
    for axis in &mut machine.axes {
        change(&mut axis.plant);
        axis.control.proportional = 0.0150 * v_p;
        axis.control.integral = 0.0150 * v_p * v_i * 103.35;
    }
    let motion = Motion::Circle { radius: RADIUS, feed: FEED, is_ccw: true, laps: 1 };
    let mut setpoints = Run { name: "reference".to_owned(), motion, is_held_out: false }.setpoints();
    setpoints.truncate((turns * std::f64::consts::TAU * RADIUS / FEED / PERIOD) as usize);
    let told = machine.axes.map(|axis| axis.plant);
    run(&machine, &told, &[Features::default(); 2], &setpoints, &Conditions { steps, ..Conditions::QUIET })
}

/// Largest way by which x is further out behind its first reversal than without friction, at the motor and at the
/// table, um.
fn protrusions(v_p: f64, v_i: f64, steps: usize) -> [f64; 2] {
    // The lead-in is 0.15 of a turn, and the axis reverses 117 ms after its setpoint.
    let turns = 0.17;
    let rubbing = circle(|_| {}, v_p, v_i, turns, steps);
    let free = circle(without_friction, v_p, v_i, turns, STEPS);
    let from = (0.148 / turns * rubbing.len() as f64) as usize;
    let behind = rubbing.iter().zip(&free).skip(from);
    behind.fold([f64::MIN; 2], |[motor, table], (row, free)| {
        let [by_motor, by_table] = [row[0].position - free[0].position, row[0].table - free[0].table];
        [motor.max(1e6 * by_motor), table.max(1e6 * by_table)]
    })
}

fn without_friction(plant: &mut Plant) {
    plant.breakaway = 0.0;
    plant.sliding = 0.0;
}

#[track_caller]
fn is_near(value: f64, known: f64, bound: f64, unit: &str) {
    assert!((value - known).abs() <= bound, "{value} {unit}, known is {known} +- {bound} {unit}");
}

#[test]
fn protrusions_are_those_of_both_gain_sets() {
    let [motor, table] = protrusions(101.121, 1.140, STEPS);
    is_near(motor, 25.01, 0.02, "um");
    is_near(table, 31.7, 0.05, "um");
    let [motor, _] = protrusions(99.522, 2.596, STEPS);
    is_near(motor, 12.17, 0.02, "um");
}

#[test]
fn half_the_step_changes_no_protrusion_by_a_nanometre() {
    for (v_p, v_i) in [(101.121, 1.140), (99.522, 2.596)] {
        let (whole, half) = (protrusions(v_p, v_i, STEPS), protrusions(v_p, v_i, 2 * STEPS));
        for n in 0..2 {
            is_near(whole[n], half[n], 1e-3, "um");
        }
    }
}

#[test]
fn the_circle_without_friction_loses_the_known_radius() {
    let rows = circle(without_friction, 101.121, 1.140, 0.5, STEPS);
    let last = rows[rows.len() - 1];
    is_near(1e6 * (RADIUS - last[0].position.hypot(last[1].position)), 49.99, 0.01, "um");
}

/// An axis alone, without controller, current or noise.
fn alone(change: impl Fn(&mut Plant)) -> (Plant, Axis) {
    let mut plant = Machine::paper().axes[0].plant;
    change(&mut plant);
    (plant, Axis::new(&plant, &Features::default(), 0.0, 0.0))
}

#[test]
fn a_ramp_breaks_away_when_the_spring_has_the_force() {
    let pull = 0.1e-3;
    // A motor of so much inertia keeps its speed.
    let (plant, mut axis) = alone(|plant| plant.inertia = 1e6);
    let mut state = *axis.state();
    state[MOTOR_SPEED] = pull;
    axis.set_state(state);
    let known = (plant.breakaway - plant.damping * pull) / (plant.stiffness * pull);
    let mut steps = 0;
    while axis.state()[TABLE_SPEED] == 0.0 {
        axis.advance(0.0, 1e-5, &Push::default());
        steps += 1;
        assert!(steps < 100_000, "stuck after 1 s, should break away after {known} s");
    }
    is_near(f64::from(steps) * 1e-5, known, 1.1e-5, "s");
}

#[test]
fn a_table_without_a_screw_slides_as_far_as_its_energy_lasts() {
    let (plant, mut axis) = alone(|plant| {
        (plant.stiffness, plant.damping) = (0.0, 0.0);
        plant.breakaway = plant.sliding;
    });
    let mut state = *axis.state();
    state[TABLE_SPEED] = 0.05;
    axis.set_state(state);
    for _ in 0..10_000 {
        axis.advance(0.0, 1e-5, &Push::default());
    }
    assert!(axis.is_stuck(), "still moves with {} m/s", axis.state()[TABLE_SPEED]);
    let known = plant.mass * 0.05 * 0.05 / (2.0 * plant.sliding);
    is_near(1e6 * axis.state()[TABLE], 1e6 * known, 1e-6, "um");
}

#[test]
fn work_goes_into_motion_spring_damper_and_friction_and_nowhere_else() {
    let (plant, mut axis) = alone(|plant| plant.efficiency = 1.0);
    let step = 1e-5;
    let (mut work, mut lost, mut throughput) = (0.0, 0.0, 0.0);
    let energy = |axis: &Axis| {
        let s = axis.state();
        let reflected = plant.inertia / plant.travel_per_rad().powi(2);
        0.5 * (reflected * s[MOTOR_SPEED].powi(2)
            + plant.mass * s[TABLE_SPEED].powi(2)
            + plant.stiffness * (s[MOTOR] - s[TABLE]).powi(2))
    };
    for n in 0..100_000 {
        let t = f64::from(n) * step;
        let torque = 3.0 * (20.0 * t).sin();
        let before = *axis.state();
        axis.advance(t, step, &Push { torque, ..Push::default() });
        let after = *axis.state();
        // Trapezoids: of the second order, so small against what passes.
        let mean = |power: &dyn Fn(&State) -> f64| 0.5 * (power(&before) + power(&after)) * step;
        let put_in = torque * (after[MOTOR] - before[MOTOR]) / plant.travel_per_rad();
        work += put_in;
        throughput += put_in.abs();
        lost += mean(&|s| plant.damping * (s[MOTOR_SPEED] - s[TABLE_SPEED]).powi(2));
        lost += mean(&|s| plant.dry_friction(s[TABLE_SPEED].abs()) * s[TABLE_SPEED].abs());
    }
    let missing = (work - lost - energy(&axis)).abs() / throughput;
    assert!(throughput > 1.0, "only {throughput} J passed");
    assert!(missing < 2e-5, "{missing} of the energy that passed is missing");
}

/// Force of the screw at steady acceleration, and how far the table is behind the motor then.
fn pulled(change: impl Fn(&mut Plant), features: &Features) -> [f64; 2] {
    let mut plant = Machine::paper().axes[0].plant;
    (plant.breakaway, plant.sliding, plant.efficiency) = (0.0, 0.0, 1.0);
    change(&mut plant);
    let mut axis = Axis::new(&plant, features, 0.0, 0.0);
    for n in 0..40_000 {
        axis.advance(f64::from(n) * 1e-5, 1e-5, &Push { torque: 1.0, ..Push::default() });
    }
    let state = axis.state();
    [axis.screw_force(0.4), 1e6 * (state[MOTOR] - state[TABLE])]
}

#[test]
fn a_screw_within_its_spring_divides_it_and_takes_its_share_of_the_torque() {
    let mut soft = Features::default();
    (soft.train.soft_share, soft.train.soft_half_width) = (0.6, 1e-6);
    for features in [Features::default(), soft] {
        let [force, apart] = pulled(|_| {}, &features);
        let share = 0.1;
        let [after, twice] = pulled(|plant| plant.screw_share = share, &features);
        is_near(force, after, 1e-6 * force, "N");
        // The motor's half has what accelerates the screw besides the table.
        let plant = Machine::paper().axes[0].plant;
        let reflected = plant.inertia / plant.travel_per_rad().powi(2);
        let screw = force / plant.mass * share * reflected;
        is_near(twice, apart + 1e6 * screw / (2.0 * plant.stiffness), 1e-5, "um");
    }
}

#[test]
fn a_table_held_before_a_screw_within_its_spring_has_two_modes() {
    // Of two masses on springs 2k, 2k before a wall, the motor's and the screw's.
    let share = 0.2;
    let (plant, mut axis) = alone(|plant| {
        plant.screw_share = share;
        (plant.damping, plant.breakaway, plant.efficiency) = (0.0, 1e9, 1.0);
    });
    let reflected = plant.inertia / plant.travel_per_rad().powi(2);
    let [motor, screw] = [(1.0 - share) * reflected, share * reflected];
    let spring = 2.0 * plant.stiffness;
    // `m_m m_s w^4 - (m_s + 2 m_m) K w^2 + K^2 = 0`, the slower root.
    let (a, b) = (motor * screw, (screw + 2.0 * motor) * spring);
    let slow = ((b - (b * b - 4.0 * a * spring * spring).sqrt()) / (2.0 * a)).sqrt();
    // The motor's speed as a sum of both modes; the fast one is small: count the passes through zero.
    let mut state = *axis.state();
    state[MOTOR_SPEED] = 1e-3;
    axis.set_state(state);
    let mut passes = Vec::new();
    for n in 0..200_000 {
        let before = axis.state()[MOTOR];
        axis.advance(0.0, 1e-6, &Push::default());
        let after = axis.state()[MOTOR];
        if before < 0.0 && after >= 0.0 {
            passes.push(f64::from(n) * 1e-6);
        }
    }
    let known = slow / std::f64::consts::TAU;
    let found = (passes.len() - 1) as f64 / (passes[passes.len() - 1] - passes[0]);
    is_near(found, known, 0.01 * known, "Hz");
}
