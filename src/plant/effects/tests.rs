//! What holds for every effect of the catalogue, and the closed forms of those that have one.

mod crossing;

use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::sync::Arc;

use super::acting::Acting;
use super::*;
use crate::base::time::Span;
use crate::base::units::{Current, Force as Newtons, Position, Velocity};
use crate::plant::tests::paper_axis;
use crate::plant::{Parameters, Plant};

const TICK: Span = Span::us(500);

/// One tick of an axis in a loop.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row {
    motor_um: f64,
    table_um: f64,
    current_a: f64,
}

const SPEED_RAD_PER_S: f64 = 2000.0 / 60.0 / 150.0;
const RADIUS_M: f64 = 0.15;
/// Before the reversal.
const BEGIN_S: f64 = -0.25;

/// An axis on its way along a sine of 150 mm, a quarter of a second before its reversal.
fn under_way(axis: &Parameters, fine_steps: u32) -> Plant {
    under_way_at(axis, TICK, fine_steps)
}

/// The same, stepped at another tick.
fn under_way_at(axis: &Parameters, tick: Span, fine_steps: u32) -> Plant {
    let angle = SPEED_RAD_PER_S * BEGIN_S;
    let (place, velocity) = (RADIUS_M * angle.cos(), -RADIUS_M * SPEED_RAD_PER_S * angle.sin());
    Plant::sliding_in(axis, tick, fine_steps, Velocity::m_per_s(velocity), Position::m(place))
}

/// Follows the sine under loops like those of the paper, to a third of a second after the reversal.
fn reversal(plant: Plant) -> Vec<Row> {
    reversal_in(plant, 1)
}

/// The same of a plant that is stepped so often in a tick.
fn reversal_in(mut plant: Plant, steps: u32) -> Vec<Row> {
    let rad_per_m = TAU / 0.01;
    let begin = plant.state();
    let (mut integral_nm, mut last_m) = (begin.current.as_a(), f64::NAN);
    let row = |tick: i32| {
        let angle = SPEED_RAD_PER_S * (BEGIN_S + f64::from(tick) * TICK.as_s());
        let state = plant.state();
        let [motor, table] = plant.shown(state.motor_position, state.table_position);
        let asked_m = RADIUS_M * (angle.cos() - (SPEED_RAD_PER_S * BEGIN_S).cos());
        let asked_m_per_s = -RADIUS_M * SPEED_RAD_PER_S * angle.sin();
        let shown_m_per_s =
            if last_m.is_nan() { asked_m_per_s } else { (motor.as_m() - last_m) / TICK.as_s() };
        last_m = motor.as_m();
        let error = rad_per_m * (20.0 * (asked_m - motor.as_m()) + asked_m_per_s - shown_m_per_s);
        integral_nm += 178.7 * error * TICK.as_s();
        for _ in 0..steps {
            plant.step(Current::a(1.2 * error + integral_nm));
        }
        Row { motor_um: motor.as_um(), table_um: table.as_um(), current_a: state.current.as_a() }
    };
    (0..1_166).map(row).collect()
}

/// How far an axis gets from rest in 100 ms of 8 A, um: 0.14 m/s at its end.
fn dash(axis: &Parameters) -> f64 {
    let mut plant = Plant::new(axis, TICK);
    for _ in 0..200 {
        plant.step(Current::a(8.0));
    }
    plant.state().motor_position.as_um()
}

/// How far two runs are apart at most, um, and by how much of the current, rms.
fn apart(one: &[Row], other: &[Row]) -> (f64, f64) {
    let (mut worst_um, mut off_a2, mut all_a2) = (0.0_f64, 0.0, 0.0);
    for (a, b) in one.iter().zip(other) {
        worst_um = worst_um.max((a.motor_um - b.motor_um).abs()).max((a.table_um - b.table_um).abs());
        off_a2 += (a.current_a - b.current_a).powi(2);
        all_a2 += a.current_a.powi(2);
    }
    (worst_um, (off_a2 / all_a2).sqrt())
}

