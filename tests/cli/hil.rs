//! Promise: `quadrant hil run` says of each scenario whether it came as expected, and ends so that a script knows.

use assert_cmd::Command;
use serde_json::Value;

const SILENT: &str = include_str!("../scenarios/silent-board.toml");

fn hil_run(scenario: &str) -> (i32, Value) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("one.toml");
    std::fs::write(&file, scenario).unwrap();
    let mut quadrant = Command::cargo_bin("quadrant").unwrap();
    let output = quadrant.args(["hil", "run", "--json"]).arg(file).output().unwrap();
    (output.status.code().unwrap(), serde_json::from_slice(&output.stdout).unwrap())
}

#[test]
fn only_a_virtual_interface_is_taken_and_it_must_be_there() {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenarios/clean-hold.toml");
    for (words, says) in [
        (&["--bus", "vcan77"][..], "there is no interface vcan77; `ip -brief link`"),
        (&["--bus", "lo"], "lo is not a vcan: a real machine may be at its other end"),
        (&["--bus", "lo", "--pace", "realtime"], "lo is not a vcan"),
        (&["--bus", "lo", "--attach"], "lo is not a vcan"),
        (&["--pace", "realtime"], "--bus <INTERFACE>"),
        (&["--attach"], "--bus <INTERFACE>"),
    ] {
        let mut quadrant = Command::cargo_bin("quadrant").unwrap();
        let output = quadrant.args(["hil", "run"]).args(words).arg(&file).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && said.contains(says), "{words:?}: {said}");
    }
}

#[test]
fn a_log_of_each_run_is_kept_where_it_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let (file, logs) = (folder.path().join("quiet.toml"), folder.path().join("logs"));
    std::fs::write(&file, SILENT).unwrap();
    let run = || {
        let mut quadrant = Command::cargo_bin("quadrant").unwrap();
        quadrant.args(["hil", "run", "--logs"]).arg(&logs).arg(&file).output().unwrap()
    };
    assert!(run().status.success());
    let log = logs.join("quiet.mcap");
    let mut quadrant = Command::cargo_bin("quadrant").unwrap();
    let replay = quadrant.args(["replay", "--json"]).arg(&log).output().unwrap();
    assert!(replay.status.success(), "{}", String::from_utf8_lossy(&replay.stderr));
    let again = run();
    let said = String::from_utf8(again.stderr).unwrap();
    assert!(
        again.status.code() == Some(2) && said.contains("quiet.mcap"),
        "a log is not overwritten: {said}"
    );
}

#[test]
fn a_scenario_that_comes_as_expected_ends_with_zero_and_another_with_two() {
    let (code, told) = hil_run(SILENT);
    assert_eq!((code, told["unmet"].as_u64()), (0, Some(0)), "{told}");
    assert_eq!(told["scenarios"][0]["name"], "silent-board");

    let other = SILENT.replace("feedback-lost", "overspeed");
    assert_ne!(other, SILENT, "the scenario expects fault 1");
    let (code, told) = hil_run(&other);
    assert_eq!((code, told["unmet"].as_u64()), (2, Some(1)), "{told}");
    let finding = &told["scenarios"][0]["findings"][0];
    assert_eq!(finding["is_met"], false);
    assert!(finding["measured"].as_str().unwrap().contains("feedback-lost"), "{finding}");
}
