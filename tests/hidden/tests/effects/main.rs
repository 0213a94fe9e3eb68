//! Each effect shows where it is said to show, and an effect of no size changes nothing.

mod crossing;

use std::f64::consts::TAU;

use hidden::axis::{Axis, Push, TABLE};
use hidden::effect::{Effect, Kind, NAMES, Shape, Strangeness, What};
use hidden::features::Features;
use hidden::machine::Machine;
use hidden::path::{Motion, Run};
use hidden::plant::Plant;
use hidden::rig::{Conditions, Row, run};

/// Of the session at the begin of the runs here, s: what warms up has begun to.
const START: f64 = 30.0;

fn machine() -> Machine {
    let mut machine = Machine::paper();
    for axis in &mut machine.axes {
        // Fast enough that a leg of a sweep comes to its steady state, and something wet beside the dry friction.
        axis.control.position_gain = 30.0;
        axis.plant.viscous = 1e4;
    }
    machine
}

/// There and back at a speed, or a piece of a circle.
fn rows(motion: Motion, features: &[Features; 2], periods: usize) -> Vec<Row> {
    let machine = machine();
    let told = machine.axes.map(|axis| axis.plant);
    let mut setpoints = Run { name: String::new(), motion, is_held_out: false }.setpoints();
    setpoints.truncate(periods);
    run(&machine, &told, features, &setpoints, &Conditions { start: START, ..Conditions::QUIET })
}

fn sweep(speed: f64) -> Motion {
    Motion::Sweep { speeds: vec![speed], laps: 1 }
}

fn effect(what: What, amplitude: f64, choice: f64) -> Effect {
    let shape = Shape { choices: [choice; 4], phase: 0.7, sign: 1.0 };
    Effect { what, axis: 0, shape, amplitude }
}

/// Its features, and its first parameter as a machine file would call it.
fn set(effect: &Effect) -> ([Features; 2], f64) {
    let mut features = [Features::default(); 2];
    let keys = effect.set(&machine(), &mut features);
    let first = ["n", "mm", "um", "percent", "us", "ms", "a", "m", "m2", "kn", "hz"];
    let is_size = |key: &str| first.iter().any(|unit| key.ends_with(&format!("-{unit}")));
    let size = keys.iter().filter(|(key, _)| is_size(key)).find_map(|(_, value)| value.as_f64());
    (features, size.unwrap_or(f64::NAN))
}

/// A row of the run with the effect beside that of the run without, in a steady part of a leg.
struct Place<'a> {
    plant: Plant,
    features: &'a [Features; 2],
    /// m, m/s, s.
    place: f64,
    velocity: f64,
    t: f64,
}

impl Place<'_> {
    fn direction(&self) -> f64 {
        self.velocity.signum()
    }
    /// Angle of the motor, rad.
    fn angle(&self) -> f64 {
        self.place / self.plant.travel_per_rad()
    }
    /// Force of the screw without the effect, N.
    fn friction(&self) -> f64 {
        self.dry() + self.direction() * self.plant.viscous_friction(self.velocity.abs())
    }
    /// The dry part of it, N.
    fn dry(&self) -> f64 {
        self.direction() * self.plant.sliding
    }
}

/// What is looked at.
#[derive(Clone, Copy)]
enum Channel {
    /// Current, as force at the table, N.
    Force,
    /// Table less motor encoder, m.
    Stretch,
    /// Setpoint less motor encoder, m.
    Lag,
}