fn run(axis: &Parameters, fine_steps: u32) -> Vec<Row> {
    reversal(under_way(axis, fine_steps))
}

#[test]
fn names_and_keys_say_what_they_are_once() {
    let names: BTreeSet<&str> = CATALOGUE.iter().map(|entry| entry.name).collect();
    assert_eq!(names.len(), CATALOGUE.len());
    for entry in CATALOGUE {
        assert!(entry.parameters.len() <= VALUES_MAX, "{}", entry.name);
        let keys: BTreeSet<&str> = entry.parameters.iter().map(|parameter| parameter.key).collect();
        assert_eq!(keys.len(), entry.parameters.len(), "{}", entry.name);
        for alias in entry.aliases {
            let other = super::entry(alias).unwrap_or_else(|| panic!("{}: no effect {alias}", entry.name));
            assert!(other.aliases.contains(&entry.name), "{alias} does not know its alias {}", entry.name);
        }
        for parameter in entry.parameters {
            let [least, most] = parameter.bounds;
            assert!(least < most && parameter.prior > 0.0, "{} {}", entry.name, parameter.key);
            assert!((least..=most).contains(&parameter.nominal), "{} {}", entry.name, parameter.key);
            // As words: `N s/mm` is `n-s-per-mm`.
            let words = parameter.unit.to_lowercase().replace("n m", "nm").replace('%', "percent");
            let words = words.replace('/', "-per-").replace(' ', "-");
            assert!(
                parameter.key.ends_with(&words),
                "{}: {} is in {}",
                entry.name,
                parameter.key,
                parameter.unit
            );
        }
        assert!(entry.nominal()[0] != 0.0, "{} does nothing", entry.name);
    }
}

#[test]
fn an_effect_without_amplitude_changes_no_bit() {
    let pushed = paper_axis().with_effect(entry("constant-force").unwrap(), [-70.0, 0.0, 0.0]);
    for (axis, entry) in
        [paper_axis(), pushed].iter().flat_map(|axis| CATALOGUE.iter().map(move |e| (axis, e)))
    {
        if axis.effects.of(entry)[0] != 0.0 {
            continue;
        }
        let base = run(axis, 10);
        let mut values = entry.nominal();
        values[0] = 0.0;
        assert_eq!(run(&axis.with_effect(entry, values), 10), base, "{}", entry.name);
        // Nor does its formula, where it is computed all the same. Bristles without length are no spring.
        if matches!(entry.action, Action::Bristles(_)) {
            continue;
        }
        let acting = Acting::of(axis, std::iter::once((entry, &values)));
        let plant = Plant { acting: Some(Arc::new(acting)), ..under_way(axis, 10) };
        let (off_um, off) = apart(&reversal(plant), &base);
        assert!(off_um < 1e-6 && off < 1e-6, "{}: {off_um} um, {off} of the current", entry.name);
    }
}

#[test]
fn an_axis_moves_with_any_effect_at_either_end_of_what_it_may_be() {
    for entry in CATALOGUE {
        for (of, parameter) in entry.parameters.iter().enumerate() {
            for end in parameter.bounds {
                let mut values = entry.nominal();
                values[of] = end;
                let rows = run(&paper_axis().with_effect(entry, values), 10);
                let is_finite = |row: &Row| row.current_a.is_finite() && row.table_um.is_finite();
                assert!(rows.iter().all(is_finite), "{} {} = {end}", entry.name, parameter.key);
            }
        }
    }
}

#[test]
fn an_effect_with_its_usual_values_is_plain_to_see() {
    let base = run(&paper_axis(), 10);
    for entry in CATALOGUE {
        // What the next axis or the control does, and what takes an hour, is not to be seen here.
        let is_of_others = matches!(entry.action, Action::NextAxis(_) | Action::Control(_));
        if is_of_others || entry.experiment == Experiment::Repetition {
            continue;
        }
        let axis = paper_axis().with_effect(entry, entry.nominal());
        let (off_um, off) = apart(&run(&axis, 10), &base);
        let dash_um = (dash(&axis) - dash(&paper_axis())).abs();
        assert!(
            off_um > 0.02 || off > 2e-3 || dash_um > 1.0,
            "{}: {off_um} um, {off} of the current, {dash_um} um in a dash",
            entry.name
        );
    }
}

