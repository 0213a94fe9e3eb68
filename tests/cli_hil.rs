//! Promise: `quadrant hil run` says of each scenario whether it came as expected, and ends so that a script knows.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use assert_cmd::Command;
use serde_json::Value;

const SILENT: &str = include_str!("scenarios/silent-board.toml");

fn hil_run(scenario: &str) -> (i32, Value) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("one.toml");
    std::fs::write(&file, scenario).unwrap();
    let mut quadrant = Command::cargo_bin("quadrant").unwrap();
    let output = quadrant.args(["hil", "run", "--json"]).arg(file).output().unwrap();
    (output.status.code().unwrap(), serde_json::from_slice(&output.stdout).unwrap())
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
