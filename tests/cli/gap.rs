//! Promise: `quadrant gap plan` says what it will move and what no run shows, moves nothing when told so, and leaves a sound
//! log of each run that names its motions.

use std::path::Path;

use quadrant::log::Reader;
use tempfile::TempDir;

use crate::machine_file::machine_file;
use crate::tool::{run, text, with};

#[test]
fn the_runs_of_an_axis_are_said_and_recorded() {
    let folder = TempDir::new().unwrap();
    // Not all speeds have room.
    let machine = machine_file(folder.path(), "machine.toml", [-30.0, 50.0], &[]);
    let out = folder.path().join("out");
    let words = ["gap", "plan", "--machine", text(&machine), "--axes", "y", "--out", text(&out), "--json"];

    let (told, said, code) = run(&with(&words, &["--dry-run"]));
    assert_eq!(code, 0, "{said}");
    for part in [
        "axis x stays where it stands",
        "axis y moves between",
        "left out: sweep-y: axis y: no steady run at",
        "not shown by any of them: friction-warm-up, thermal-growth; needed: repetition for an hour",
    ] {
        assert!(said.contains(part), "{said}\nlacks {part:?}");
    }
    let told = told.unwrap();
    assert!(told["runs"].as_array().unwrap().iter().all(|run| run["log"].is_null()), "{told}");
    assert!(!out.exists(), "not even a folder");

    let (told, said, code) = run(&words);
    assert_eq!(code, 0, "{said}");
    let told = told.unwrap();
    let mut names = Vec::new();
    for planned in told["runs"].as_array().unwrap() {
        names.push(planned["name"].as_str().unwrap());
        let log = planned["log"].as_str().unwrap();
        let reader = Reader::open(Path::new(log)).unwrap();
        assert_eq!(reader.header().motions.len() as u64, planned["motions"].as_u64().unwrap(), "{log}");
        let (told, said, code) = run(&["log", log, "--json"]);
        assert_eq!(code, 0, "{log}: {said}");
        let told = told.unwrap();
        assert_eq!(told["faults"], serde_json::json!([]), "{log}");
    }
    let all = ["circles-slow", "heldout-circles", "circles-fast", "sweep-y", "small-reversals-y"];
    assert_eq!(names, with(&all, &["accelerations-y", "heldout-accelerations-y"]));
}

#[test]
fn what_cannot_be_shown_or_planned_is_refused() {
    for (words, refusal) in [
        (&["plan", "--gains", "swift"][..], "gain set \"swift\" is not in the machine file"),
        (&["plan", "--axes", "z"], "no axis \"z\" in machine reference; it has x, y"),
        (&["plan", "--repetition-minutes", "0"], "wanted is a number from 1 to 600 (minutes)"),
        (&["demo", "--effect", "command-filter"], "a simulated machine moves under ours"),
        (&["demo", "--amount", "-1"], "width-um = -1 um is outside the allowed range of 0 to 1000 um"),
    ] {
        let (_, said, code) = run(&with(&["gap"], words));
        assert_eq!(code, 2, "{words:?}: {said}");
        assert!(said.contains(refusal), "{words:?}: {said}");
    }
}