#[test]
fn a_tick_in_ten_steps_of_their_own_changes_less_than_can_be_seen() {
    // A tenth of what counts: 0.1 um and 0.5 % of the current. A plant that is stepped so often takes no long steps.
    // Bristles swing the faster the shorter their way.
    let bristly = CATALOGUE.iter().filter(|entry| matches!(entry.action, Action::Bristles(_)));
    let shortest = bristly.map(|entry| (entry, [entry.parameters[0].bounds[0], 4.0, 0.0]));
    for (entry, values) in CATALOGUE.iter().map(|entry| (entry, entry.nominal())).chain(shortest) {
        let axis = paper_axis().with_effect(entry, values);
        let tick = Span::us(50);
        let (off_um, off) = apart(&run(&axis, 10), &reversal_in(under_way_at(&axis, tick, 4), 10));
        println!("{}: {off_um:.5} um, {:.5} % of the current", entry.name, 100.0 * off);
        assert!(off_um < 0.01, "{}: {off_um} um by steps of a tenth", entry.name);
        assert!(off < 5e-4, "{}: {} % of the current by steps of a tenth", entry.name, 100.0 * off);
    }
}

/// Current, A, wind-up, um, and place of the table, m, of an axis that has moved steadily for 0.4 s, from a place on.
fn steady(axis: &Parameters, mm_per_s: f64, from_mm: f64) -> [f64; 3] {
    let velocity = Velocity::mm_per_s(mm_per_s);
    let mut plant = Plant::sliding(axis, TICK, velocity, Position::mm(from_mm));
    let mut integral_a = plant.state().current.as_a();
    for _ in 0..800 {
        let error = mm_per_s - plant.state().motor_velocity.as_mm_per_s();
        integral_a += 0.1 * error;
        plant.step(Current::a(2.0 * error + integral_a));
    }
    let state = plant.state();
    let table_m = 1e-3 * from_mm + state.table_position.as_m();
    [state.current.as_a(), (state.motor_position - state.table_position).as_um(), table_m]
}

#[test]
fn a_steady_motion_takes_the_current_that_the_equation_says() {
    // Of the paper's axis: 951.3 N of friction, 1 N m/A.
    const SLIDING_N: f64 = 951.3;
    let per_newton_a = 1.0 / paper_axis().mechanics.force_per_torque();
    type Force = fn(v: f64, x: f64) -> f64;
    let cases: [(&str, Values, Force); 10] = [
        ("viscous-friction", [2.0, 0.0, 0.0], |v, _| {
            SLIDING_N.copysign(v) + 2e3 * (v.abs() - 5e-4).copysign(v)
        }),
        ("quadratic-drag", [80_000.0, 0.0, 0.0], |v, _| (SLIDING_N + 8e4 * v * v).copysign(v)),
        ("stribeck", [300.0, 20.0, 2.0], |v, _| {
            (SLIDING_N + 300.0 * (-(v / 0.02).powi(2)).exp()).copysign(v)
        }),
        ("stribeck", [300.0, 20.0, 1.0], |v, _| (SLIDING_N + 300.0 * (-(v / 0.02).abs()).exp()).copysign(v)),
        ("direction-asymmetry", [10.0, 0.0, 0.0], |v, _| SLIDING_N.copysign(v) + 0.1 * SLIDING_N),
        ("constant-force", [-70.0, 0.0, 0.0], |v, _| SLIDING_N.copysign(v) + 70.0),
        ("spring-load", [2.0, 100.0, 0.0], |v, x| SLIDING_N.copysign(v) + 2e3 * (x - 0.1)),
        ("position-dependent-friction", [80.0, 0.0, 0.0], |v, x| (SLIDING_N * (1.0 + 0.8 * x)).copysign(v)),
        // The screw pushes with what it has to push against.
        ("load-dependent-friction", [5.0, 0.0, 0.0], |v, _| (SLIDING_N / 0.95).copysign(v)),
        // A time constant is over when 0.4 s are.
        ("friction-warm-up", [20.0, 1.0, 0.0], |v, _| {
            (SLIDING_N * (1.0 - 0.2 * (1.0 - (-0.4_f64).exp()))).copysign(v)
        }),
    ];
    for (name, values, force) in cases {
        let axis = paper_axis().with_effect(entry(name).unwrap(), values);
        for (mm_per_s, from_mm) in [(20.0, 40.0), (-30.0, 150.0)] {
            let [current_a, _, table_m] = steady(&axis, mm_per_s, from_mm);
            let expected_a = force(1e-3 * mm_per_s, table_m) * per_newton_a;
            assert!(
                (current_a - expected_a).abs() < 5e-4 * expected_a.abs(),
                "{name} at {mm_per_s} mm/s: {current_a} A, expected {expected_a} A"
            );
        }
    }
    // i (1 - k i) makes the torque.
    let axis = paper_axis().with_effect(entry("torque-saturation").unwrap(), [4.0, 0.0, 0.0]);
    let [current_a, ..] = steady(&axis, 20.0, 0.0);
    let made_a = current_a * (1.0 - 0.04 * current_a);
    assert!((made_a / (SLIDING_N * per_newton_a) - 1.0).abs() < 1e-4, "{current_a} A make {made_a} N m");
}

