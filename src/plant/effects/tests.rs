//! What holds for every effect of the catalogue, and the closed forms of those that have one.

use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::sync::Arc;

use super::acting::Acting;
use super::*;
use crate::base::time::Span;
use crate::base::units::{Current, Position, Velocity};
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
    let angle = SPEED_RAD_PER_S * BEGIN_S;
    let (place, velocity) = (RADIUS_M * angle.cos(), -RADIUS_M * SPEED_RAD_PER_S * angle.sin());
    Plant::sliding_in(axis, TICK, fine_steps, Velocity::m_per_s(velocity), Position::m(place))
}

/// Follows the sine under loops like those of the paper, to a third of a second after the reversal.
fn reversal(mut plant: Plant) -> Vec<Row> {
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
        plant.step(Current::a(1.2 * error + integral_nm));
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
    let base = run(&paper_axis(), 10);
    for entry in CATALOGUE {
        let mut values = entry.nominal();
        values[0] = 0.0;
        let axis = paper_axis().with_effect(entry, values);
        assert_eq!(run(&axis, 10), base, "{}", entry.name);
        // Nor does its formula, where it is computed all the same. Bristles without length are no spring.
        if matches!(entry.action, Action::Bristles(_)) {
            continue;
        }
        let acting = Acting::of(&paper_axis(), std::iter::once((entry, &values)));
        let plant = Plant { acting: Some(Arc::new(acting)), ..under_way(&paper_axis(), 10) };
        let (off_um, off) = apart(&reversal(plant), &base);
        assert!(off_um < 1e-6 && off < 1e-6, "{}: {off_um} um, {off} of the current", entry.name);
    }
}

#[test]
fn an_effect_with_its_usual_values_is_plain_to_see() {
    let base = run(&paper_axis(), 10);
    for entry in CATALOGUE {
        // What the next axis does, and what takes an hour, is not to be seen here.
        if matches!(entry.action, Action::NextAxis(_)) || entry.experiment == Experiment::Repetition {
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
fn half_the_step_changes_less_than_can_be_seen() {
    // A tenth of what counts: 0.1 um and 0.5 % of the current.
    for entry in CATALOGUE {
        let axis = paper_axis().with_effect(entry, entry.nominal());
        let (off_um, off) = apart(&run(&axis, 10), &run(&axis, 20));
        println!("{}: {off_um:.5} um, {:.5} % of the current", entry.name, 100.0 * off);
        assert!(off_um < 0.01, "{}: {off_um} um by half the step", entry.name);
        assert!(off < 5e-4, "{}: {} % of the current by half the step", entry.name, 100.0 * off);
    }
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
