//! Promise: what a machine file lacks is found from runs and named, and from runs of a machine that lacks nothing
//! nothing is named.
#![cfg(feature = "offline")]

mod anew;
mod behind;
mod clocks;
mod crossed;
mod lines;
mod loops;
mod nearby;
mod passes;
mod shaken;
mod strained;
mod usual;
mod zeros;

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use quadrant::base::axis::AxisId;
use quadrant::config::edit::MachineFile;
use quadrant::config::{self, Machine};
use quadrant::offline::gap::analysis::{Analysis, Request, analyse};
use quadrant::offline::gap::asked::GapError;
use quadrant::offline::gap::asked::problem_of;
use quadrant::offline::gap::fit::{Effort, fit};
use quadrant::offline::gap::gates::judged;
use quadrant::offline::gap::locate;
use quadrant::offline::gap::measure::controller;
use quadrant::offline::gap::measure::forward::{Course, Signals};
use quadrant::offline::gap::model::data::Part;
use quadrant::offline::gap::model::problem::Problem;
use quadrant::offline::gap::model::{Model, Tried};
use quadrant::offline::gap::runs::repeats::repeats;
use quadrant::offline::gap::runs::{AxisRun, Run};
use quadrant::offline::gap::show::verdict::Verdict;
use quadrant::offline::gap::write_back::{self, Origin};
use quadrant::plant::Parameters;
use quadrant::plant::effects::{Coordinate, entry};
use quadrant::rt::drive::velocity::VelocityEstimate;
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;

const ROWS_PER_S: f64 = 2_000.0;
/// Noise of the current, rms.
const NOISE_A: f64 = 0.02;

/// Two laps of one axis of a circle as a machine with this plant logs them; its position loop acts in the row `phase`
/// first.
fn circle(
    machine: &Machine,
    plant: &Parameters,
    name: &str,
    [radius_mm, lap_s]: [f64; 2],
    seed: u64,
    phase: usize,
) -> Run {
    let rows = (2.2 * lap_s * ROWS_PER_S) as usize;
    // From rest: the way grows over the first fifth of a lap.
    let place = |row: usize| {
        let turns = row as f64 / ROWS_PER_S / lap_s;
        1e-3 * radius_mm * (TAU * turns).sin() * (5.0 * turns).min(1.0)
    };
    let mut run = commanded(name, rows, place);
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let axis = recorded(machine, &run, (AxisId::X, plant), phase, &mut random);
    run.axes.insert(AxisId::X, axis);
    run
}

/// A run in which axis x is told where to be, row by row, and nothing was measured yet.
fn commanded(name: &str, rows: usize, place_m: impl Fn(usize) -> f64) -> Run {
    let blank = AxisRun {
        setpoint_m: (0..rows).map(place_m).collect(),
        position_m: vec![0.0; rows],
        table_m: Some(vec![0.0; rows]),
        current_a: vec![0.0; rows],
    };
    Run {
        name: name.to_owned(),
        start_s: 0.0,
        period_s: 1.0 / ROWS_PER_S,
        axes: BTreeMap::from([(AxisId::X, blank)]),
        is_sound: vec![true; rows],
    }
}

/// What an axis with this plant does where a run has its setpoints.
fn recorded(
    machine: &Machine,
    run: &Run,
    (id, plant): (AxisId, &Parameters),
    phase: usize,
    random: &mut Pcg64Mcg,
) -> AxisRun {
    let course = Course::new(run, machine, id, phase, 0.0).expect("an axis");
    let made = course.run(&machine.axes[id], machine.cycle.position_every, 0, plant);
    logged(&run.axes[&id].setpoint_m, &made, random)
}

/// What was made of setpoints, with noise of the current.
fn logged(setpoint_m: &[f64], made: &Signals, random: &mut Pcg64Mcg) -> AxisRun {
    let noise = Normal::new(0.0, NOISE_A).expect("a width");
    let position_m: Vec<f64> = setpoint_m.iter().zip(&made.following_error_m).map(|(s, e)| s - e).collect();
    AxisRun {
        table_m: Some(position_m.iter().zip(&made.deflection_m).map(|(p, d)| p - d).collect()),
        position_m,
        current_a: made.current_a.iter().map(|current| current + noise.sample(random)).collect(),
        setpoint_m: setpoint_m.to_vec(),
    }
}