#[test]
fn a_screw_winds_up_as_its_stiffness_says() {
    let stiff_um = 951.3 / 151.0;
    for (name, values, mm_per_s, expected_um) in [
        ("soft-zone", [60.0, 2.0, 0.0], 20.0, stiff_um + 0.6 * 2.0),
        ("soft-zone", [60.0, 50.0, 0.0], -20.0, -stiff_um / 0.4),
        ("position-dependent-stiffness", [200.0, 0.0, 0.0], 20.0, stiff_um * (1.0 + 2.0 * 0.108)),
        ("backlash", [4.0, 0.0, 0.0], -20.0, -stiff_um - 2.0),
    ] {
        let axis = paper_axis().with_effect(entry(name).unwrap(), values);
        let [_, wound_um, _] = steady(&axis, mm_per_s, 100.0);
        assert!((wound_um - expected_um).abs() < 5e-3, "{name}: {wound_um} um, expected {expected_um} um");
    }
}

#[test]
fn torques_swing_as_often_and_as_far_as_they_say() {
    // Two turns at 2 turns a second: slow enough for a stiff loop to answer in full.
    let per_torque = paper_axis().mechanics.force_per_torque();
    for (name, values, amplitude_a, periods) in [
        ("motor-cogging", [0.2, 3.0, 0.0], 0.2, 6.0),
        ("torque-ripple", [10.0, 4.0, 0.0], 0.1 * 951.3 / per_torque, 8.0),
        ("torque-disturbance", [0.2, 5.0, 0.0], 0.2, 5.0),
        ("torque-disturbance-push", [200.0, 5.0, 0.0], 200.0 / per_torque, 5.0),
        ("ball-pass-ripple", [10.0, 2.5, 0.0], 0.1 * 951.3 / per_torque, 5.0),
    ] {
        let axis = paper_axis().with_effect(entry(name).unwrap(), values);
        let mut plant = Plant::sliding(&axis, TICK, Velocity::mm_per_s(20.0), Position::ZERO);
        let mut integral_a = plant.state().current.as_a();
        let [mut sine_a, mut cosine_a] = [0.0; 2];
        for tick in 0..3_000 {
            let state = plant.state();
            let error = 20.0 - state.motor_velocity.as_mm_per_s();
            integral_a += 0.4 * error;
            plant.step(Current::a(4.0 * error + integral_a));
            // After a turn to settle.
            if tick >= 1_000 {
                let angle = TAU * periods * f64::from(tick) / 2_000.0;
                sine_a += state.current.as_a() * angle.sin() / 1_000.0;
                cosine_a += state.current.as_a() * angle.cos() / 1_000.0;
            }
        }
        let found_a = f64::hypot(sine_a, cosine_a);
        assert!((found_a / amplitude_a - 1.0).abs() < 0.05, "{name}: {found_a} A, expected {amplitude_a} A");
    }
}

