//! Scenarios over an interface: the tool at one end, the simulated machine that it starts at the other.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use quadrant::config::scenario::{Scenario, load_scenario};
use quadrant::log::Reader;
use quadrant::log::schema::difference;
use quadrant::offline::hil::in_memory;
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::machine::{Machine, result, wait_for};
use crate::rig::{Interface, say};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenarios")
}

/// The tool, about to run scenarios over an interface.
fn hil_run(interface: &Interface, files: &[PathBuf]) -> Command {
    let mut tool = Command::new(assert_cmd::cargo::cargo_bin("quadrant"));
    tool.args(["hil", "run", "--json", "--bus", &interface.name]).args(files);
    tool.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    tool
}

/// Runs a scenario in memory beside the log of the same over an interface; how many cycles both have.
#[track_caller]
fn assert_same(scenario: &Scenario, log: &Path, told: &Value) -> u64 {
    let axes = scenario.machine.axis_names();
    let mut reader = Reader::open(log).unwrap();
    let mut cycles = 0;
    let outcome = in_memory(scenario, |record, inputs| {
        let over_the_bus =
            reader.next().unwrap_or_else(|| panic!("{}: {cycles} cycles", scenario.name)).unwrap();
        assert_eq!(
            difference(record, &over_the_bus, &axes),
            None,
            "{}, cycle {}",
            scenario.name,
            record.cycle
        );
        assert_eq!(inputs, reader.inputs_until(&over_the_bus), "{}, cycle {}", scenario.name, record.cycle);
        cycles += 1;
    });
    // A log without a cycle has no end to look for.
    assert!(cycles == 0 || reader.next().is_none(), "{}: more than {cycles} cycles", scenario.name);
    assert_eq!(told["findings"], json!(outcome.findings), "{}", scenario.name);
    assert_eq!(told["unjudged"], json!([]), "{}", scenario.name);
    cycles
}

/// The scenarios as they are, or with smaller circles and earlier faults where a cycle takes a millisecond.
fn scenarios(shortened: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> =
        fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let is_guest = std::env::var_os("QUADRANT_VCAN_CLOCK").is_some();
    if !is_guest || std::env::var_os("QUADRANT_VCAN_WHOLE").is_some() {
        return files;
    }
    say(
        "the scenarios are SHORTENED, because this kernel is slow; with QUADRANT_VCAN_WHOLE set they are not",
    );
    let shorten = |file: PathBuf| {
        let short = shortened.join(file.file_name().unwrap());
        fs::write(&short, shortened_text(&fs::read_to_string(file).unwrap())).unwrap();
        short
    };
    files.into_iter().map(shorten).collect()
}

/// A scenario that takes about a quarter of its time.
fn shortened_text(text: &str) -> String {
    let line = |line: &str| match line.split_once(" = ") {
        Some(("radius-mm", _)) => "radius-mm = 0.1".to_owned(),
        Some(("feed-mm-per-min", _)) => "feed-mm-per-min = 100.0".to_owned(),
        Some((key @ ("at-s" | "for-s"), value)) => {
            let time_s: f64 = value.parse().unwrap();
            // What lasts a period or so still does.
            format!("{key} = {:?}", if time_s < 0.01 { time_s } else { 0.1 * time_s })
        }
        _ => line.to_owned(),
    };
    text.lines().map(|text| line(text) + "\n").collect()
}

#[test]
fn every_scenario_gives_the_records_and_the_judgement_of_the_run_in_memory() {
    let Some(interface) = Interface::new() else { return };
    let texts = TempDir::new().unwrap();
    let files = scenarios(texts.path());
    assert!(files.len() >= 37, "{} scenarios", files.len());
    let logs = TempDir::new().unwrap();
    let began = Instant::now();
    let output = hil_run(&interface, &files).arg("--logs").arg(logs.path()).output().unwrap();
    // Whether a shortened one comes as expected is not the question.
    let told = serde_json::from_slice::<Value>(&output.stdout);
    let told = told.unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    let over_the_bus_s = began.elapsed().as_secs_f64();
    let mut cycles = 0;
    for (file, told) in files.iter().zip(told["scenarios"].as_array().unwrap()) {
        let log = logs.path().join(file.file_stem().unwrap()).with_extension("mcap");
        cycles += assert_same(&load_scenario(file).unwrap(), &log, told);
        fs::remove_file(&log).unwrap();
    }
    assert!(cycles > 50_000, "{cycles} cycles are too few to tell");
    say(&format!(
        "{} scenarios over the bus: {cycles} cycles in {over_the_bus_s:.0} s, {:.0} per second",
        files.len(),
        cycles as f64 / over_the_bus_s
    ));
}

