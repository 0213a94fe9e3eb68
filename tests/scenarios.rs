//! Promise: every scenario of `tests/scenarios` comes as it says, run in memory, and every kind of scripted
//! fault has one. A scenario that is not right is told what is wrong, each problem at its place.
#![cfg(feature = "offline")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use quadrant::config::scenario::{Scenario, from_text, load_scenario};
use quadrant::offline::hil::run_in_memory;
use quadrant::sim::script::Kind;

fn paths() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenarios");
    let entries = folder.read_dir().expect("the folder is part of the project");
    let mut paths: Vec<_> = entries.map(|entry| entry.expect("it can be read").path()).collect();
    paths.sort();
    paths
}

fn scenario(path: &Path) -> Scenario {
    load_scenario(path).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn every_scenario_comes_as_it_says() {
    let mut unmet = Vec::new();
    for path in paths() {
        let scenario = scenario(&path);
        let outcome = run_in_memory(&scenario);
        println!("{}: {}", scenario.name, scenario.shows);
        assert!(outcome.unjudged.is_empty(), "{}: {:?} not judged", scenario.name, outcome.unjudged);
        for finding in &outcome.findings {
            println!("    {finding}");
            if !finding.is_met {
                unmet.push(format!("{}: {finding}", scenario.name));
            }
        }
    }
    assert!(unmet.is_empty(), "{} unmet:\n{}", unmet.len(), unmet.join("\n"));
}

#[test]
fn every_kind_of_fault_has_a_scenario_and_the_clean_runs_have_none() {
    let scenarios: Vec<Scenario> = paths().iter().map(|path| scenario(path)).collect();
    let shown: BTreeSet<Kind> = scenarios
        .iter()
        .flat_map(|scenario| &scenario.script.faults)
        .map(|fault| fault.effect.kind())
        .collect();
    let missing: Vec<&str> =
        Kind::ALL.into_iter().filter(|kind| !shown.contains(kind)).map(Kind::name).collect();
    assert!(missing.is_empty(), "no scenario for {missing:?}");
    let clean = scenarios.iter().filter(|scenario| scenario.script.faults.is_empty()).count();
    assert!(clean >= 3, "{clean} clean runs");
    for (path, scenario) in paths().iter().zip(&scenarios) {
        assert_eq!(path.file_stem().and_then(|stem| stem.to_str()), Some(scenario.name.as_str()));
    }
}

#[test]
fn the_same_scenario_gives_the_same_outcome() {
    let path =
        |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/scenarios/{name}.toml"));
    let mut scenario = scenario(&path("reordered-frames"));
    let outcome = run_in_memory(&scenario);
    assert_eq!(run_in_memory(&scenario), outcome);
    scenario.script.seed += 1;
    assert_ne!(run_in_memory(&scenario).evidence, outcome.evidence, "another seed hits other frames");
}

const GOOD: &str = include_str!("scenarios/lost-frames.toml");

/// What is said of the scenario with a text in it replaced.
fn said(from: &str, to: &str) -> String {
    assert!(GOOD.contains(from), "the scenario has no {from:?}");
    match from_text("bad.toml", &GOOD.replacen(from, to, 1)) {
        Err(problems) => problems.to_string(),
        Ok(_) => panic!("{to:?} is taken for sound"),
    }
}

#[test]
fn a_scenario_that_is_not_right_is_told_what_is_wrong_where() {
    for (from, to, says) in [
        ("kind = \"lost-frames\"", "kind = \"lost-frame\"", "fault[0].kind: \"lost-frame\" is not known"),
        ("axis = \"all\"", "axis = \"z\"", "fault[0].axis: machine reference has no axis z (it has x, y)"),
        ("at-s = 1.0", "at-s = 100.0", "fault[0].at-s: 100 s is after the motion"),
        ("for-s = 5.0", "for-s = 0.0", "fault[0].for-s: 0 s is outside the allowed range"),
        ("chance = 0.001", "chance = 1.5", "fault[0].chance: 1.5 is outside the allowed range"),
        ("chance = 0.001", "", "fault[0].chance: missing, wanted is a number from 0 to 1"),
        ("chance = 0.001", "chance = 0.001\nfactor = 2", "fault[0].factor: unknown key"),
        (
            "way = \"both\"\nframes = \"all\"",
            "way = \"from-boards\"\nframes = \"sync\"",
            "fault[0].frames: does not travel on this way",
        ),
        ("[[fault]]", "[fault]", "fault: is of type table (wanted is an array of sections)"),
        ("machine = \"reference\"", "machine = \"none\"", "machine: no machine \"none\""),
        ("radius-mm = 20.0", "radius-mm = 900.0", "motion: cannot be run on the machine (radius = 900 mm"),
        ("shows = ", "shows = \"\" #", "shows: is empty"),
        ("ending = \"complete\"", "ending = \"faulted\"", "expect.fault: missing, wanted is one of"),
        ("min = 28.0", "min = 31.0", "expect.protrusion-um.max: 30 um is below min"),
    ] {
        let said = said(from, to);
        assert!(said.contains(says), "`{says}` is not in `{said}`");
    }
}

#[test]
fn all_problems_are_told_at_once_at_their_places() {
    let text = GOOD.replace("chance = 0.001", "chance = 2.0").replace("seed = 1", "seed = -1");
    let problems = from_text("bad.toml", &text).expect_err("two values are out of range");
    let keys: Vec<&str> = problems.problems.iter().map(|problem| problem.key.as_str()).collect();
    assert_eq!(keys, ["seed", "fault[0].chance"]);
    let shown = problems.render(false);
    assert!(shown.contains("chance = 2.0") && shown.contains("^^^ allowed is"), "{shown}");
}
