//! Known answers of the two-mass axis with stick-slip friction: each has a closed form.

use std::f64::consts::{PI, TAU};

use super::*;
use crate::base::units::Force;
use crate::plant::effects::{Effects, entry};
use crate::plant::friction::Variant;

const TICK: Span = Span::us(500);

/// The axis of the paper's Table 1 with the drive of the reference machine.
pub(crate) fn paper_axis() -> Parameters {
    Parameters {
        mechanics: Mechanics {
            mass_kg: 335.0,
            stiffness_n_per_m: 151e6,
            damping_n_s_per_m: 73.8e3,
            inertia_kg_m2: 0.0064,
            lead_m: 0.01,
            efficiency: 0.9,
            backlash_m: 0.0,
            carried_share: 0.0,
        },
        friction: friction::Parameters {
            variant: Variant::Nonlinear,
            breakaway: Force::n(1127.8),
            sliding: Force::n(951.3),
            fall_end: Velocity::mm_per_s(0.5),
            fall_start: Velocity::mm_per_s(0.1),
            viscous_n_s_per_m: 0.0,
        },
        actuator: Actuator {
            torque_constant_nm_per_a: 1.0,
            current_loop_hz: 300.0,
            filter_s: 0.0,
            dead_time: Span::ZERO,
            peak_current: Current::a(60.0),
        },
        effects: Effects::NONE,
    }
}

/// An axis whose motor is too heavy to be felt: it holds the velocity it is given.
fn pulled(mut axis: Parameters, velocity_m_per_s: f64) -> Plant {
    axis.mechanics.inertia_kg_m2 = 1e9;
    let mut plant = Plant::new(&axis, Span::us(1));
    plant.body.motion[1] = velocity_m_per_s;
    plant
}

fn coulomb(force_n: f64, viscous_n_s_per_m: f64) -> friction::Parameters {
    friction::Parameters {
        variant: Variant::Linear,
        breakaway: Force::n(force_n),
        sliding: Force::n(force_n),
        fall_end: Velocity::ZERO,
        fall_start: Velocity::ZERO,
        viscous_n_s_per_m,
    }
}

fn assert_near(name: &str, got: f64, expected: f64, bound: f64, unit: &str) {
    assert!((got - expected).abs() <= bound, "{name}: {got} {unit}, expected {expected} +- {bound} {unit}");
}

#[test]
fn a_ramp_breaks_away_when_spring_and_damper_reach_f_max() {
    for velocity_m_per_s in [1e-4, 1e-3] {
        let mut plant = pulled(paper_axis(), velocity_m_per_s);
        let mut ticks = 0;
        while plant.state().is_stuck {
            plant.step(Current::ZERO);
            ticks += 1;
        }
        let expected_s = (1127.8 - 73.8e3 * velocity_m_per_s) / (151e6 * velocity_m_per_s);
        // Within a step of 1 us and the rounding of the sum.
        assert_near("time to break-away", f64::from(ticks) * 1e-6, expected_s, 1.01e-6, "s");
    }
}

#[test]
fn a_free_table_decays_as_coulomb_and_viscous_friction_say() {
    for viscous in [0.0, 400.0] {
        let mut axis = paper_axis();
        axis.friction = coulomb(951.3, viscous);
        axis.mechanics.stiffness_n_per_m = 0.0;
        axis.mechanics.damping_n_s_per_m = 0.0;
        let mut plant = Plant::new(&axis, TICK);
        let (v0, m, f) = (0.1, 335.0, 951.3);
        plant.body.motion[2] = v0;
        plant.body.slide = 1.0;
        let mut time_s = 0.0;
        while !plant.state().is_stuck {
            plant.step(Current::ZERO);
            time_s += TICK.as_s();
        }
        let (way_m, end_s) = if viscous == 0.0 {
            (m * v0 * v0 / (2.0 * f), m * v0 / f)
        } else {
            let decay: f64 = (1.0 + viscous * v0 / f).ln();
            (m / viscous * (v0 - f / viscous * decay), m / viscous * decay)
        };
        let travelled_m = plant.state().table_position.as_m();
        assert_near("way to rest", travelled_m, way_m, way_m * 2e-6, "m");
        assert_near("time to rest", time_s, end_s, TICK.as_s(), "s");
        for _ in 0..1000 {
            plant.step(Current::ZERO);
        }
        assert_eq!(plant.state().table_position.as_m(), travelled_m, "it stays where it stuck");
    }
}

