//! Two processes on an interface: the boards of a log, and the tool that is to command them as it did then. And
//! what `candump` writes of it as a log.

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Output, Stdio};
use std::time::Instant;

use serde_json::Value;
use tempfile::TempDir;

use crate::machine::waiting;
use crate::rig::{Interface, say};

/// A circle of some seconds of machine time.
const SMALL: [&str; 6] = ["--radius-mm", "3", "--feed-mm-per-min", "1500", "--direction", "ccw"];

/// A program that waits for a host; killed with its value.
struct Waiting {
    child: Child,
    said: BufReader<ChildStderr>,
}

impl Waiting {
    #[track_caller]
    fn start(command: &mut Command) -> Self {
        let (child, said) = waiting(command.stdout(Stdio::piped()));
        Self { child, said }
    }

    /// Waits for its end: exit code, result, and what it said.
    #[track_caller]
    fn end(mut self) -> (Option<i32>, Value, String) {
        let (mut result, mut rest) = (String::new(), String::new());
        self.child.stdout.take().unwrap().read_to_string(&mut result).unwrap();
        self.said.read_to_string(&mut rest).unwrap();
        (self.child.wait().unwrap().code(), serde_json::from_str(&result).unwrap_or_default(), rest)
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        let _gone = self.child.kill();
        let _reaped = self.child.wait();
    }
}

fn quadrant(words: &[&str]) -> Command {
    let mut tool = Command::new(assert_cmd::cargo::cargo_bin("quadrant"));
    tool.args(words).stdin(Stdio::null());
    tool
}

#[track_caller]
fn circle(interface: &Interface, words: &[&str], folder: &Path) -> Output {
    let folder = folder.to_str().unwrap();
    let on = ["circle", "--bus", &interface.name, "--pace", "virtual", "--json", "--out", folder];
    quadrant(&[&on, &SMALL[..], words].concat()).output().unwrap()
}

/// The log of a run on the simulated machine.
#[track_caller]
fn recorded(interface: &Interface, folder: &Path) -> PathBuf {
    let program = assert_cmd::cargo::cargo_bin("quadrant").with_file_name("hil-sim");
    assert!(program.exists(), "{} is missing: cargo build -p hil-sim", program.display());
    let _machine = Waiting::start(Command::new(program).args(["--bus", &interface.name, "--seed", "9"]));
    let log = folder.join("run.mcap");
    let output = circle(interface, &["--log", log.to_str().unwrap()], folder);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    log
}

fn playback(interface: &Interface, log: &Path) -> Waiting {
    Waiting::start(&mut quadrant(&["replay", log.to_str().unwrap(), "--bus", &interface.name, "--json"]))
}

#[test]
fn a_log_played_to_another_host_draws_the_recorded_commands() {
    let Some(interface) = Interface::new() else { return };
    let [folder, again, other] = [(); 3].map(|()| TempDir::new().unwrap());
    let log = recorded(&interface, folder.path());

    let boards = playback(&interface, &log);
    let began = Instant::now();
    let output = circle(&interface, &[], again.path());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let seconds = began.elapsed().as_secs_f64();
    let (code, result, said) = boards.end();
    assert_eq!(
        (code, &result["difference"], &result["ended_early"]),
        (Some(0), &Value::Null, &Value::Null),
        "{said}"
    );
    let cycles = result["cycles"].as_u64().unwrap();
    assert!(cycles > 3_000 && result["commands"] == 2 * cycles, "{result}");
    say(&format!(
        "playback: {cycles} cycles, every command equal, {:.0} per second",
        cycles as f64 / seconds
    ));

    // The first gain to act is another.
    let text = include_str!("../../firmware-config/machines/reference.toml");
    let machine = other.path().join("other.toml");
    std::fs::write(&machine, text.replace("kp-per-s = 8.55", "kp-per-s = 8.56")).unwrap();
    let boards = playback(&interface, &log);
    let output = circle(&interface, &["--machine", machine.to_str().unwrap()], other.path());
    let (code, result, said) = boards.end();
    assert_eq!(code, Some(2), "{said}");
    let difference = &result["difference"];
    assert_eq!((&difference["field"], &difference["axis"]), (&"current_ua".into(), &"x".into()), "{result}");
    let cycle = difference["cycle"].as_u64().unwrap();
    assert!(cycle > 1 && result["cycles"] == cycle, "{result}");
    assert!(said.contains(&format!("cycle {cycle}: current_ua of the command to axis x is ")), "{said}");
    assert_eq!(output.status.code(), Some(2), "a host that is left alone stops its axes");
}