/// Holds the change of a channel in the steady parts of a sweep against what it should be; `wanted` is a share of the
/// rms of the latter.
#[track_caller]
fn changes(
    effect: &Effect,
    speed: f64,
    channel: Channel,
    wanted: f64,
    expected: impl Fn(&Place<'_>, f64) -> f64,
) {
    let (features, size) = set(effect);
    let (with, without) =
        (rows(sweep(speed), &features, 4000), rows(sweep(speed), &Default::default(), 4000));
    let plant = machine().axes[0].plant;
    let value = |row: &Row| match channel {
        Channel::Force => row[0].current * plant.torque_constant / plant.torque_per_force(),
        Channel::Stretch => row[0].table - row[0].position,
        Channel::Lag => row[0].setpoint - row[0].position,
    };
    let (mut missed, mut sum, mut count) = (0.0, 0.0, 0);
    for (number, (with, without)) in with.windows(2).zip(without.windows(2)).enumerate() {
        let step = |rows: &[Row], of: &dyn Fn(&Row) -> f64| (of(&rows[1]) - of(&rows[0])) / 5e-4;
        let velocity = step(without, &|row| row[0].position);
        let is_steady = (step(without, &|row| row[0].setpoint).abs() - speed).abs() < 1e-6 * speed
            && (velocity.abs() - speed).abs() < 0.01 * speed;
        if !is_steady {
            continue;
        }
        let t = START + number as f64 * 5e-4;
        let place = Place { plant, features: &features, place: without[0][0].position, velocity, t };
        let wanted = expected(&place, size);
        missed += (value(&with[0]) - value(&without[0]) - wanted).powi(2);
        sum += wanted.powi(2);
        count += 1;
    }
    assert!(count > 100, "{}: only {count} steady rows", effect.name());
    let [missed, rms] = [missed, sum].map(|sum| (sum / f64::from(count)).sqrt());
    assert!(missed < wanted * rms, "{}: off by {missed:.3e} of {rms:.3e}", effect.name());
}

fn named(kind: Kind, amplitude: f64) -> Effect {
    effect(What::Named(kind), amplitude, 0.1)
}

const SPEED: f64 = 0.02;

#[test]
fn forces_of_friction_and_load_show_in_the_current() {
    use Channel::Force;
    changes(&named(Kind::ViscousFriction, 0.3), SPEED, Force, 0.05, |at, size| size * 1e3 * at.velocity);
    changes(&named(Kind::QuadraticDrag, 1.0), SPEED, Force, 0.05, |at, size| {
        size * at.velocity * at.velocity.abs()
    });
    changes(&named(Kind::DirectionAsymmetry, 0.3), SPEED, Force, 0.05, |at, size| {
        0.01 * size * at.friction() * at.direction()
    });
    // Told along the travel, so the drive pushes against it.
    changes(&named(Kind::ConstantForce, 0.3), SPEED, Force, 0.05, |_, size| -size);
    changes(&named(Kind::SpringLoad, 0.3), SPEED, Force, 0.05, |at, _| {
        let train = &at.features[0].train;
        train.spring * (at.place - train.spring_centre)
    });
    changes(&named(Kind::LoadDependentFriction, 1.0), SPEED, Force, 0.05, |at, size| {
        at.friction() * 0.01 * size / (1.0 - 0.01 * size)
    });
    changes(&named(Kind::FrictionWarmUp, 0.5), SPEED, Force, 0.05, |at, size| {
        let time = at.features[0].rubbing.warm.time;
        -at.dry() * 0.01 * size * (1.0 - (-at.t / time).exp())
    });
    // Slope, wave and bump.
    for choice in [0.1, 0.5, 0.9] {
        let effect = effect(What::Named(Kind::PositionDependentFriction), 0.3, choice);
        changes(&effect, SPEED, Force, 0.1, |at, _| {
            let rubbing = &at.features[0].rubbing;
            let [height, place, width] = rubbing.place_bump;
            let bump =
                if height == 0.0 { 0.0 } else { height * (-((at.place - place) / width).powi(2)).exp() };
            at.dry() * (rubbing.place_slope * at.place + rubbing.place_wave.at(at.place) + bump)
        });
    }
    // As a bell.
    changes(&effect(What::Named(Kind::Stribeck), 0.5, 0.3), 0.0015, Force, 0.1, |at, size| {
        let ratio = at.velocity / at.features[0].rubbing.stribeck_speed;
        at.direction() * size * (-ratio * ratio).exp()
    });
}

#[test]
fn ripples_show_over_the_angle_in_the_current() {
    use Channel::Force;
    // Slowly, so that the loops follow: at 5 mm/s the sixth order is 3 Hz.
    let slow = 0.005;
    changes(&named(Kind::ScrewRipple, 0.3), SPEED, Force, 0.15, |at, _| {
        at.dry() * at.features[0].rubbing.ripple[0].at(at.angle())
    });
    changes(&named(Kind::BallPassRipple, 0.5), slow, Force, 0.15, |at, _| {
        at.dry() * at.features[0].rubbing.ripple[1].at(at.angle())
    });
    changes(&named(Kind::MotorCogging, 0.3), slow, Force, 0.35, |at, _| {
        let torque: f64 = at.features[0].motor.cogging.iter().map(|wave| wave.at(at.angle())).sum();
        -torque / at.plant.torque_per_force()
    });
    changes(&named(Kind::TorqueRipple, 0.5), slow, Force, 0.35, |at, _| {
        -at.friction() * at.features[0].motor.ripple.at(at.angle())
    });
    changes(&named(Kind::TorqueSaturation, 1.0), SPEED, Force, 0.05, |at, _| {
        let nominal = at.friction() * at.plant.torque_per_force() / at.plant.torque_constant;
        // i (1 - k |i|) is the current that is needed.
        let loss = at.features[0].motor.saturation;
        let needed = (1.0 - (1.0 - 4.0 * loss * nominal.abs()).sqrt()) / (2.0 * loss);
        (needed.copysign(nominal) - nominal) * at.plant.torque_constant / at.plant.torque_per_force()
    });
}

#[test]
fn what_lies_between_motor_and_table_shows_in_their_distance() {
    use Channel::Stretch;
    changes(&named(Kind::Backlash, 0.5), SPEED, Stretch, 0.05, |at, size| -at.direction() * 0.5e-6 * size);
    changes(&named(Kind::SoftZone, 0.5), SPEED, Stretch, 0.05, |at, size| {
        -at.direction() * at.features[0].train.soft_share * 1e-6 * size
    });
    changes(&named(Kind::PositionDependentStiffness, 0.5), SPEED, Stretch, 0.05, |at, _| {
        -at.friction() / at.plant.stiffness * at.features[0].train.compliance_slope * at.place
    });
    changes(&named(Kind::PitchError, 1.0), SPEED, Stretch, 0.05, |at, _| {
        at.features[0].train.pitch.from_home(at.place)
    });
    changes(&named(Kind::ScaleError, 1.0), SPEED, Stretch, 0.05, |at, size| size * 1e-6 * at.place);
    changes(&named(Kind::ThermalGrowth, 1.0), SPEED, Stretch, 0.05, |at, size| {
        let time = at.features[0].train.growth.time;
        size * 1e-6 * at.place * (1.0 - (-at.t / time).exp())
    });
}

#[test]
fn errors_of_sensors_show_at_the_sensor() {
    use Channel::{Force, Stretch};
    changes(&named(Kind::EncoderEccentricity, 1.0), SPEED, Stretch, 0.1, |at, _| {
        -at.features[0].reading.motor_error(at.place)
    });
    let in_motor = effect(What::Named(Kind::EncoderInterpolation), 1.0, 0.5);
    changes(&in_motor, 0.005, Stretch, 0.35, |at, _| -at.features[0].reading.motor_error(at.place));
    changes(&named(Kind::EncoderInterpolation, 1.0), 0.002, Stretch, 0.35, |at, _| {
        at.features[0].reading.table.from_home(at.place - at.friction() / at.plant.stiffness)
    });
    // Both axes make the same sweep here.
    changes(&named(Kind::Squareness, 1.0), SPEED, Stretch, 0.05, |at, size| size * 1e-6 * at.place);
    changes(&named(Kind::CrossCoupling, 1.0), SPEED, Stretch, 0.05, |at, size| size * 1e-9 * at.friction());
    let pushed = effect(What::Named(Kind::CrossCoupling), 1.0, 0.9);
    changes(&pushed, SPEED, Force, 0.05, |at, size| -0.01 * size * at.friction());
}

#[test]
fn what_the_controller_does_otherwise_shows_in_the_following_error() {
    use Channel::Lag;
    changes(&named(Kind::ServoGainMismatch, 1.0), SPEED, Lag, 0.05, |at, size| {
        at.velocity / 30.0 * (1.0 / (1.0 + 0.01 * size) - 1.0)
    });
    changes(&named(Kind::CommandFilter, 0.5), SPEED, Lag, 0.05, |at, size| at.velocity * 1e-3 * size);
    let mean = effect(What::Named(Kind::CommandFilter), 0.5, 0.9);
    // Late by half of its length, and told so.
    changes(&mean, SPEED, Lag, 0.05, |at, size| at.velocity * 1e-3 * size);
}

/// The row from which on two runs differ in the current.
fn first_difference(a: &[Row], b: &[Row]) -> usize {
    a.iter()
        .zip(b)
        .position(|(a, b)| (a[0].current - b[0].current).abs() > 1e-12)
        .expect("they differ somewhere")
}

#[test]
fn a_delay_and_a_lag_come_before_anything_moves() {
    let base = rows(sweep(SPEED), &Default::default(), 200);
    let at_rest = vec![Row::default(); 200];
    let begin = first_difference(&base, &at_rest);
    let (features, size) = set(&named(Kind::ActuatorDelay, 2.0));
    assert_eq!(size, 1000.0);
    let late = first_difference(&rows(sweep(SPEED), &features, 200), &at_rest);
    assert_eq!(late, begin + 2, "a delay of 1 ms is two periods");
    let (features, size) = set(&named(Kind::CurrentLoopLag, 2.0));
    let lagging = rows(sweep(SPEED), &features, 200);
    // Half a millisecond after a step: one pole of the current loop against two.
    let [fast, slow] = [TAU * 300.0, 1e6 / size];
    let one = 1.0 - (-fast * 5e-4_f64).exp();
    let two = 1.0 - (fast * (-slow * 5e-4_f64).exp() - slow * (-fast * 5e-4_f64).exp()) / (fast - slow);
    let share = lagging[begin][0].current / base[begin][0].current;
    assert!((share / (two / one) - 1.0).abs() < 1e-3, "{share} of the current, should be {}", two / one);
}

#[test]
fn a_compensation_acts_at_the_reversal_of_the_setpoint_and_not_before() {
    let (features, size) = set(&named(Kind::ReversalCompensation, 1.0));
    let (with, without) =
        (rows(sweep(SPEED), &features, 3000), rows(sweep(SPEED), &Default::default(), 3000));
    let turn =
        without.windows(2).position(|rows| rows[1][0].setpoint < rows[0][0].setpoint).expect("it turns");
    assert!(first_difference(&with, &without).abs_diff(turn + 1) <= 1);
    let change = with[turn + 4][0].current - without[turn + 4][0].current;
    assert!((-1.1..-0.4).contains(&(change / size)), "{change} A of a pulse of {size} A");
}

#[test]
fn a_disturbance_keeps_its_frequency_at_every_speed() {
    let (features, _) = set(&named(Kind::TorqueDisturbance, 0.5));
    let omega = features[0].motor.disturbance.wave;
    for speed in [0.01, 0.04] {
        let (with, without) =
            (rows(sweep(speed), &features, 4000), rows(sweep(speed), &Default::default(), 4000));
        let (mut sums, mut square) = ([0.0; 2], 0.0);
        // Within the first leg, from its steady part on.
        for number in 600..1000 {
            let change = with[number][0].current - without[number][0].current;
            let (sin, cos) = (omega * number as f64 * 5e-4).sin_cos();
            sums[0] += change * sin;
            sums[1] += change * cos;
            square += change * change;
        }
        let explained = (sums[0] * sums[0] + sums[1] * sums[1]) * 2.0 / 400.0 / square;
        assert!(explained > 0.9, "at {speed} m/s its frequency explains {explained} of the change");
    }
}

#[test]
fn presliding_moves_the_table_before_it_breaks_away() {
    let mut plant = machine().axes[0].plant;
    (plant.stiffness, plant.damping) = (0.0, 0.0);
    let (features, size) = set(&named(Kind::Presliding, 1.0));
    // Slowly, so that nothing rings.
    let moved = |features: &Features| {
        let mut axis = Axis::new(&plant, features, 0.0, 0.0);
        for step in 0..40_000 {
            let force = 0.5 * plant.breakaway * f64::from(step) / 40_000.0;
            axis.advance(0.0, 2e-5, &Push { force, ..Push::default() });
        }
        axis.state()[TABLE]
    };
    assert_eq!(moved(&Features::default()), 0.0);
    let at = 1e6 * moved(&features[0]) / size;
    let share = (0..8).map(|n| (at / (f64::from(2 * n + 1) / 8.0)).min(1.0)).sum::<f64>() / 8.0;
    assert!((share - 0.5).abs() < 0.03, "at {at} of the mean travel the springs carry {share}, not a half");
}

#[test]
fn a_swinging_mass_rings_at_its_frequency() {
    let (features, _) = set(&named(Kind::Resonance, 1.0));
    let (hz, damping) = (features[0].train.swing_hz, features[0].train.swing_damping);
    let (with, without) = (rows(sweep(0.1), &features, 1000), rows(sweep(0.1), &Default::default(), 1000));
    // After the ramp of 50 ms; what explains the change best between 0.7 and 1.3 of the frequency.
    let explained = |omega: f64| {
        let (mut sums, mut square) = ([0.0; 2], 0.0);
        for number in 110..500 {
            let speed = |rows: &[Row]| rows[number + 1][0].table - rows[number - 1][0].table;
            let t = (number - 110) as f64 * 5e-4;
            let grown = (damping * TAU * hz * t).exp() * (speed(&with) - speed(&without));
            let (sin, cos) = (omega * t).sin_cos();
            sums[0] += grown * sin;
            sums[1] += grown * cos;
            square += grown * grown;
        }
        (sums[0] * sums[0] + sums[1] * sums[1]) * 2.0 / 390.0 / square
    };
    let shares: Vec<f64> =
        (70..=130).map(|percent| explained(TAU * hz * f64::from(percent) * 0.01)).collect();
    let best = (0..shares.len()).max_by(|a, b| shares[*a].total_cmp(&shares[*b])).expect("there are some");
    assert!(
        best.abs_diff(30) <= 12 && shares[best] > 0.3,
        "{} at {} % of its frequency",
        shares[best],
        70 + best
    );
}

#[test]
fn an_effect_of_no_size_changes_no_bit() {
    let circle = || Motion::Circle { radius: 0.01, feed: 0.05, is_ccw: true, laps: 1 };
    let base = rows(circle(), &Default::default(), 800);
    let all = NAMES.iter().map(|(kind, _)| What::Named(*kind)).chain(Strangeness::ALL.map(What::Strange));
    for what in all {
        for choice in [0.1, 0.9] {
            let (none, _) = set(&effect(what, 0.0, choice));
            let is_same = rows(circle(), &none, 800) == base;
            assert!(is_same, "{} of no size changes the run", effect(what, 0.0, choice).name());
        }
    }
}

#[test]
fn every_effect_changes_the_run() {
    let circle = || Motion::Circle { radius: 0.01, feed: 0.05, is_ccw: true, laps: 1 };
    let base = rows(circle(), &Default::default(), 2400);
    let all = NAMES.iter().map(|(kind, _)| What::Named(*kind)).chain(Strangeness::ALL.map(What::Strange));
    for what in all {
        let (some, _) = set(&effect(what, 1.0, 0.1));
        assert!(rows(circle(), &some, 2400) != base, "{what:?} changes nothing");
    }
}
