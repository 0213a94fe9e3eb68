//! Promise: `docs/fault-outcomes.md` is what the survey of today's control gives, byte for byte, and no run of
//! it carried on with wrong data. Here a part of its rows is run again (`.ci/run` does all of them); a part
//! gives the same rows as the whole, and a machine that does carry on is told.
#![cfg(feature = "cli")]
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use assert_cmd::Command;
use quadrant::config;
use quadrant::offline::hil::survey::{Line, Survey, page, row};
use serde_json::Value;

const PAGE: &str = include_str!("../docs/fault-outcomes.md");
/// The page is of `quadrant hil survey` without options.
const SEED: u64 = 1;
const MOMENTS: usize = 20;
/// One row of so many is run again.
const EVERY: usize = 7;

fn survey(moments: usize) -> Survey {
    Survey::plan(&config::load("reference").unwrap(), SEED, moments).unwrap()
}

/// The rows of the table on the page.
fn rows() -> Vec<&'static str> {
    let (_, table) = PAGE.split_once("|---|---|---|---|---|---|---|---|\n").unwrap();
    table.lines().take_while(|line| line.starts_with('|')).collect()
}

fn run(survey: &Survey, cases: &[usize]) -> Vec<Line> {
    survey.run_cases(cases, &|| ())
}

#[test]
fn the_page_is_what_the_survey_gives() {
    let survey = survey(MOMENTS);
    let rows = rows();
    assert_eq!(rows.len(), survey.cases().len(), "rows of the page");
    let again: Vec<usize> = (0..rows.len()).step_by(EVERY).collect();
    for (case, line) in again.iter().zip(run(&survey, &again)) {
        assert_eq!(
            row(&line).trim_end(),
            rows[*case],
            "run `quadrant hil survey --write docs/fault-outcomes.md`"
        );
        assert_eq!(line.outcomes.values().sum::<usize>(), MOMENTS, "{} {}", line.fault, line.how);
        assert!(line.carried_on.is_empty(), "{:?}", line.carried_on);
    }
    // All but the rows needs no run.
    let bare = |text: &str| text.lines().filter(|line| !rows.contains(line)).collect::<Vec<_>>().join("\n");
    assert_eq!(bare(PAGE), bare(&page(&survey, &[])));
    assert!(PAGE.contains("\n## Carried on with wrong data\n\nIn no run.\n"));
}

#[test]
fn a_part_of_the_survey_gives_the_lines_of_the_whole() {
    let survey = survey(3);
    let at = |fault: &str| survey.cases().iter().position(|case| case.fault() == fault).unwrap();
    let (corrupted, jump, host) = (at("corrupted-frames"), at("encoder-jump"), at("second-host"));
    let together = run(&survey, &[corrupted, jump, host]);
    let apart = [corrupted, jump, host].map(|case| run(&survey, &[case])).concat();
    assert_eq!(together, apart);
}

/// An encoder that is too coarse to see the screw wind up.
const COARSE: (&str, &str) = ("counts-per-rev = 1048576", "counts-per-rev = 2000");

#[test]
fn a_machine_that_carries_on_with_wrong_data_is_told() {
    let (_, text) = config::EMBEDDED.into_iter().find(|(name, _)| *name == "reference").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("coarse.toml");
    std::fs::write(&file, text.replace(COARSE.0, COARSE.1)).unwrap();
    let arguments = ["hil", "survey", "--fault", "encoder-frozen", "--json", "--machine"];
    let mut quadrant = Command::cargo_bin("quadrant").unwrap();
    let output = quadrant.args(arguments).arg(&file).output().unwrap();
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1), "{told}");
    let lines = told["lines"].as_array().unwrap();
    let carried_on: Vec<&Value> =
        lines.iter().flat_map(|line| line["carried_on"].as_array().unwrap()).collect();
    assert_eq!(told["carried_on"].as_u64(), Some(carried_on.len() as u64));
    assert!(carried_on.iter().all(|run| run["fault"] == "encoder-frozen"), "{carried_on:?}");
    assert!(carried_on.iter().all(|run| run["position_error_um"].as_f64() > run["unseen_um"].as_f64()));
    assert!(!carried_on.is_empty());
}
