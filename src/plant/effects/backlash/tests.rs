//! What is known of play without a simulation: who rests while whom moves, how much way is lost, and that
//! no energy comes out of it.

use super::*;
use crate::base::time::Span;
use crate::base::units::Current;
use crate::plant::tests::paper_axis;
use crate::plant::{Plant, State};

const TICK: Span = Span::us(500);

fn with_play(width_um: f64) -> Parameters {
    let mut axis = paper_axis();
    axis.mechanics.backlash_m = width_um * 1e-6;
    axis
}

/// An axis whose motor is too heavy to be felt and moves steadily, in ticks of 50 us.
fn pulled(mut axis: Parameters, velocity_m_per_s: f64) -> Plant {
    axis.mechanics.inertia_kg_m2 = 1e9;
    let mut plant = Plant::new(&axis, Span::us(50));
    plant.body.motion[1] = velocity_m_per_s;
    plant
}

fn run(plant: &mut Plant, ticks: usize) -> State {
    for _ in 0..ticks {
        plant.step(Current::ZERO);
    }
    plant.state()
}

/// A current that reverses the axis over and over, of whole numbers only: every processor makes the same.
fn to_and_fro(tick: i64) -> Current {
    let phase = tick % 400;
    Current::a((if phase < 200 { phase - 100 } else { 300 - phase }) as f64 * 0.0625)
}

#[test]
fn without_play_no_bit_changes() {
    let mut plant = Plant::new(&with_play(0.0), TICK);
    assert!(plant.late.with_gap.is_none());
    let mut bits = 0_u64;
    for tick in 0..4_000 {
        plant.step(to_and_fro(tick));
        for value in plant.body.motion {
            bits = bits.rotate_left(1) ^ value.to_bits();
        }
    }
    // Of the base model, whose table stops and tears loose within its steps.
    assert_eq!(bits, 0xb6a1_1fc1_b22c_d930, "{bits:#018x}");
}

#[test]
fn the_table_rests_while_the_motor_crosses_the_gap() {
    let width_um = 40.0;
    let mut plant = pulled(with_play(width_um), 1e-3);
    let pushed = run(&mut plant, 4_000);
    assert!(!pushed.is_stuck, "the upper flank pushes the table");
    plant.body.motion[1] = 0.0;
    run(&mut plant, 4_000);
    plant.body.motion[1] = -1e-3;
    // The flank lets go first; until the other one is reached nothing touches the table.
    let mut rest = None;
    let mut crossed = 0;
    while plant.state().is_stuck {
        plant.step(Current::ZERO);
        if plant.body.gap.contact(&plant.body.motion, &plant.body).0 == Flank::None {
            crossed += 1;
            let place = plant.state().table_position;
            let moved_um = (place - *rest.get_or_insert(place)).as_um();
            assert!(moved_um.abs() < 1e-9, "the table moves by {moved_um} um without a force");
        }
    }
    // The flank lets go while it is still pressed by `C v / K`: the damper does not pull.
    let expected_um = width_um + 73.8e3 * 1e-3 / 151e6 * 1e6;
    let crossed_um = f64::from(crossed) * 50e-6 * 1e-3 * 1e6;
    assert!((crossed_um - expected_um).abs() < 0.1, "{crossed_um} um without force of {expected_um} um");
}

#[test]
fn a_slow_reversal_loses_the_width_of_the_gap() {
    // Way of the motor from its reversal to the table's first move on the other flank. At this speed the
    // table slides without stick-slip: the friction law is flat below `D_v'`.
    let lost_m = |width_um: f64| {
        let mut plant = pulled(with_play(width_um), 2e-5);
        while plant.state().is_stuck {
            plant.step(Current::ZERO);
        }
        let turn = run(&mut plant, 20_000).motor_position;
        plant.body.motion[1] = -2e-5;
        run(&mut plant, 100);
        assert!(plant.state().is_stuck, "the table stays behind");
        while plant.state().is_stuck {
            plant.step(Current::ZERO);
        }
        (turn - plant.state().motor_position).as_m()
    };
    let wound_m = lost_m(0.0);
    for width_um in [2.0, 20.0, 100.0] {
        let got_um = (lost_m(width_um) - wound_m) * 1e6;
        assert!((got_um - width_um).abs() < 0.01 * width_um, "{got_um} um lost in {width_um} um of play");
    }
}

