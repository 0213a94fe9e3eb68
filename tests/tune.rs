//! Promise: what tuning evaluates is what the machine does, its answers are the best there are within what the loops
//! must keep, and the paper's own problem gives the paper's own gains.
//!
//! The long versions are ignored here and run in `.ci/run`, optimised.
#![cfg(feature = "offline")]
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::ops::ControlFlow;
use std::sync::Arc;

use quadrant::base::axis::AxisId;
use quadrant::base::time::Span;
use quadrant::base::units::{Position, Velocity};
use quadrant::config::{self, Machine};
use quadrant::offline::loops::Loops;
use quadrant::offline::tune::judge::{Requirements, violation};
use quadrant::offline::tune::map::Map;
use quadrant::offline::tune::space::{Choice, Quantity, Range, Space};
use quadrant::offline::tune::spread::Spread;
use quadrant::offline::tune::whole::circular_test;
use quadrant::offline::tune::window::{Path, Window};
use quadrant::offline::tune::{Counts, Goal, Objective, Request, Tuned, Valuer, paper, tune};
use quadrant::rt::drive::sheet::CommandApplies;
use rstest::rstest;

const PATH: Path = Path { radius: Position::mm(150.0), feed: Velocity::mm_per_min(2000.0) };
const REQUIREMENTS: Requirements =
    Requirements { phase_margin_deg_min: 40.0, gain_margin_db_min: 8.0, sensitivity_max: 2.0 };

/// The machine of the paper with boards that apply a command at the next SYNC: one and a half ticks of delay.
fn delayed_paper() -> Machine {
    let mut machine = config::load("paper").unwrap();
    for (_, axis) in machine.axes.iter_mut() {
        axis.sheet.command_applies = CommandApplies::OnNextSync;
    }
    machine
}

fn request(machine: &Machine, kp_per_s: f64, seed: u64) -> Request {
    let fixed = Choice { kp_per_s, ..Choice::of_set(machine, 0) };
    Request {
        goal: Goal::Machine { objectives: vec![Objective::Protrusion], counts: Counts::Worst },
        space: Space {
            fixed,
            ranges: vec![
                Range { quantity: Quantity::VP, low: 10.0, high: 1000.0 },
                Range { quantity: Quantity::VI, low: 0.1, high: 10.0 },
            ],
        },
        requirements: REQUIREMENTS,
        spread: Spread::Nominal,
        path: PATH,
        evaluations_max: 2_000,
        seed,
    }
}

fn tuned(machine: &Machine, request: &Request) -> Tuned {
    tune(machine, request, |_| ControlFlow::Continue(()))
}

/// Highest protrusion of the whole circle, um.
fn whole_um(machine: &Machine, choice: &Choice) -> f64 {
    let gains = machine.axes.map(|_, axis| choice.gains(axis));
    circular_test(machine, &gains, &PATH, 1, &Arc::default()).unwrap().motor.protrusion_um.max
}

#[rstest]
#[case("paper", 8.55, 101.121, 1.140)]
#[case("paper", 8.55, 99.522, 2.596)]
#[case("paper", 30.0, 150.0, 1.3)]
#[case("reference", 8.55, 101.121, 1.140)]
#[case("reference", 20.0, 101.121, 1.140)]
fn one_reversal_shows_what_the_whole_circle_shows(
    #[case] name: &str,
    #[case] kp_per_s: f64,
    #[case] v_p: f64,
    #[case] v_i: f64,
) {
    let machine = config::load(name).unwrap();
    let choice = Choice { kp_per_s, v_p, v_i, ..Choice::of_set(&machine, 0) };
    let axis = &machine.axes[AxisId::X];
    let seen = Window::new(&machine, axis, PATH, 0.0).run(&choice.gains(axis));
    let whole_um = whole_um(&machine, &choice);
    assert!((seen.height_um - whole_um).abs() < 0.05, "{} um, on the circle {whole_um} um", seen.height_um);
}