/// Runs of a machine whose base parameters differ from its file, and which may have effects.
fn runs(machine: &Machine, effects: &[(&str, f64)]) -> Vec<Run> {
    let mut plant = machine.axes[AxisId::X].plant;
    plant.mechanics.mass_kg *= 1.1;
    plant.mechanics.stiffness_n_per_m *= 0.93;
    plant.friction = plant.friction.scaled(1.05);
    for (name, amplitude) in effects {
        let entry = entry(name).expect("an effect");
        let mut values = entry.nominal();
        values[0] = *amplitude;
        plant = plant.with_effect(entry, values);
    }
    [("slow", 10.0, 2.4, 1), ("fast", 20.0, 1.6, 2), ("heldout", 15.0, 2.0, 3)]
        .map(|(name, radius_mm, lap_s, seed)| circle(machine, &plant, name, [radius_mm, lap_s], seed, 0))
        .to_vec()
}

fn analysed<'m>(machine: &'m Machine, runs: &[Run]) -> Analysis<'m> {
    let request = Request { gains: Some("standard".to_owned()), axes: Vec::new() };
    analyse(machine, runs, &request, &|_| ()).expect("an analysis")
}

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn a_hidden_backlash_is_named_and_closes_the_gap() {
    let machine = config::load("paper").expect("a machine");
    let analysis = analysed(&machine, &runs(&machine, &[("backlash", 2.0)]));
    assert_eq!(analysis.repeats.len(), 3, "two laps each");
    let [axis] = analysis.axes.as_slice() else { panic!("one axis") };
    assert_eq!(axis.verdict, Verdict::Named);
    let names: Vec<&str> = axis.named.effects.iter().map(|effect| effect.name).collect();
    assert_eq!(names, ["backlash"]);
    let (_, width_um, [low, high]) = axis.named.model.effect(0)[0];
    assert!((width_um - 2.0).abs() < 0.1, "{width_um} um");
    assert!(low < width_um && width_um < high);
    // Encoder and scale are all but perfect here: what is left is the noise of the current.
    let current = axis.gap.iter().find(|gap| gap.signal == "current").expect("a current");
    assert!(current.after < 1.05 * NOISE_A, "{current:?}");
    let deflection = axis.gap.iter().find(|gap| gap.signal == "deflection").expect("a scale");
    assert!(deflection.closed_share() > 0.95, "{deflection:?}");

    let mut file = MachineFile::create(Path::new("mill.toml"), &machine).expect("a file");
    let origin =
        Origin { runs: "slow, fast".to_owned(), date: "today".to_owned(), commit: "this".to_owned() };
    assert!(write_back::put(&mut file, &machine, &analysis, &origin).expect("it has the keys"));
    let text = file.text();
    assert!(text.contains("# gap: fitted with its effects to slow, fast, today, by this"), "{text}");
    let after = file.machine().expect("a sound machine").axes[AxisId::X].plant;
    assert!((1e6 * after.mechanics.backlash_m - 2.0).abs() < 0.1, "{} m", after.mechanics.backlash_m);
    assert!((after.mechanics.stiffness_n_per_m / (0.93 * 151e6) - 1.0).abs() < 0.01);
    assert!(text.starts_with(&machine.text[..80]), "what stood there stays");
}

