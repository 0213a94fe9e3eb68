//! Promise: the margins that are stated of a velocity loop are those of the loop that runs. The shipped
//! loop, estimator and plant, stepped in time, stay calm with 1 % less gain than the gain margin
//! allows and swing up with 1 % more.

use quadrant::base::axis::AxisId;
use quadrant::base::time::Span;
use quadrant::base::units::{Current, Torque, Velocity};
use quadrant::config::{self, Machine};
use quadrant::offline::loops::Loops;
use quadrant::plant::Plant;
use quadrant::plant::encoder::{Knot, Latch};
use quadrant::rt::control::velocity_pi::{Gains, Memory, VelocityLoop};
use quadrant::rt::drive::velocity::VelocityEstimator;

/// The gain set with its loop gain scaled.
fn scaled(gains: &Gains, factor: f64) -> Gains {
    let memory = match gains.memory {
        Memory::Integrator { gain_nm_per_rad } => {
            Memory::Integrator { gain_nm_per_rad: gain_nm_per_rad * factor }
        }
        Memory::Lag { gain_nm_s_per_rad, time_constant_s } => {
            Memory::Lag { gain_nm_s_per_rad: gain_nm_s_per_rad * factor, time_constant_s }
        }
    };
    Gains { proportional_nm_s_per_rad: gains.proportional_nm_s_per_rad * factor, memory }
}

/// Growth of the swing from the second to the last quarter of a second, after a kick.
fn growth(machine: &Machine, set: u8, factor: f64) -> f64 {
    let mut axis = machine.axes[AxisId::X];
    axis.plant = axis.plant.without_friction();
    // Nothing that would end a swing.
    axis.plant.actuator.peak_current = Current::a(1e12);
    let tick = machine.cycle.period;
    let mut plant = Plant::new(&axis.plant, tick);
    let mut latch = Latch::new(axis.feedback_latency, tick);
    let mut estimator = VelocityEstimator::new(axis.velocity_estimate, tick);
    let mut velocity_loop = VelocityLoop::new(&scaled(&machine.gains(AxisId::X, set).velocity, factor), tick);
    let is_late = axis.sheet.command_delay(tick) > Span::ZERO;
    let rad_per_m = 1.0 / axis.plant.mechanics.travel_per_rad_m();
    let (mut pending, mut swing) = (Current::ZERO, [0.0_f64; 4]);
    let ticks = (1.0 / tick.as_s()) as usize;
    for n in 0..ticks {
        let state = plant.state();
        latch.feed(Knot { position: state.motor_position, velocity: state.motor_velocity });
        let velocity = estimator.advance(latch.position(Span::ZERO), 1);
        let kick = if n == 10 { Velocity::mm_per_s(1.0) } else { Velocity::ZERO };
        let error = (kick - velocity).as_m_per_s() * rad_per_m;
        let parts = velocity_loop.step(error, Torque::ZERO, Torque::nm(1e12));
        let command = axis.plant.actuator.current(parts.proportional + parts.integral);
        plant.step(if is_late { std::mem::replace(&mut pending, command) } else { command });
        let quarter = &mut swing[4 * n / ticks];
        *quarter = quarter.max(state.motor_velocity.as_m_per_s().abs());
    }
    swing[3] / swing[1]
}

fn assert_margin_is_the_edge(machine: &Machine, what: &str) {
    for (set, name) in (0..).zip(&machine.gain_sets) {
        let loops = Loops::new(machine, AxisId::X, set);
        let margin_db = loops.velocity_margins().gain_margin_db.unwrap_or(f64::NAN);
        let edge = 10.0_f64.powf(margin_db / 20.0);
        let (below, above) = (growth(machine, set, 0.99 * edge), growth(machine, set, 1.01 * edge));
        assert!(
            below < 1.0 && above > 1.0,
            "{what}, {name}: gain margin {margin_db:.2} dB, growth {below:.4} below and {above:.4} above it"
        );
    }
}

#[test]
fn the_gain_margin_is_the_edge_of_the_running_loop() {
    for name in ["reference", "paper"] {
        let machine = config::load(name).unwrap_or_else(|error| panic!("{error}"));
        assert_margin_is_the_edge(&machine, name);
    }
}

#[test]
fn latency_and_dead_time_move_the_edge_as_stated() {
    let mut machine = config::load("reference").unwrap_or_else(|error| panic!("{error}"));
    machine.axes[AxisId::X].feedback_latency = Span::us(150);
    machine.axes[AxisId::X].plant.actuator.dead_time = Span::us(700);
    assert_margin_is_the_edge(&machine, "late reference");
}

#[test]
fn the_lag_of_eq_5_has_the_edge_that_is_stated() {
    let mut machine = config::load("reference").unwrap_or_else(|error| panic!("{error}"));
    let gains = &mut machine.axes[AxisId::X].control.gain_sets[0].velocity;
    gains.memory = Memory::Lag { gain_nm_s_per_rad: 9.0, time_constant_s: 0.069 };
    assert_margin_is_the_edge(&machine, "lag");
}
