//! The plant's step is fine enough: the protrusions of a circle are those of an independent simulation
//! (event-driven, Runge-Kutta and exact maps agree on them to 1e-4 um), and a smaller step moves them by
//! nanometres. `cargo bench --bench plant` prints the whole table.

#[path = "common/ideal_loop.rs"]
mod ideal_loop;
#[path = "common/spread.rs"]
mod spread;

use ideal_loop::{Axis, Comparison};
use quadrant::config;
use quadrant::plant::FINE_STEPS;

#[test]
fn the_paper_s_protrusions_come_out_at_the_motor() {
    let machine = config::load("paper").expect("the embedded machine is right");
    for (gains, expected_um) in [("standard", 25.009), ("optimal", 12.174)] {
        let comparison = Comparison::new(Axis::of(&machine, gains));
        for fine_steps in [FINE_STEPS, 25 * FINE_STEPS] {
            let got_um = comparison.protrusion(fine_steps).motor_um;
            assert!(
                (got_um - expected_um).abs() < 0.01,
                "{gains} gains, {fine_steps} fine steps: {got_um:.4} um, expected {expected_um} +- 0.01 um"
            );
        }
    }
}

#[test]
fn a_step_25_times_smaller_changes_nothing_that_counts() {
    let machine = config::load("paper").expect("the embedded machine is right");
    let mut off_um: Vec<f64> = spread::axes(&machine)
        .into_iter()
        .map(|axis| {
            let comparison = Comparison::new(axis);
            let [coarse, fine] = [FINE_STEPS, 25 * FINE_STEPS].map(|steps| comparison.protrusion(steps));
            (coarse.motor_um - fine.motor_um).abs().max((coarse.table_um - fine.table_um).abs())
        })
        .collect();
    off_um.sort_by(f64::total_cmp);
    let (median_um, max_um) = (off_um[spread::SETS / 2], off_um[spread::SETS - 1]);
    assert!(median_um < 0.0005, "median {median_um:.5} um of {} axes, bound 0.0005 um", spread::SETS);
    assert!(max_um < 0.005, "largest {max_um:.5} um of {} axes, bound 0.005 um", spread::SETS);
}