/// Runs as CSV files of a folder.
fn written(runs: &[Run], folder: &Path) -> Vec<PathBuf> {
    let one = |run: &Run| {
        let axis = &run.axes[&AxisId::X];
        let table_m = axis.table_m.as_ref().expect("a scale");
        let mut text = "t_s,x.setpoint_mm,x.position_mm,x.table_mm,x.current_a\n".to_owned();
        for row in 0..run.len() {
            let [setpoint, position, table] =
                [&axis.setpoint_m, &axis.position_m, table_m].map(|column| 1e3 * column[row]);
            let (t_s, current) = (row as f64 / ROWS_PER_S, axis.current_a[row]);
            writeln!(text, "{t_s},{setpoint},{position},{table},{current}").expect("a string takes all");
        }
        let path = folder.join(format!("{}.csv", run.name));
        fs::write(&path, text).expect("a folder that can be written to");
        path
    };
    runs.iter().map(one).collect()
}

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn what_is_named_is_written_into_the_file_and_shown_on_a_page() {
    let machine = config::load("paper").expect("a machine");
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("mill.toml");
    fs::write(&file, &machine.text).expect("a file");
    let mut command = assert_cmd::Command::cargo_bin("quadrant").expect("the tool");
    let runs = written(&runs(&machine, &[("backlash", 2.0)]), folder.path());
    command.current_dir(folder.path()).args(["gap", "--json", "--machine", "mill.toml", "--data"]).args(runs);
    command.env("RUST_LOG", "quadrant=debug");
    let output = command.args(["--write", "mill.toml", "--out", "page"]).output().expect("an answer");
    let steps = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{steps}");
    for step in ["on the shortlist law=\"backlash\"", "put to the gates law=\"backlash\"", "put to the test"]
    {
        assert!(steps.contains(step), "it does not say that something was {step}");
    }
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one object");
    assert_eq!(said["effects"][0]["name"], "backlash");
    assert!(!said["located"].as_array().expect("a list").is_empty(), "{}", said["located"]);

    let after = config::load(file.to_str().expect("a name")).expect("a sound file");
    let backlash_um = 1e6 * after.axes[AxisId::X].plant.mechanics.backlash_m;
    assert!((backlash_um - 2.0).abs() < 0.1, "{backlash_um} um in the file, 2 um in the machine");
    assert_eq!(said["machine_after"].as_str().map(str::len), Some(after.text.len()));
    let is_old = |path: &PathBuf| fs::read_to_string(path).is_ok_and(|text| text == machine.text);
    let beside = fs::read_dir(folder.path()).expect("a folder").filter_map(|entry| Some(entry.ok()?.path()));
    assert_eq!(beside.filter(is_old).count(), 1, "the old file is kept, once");

    let page = fs::read_to_string(folder.path().join("page/gap.html")).expect("a page");
    let falsified = &said["effects"][0]["falsified_by"];
    assert!(falsified["apart"].as_f64() > falsified["noise"].as_f64(), "{falsified}");
    for part in ["backlash", "width-um", "an effect is missing", "<svg", "falsified by small reversals"] {
        assert!(page.contains(part), "the page has no {part}");
    }
}

#[test]
fn where_the_gap_lives_is_told_and_not_where_it_does_not() {
    let machine = config::load("paper").expect("a machine");
    let file = machine.axes[AxisId::X].plant;
    let ripple = entry("screw-ripple").expect("an effect");
    let tried = Tried { entry: ripple, values: [6.0, 1.0, 40.0] };
    let runs = [("slow", 10.0, 2.4, 1), ("fast", 20.0, 1.6, 2)].map(|(name, radius_mm, lap_s, seed)| {
        circle(&machine, &file.with_effect(ripple, tried.values), name, [radius_mm, lap_s], seed, 0)
    });
    let problem = problem_of(&machine, &runs, &repeats(&runs), AxisId::X, 0, &[0, 0]);
    let (base, named) = (Model::new(file), Model::new(file).with(tried));
    let both = locate::both(&problem, &base, &named);
    let current = 2;
    let located = locate::located(&problem, &both);
    // On a circle the acceleration is the place at another scale.
    let by_place = |found: &&locate::Located| found.coordinate == Coordinate::Acceleration;
    let first =
        located.iter().filter(|found| found.signal == current).find(by_place).expect("it has a place");
    assert!(first.share > 0.1 && first.share < 0.5, "a share of {}", first.share);
    assert!(located.iter().all(|found| found.coordinate != Coordinate::Time), "it does not change in time");
    let most = |which: usize| first.profile.iter().map(|bin| bin[which].abs()).fold(0.0, f64::max);
    assert!(most(1) > 0.02 && most(2) < 0.2 * most(1), "{} A without it, {} A with it", most(1), most(2));
    for left in locate::runs_left(&problem, &both).iter().filter(|left| left.signal == current) {
        assert!(left.per_row[0] > 1.2 * left.per_row[1], "{left:?}");
    }
    // What is left is noise: it has no place.
    let noise = locate::located(&problem, &locate::both(&problem, &named, &named));
    let of_noise = noise.iter().filter(|found| found.signal == current).find(by_place);
    assert!(of_noise.is_none(), "{of_noise:?}");
}