#[test]
fn the_problem_of_the_paper_gives_the_gains_of_the_paper() {
    let machine = config::load("paper").unwrap();
    let goal = Goal::Paper(paper::Request { phase_margin_deg_min: 49.0, acceleration_time_s_max: 0.2 });
    let mut request = Request { goal, ..request(&machine, 8.55, 1) };
    request.space.ranges[0] = Range { quantity: Quantity::VP, low: 1.0, high: 100.0 };
    let Tuned { best, active, broken, .. } = tuned(&machine, &request);
    for (name, value, known) in [("V_p", best.choice.v_p, 99.522), ("V_i", best.choice.v_i, 2.596)] {
        assert!((value / known - 1.0).abs() < 0.01, "{name} {value}, in Table 2 {known}");
    }
    assert_eq!(best.choice.v_p, 100.0, "at the bound, where the objective wants it");
    assert!(broken.is_empty(), "{broken:?}");
    assert_eq!(active.len(), 2, "{active:?}");
    assert!(active[0].starts_with("phase margin by the printed formula"), "{active:?}");
    assert_eq!(active[1], "v-p at its upper bound of 100");

    // With more room the gains of the paper are not the best: the bound was what chose them.
    request.space.ranges[0].high = 150.0;
    let wider = tuned(&machine, &request).best.choice;
    assert!(wider.v_p == 150.0 && wider.v_i > 3.5, "{wider:?}");
}

#[test]
fn a_seed_gives_the_same_bits_on_one_thread_and_on_two() {
    let machine = config::load("reference").unwrap();
    let request = Request { evaluations_max: 120, ..request(&machine, 8.55, 3) };
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| tuned(&machine, &request))
    };
    let [one, two] = [on(1), on(2)];
    assert_eq!(one.front, two.front);
    assert_eq!(one.evaluations, two.evaluations);
    assert_ne!(one.front, tuned(&machine, &Request { seed: 4, ..request }).front, "the seed matters");
}

/// How far the search is above the best point of a grid, as a share, at worst over seeds.
fn above_the_grid(machine: &Machine, steps: usize, seeds: std::ops::Range<u64>) -> f64 {
    let asked = request(machine, 8.55, 0);
    let map = Map::of(machine, &asked, asked.space.fixed, [[100.0, 300.0], [0.5, 3.0]], steps);
    let best_um = map.best().expect("there are gains that keep all").objective;
    let of_seed = |seed| {
        let Tuned { best, broken, .. } = tuned(machine, &Request { seed, ..asked.clone() });
        assert!(broken.is_empty(), "seed {seed}: {broken:?}");
        best.objectives[0] / best_um - 1.0
    };
    seeds.map(of_seed).fold(f64::NEG_INFINITY, f64::max)
}

#[test]
fn the_search_ends_no_higher_than_a_grid() {
    let above = above_the_grid(&delayed_paper(), 15, 0..1);
    assert!(above < 0.005, "{:.2} % above the best point of the grid", 100.0 * above);
}

#[test]
#[ignore = "minutes unless optimised; run by .ci/run"]
fn from_any_seed_the_search_ends_no_higher_than_a_dense_grid() {
    for machine in [delayed_paper(), config::load("reference").unwrap()] {
        let above = above_the_grid(&machine, 90, 0..12);
        println!("{}: worst of 12 seeds {:+.3} % from the best of 8100 points", machine.name, 100.0 * above);
        assert!(above < 0.005, "{}: {:.2} % above the best point of the grid", machine.name, 100.0 * above);
    }
}

