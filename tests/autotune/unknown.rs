//! Twenty machines that their files do not know: identified by experiments, tuned, and judged on what they are.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use quadrant::base::axis::AxisId;
use quadrant::base::input::Inputs;
use quadrant::base::record::CycleRecord;
use quadrant::base::time::Span;
use quadrant::base::units::{Position, Velocity};
use quadrant::config::Machine;
use quadrant::config::edit::MachineFile;
use quadrant::config::machine::AXIS_NAMES;
use quadrant::offline::identify::axis::{self, IdentifiedAxis};
use quadrant::offline::identify::frequency::respond;
use quadrant::offline::identify::frequency::spectra::Collector;
use quadrant::offline::identify::logged::{LoggedAxis, Settings};
use quadrant::offline::identify::plan::{self, Plan};
use quadrant::offline::identify::write_back::{self, Origin};
use quadrant::offline::loops::Loops;
use quadrant::offline::simulated;
use quadrant::offline::trace::Tracing;
use quadrant::offline::tune::judge::Requirements;
use quadrant::offline::tune::space::{Choice, Quantity, Range, Space};
use quadrant::offline::tune::spread::Spread;
use quadrant::offline::tune::whole::circular_test;
use quadrant::offline::tune::window;
use quadrant::offline::tune::{Counts, Goal, Objective, Request, tune};
use quadrant::rt::cycle::procedure::Ending;
use quadrant::rt::door::Records;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use crate::common::{X, Y, machine_with};
use crate::machines;

/// Machines that are asked; with `QUADRANT_FULL` the second.
const MACHINES: [u64; 2] = [6, 20];
/// How far the protrusion may be from that with the true parameters.
const SHARE: f64 = 0.10;
/// What is asked of the loops of the machine that was identified, and what those of the true one must keep of it.
const ASKED: Requirements =
    Requirements { phase_margin_deg_min: 40.0, gain_margin_db_min: 8.0, sensitivity_max: 2.0 };
const KEPT: Requirements =
    Requirements { phase_margin_deg_min: 36.0, gain_margin_db_min: 7.0, sensitivity_max: 2.2 };
const PATH: window::Path = window::Path { radius: Position::mm(150.0), feed: Velocity::mm_per_min(2000.0) };

/// How much of it is done.
#[derive(Clone, Copy)]
struct Extent {
    /// Both axes are drawn and identified, each for itself; else both are the first.
    both_axes: bool,
    spread: Spread,
    evaluations_max: usize,
}

/// What the verb does.
const FULL: Extent =
    Extent { both_axes: true, spread: Spread::Corners { share: 0.1 }, evaluations_max: 2_000 };
/// A sixteenth of that.
const SHORT: Extent = Extent { both_axes: false, spread: Spread::Nominal, evaluations_max: 400 };

/// A machine, and what its file has of it: the reference machine with its encoder.
fn drawn(seed: u64, extent: Extent) -> [Machine; 2] {
    let mut truth = machines::random(seed).truth;
    let mut random = Pcg64Mcg::seed_from_u64(3_000 + seed);
    for (_, axis) in truth.axes.iter_mut() {
        axis.plant.actuator.dead_time = Span::us(random.random_range(0..200));
        axis.feedback_latency = Span::us(random.random_range(0..150));
    }
    if !extent.both_axes {
        truth.axes[Y] = quadrant::config::machine::Axis { node: truth.axes[Y].node, ..truth.axes[X] };
    }
    let counts = if seed.is_multiple_of(2) { "100000" } else { "10000" };
    let edit = format!("counts-per-rev = {counts}");
    [truth, machine_with("reference", &[("counts-per-rev = 1048576", &edit)])]
}

/// What experiments leave: columns, and the lines of what was excited.
struct Seen {
    tracing: Tracing,
    collector: Collector,
}

impl Records for Seen {
    fn put(&mut self, record: &CycleRecord, inputs: &Inputs) {
        self.tracing.put(record, inputs);
        self.collector.see(record, inputs.iter());
    }
    fn lost(&self) -> u64 {
        0
    }
}

