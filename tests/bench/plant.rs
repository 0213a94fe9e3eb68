//! The plant alone: how many times faster than real time it is, and what its step costs in accuracy.
//!
//! Speed: two axes on the reference circle, fed with the current commands that the closed loop gave them,
//! on one core. Accuracy: the convergence table of the step, and its error on axes drawn at random.

use std::hint::black_box;
use std::time::Instant;

#[path = "../common/circle_run.rs"]
mod circle_run;
#[path = "../common/ideal_loop.rs"]
mod ideal_loop;
#[path = "../common/spread.rs"]
mod spread;

use circle_run::{Kept, SEED, paper_circle};
use ideal_loop::{Axis, Comparison};
use quadrant::base::axis::AxisId;
use quadrant::base::units::Current;
use quadrant::config::{self, Machine};
use quadrant::plant::{FINE_STEPS, Plant};

/// Runs of the circle; the fastest counts, the others met somebody else on the core.
const RUNS: usize = 15;
/// Steps of a servo tick of 500 us.
const FINE: [u32; 6] = [10, 20, 50, 100, 250, 500];

fn main() {
    speed(&config::load("reference").expect("the embedded machine is right"));
    let paper = config::load("paper").expect("the embedded machine is right");
    for gains in ["standard", "optimal"] {
        convergence(&paper, gains);
    }
    random_axes(&paper);
}

fn speed(machine: &Machine) {
    let mut kept = Kept::default();
    circle_run::run(machine, "optimal", paper_circle(1), SEED, &mut kept);
    let currents: Vec<[Current; 2]> = kept
        .0
        .iter()
        .map(|record| [AxisId::X, AxisId::Y].map(|axis| record.axes[axis].command.current))
        .collect();
    let span_s = machine.cycle.period.as_s() * currents.len() as f64;
    let rest = [AxisId::X, AxisId::Y].map(|axis| Plant::new(&machine.axes[axis].plant, machine.cycle.period));
    let seconds = (0..RUNS).map(|_| {
        let mut plants = rest.clone();
        let start = Instant::now();
        for currents in black_box(&currents) {
            plants[0].step(currents[0]);
            plants[1].step(currents[1]);
        }
        black_box(&plants);
        start.elapsed().as_secs_f64()
    });
    let fastest_s = seconds.fold(f64::INFINITY, f64::min);
    println!(
        "plant alone, two axes, {span_s:.1} s of circle, one core: {:.0} times real time, {:.1} ns per tick and axis",
        span_s / fastest_s,
        fastest_s / (2 * currents.len()) as f64 * 1e9
    );
}

/// Protrusion over the response of the same loop without friction, by step.
fn convergence(machine: &Machine, gains: &str) {
    let comparison = Comparison::new(Axis::of(machine, gains));
    println!("{gains} gains: protrusion over the friction-free response, um");
    println!("  step us   motor    table");
    for fine_steps in FINE {
        let height = comparison.protrusion(fine_steps);
        println!(
            "  {:>7.0}  {:>7.4}  {:>7.4}",
            500.0 / f64::from(fine_steps),
            height.motor_um,
            height.table_um
        );
    }
}

fn random_axes(machine: &Machine) {
    let mut off_um = [Vec::new(), Vec::new()];
    for axis in spread::axes(machine) {
        let comparison = Comparison::new(axis);
        let [coarse, fine] = [FINE_STEPS, 25 * FINE_STEPS].map(|steps| comparison.protrusion(steps));
        off_um[0].push((coarse.motor_um - fine.motor_um).abs());
        off_um[1].push((coarse.table_um - fine.table_um).abs());
    }
    println!("{} axes at random, step 50 us against 2 us: error, um", spread::SETS);
    for (point, off_um) in ["motor", "table"].into_iter().zip(&mut off_um) {
        off_um.sort_by(f64::total_cmp);
        println!("  {point}: median {:.4}, max {:.4}", off_um[spread::SETS / 2], off_um[spread::SETS - 1]);
    }
}
