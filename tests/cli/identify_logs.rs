//! Promise: `quadrant identify --log` says what a log tells and what it does not, and puts into a machine file what it
//! found, and nothing else.

use std::fs;
use std::path::{Path, PathBuf};

use quadrant::config;
use serde_json::Value;
use tempfile::TempDir;

use crate::tool::{only_log, run, text};

/// A log of circles: reversals, and accelerations on the way to their start.
fn circles(folder: &Path) -> PathBuf {
    let circle = ["circle", "--radius-mm", "10", "--feed-mm-per-min", "500", "--revolutions", "2"];
    let (_, said, code) = run(&[&circle[..], &["--json", "--out", text(folder)]].concat());
    assert_eq!(code, 0, "{said}");
    only_log(folder)
}

fn holds(finding: &Value, truth: f64) -> bool {
    let end = |k: usize| finding["ci95"][k].as_f64().unwrap();
    (end(0)..=end(1)).contains(&truth)
}

#[test]
fn a_log_tells_what_is_in_it_and_a_machine_file_takes_it() {
    let folder = TempDir::new().unwrap();
    let log = circles(folder.path());
    let report = folder.path().join("report");
    let (found, said, code) = run(&["identify", "--log", text(&log), "--json", "--report", text(&report)]);
    assert_eq!(code, 0, "{said}");
    let found = found.unwrap();
    for axis in ["x", "y"] {
        let stiffness = &found[axis]["stiffness"];
        assert!(holds(stiffness, 151.0), "{axis}: {stiffness}");
        assert!(stiffness["source"].as_str().unwrap().contains("5 % of it by the torque constant"));
        let damping = &found[axis]["damping"];
        assert!(damping["value"].is_null(), "{damping}");
        assert!(damping["needs"].as_str().unwrap().contains("frequency response"), "{damping}");
        for file in ["friction", "reversal"] {
            let picture = report.join(format!("{file}-{axis}.png"));
            assert!(fs::metadata(&picture).unwrap().len() > 10_000, "{}", picture.display());
        }
    }
    let file = folder.path().join("machine.toml");
    let before = config::load("reference").unwrap().text;
    fs::write(&file, &before).unwrap();
    let write = ["--write", text(&file), "--torque-constant-tolerance-percent", "0", "--json"];
    let (exact, said, code) = run(&[&["identify", "--log", text(&log)], &write[..]].concat());
    assert_eq!(code, 0, "{said}");
    // The torque constant is a term of its own: without it the interval is that of the scatter.
    let width = |found: &Value| {
        let ci95 = &found["x"]["stiffness"]["ci95"];
        ci95[1].as_f64().unwrap() - ci95[0].as_f64().unwrap()
    };
    assert!(width(&exact.unwrap()) < 0.5 * width(&found), "5 % of 151 N/um are 15 N/um both ways");
    let after = fs::read_to_string(&file).unwrap();
    let machine = config::load(text(&file)).unwrap();
    let stiffness = machine.axes.as_slice()[0].plant.mechanics.stiffness_n_per_m;
    assert!((stiffness / 151e6 - 1.0).abs() < 0.05 && stiffness != 151e6, "{stiffness} N/m");
    let gone: Vec<&str> = before.lines().filter(|line| !after.lines().any(|other| other == *line)).collect();
    let is_known = |line: &&str| {
        [
            "stiffness",
            "motor-inertia",
            "breakaway",
            "sliding",
            "fall-",
            "viscous",
            "variant",
            "current-loop",
            "dead-time",
        ]
        .iter()
        .any(|key| line.starts_with(key))
    };
    assert!(gone.iter().all(is_known), "{gone:?}");
    assert!(after.contains("# paper, Table 1: K_eq; printed as N/mm"), "the comment beside the value stays");
    let note = after.lines().find(|line| line.starts_with("# identified: from ")).expect("a note");
    assert!(note.contains(text(&log)), "{note}");
    assert!(
        said.contains("\n- stiffness-n-per-um = 151.0") && said.contains("\n+ stiffness-n-per-um"),
        "{said}"
    );
}

#[test]
fn a_file_of_another_machine_gets_nothing() {
    let folder = TempDir::new().unwrap();
    let log = circles(folder.path());
    let file = folder.path().join("machine.toml");
    let other = config::load("reference").unwrap().text.replace("mass-kg = 335.0", "mass-kg = 300.0");
    fs::write(&file, &other).unwrap();
    let (_, said, code) = run(&["identify", "--log", text(&log), "--write", text(&file)]);
    assert_eq!(code, 2, "{said}");
    assert!(
        said.contains("axis.x.mechanics.mass-kg is 300, in the machine file of the logs it was 335"),
        "{said}"
    );
    assert_eq!(fs::read_to_string(&file).unwrap(), other);
    assert_eq!(
        fs::read_dir(folder.path())
            .unwrap()
            .filter(|entry| {
                entry.as_ref().unwrap().path().extension().is_some_and(|extension| extension == "part")
            })
            .count(),
        0,
        "no draft is left"
    );
}

#[test]
fn what_cannot_be_identified_is_refused_with_a_reason() {
    let folder = TempDir::new().unwrap();
    let none = folder.path().join("none.mcap");
    let (_, said, code) = run(&["identify", "--log", text(&none)]);
    assert_eq!(code, 2);
    assert!(said.contains("none.mcap"), "{said}");
    let (_, said, code) =
        run(&["identify", "--log", text(&none), "--torque-constant-tolerance-percent", "-1"]);
    assert_eq!(code, 2);
    assert!(said.contains("from 0 to 50"), "{said}");
}