#[test]
fn a_sprung_mass_loses_2f_over_k_each_half_cycle() {
    let mut axis = paper_axis();
    axis.friction = coulomb(951.3, 0.0);
    axis.mechanics.damping_n_s_per_m = 0.0;
    let mut plant = pulled(axis, 0.0);
    // Table at +100 um with the motor at 0.
    plant.body.motion[0] = -100e-6;
    let band_m: f64 = 951.3 / 151e6;
    for _ in 0..200_000 {
        plant.step(Current::ZERO);
    }
    let half_cycles = ((100e-6 - band_m) / (2.0 * band_m)).ceil();
    let expected_m =
        (100e-6 - half_cycles * 2.0 * band_m) * if half_cycles % 2.0 == 0.0 { 1.0 } else { -1.0 };
    assert_near("rest", plant.state().table_position.as_um(), expected_m * 1e6, 1e-5, "um");
    assert!(plant.state().is_stuck);
}

#[test]
fn stick_slip_has_the_period_and_jump_of_its_closed_form() {
    let mut axis = paper_axis();
    axis.friction = friction::Parameters { breakaway: Force::n(1127.8), ..coulomb(951.3, 0.0) };
    axis.mechanics.damping_n_s_per_m = 0.0;
    let v0 = 1e-4;
    let mut plant = pulled(axis, v0);
    let natural = (151e6_f64 / 335.0).sqrt();
    let drop_m = (1127.8 - 951.3) / 151e6;
    let slip_s = 2.0 / natural * (PI - (drop_m * natural / v0).atan());
    let (expected_period_s, expected_jump_m) = (slip_s + 2.0 * drop_m / v0, v0 * slip_s + 2.0 * drop_m);

    let mut starts = Vec::new();
    let mut was_stuck = true;
    for tick in 0..200_000 {
        plant.step(Current::ZERO);
        let state = plant.state();
        if was_stuck && !state.is_stuck {
            starts.push((f64::from(tick) * 1e-6, state.table_position.as_m()));
        }
        was_stuck = state.is_stuck;
    }
    assert!(starts.len() > 4, "{} slips in 200 ms", starts.len());
    let (first, last) = (starts[1], starts[starts.len() - 1]);
    let cycles = (starts.len() - 2) as f64;
    assert_near("period", (last.0 - first.0) / cycles, expected_period_s, 1e-6, "s");
    assert_near("jump", (last.1 - first.1) / cycles, expected_jump_m, 2e-10, "m");
}

#[test]
fn energy_is_balanced_through_a_reversal() {
    let axis = paper_axis();
    let mut plant = Plant::new(&axis, Span::us(1));
    let (motor_kg, table_kg) = (axis.mechanics.motor_mass_kg(), axis.mechanics.mass_kg);
    let stored_j = |p: &Plant| {
        let [d, vm, vt, ..] = p.body.motion;
        0.5 * (motor_kg * vm * vm + table_kg * vt * vt + 151e6 * d * d)
    };
    let (mut work_j, mut damped_j, mut rubbed_j) = (0.0, 0.0, 0.0);
    let step_s = 1e-6;
    for tick in 0..400_000 {
        let before = plant.body.motion;
        let time_s = f64::from(tick) * step_s;
        plant.step(Current::a(6.0 * (TAU * 5.0 * time_s).cos()));
        let after = plant.body.motion;
        let mean = |a: f64, b: f64| 0.5 * (a + b);
        let relative = [before[1] - before[2], after[1] - after[2]];
        work_j += mean(before[3] * before[1], after[3] * after[1]) * step_s;
        damped_j += 73.8e3 * mean(relative[0].powi(2), relative[1].powi(2)) * step_s;
        let friction = |v: f64| plant.body.law.sliding(Velocity::m_per_s(v)).as_n() * v;
        rubbed_j += mean(friction(before[2]), friction(after[2])) * step_s;
    }
    let missing_j = work_j - damped_j - rubbed_j - stored_j(&plant);
    assert!(work_j > 1.0, "the axis took {work_j} J: too little to judge by");
    assert!(missing_j.abs() < 1e-5 * work_j, "{missing_j} J of {work_j} J are unaccounted for");
}