#[test]
fn nothing_is_played_beside_a_machine() {
    let Some(interface) = Interface::new() else { return };
    let folder = TempDir::new().unwrap();
    let [log, out] = ["run.mcap", "out"].map(|name| folder.path().join(name));
    let words = ["circle", "--log", log.to_str().unwrap(), "--out", out.to_str().unwrap()];
    assert!(quadrant(&[&words, &SMALL[..]].concat()).output().unwrap().status.success());
    let boards = playback(&interface, &log);
    let heartbeat = Command::new("cansend").args([&interface.name, "702#05000000"]).status();
    assert!(heartbeat.expect(crate::rig::CAN_UTILS).success());
    let (code, _, said) = boards.end();
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("a board speaks on this bus, node 2"), "{said}");
}

/// The columns of a log that a listener knows too.
#[track_caller]
fn known(log: &Path) -> Vec<Vec<String>> {
    let output = quadrant(&["log", log.to_str().unwrap(), "--csv", "-"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut reader = csv::Reader::from_reader(output.stdout.as_slice());
    let names = reader.headers().unwrap().clone();
    let is_known = |name: &str| {
        ["cycle", "scheduled_ns", "woke_ns", "overruns", "sent_crc"].contains(&name)
            || ["sample_", "raw_", "freshness", "age_", "fresh_", "missed_", "heartbeats", "control_word"]
                .iter()
                .any(|part| name.split_once('.').is_some_and(|(_, field)| field.starts_with(part)))
    };
    let places: Vec<usize> = (0..names.len()).filter(|place| is_known(&names[*place])).collect();
    assert!(places.len() > 35, "{} columns", places.len());
    reader
        .records()
        .map(|line| places.iter().map(|place| line.as_ref().unwrap()[*place].to_owned()).collect())
        .collect()
}

#[test]
fn what_candump_wrote_of_a_run_becomes_a_log_with_its_samples_and_commands() {
    let Some(interface) = Interface::new() else { return };
    let folder = TempDir::new().unwrap();
    let (dump, again) = (folder.path().join("run.log"), folder.path().join("again.mcap"));
    let file = std::fs::File::create(&dump).unwrap();
    // A buffer for all of it: a listener that loses frames says so, and is no witness.
    let candump =
        Command::new("candump").args(["-L", "-d", "-r", "8388608", &interface.name]).stdout(file).spawn();
    let mut candump = candump.expect(crate::rig::CAN_UTILS);
    // It says nothing when it is ready.
    std::thread::sleep(std::time::Duration::from_millis(300));
    let log = recorded(&interface, folder.path());
    std::thread::sleep(std::time::Duration::from_millis(300));
    let ended = Command::new("kill").args(["-INT", &candump.id().to_string()]).status().unwrap();
    assert!(ended.success());
    candump.wait().unwrap();

    let import = [
        "import",
        dump.to_str().unwrap(),
        "--machine",
        "reference",
        "--log",
        again.to_str().unwrap(),
        "--json",
    ];
    let output = quadrant(&import).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&told["interface"], &told["pace"]), (&interface.name.as_str().into(), &"virtual".into()));
    let (own, listened) = (known(&log), known(&again));
    assert_eq!((own.len() as u64, &told["cycles_missing"]), (told["cycles"].as_u64().unwrap(), &0.into()));
    own.iter().zip(&listened).for_each(|(own, listened)| assert_eq!(own, listened));
}