/// The machine as experiments tell it to one that knows its file only.
fn identified(believed: &Machine, truth: &Machine, seed: u64, extent: Extent) -> Machine {
    let axes: Vec<AxisId> = if extent.both_axes { vec![X, Y] } else { vec![X] };
    let plan =
        Plan::of(believed, &plan::Request { gains: "standard".to_owned(), axes: axes.clone() }).unwrap();
    let mut seen = Seen { tracing: Tracing::default(), collector: Collector::new(believed.cycle.period) };
    let ending = simulated::run(believed, truth, plan.programme(), seed, &Arc::default(), &mut seen).unwrap();
    assert_eq!(ending, Ending::Complete, "machine {seed}: the experiments");
    let traces = [seen.tracing.finish().unwrap()];
    let settings = Settings { torque_constant_tolerance_percent: 5.0 };
    let logged: Vec<(String, LoggedAxis)> = axes
        .iter()
        .map(|id| {
            let found = LoggedAxis::identify(&traces, *id, &believed.axes[*id], settings).unwrap();
            (AXIS_NAMES[id.index()].to_owned(), found)
        })
        .collect();
    let sliding = axis::sliding(believed, &logged);
    let name = |id: AxisId| AXIS_NAMES[id.index()].to_owned();
    let observed = seen.collector.finish();
    let responses: BTreeMap<String, _> =
        observed.iter().map(|axis| (name(axis.axis), respond(&sliding, axis))).collect();
    let mut found = IdentifiedAxis::all(logged, responses, settings);
    if !extent.both_axes {
        let mut twin = found[0].clone();
        twin.name = name(Y);
        found.push(twin);
    }
    let mut file = MachineFile::create(Path::new("identified.toml"), believed).unwrap();
    let origin = Origin { logs: "a run in memory".to_owned(), date: String::new(), commit: String::new() };
    write_back::put(&mut file, believed, &found, &origin).unwrap();
    file.machine().unwrap()
}

fn tuned(machine: &Machine, extent: Extent) -> Choice {
    let request = Request {
        goal: Goal::Machine { objectives: vec![Objective::Protrusion], counts: Counts::Worst },
        space: Space {
            fixed: Choice::of_set(machine, 0),
            ranges: vec![
                Range { quantity: Quantity::VP, low: 10.0, high: 1000.0 },
                Range { quantity: Quantity::VI, low: 0.1, high: 10.0 },
            ],
        },
        requirements: ASKED,
        spread: extent.spread,
        path: PATH,
        evaluations_max: extent.evaluations_max,
        seed: 1,
    };
    let tuned = tune(machine, &request, |_| ControlFlow::Continue(()));
    assert!(tuned.broken.is_empty(), "{:?}", tuned.broken);
    tuned.best.choice
}

/// Both judged on the machine as it is: protrusion with what was identified, over that with the true parameters.
fn ratio(seed: u64, extent: Extent) -> f64 {
    let [truth, believed] = drawn(seed, extent);
    let found = identified(&believed, &truth, seed, extent);
    let choices = [tuned(&found, extent), tuned(&truth, extent)];
    let [ours_um, known_um] = choices.map(|choice| {
        let gains = truth.axes.map(|_, axis| choice.gains(axis));
        // An axis that faults is an error here.
        circular_test(&truth, &gains, &PATH, seed, &Arc::default()).unwrap().motor.protrusion_um.max
    });
    let ratio = ours_um / known_um;
    for (id, axis) in truth.axes.iter() {
        let gains = choices[0].gains(axis);
        let loops = Loops::with_gains(&truth, axis, &gains);
        for (name, margins) in
            [("velocity", loops.velocity_margins()), ("position", loops.position_margins())]
        {
            let phase_deg = margins.phase_margin_deg.unwrap();
            let gain_db = margins.gain_margin_db.unwrap_or(f64::INFINITY);
            let peak = margins.sensitivity_max;
            assert!(
                phase_deg >= KEPT.phase_margin_deg_min
                    && gain_db >= KEPT.gain_margin_db_min
                    && peak <= KEPT.sensitivity_max,
                "machine {seed}, {name} loop of axis {id}: {phase_deg:.1} deg, {gain_db:.2} dB, Ms {peak:.2}"
            );
        }
    }
    println!("machine {seed}: {ours_um:.2} um, with the true parameters {known_um:.2} um, {ratio:.3} of it");
    ratio
}

/// Some of them, short; with `QUADRANT_FULL` all, as the verb does it.
#[test]
#[ignore = "a minute and only if optimised; run by .ci/run"]
fn gains_for_a_machine_that_is_not_known_are_as_good_as_if_it_were() {
    let is_full = std::env::var_os("QUADRANT_FULL").is_some();
    let (extent, machines) = if is_full { (FULL, MACHINES[1]) } else { (SHORT, MACHINES[0]) };
    let ratios: Vec<f64> = (0..machines).into_par_iter().map(|seed| ratio(seed, extent)).collect();
    let ends = ratios.iter().fold([1.0_f64; 2], |[low, high], ratio| [low.min(*ratio), high.max(*ratio)]);
    println!(
        "{machines} machines: {:.3} to {:.3} of the protrusion with the true parameters",
        ends[0], ends[1]
    );
    for (seed, ratio) in ratios.iter().enumerate() {
        assert!((ratio - 1.0).abs() <= SHARE, "machine {seed}: {ratio:.3} of what the true parameters give");
    }
}