#[test]
fn any_delay_fits_beside_the_longest_dead_time_in_the_shortest_cycle() {
    let cycle = Span::us(50);
    let mut axis = paper_axis();
    axis.actuator.dead_time = cycle * FILE_DEAD_TICKS_MAX as i64;
    let entry = effects::entry("actuator-delay").expect("an effect");
    let mut plant = Plant::new(&axis.with_effect(entry, [entry.parameters[0].bounds[1], 0.0, 0.0]), cycle);
    let ticks = (0..DEAD_TICKS_MAX).take_while(|_| {
        plant.step(Current::a(5.0));
        plant.state().current == Current::a(0.0)
    });
    assert_eq!(ticks.count(), 120, "20 of the file and 100 of the effect");
}

#[test]
fn dead_time_shifts_the_motion_and_changes_nothing_else() {
    let mut late = paper_axis();
    late.friction = friction::Parameters::NONE;
    let prompt = late;
    for (dead_us, fine_us) in [(500, 500), (1000, 500), (125, 125), (625, 125)] {
        late.actuator.dead_time = Span::us(dead_us);
        let mut late_plant = Plant::new(&late, TICK);
        let mut prompt_plant = Plant::new(&prompt, Span::us(fine_us));
        let command =
            |tick: i64| Current::a(if tick < 0 { 0.0 } else { 3.0 * (tick as f64 * 0.05).sin() + 1.0 });
        for tick in 0..200 {
            late_plant.step(command(tick));
        }
        // The same commands, shifted in time and fed on the finer grid.
        for fine in 0..200 * 500 / fine_us {
            prompt_plant.step(command((fine * fine_us - dead_us).div_euclid(500)));
        }
        let (a, b) = (late_plant.state(), prompt_plant.state());
        let off_um = (a.motor_position - b.motor_position).as_um();
        // At rest both stick for one fine step of their own length: 1e-5 um of 40 mm.
        assert!(off_um.abs() < 1e-4, "dead time {dead_us} us: off by {off_um} um");
    }
}

#[test]
fn the_drive_makes_no_more_than_its_peak() {
    let mut plant = Plant::new(&paper_axis(), TICK);
    assert!(!plant.step(Current::a(60.0)));
    for _ in 0..100 {
        assert!(plant.step(Current::a(-90.0)), "the clamp is reported");
    }
    assert_near("current", plant.state().current.as_a(), -60.0, 1e-9, "A");
}

#[test]
fn an_axis_that_changes_on_its_way_does_not_jump() {
    let axis = paper_axis();
    let mut other = axis;
    other.mechanics.mass_kg *= 2.0;
    other.mechanics.backlash_m = 20e-6;
    other.friction.breakaway = other.friction.breakaway * 0.5;
    other.friction.sliding = other.friction.sliding * 0.5;
    // While the table sticks, as it begins to slide, and at speed.
    for ticks in [3, 12, 400] {
        let mut stays = Plant::new(&axis, TICK);
        for _ in 0..ticks {
            stays.step(Current::a(4.0));
        }
        let mut changes = stays.clone();
        changes.change(&other);
        assert_eq!(changes.state(), stays.state(), "after {ticks} ticks");
        let mut apart_um = || {
            stays.step(Current::a(4.0));
            changes.step(Current::a(4.0));
            (changes.state().motor_position - stays.state().motor_position).abs().as_um()
        };
        let first_um = apart_um();
        assert!(first_um < 0.05, "{first_um} um apart one tick after the change at {ticks} ticks");
        let later_um = (0..100).map(|_| apart_um()).fold(0.0, f64::max);
        assert!(later_um > 1.0, "{later_um} um apart later: the change does not act");
    }
}

#[test]
fn an_axis_that_begins_sliding_goes_on_sliding() {
    for (backlash_m, mm_per_s) in [(0.0, 20.0), (0.0, -3.0), (8e-6, -3.0)] {
        let mut axis = paper_axis();
        axis.mechanics.backlash_m = backlash_m;
        axis.friction.viscous_n_s_per_m = 3000.0;
        axis.actuator.dead_time = Span::us(700);
        let velocity = Velocity::mm_per_s(mm_per_s);
        let mut plant = Plant::sliding(&axis, TICK, velocity, Position::ZERO);
        let begin = plant.state();
        let torque = axis.mechanics.torque_for_force(Law::new(axis.friction).sliding(velocity));
        for _ in 0..200 {
            plant.step(axis.actuator.current(torque));
        }
        let state = plant.state();
        let (wound, still) =
            (begin.motor_position - begin.table_position, state.motor_position - state.table_position);
        assert!(state.motor_position.as_m() * mm_per_s > 0.0, "{state:?}");
        let way_off = state.motor_position - Position::m(velocity.as_m_per_s() * 0.1);
        assert!(way_off.abs() < Position::um(1e-6), "{} um off its way", way_off.as_um());
        assert!(
            (wound - still).abs() < Position::um(1e-6),
            "wound up by {} um, then {} um",
            wound.as_um(),
            still.as_um()
        );
    }
}