fn scenario(name: &str) -> PathBuf {
    folder().join(name).with_extension("toml")
}

#[test]
fn a_machine_that_runs_already_is_taken_and_what_only_it_knows_stays_unjudged() {
    let Some(interface) = Interface::new() else { return };
    let file = scenario("clean-hold");
    let truth = TempDir::new().unwrap();
    let truth = truth.path().join("truth.csv");
    let words = ["--scenario", file.to_str().unwrap(), "--truth", truth.to_str().unwrap()];
    let machine = Machine::start_with(&interface, &words);
    let told = result(&hil_run(&interface, &[file]).arg("--attach").output().unwrap());
    let one = &told["scenarios"][0];
    assert_eq!(one["unjudged"], json!(["position-error-max-um", "path-error-max-um"]), "{one}");
    assert_eq!(one["findings"].as_array().unwrap().len(), 1, "{one}");
    let said = machine.end("-TERM");
    assert!(said.starts_with("1 sessions, "), "{said}");
    let rows = fs::read_to_string(truth).unwrap();
    assert!(rows.starts_with("cycle,x position m,"), "{}", &rows[..60]);
    assert!(rows.lines().count() > 4_000, "{} rows of truth", rows.lines().count());

    let two =
        hil_run(&interface, &[scenario("clean-hold"), scenario("load")]).arg("--attach").output().unwrap();
    let said = String::from_utf8_lossy(&two.stderr);
    assert!(two.status.code() == Some(2) && said.contains("--attach takes one scenario"), "{said}");
}

/// The process that another has started.
fn child_of(parent: u32) -> Option<u32> {
    let children = fs::read_to_string(format!("/proc/{parent}/task/{parent}/children")).ok()?;
    children.split_whitespace().next()?.parse().ok()
}

/// A run that has begun, and the machine it has started.
#[track_caller]
fn begun(interface: &Interface) -> (Child, u32) {
    let count = format!("/sys/class/net/{}/statistics/tx_packets", interface.name);
    let frames = || fs::read_to_string(&count).unwrap().trim().parse::<u64>().unwrap();
    let before = frames();
    let host = hil_run(interface, &[scenario("friction")]).spawn().unwrap();
    wait_for("the run to begin", || frames() > before + 2_000);
    let machine = child_of(host.id()).expect("a machine of its own");
    (host, machine)
}

fn is_there(process: u32) -> bool {
    // One that has ended and was not waited for is not there.
    fs::read_to_string(format!("/proc/{process}/stat"))
        .is_ok_and(|stat| !stat.rsplit(')').next().unwrap_or_default().trim_start().starts_with('Z'))
}

fn kill(signal: &str, process: u32) {
    assert!(Command::new("kill").args([signal, &process.to_string()]).status().unwrap().success());
}

#[test]
fn a_machine_that_dies_ends_the_run_with_a_reason_and_a_tool_that_dies_ends_the_machine() {
    let Some(interface) = Interface::new() else { return };
    let (host, machine) = begun(&interface);
    kill("-KILL", machine);
    let killed = Instant::now();
    let output = host.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(killed.elapsed() < Duration::from_secs(20), "{:?} until it ended", killed.elapsed());
    for part in ["friction.toml", "no simulated machine answered within 2 s", "waiting for a host"] {
        assert!(said.contains(part), "does not say `{part}`: {said}");
    }

    for signal in ["-KILL", "-INT"] {
        let (mut host, machine) = begun(&interface);
        kill(signal, host.id());
        host.wait().unwrap();
        wait_for("the machine to end", || !is_there(machine));
    }
}

#[test]
fn a_machine_that_cannot_be_started_is_told_with_what_it_said() {
    let Some(interface) = Interface::new() else { return };
    interface.down();
    let output = hil_run(&interface, &[scenario("clean-hold")]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    for part in ["hil-sim said", &format!("interface {} is down", interface.name), "ip link set"] {
        assert!(said.contains(part), "does not say `{part}`: {said}");
    }
}