#[test]
fn a_mode_of_the_table_weighs_nothing_of_its_own() {
    let mut axis = paper_axis().without_friction();
    let bare = Plant::new(&axis, TICK);
    axis = axis.with_effect(entry("resonance").unwrap(), [40.0, 30.0, 20.0]);
    let way_um = |mut plant: Plant| {
        for tick in 0..2_000 {
            plant.step(Current::a(if tick < 400 { 2.0 } else { 0.0 }));
        }
        (plant.state().motor_position.as_um(), plant.state().motor_velocity.as_mm_per_s())
    };
    let ((bare_um, bare_mm_per_s), (with_um, with_mm_per_s)) =
        (way_um(bare), way_um(Plant::new(&axis, TICK)));
    // The momentum is the same, and once all is quiet so is the velocity.
    assert!((with_mm_per_s / bare_mm_per_s - 1.0).abs() < 1e-6, "{with_mm_per_s} mm/s, {bare_mm_per_s} mm/s");
    // What swings lags behind while it is accelerated, by far less than the way.
    assert!((with_um / bare_um - 1.0).abs() < 1e-3 && with_um != bare_um, "{with_um} um, {bare_um} um");
}

/// Energy that a table rubbed off, J, from rest on, after each 5 us of a current that swings by `swing_a`.
fn rubbed_j(axis: &Parameters, swing_a: f64) -> Vec<f64> {
    let mut plant = Plant::new(axis, Span::us(5));
    let (motor_kg, table_kg) = (axis.mechanics.motor_mass_kg(), axis.mechanics.mass_kg);
    let (k, c) = (axis.mechanics.stiffness_n_per_m, axis.mechanics.damping_n_s_per_m);
    let (mut work_j, mut damped_j) = (0.0, 0.0);
    let step_s = 5e-6;
    (0..40_000)
        .map(|step| {
            let before = plant.body.motion;
            let time_s = f64::from(step) * step_s;
            plant
                .step(Current::a(swing_a * ((TAU * 5.0 * time_s).sin() + 0.4 * (TAU * 23.0 * time_s).sin())));
            let after = plant.body.motion;
            work_j += 0.5 * (before[3] * before[1] + after[3] * after[1]) * step_s;
            damped_j += 0.5 * c * ((before[1] - before[2]).powi(2) + (after[1] - after[2]).powi(2)) * step_s;
            let [deflection, motor, table, ..] = after;
            let stored_j =
                0.5 * (motor_kg * motor * motor + table_kg * table * table + k * deflection * deflection);
            work_j - damped_j - stored_j
        })
        .collect()
}

#[test]
fn what_rubs_never_gives_energy() {
    for entry in CATALOGUE {
        let is_bristly = matches!(entry.action, Action::Bristles(_));
        if !is_bristly && !matches!(entry.action, Action::Friction(_)) {
            continue;
        }
        for (severity, swing_a) in [(1.0, 1.5), (-1.0, 6.0), (3.0, 6.0)] {
            let mut values = entry.nominal();
            let [least, most] = entry.parameters[0].bounds;
            values[0] = (severity * values[0]).clamp(least, most);
            let rubbed = rubbed_j(&paper_axis().with_effect(entry, values), swing_a);
            let turned_over_j = rubbed.iter().fold(0.0, |most: f64, now| most.max(*now)).max(1e-3);
            // Bristles give back what they stored; the rest never gives anything.
            let mut most_j = 0.0_f64;
            for now_j in rubbed {
                let floor_j = if is_bristly { 0.0 } else { most_j };
                assert!(
                    now_j >= floor_j - 1e-5 * turned_over_j,
                    "{} {values:?} at {swing_a} A: {} J came back",
                    entry.name,
                    floor_j - now_j
                );
                most_j = most_j.max(now_j);
            }
        }
    }
}