#[test]
fn rows_that_judge_say_by_themselves_whether_they_have_it() {
    let machine = config::load("paper").expect("a machine");
    let file = machine.axes[AxisId::X].plant;
    let ripple = entry("screw-ripple").expect("an effect");
    // Little: they are asked by one step, which stops short of what is far away, at -0.7 of it with twice as much.
    let with = Model::new(file).with(Tried { entry: ripple, values: [0.25, 1.0, 40.0] });
    let share = |held: &Parameters| -> f64 {
        let plant = with.twin().plant;
        let runs =
            [("slow", 10.0, 2.4, 1, &plant), ("fast", 20.0, 1.6, 2, &plant), ("heldout", 15.0, 2.0, 3, held)]
                .map(|(name, radius_mm, lap_s, seed, plant)| {
                    circle(&machine, plant, name, [radius_mm, lap_s], seed, 0)
                });
        let problem = problem_of(&machine, &runs, &repeats(&runs), AxisId::X, 0, &[0; 3]);
        let fitted = fit(&problem, &with, Effort::Coarse(3), None);
        assert!((fitted.effect(0)[0].1 / 0.25 - 1.0).abs() < 0.1, "the fitted rows have it");
        judged::alone(&problem, &fitted, &[with.first_coordinate(0)])[0].share
    };
    // Half a turn later it is another effect.
    let other = file.with_effect(ripple, [0.25, 1.0, -140.0]);
    for (held, truth) in [(&with.twin().plant, 1.0), (&file, 0.0), (&other, -1.0)] {
        let found = share(held);
        assert!((found - truth).abs() < 0.3, "{found} of it, truth {truth}");
    }
}

#[test]
fn rows_in_which_the_table_breaks_away_count_less_until_friction_is_known() {
    let machine = config::load("paper").expect("a machine");
    let plant = machine.axes[AxisId::X].plant;
    let runs = [circle(&machine, &plant, "slow", [10.0, 2.4], 1, 0)];
    let problem = problem_of(&machine, &runs, &repeats(&runs), AxisId::X, 0, &[0]);
    let louder = |reach: f64| -> Vec<f64> {
        let straight = problem.where_straight(&Model::new(plant), reach, 0);
        straight.told(0, 0).map(|told| told.sqrt().recip()).collect()
    };
    // The second lap of a sine: it reverses at a quarter and three quarters, and slides at once in between.
    let row = |turns: f64| (2.4 * turns * ROWS_PER_S) as usize;
    let most = |rows: &[f64]| rows.iter().copied().fold(0.0, f64::max);
    let wide = louder(0.3);
    let (reversal, sliding) = (&wide[row(1.25)..row(1.35)], &wide[row(1.45)..row(1.7)]);
    assert!(most(reversal) > 3.0 * most(sliding), "{} and {}", most(reversal), most(sliding));
    let narrow = louder(0.01);
    assert!(most(&narrow) < 0.3 * most(&wide), "{} and {}", most(&narrow), most(&wide));
    assert!(most(&narrow[row(1.45)..row(1.7)]) < 1.01);
    // A reversal that comes out otherwise is one event, and not as many as it has rows.
    let mut other = plant;
    other.friction = other.friction.scaled(1.02);
    let straight = problem.where_straight(&Model::new(plant), 0.3, 0);
    let per_row = |problem: &Problem<'_>| {
        let of_error = &problem.residual(0, &Model::new(other), Part::Fit)[0][row(1.26)..row(1.32)];
        of_error.iter().map(|left| left * left).sum::<f64>() / of_error.len() as f64
    };
    let [as_noise, as_events] = [per_row(&problem), per_row(&straight)];
    assert!(as_noise > 10.0 && as_events < 0.1, "{as_noise} and {as_events} per row");
    let [all, told] = [&problem, &straight].map(|problem| problem.count(Part::Fit) as f64);
    assert!((0.3..0.95).contains(&(told / all)), "{told} of {all} values");
}

