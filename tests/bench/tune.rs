//! What tuning costs: judgements of gains per second, on one core and on all, their parts, and whole searches.
//!
//! The machine is the reference machine, the circle 150 mm at 2000 mm/min.

mod fastest;

use std::hint::black_box;
use std::ops::ControlFlow;

use fastest::fastest_s;
use quadrant::base::axis::AxisId;
use quadrant::base::units::{Position, Velocity};
use quadrant::config::{self, Machine};
use quadrant::offline::loops::Loops;
use quadrant::offline::tune::judge::Requirements;
use quadrant::offline::tune::space::{Choice, Quantity, Range, Space};
use quadrant::offline::tune::spread::Spread;
use quadrant::offline::tune::window::{Path, Window};
use quadrant::offline::tune::{Counts, Goal, Objective, Request, Valuer, tune};
use rayon::prelude::*;

const JUDGEMENTS: usize = 400;

fn main() {
    let machine = config::load("reference").expect("the embedded machine is right");
    let axis = &machine.axes[AxisId::X];
    let (nominal, spread) =
        (request(&machine, Spread::Nominal), request(&machine, Spread::Corners { share: 0.1 }));
    let choice = nominal.space.fixed;
    let gains = choice.gains(axis);

    let window = Window::new(&machine, axis, nominal.path, 0.0);
    say("one reversal", 1.0, fastest_s(|| _ = black_box(window.run(&gains))));
    let loops = Loops::with_gains(&machine, axis, &gains);
    say(
        "margins of both loops",
        1.0,
        fastest_s(|| {
            black_box((loops.velocity_margins(), loops.position_margins()));
        }),
    );
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    for (what, request) in [("nominal", &nominal), ("nine plants", &spread)] {
        let valuer = Valuer::new(&machine, request);
        for threads in [1, cores] {
            let judged = || {
                let each = |_| drop(black_box(valuer.worth(&choice)));
                pool(threads).install(|| (0..JUDGEMENTS).into_par_iter().for_each(each));
            };
            say(&format!("gains judged, {what}, {threads} cores"), JUDGEMENTS as f64, fastest_s(judged));
        }
        let mut evaluations = 0;
        let took_s = fastest_s(|| {
            let tuned = tune(&machine, request, |_| ControlFlow::Continue(()));
            evaluations = tuned.evaluations;
        });
        say(&format!("whole search, {what}"), evaluations as f64, took_s);
    }
}

fn say(what: &str, count: f64, took_s: f64) {
    println!("{what:<34} {count:>6.0} in {:>9.2} ms  {:>8.0} per second", took_s * 1e3, count / took_s);
}

fn request(machine: &Machine, spread: Spread) -> Request {
    Request {
        goal: Goal::Machine { objectives: vec![Objective::Protrusion], counts: Counts::Worst },
        space: Space {
            fixed: Choice::of_set(machine, 0),
            ranges: vec![
                Range { quantity: Quantity::VP, low: 10.0, high: 1000.0 },
                Range { quantity: Quantity::VI, low: 0.1, high: 10.0 },
            ],
        },
        requirements: Requirements {
            phase_margin_deg_min: 40.0,
            gain_margin_db_min: 8.0,
            sensitivity_max: 2.0,
        },
        spread,
        path: Path { radius: Position::mm(150.0), feed: Velocity::mm_per_min(2000.0) },
        evaluations_max: 2_000,
        seed: 1,
    }
}