#[test]
fn energy_never_appears_from_nothing() {
    let axis = with_play(30.0);
    let mut plant = Plant::new(&axis, Span::us(1));
    let (motor_kg, table_kg) = (axis.mechanics.motor_mass_kg(), axis.mechanics.mass_kg);
    let stored_j = |plant: &Plant| {
        let [d, vm, vt, ..] = plant.body.motion;
        let pressed_m = (d.abs() - 15e-6).max(0.0);
        0.5 * (motor_kg * vm * vm + table_kg * vt * vt + 151e6 * pressed_m * pressed_m)
    };
    let (mut work_j, mut spare_j, mut before_j) = (0.0, 0.0_f64, 0.0);
    for tick in 0..400_000 {
        let [_, vm, _, force, _] = plant.body.motion;
        plant.step(Current::a(to_and_fro(tick / 500).as_a() * 2.0));
        let [_, vm_after, _, force_after, _] = plant.body.motion;
        let given_j = 0.5 * (force * vm + force_after * vm_after) * 1e-6;
        let now_j = stored_j(&plant);
        work_j += f64::abs(given_j);
        // What friction and damper leave over; it may be lost, never won.
        spare_j = spare_j.max(now_j - before_j - given_j);
        before_j = now_j;
    }
    assert!(work_j > 1.0, "the axis took {work_j} J: too little to judge by");
    // The trapezium of the work is off by the third power of the step.
    assert!(spare_j < 1e-9, "a step of 1 us gave {spare_j} J of its own");
}

#[test]
fn a_finer_step_changes_little() {
    // Where the axis is after half a second, against steps of 1 us.
    let off_um = |width_um: f64, fine_steps: u32| {
        let end = |fine_steps: u32| {
            let mut plant = Plant::with_fine_steps(&with_play(width_um), TICK, fine_steps);
            for tick in 0..1_000 {
                plant.step(to_and_fro(tick));
            }
            let state = plant.state();
            [state.motor_position, state.table_position]
        };
        let off = end(fine_steps).into_iter().zip(end(500)).map(|(a, b)| (a - b).abs().as_um());
        off.fold(0.0, f64::max)
    };
    // The plant without play is off by 0.003 um here; touching and leaving may cost a few times as much.
    let [coarse, fine] = [10, 50].map(|fine_steps| off_um(20.0, fine_steps));
    let coarse_without = off_um(0.0, 10);
    assert!(coarse_without < 0.005, "{coarse_without} um off without play");
    assert!(coarse < 4.0 * coarse_without, "{coarse} um off with play, {coarse_without} um without");
    assert!(fine < 0.003, "{coarse} um off in steps of 50 us, {fine} um in steps of 10 us");
}

#[test]
fn play_that_comes_and_goes_moves_nothing_at_once() {
    let mut plant = pulled(with_play(0.0), 1e-3);
    run(&mut plant, 4_000);
    let before = plant.body.motion;
    let pull_n = plant.body.pull_n(&plant.body.motion);
    for width_um in [25.0, 5.0, 0.0, 60.0] {
        plant.body.gap = plant.body.gap.resized(width_um * 1e-6, before[0]);
        let (flank, force_n) = plant.body.gap.contact(&before, &plant.body);
        let rest_n = 73.8e3 * before[2];
        assert_eq!(flank, Flank::Upper, "{width_um} um");
        assert!(
            (force_n + rest_n - pull_n).abs() < 1e-6 * pull_n,
            "{force_n} N of {pull_n} N at {width_um} um"
        );
    }
    let inside = Gap::new(50e-6).resized(10e-6, 20e-6);
    let flank_um = inside.rest_m(Flank::Upper) * 1e6;
    assert!(
        (flank_um - 20.0).abs() < 1e-9,
        "the upper flank comes to the axis at 20 um, not to {flank_um} um"
    );
}
