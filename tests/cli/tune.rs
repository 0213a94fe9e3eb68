//! Promise: `quadrant tune` prints for people and programs what it found and what holds it, writes it where it was
//! told and nowhere else, and keeps the best so far when it is interrupted.

use std::fs;
use std::process::{Command, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use quadrant::config;
use serde_json::Value;
use tempfile::TempDir;

use crate::tool::{run, text, with};

/// A short circle, few evaluations, on the axes as the file has them.
const SHORT: [&str; 9] = [
    "tune",
    "--radius-mm",
    "20",
    "--feed-mm-per-min",
    "4000",
    "--spread-percent",
    "0",
    "--evaluations",
    "60",
];
const PAPER: [&str; 7] = ["tune", "--objective", "paper", "--radius-mm", "20", "--feed-mm-per-min", "4000"];

fn number(told: &Value, key: &str) -> f64 {
    told[key].as_f64().unwrap_or_else(|| panic!("{key} is {}", told[key]))
}

#[test]
fn the_problem_of_the_paper_is_answered_with_all_that_is_open() {
    let (told, said, code) = run(&with(&PAPER, &["--json"]));
    assert_eq!(code, 0, "{said}");
    let told = told.unwrap();
    assert_eq!((number(&told, "v_p"), number(&told, "kvp_nm_s_per_rad")), (100.0, 1.5));
    assert!((number(&told, "v_i") / 2.596 - 1.0).abs() < 0.01, "{}", told["v_i"]);
    for key in [
        "kvi_nm_per_rad",
        "protrusion_um",
        "phase_margin_deg",
        "gain_margin_db",
        "ms",
        "evaluations",
        "seconds",
    ] {
        assert!(number(&told, key) > 0.0, "{key}: {}", told[key]);
    }
    assert_eq!(told["active_constraints"].as_array().unwrap().len(), 2);
    assert!(told["undetermined"].as_array().unwrap().len() >= 5);
}

#[test]
fn a_set_is_written_into_a_new_file_and_tuned_again_in_its_place() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("mine.toml");
    let (told, said, code) = run(&with(&SHORT, &["--json", "--write", text(&file)]));
    assert_eq!(code, 0, "{said}");
    let told = told.unwrap();
    let machine = config::load(text(&file)).unwrap();
    assert_eq!(machine.gain_sets, ["standard", "optimal", "tuned"]);
    let written = fs::read_to_string(&file).unwrap();
    assert!(written.contains(&format!("v-p = {}", number(&told, "v_p"))), "{written}");
    assert_eq!(
        written.matches("# tuned: quadrant tune, least protrusion, um, seed 1").count(),
        2,
        "{written}"
    );
    let kept = config::load("reference").unwrap().text;
    assert!(kept.lines().all(|line| written.contains(line)), "every line of the machine is still there");

    // Another embedded machine does not go over it.
    let (_, said, code) = run(&with(&PAPER, &["--machine", "paper", "--write", text(&file)]));
    assert_eq!(code, 2);
    assert!(said.contains("is not the machine that was tuned (paper (embedded))"), "{said}");
    assert_eq!(fs::read_to_string(&file).unwrap(), written);

    // The set of this name is replaced, with its note.
    let again = ["--machine", text(&file), "--from", "tuned", "--seed", "2", "--write", text(&file)];
    assert_eq!(run(&with(&SHORT, &again)).2, 0);
    let rewritten = fs::read_to_string(&file).unwrap();
    assert_eq!(rewritten.matches("# tuned: ").count(), 2, "{rewritten}");
    assert_eq!(rewritten.matches("seed 2").count(), 2, "{rewritten}");
    assert_eq!(config::load(text(&file)).unwrap().gain_sets.len(), 3);
}

#[test]
fn nothing_is_written_where_constraints_are_broken() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("mine.toml");
    // No gains of this axis leave 89 degrees.
    let (told, said, code) =
        run(&with(&SHORT, &["--phase-margin-deg", "89", "--json", "--write", text(&file)]));
    assert_eq!(code, 2, "{said}");
    assert!(said.contains("no gains within the bounds keep all constraints: phase margin"), "{said}");
    assert!(!told.unwrap()["broken_constraints"].as_array().unwrap().is_empty());
    assert!(!file.exists());
}

#[test]
fn what_cannot_be_asked_is_refused_with_its_bound() {
    for (words, complaint) in [
        (&["--from", "swift"][..], "gain set \"swift\" is not in the machine file; it has standard, optimal"),
        (&["--kp-per-s", "900"], "--kp-per-s 900 is outside the allowed range of 0.1 to 500 1/s"),
        (&["--objective", "paper,noise"], "--objective paper stands alone"),
        (
            &["--v-p-min", "50", "--v-p-max", "20"],
            "--v-p-max 20 is outside the allowed range of 50 to 1000000",
        ),
        (&["--kp-max-per-s", "30"], "--kp-max-per-s bounds what --vary kp varies"),
    ] {
        let (_, said, code) = run(&with(&["tune"], words));
        assert_eq!(code, 2, "{words:?}");
        assert!(said.contains(complaint), "{words:?}: {said}");
    }
}

#[test]
fn an_interrupted_search_keeps_the_best_so_far_and_says_so() {
    let child = Command::new(env!("CARGO_BIN_EXE_quadrant"))
        .args(["tune", "--plants", "200", "--radius-mm", "20", "--feed-mm-per-min", "4000", "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(2));
    kill(Pid::from_raw(i32::try_from(child.id()).unwrap()), Signal::SIGINT).unwrap();
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("interrupted: what follows is the best so far"), "{said}");
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(told["is_complete"], false);
    assert!(number(&told, "protrusion_um") > 0.0 && number(&told, "evaluations") < 2_000.0);
}

#[test]
fn the_report_has_a_page_and_its_pictures() {
    let folder = TempDir::new().unwrap();
    let (_, said, code) =
        run(&with(&SHORT, &["--objective", "protrusion,noise", "--report", text(folder.path())]));
    assert_eq!(code, 0, "{said}");
    let page = fs::read_to_string(folder.path().join("tuning.html")).unwrap();
    for heading in
        ["What holds them", "Map of the objective", "Circle before", "Circle after", "Velocity loop", "Front"]
    {
        assert!(page.contains(&format!("<h2>{heading}</h2>")), "no {heading}");
    }
    for name in ["map", "circle-before", "circle-after", "loop", "front"] {
        for ending in ["svg", "png"] {
            assert!(folder.path().join(format!("{name}.{ending}")).exists(), "no {name}.{ending}");
        }
    }
}