#[test]
fn rows_in_motion_lead_from_a_file_a_quarter_off_to_its_machine() {
    let machine = config::load("paper").expect("a machine");
    let file = Model::new(machine.axes[AxisId::X].plant);
    let mut plant = file.twin().plant;
    plant.mechanics.mass_kg *= 1.25;
    plant.mechanics.stiffness_n_per_m *= 0.8;
    plant.friction = plant.friction.scaled(0.8);
    let excess = (plant.friction.breakaway - plant.friction.sliding) * 1.7;
    plant.friction.breakaway = plant.friction.sliding + excess;
    let mut runs = [("slow", 10.0, 2.4, 1), ("fast", 20.0, 1.6, 2)]
        .map(|(name, radius_mm, lap_s, seed)| circle(&machine, &plant, name, [radius_mm, lap_s], seed, 0));
    // Without a table scale mass could make up for how an axis breaks away.
    runs.iter_mut().flat_map(|run| run.axes.values_mut()).for_each(|axis| axis.table_m = None);
    let problem = problem_of(&machine, &runs, &repeats(&runs), AxisId::X, 0, &[0, 0]);
    let moving = problem.in_motion(&file).expect("circles move");
    // The second lap of a sine reverses at a quarter.
    let reversal = (2.4 * 1.25 * ROWS_PER_S) as usize;
    let near = reversal - 20..reversal + 100;
    assert!(problem.data[0].fit[near.clone()].contains(&true), "it counts");
    assert!(!moving.data[0].fit[near].contains(&true), "it does not move there");
    let found = fit(&moving, &file, Effort::Coarse(12), None).model.base_values();
    let truths = [
        ("mass", 1.25 * 335.0, 0.05),
        ("stiffness", 0.8 * 151e6, 0.02),
        ("sliding", 0.8 * 951.3, 0.01),
        ("breakaway_excess", excess.as_n(), 0.1),
    ];
    let untold = file.base_values().into_iter().filter(|(base, _)| base.name.starts_with("fall"));
    let wanted = truths.into_iter().chain(untold.map(|(base, value)| (base.name, value, 1e-12)));
    for (name, truth, within) in wanted {
        let (_, value) = found.iter().find(|(base, _)| base.name == name).expect("a parameter");
        assert!((value / truth - 1.0).abs() < within, "{name}: {value}, truth {truth}");
    }
}

#[test]
fn a_machine_that_lacks_nothing_gets_its_parameters_right_and_no_name() {
    let machine = config::load("paper").expect("a machine");
    let analysis = analysed(&machine, &runs(&machine, &[]));
    let [axis] = analysis.axes.as_slice() else { panic!("one axis") };
    assert!(axis.named.effects.is_empty(), "{:?}", axis.named.effects);
    assert_eq!(axis.verdict, Verdict::ParameterOnly);
    let truth =
        [("mass", 1.1 * 335.0, 0.05), ("stiffness", 0.93 * 151e6, 0.01), ("sliding", 1.05 * 951.3, 0.005)];
    let found = axis.named.base.model.base_values();
    for (name, truth, within) in truth {
        let (_, value) = found.iter().find(|(base, _)| base.name == name).expect("a parameter");
        assert!((value / truth - 1.0).abs() < within, "{name}: {value}, truth {truth}");
    }
    let smallest = |name: &str| {
        let all = &axis.named.smallest;
        all.iter().find(|one| one.name == name).expect("of every effect").amplitude
    };
    // Of 2 um it is named above.
    let backlash_um = smallest("backlash").expect("circles show it");
    assert!((0.02..1.0).contains(&backlash_um), "{backlash_um} um would have been seen");
    assert_eq!(smallest("squareness"), None, "one axis does not show it");
}

#[test]
fn rows_that_judge_are_held_to_their_own_noise() {
    const LOUDER: f64 = 3.0;
    let machine = config::load("paper").expect("a machine");
    let floor = |louder: f64| {
        let mut runs = runs(&machine, &[]);
        let mut random = Pcg64Mcg::seed_from_u64(9);
        let noise = Normal::new(0.0, NOISE_A * (louder * louder - 1.0).sqrt()).expect("a width");
        let held = runs[2].axes.get_mut(&AxisId::X).expect("an axis");
        held.current_a.iter_mut().for_each(|current_a| *current_a += noise.sample(&mut random));
        let problem = problem_of(&machine, &runs, &repeats(&runs), AxisId::X, 0, &[0; 3]);
        problem.floor(2, Part::Held).expect("the noise of the current")
    };
    for louder in [1.0, LOUDER] {
        let found = floor(louder) / (louder * NOISE_A);
        assert!((found - 1.0).abs() < 0.15, "{found} of a noise {louder} times as loud");
    }
}