/// Known answers: gains alone within the requirements at a delay of one and a half ticks, um at the motor of an axis
/// without that delay. With the delay in the simulation as well it is a little more.
#[rstest]
#[case(8.55, 9.6)]
#[case(50.0, 4.9)]
#[ignore = "seconds only if optimised; run by .ci/run"]
#[case(20.0, 7.7)]
#[ignore = "seconds only if optimised; run by .ci/run"]
#[case(30.0, 6.5)]
fn gains_alone_reach_what_they_can(#[case] kp_per_s: f64, #[case] known_um: f64) {
    let machine = delayed_paper();
    let Tuned { best, active, broken, evaluations, .. } = tuned(&machine, &request(&machine, kp_per_s, 1));
    let [delayed_um, prompt_um] =
        [&machine, &config::load("paper").unwrap()].map(|machine| whole_um(machine, &best.choice));
    println!(
        "Kp {kp_per_s}: {prompt_um:.3} um, delayed {delayed_um:.3} um after {evaluations}, {:?}, {active:?}",
        best.choice
    );
    assert!(broken.is_empty(), "{broken:?}");
    assert!(best.figures.phase_margin_deg >= 39.99 && best.figures.gain_margin_db >= 7.99, "{best:?}");
    assert!(best.figures.ms <= 2.001, "{best:?}");
    assert!(prompt_um <= known_um, "{prompt_um} um, known to be reached {known_um} um");
    assert!(delayed_um <= 1.03 * known_um, "{delayed_um} um with the delay, known without {known_um} um");
}

/// The gains known from a continuous loop with a pure delay reach what is known of them, but sampled they have less
/// than the gain margin: the search may not choose them.
#[test]
fn the_known_gains_reach_their_protrusion_at_less_than_their_margin() {
    let machine = delayed_paper();
    let form = machine.axes[AxisId::X].velocity_form;
    let known = quadrant::rt::control::velocity_pi::Gains {
        proportional_nm_s_per_rad: 3.30,
        memory: quadrant::rt::control::velocity_pi::Memory::Integrator { gain_nm_per_rad: 482.0 },
    };
    let [v_p, v_i] = form.pair(&known);
    let choice = Choice { v_p, v_i, ..Choice::of_set(&machine, 0) };
    let [delayed_um, prompt_um] =
        [&machine, &config::load("paper").unwrap()].map(|machine| whole_um(machine, &choice));
    let asked = request(&machine, 8.55, 1);
    let sampled = Valuer::new(&machine, &asked).judged(choice).figures;
    let mut continuous = config::load("paper").unwrap();
    continuous.cycle.period = Span::ns(100);
    for (_, axis) in continuous.axes.iter_mut() {
        axis.plant.actuator.dead_time = Span::us(750);
    }
    let gains = choice.gains(&continuous.axes[AxisId::X]);
    let pure = Loops::with_gains(&continuous, &continuous.axes[AxisId::X], &gains).velocity_margins();
    let (pure_db, pure_deg) = (pure.gain_margin_db.unwrap(), pure.phase_margin_deg.unwrap());
    println!(
        "{delayed_um} um delayed, {prompt_um} um without delay, continuous {pure_deg} deg {pure_db} dB, sampled {} deg {} dB",
        sampled.phase_margin_deg, sampled.gain_margin_db
    );
    assert!((prompt_um - 9.6).abs() < 0.05, "{prompt_um} um, known 9.6 um");
    assert!(delayed_um > prompt_um, "{delayed_um} um with the delay, {prompt_um} um without");
    assert!(pure_deg >= 40.0 && pure_db >= 8.0, "{pure:?}");
    assert!((7.5..8.0).contains(&sampled.gain_margin_db), "{sampled:?}");
}

#[test]
#[ignore = "minutes unless optimised; run by .ci/run"]
fn robust_gains_hold_on_200_plants() {
    let machine = config::load("reference").unwrap();
    let share = 0.2;
    let asked = Request { spread: Spread::Corners { share }, ..request(&machine, 8.55, 1) };
    let Tuned { best, broken, .. } = tuned(&machine, &asked);
    assert!(broken.is_empty(), "{broken:?}");
    let others = Request { spread: Spread::Random { share, plants: 200, seed: 5 }, ..asked };
    let judged = Valuer::new(&machine, &others).judged(best.choice);
    let figures = &judged.figures;
    println!(
        "{:?}: nominal {:?} um, worst of corners {:?} um, worst of 200 {:?} um, PM {} deg",
        best.choice,
        best.figures.nominal_um,
        best.figures.worst_um,
        figures.worst_um,
        figures.phase_margin_deg
    );
    assert!(violation(&figures.held) < 1e-3, "{:?}", figures.held);
    assert!(figures.worst_um.unwrap() < 1.02 * best.figures.worst_um.unwrap(), "{figures:?}");
}