#[test]
fn an_axis_that_stands_wound_up_stays_where_it_is() {
    let base = paper_axis();
    let with = |axis: Parameters, name: &str| {
        let entry = entry(name).expect("an effect");
        axis.with_effect(entry, entry.nominal())
    };
    let held_by = |names: &[&str]| names.iter().fold(base, |axis, name| with(axis, name));
    for names in [
        &["soft-zone"][..],
        &["soft-zone", "backlash"],
        &["position-dependent-stiffness"],
        &["presliding"],
        &["presliding", "constant-force", "soft-zone"],
    ] {
        let axis = held_by(names);
        for force_n in [-620.0, 25.0, 620.0] {
            let mut plant = Plant::standing(&axis, TICK, Force::n(force_n), Position::m(0.1));
            let begin = plant.state();
            let current = axis.actuator.current(axis.mechanics.torque_for_force(Force::n(force_n)));
            for _ in 0..400 {
                plant.step(current);
            }
            let end = plant.state();
            let went_um = (end.motor_position - begin.motor_position).as_um().abs()
                + (end.table_position - begin.table_position).as_um().abs();
            assert!(went_um < 2e-3, "{names:?} at {force_n} N: it went {went_um} um");
        }
    }
}

#[test]
fn an_axis_stands_wound_up_by_no_more_than_friction_holds() {
    let base = paper_axis();
    let breakaway_n = Law::new(base.friction).breakaway().as_n();
    for (name, values, most_n) in [
        ("constant-force", vec![-300.0], [-breakaway_n + 300.0, breakaway_n + 300.0]),
        ("direction-asymmetry", vec![20.0], [-0.8 * breakaway_n, 1.2 * breakaway_n]),
        // 0.1 m from where it pulls nothing.
        ("spring-load", vec![2.0, 0.0], [-breakaway_n + 200.0, breakaway_n + 200.0]),
    ] {
        let entry = entry(name).expect("an effect");
        let mut all = entry.nominal();
        all[..values.len()].copy_from_slice(&values);
        let axis = base.with_effect(entry, all);
        let slips = |force_n: f64, share: f64| {
            let mut plant = Plant::standing(&axis, TICK, Force::n(force_n), Position::m(0.1));
            let force = plant.drive_force() * share;
            for _ in 0..100 {
                plant.step(axis.actuator.current(axis.mechanics.torque_for_force(force)));
            }
            (!plant.state().is_stuck, plant.drive_force().as_n())
        };
        for most_n in most_n {
            let asked_n = 3.0 * most_n;
            let (slips_here, held_n) = slips(asked_n, 1.0);
            assert!(!slips_here && (held_n / most_n - 1.0).abs() < 0.002, "{name}: {held_n} N of {most_n} N");
            assert!(slips(asked_n, 1.005).0, "{name}: {held_n} N is not all that friction holds");
        }
    }
}

#[test]
fn a_standing_table_that_hardly_anything_pulls_hangs_between_the_flanks() {
    let mut axis = paper_axis();
    axis.mechanics.backlash_m = 5e-6;
    let held_n = Law::new(axis.friction).breakaway().as_n();
    let play_um = |share: f64| {
        let force = Force::n(share * held_n);
        let state = Plant::standing(&axis, TICK, force, Position::ZERO).state();
        let wound = Position::m(force.as_n() / axis.mechanics.stiffness_n_per_m);
        (state.motor_position - state.table_position - wound).as_um()
    };
    // As much as the mean of a few rows of a current is off, in parts of a percent.
    for (share, expected_um) in
        [(0.0, 0.0), (0.003, 0.0), (-0.01, 0.0), (0.015, 1.25), (-0.02, -2.5), (0.4, 2.5)]
    {
        let got_um = play_um(share);
        assert!((got_um - expected_um).abs() < 1e-6, "at {share}: {got_um} um of {expected_um}");
    }
}
