//! Two processes on an interface: the simulated machine, and the tool that runs a circle on it.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use quadrant::base::axis::AxisId;
use quadrant::base::record::CycleRecord;
use quadrant::base::time::Moment;
use quadrant::log::Reader;
use quadrant::rt::clock::monotonic_now;
use serde_json::Value;
use tempfile::TempDir;

use crate::rig::{CAN_UTILS, Interface, say};

/// A circle of some seconds of machine time.
const SMALL: [&str; 6] = ["--radius-mm", "3", "--feed-mm-per-min", "1500", "--direction", "ccw"];

/// A program once it says that it waits for a host, and what more it says.
#[track_caller]
pub(crate) fn waiting(command: &mut Command) -> (Child, BufReader<ChildStderr>) {
    let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    said.read_line(&mut line).unwrap();
    assert!(line.contains("waiting for a host"), "{line}");
    (child, said)
}

/// `hil-sim` on an interface; killed with its value.
pub(crate) struct Machine {
    child: Child,
    said: BufReader<ChildStderr>,
}

impl Machine {
    #[track_caller]
    fn start(interface: &Interface, seed: &str) -> Self {
        Self::start_with(interface, &["--pace", "virtual", "--seed", seed])
    }

    #[track_caller]
    pub(crate) fn start_with(interface: &Interface, words: &[&str]) -> Self {
        let program = assert_cmd::cargo::cargo_bin("quadrant").with_file_name("hil-sim");
        assert!(program.exists(), "{} is missing: cargo build -p hil-sim", program.display());
        let mut program = Command::new(program);
        let (child, said) =
            waiting(program.args(["--bus", &interface.name]).args(words).stdout(Stdio::null()));
        Self { child, said }
    }

    /// Ends it by a signal; what it said at the end.
    #[track_caller]
    pub(crate) fn end(mut self, signal: &str) -> String {
        assert!(
            Command::new("kill").args([signal, &self.child.id().to_string()]).status().unwrap().success()
        );
        let mut rest = String::new();
        self.said.read_to_string(&mut rest).unwrap();
        let code = self.child.wait().unwrap().code();
        assert_eq!(code, Some(0), "{rest}");
        rest
    }

    pub(crate) fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        let _gone = self.child.kill();
        let _reaped = self.child.wait();
    }
}

/// The tool, about to run a circle into a folder.
pub(crate) fn circle(words: &[&str], folder: &Path) -> Command {
    let mut tool = Command::new(assert_cmd::cargo::cargo_bin("quadrant"));
    tool.arg("circle").args(words).arg("--json").arg("--out").arg(folder);
    tool.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    tool
}

fn on<'a>(interface: &'a Interface, words: &[&'a str]) -> Vec<&'a str> {
    [&["--bus", &interface.name, "--pace", "virtual"], words].concat()
}

#[track_caller]
pub(crate) fn result(output: &Output) -> Value {
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The log in a folder, if there is one.
pub(crate) fn log_of(folder: &Path) -> Option<PathBuf> {
    let mut entries = std::fs::read_dir(folder).ok()?.map(|entry| entry.unwrap().path());
    entries.find(|path| path.extension().is_some_and(|end| end == "mcap"))
}

/// Every cycle in the log of a folder, and what it was told.
#[track_caller]
fn cycles(folder: &Path) -> Vec<String> {
    let log = log_of(folder).expect("a log");
    let mut reader = Reader::open(&log).unwrap();
    let mut cycles = Vec::new();
    while let Some(record) = reader.next() {
        let record = record.unwrap();
        cycles.push(format!("{record:?} {:?}", reader.inputs_until(&record)));
    }
    cycles
}

#[track_caller]
fn assert_same(one: &[String], other: &[String]) {
    assert_eq!(one.len(), other.len(), "cycles of two runs");
    one.iter().zip(other).for_each(|(a, b)| assert_eq!(a, b));
}

/// A run in memory with this seed.
fn in_memory(seed: &str) -> Vec<String> {
    let folder = TempDir::new().unwrap();
    result(&circle(&[&SMALL[..], &["--seed", seed]].concat(), folder.path()).output().unwrap());
    cycles(folder.path())
}

#[test]
fn a_run_on_the_bus_gives_the_records_of_the_run_in_memory_whatever_came_before() {
    let Some(interface) = Interface::new() else { return };
    let memory = in_memory("5");
    assert!(memory.len() > 3_000, "{} cycles are too few to tell", memory.len());
    let machine = Machine::start(&interface, "5");
    let folder = TempDir::new().unwrap();
    let json = result(&circle(&on(&interface, &SMALL), folder.path()).output().unwrap());
    assert_same(&memory, &cycles(folder.path()));

    // A host that is killed in the middle leaves a machine in motion. The next one finds it at rest. Somebody
    // else talks on the bus meanwhile, with identifiers that are none of ours.
    let cut = TempDir::new().unwrap();
    let mut host = circle(&on(&interface, &[]), cut.path()).spawn().unwrap();
    let log_grows = || std::fs::read_dir(cut.path()).is_ok_and(|mut files| files.next().is_some());
    wait_for("the killed run to begin", log_grows);
    thread::sleep(Duration::from_millis(1_500));
    host.kill().unwrap();
    host.wait().unwrap();
    assert!(cycles(cut.path()).len() > 100, "it was killed before it moved");
    let mut others =
        Command::new("cangen").args([&interface.name, "-g", "2", "-I", "3A1"]).spawn().expect(CAN_UTILS);
    let folder = TempDir::new().unwrap();
    let output = circle(&on(&interface, &SMALL), folder.path()).output().unwrap();
    others.kill().unwrap();
    others.wait().unwrap();
    result(&output);
    assert_same(&memory, &cycles(folder.path()));

    let said = machine.end("-TERM");
    assert!(said.starts_with("3 sessions, "), "{said}");
    for part in ["cycles", "frames", "frames per second"] {
        assert!(said.contains(part), "does not say `{part}`: {said}");
    }
    let seconds = json["seconds"].as_f64().unwrap();
    say(&format!(
        "lock step: {:.0} cycles per second, {:.2} times real time; the machine: {}",
        memory.len() as f64 / seconds,
        json["times_real_time"].as_f64().unwrap(),
        said.trim()
    ));
}

/// How long the kernel runs.
fn up_time() -> Duration {
    Duration::from_nanos((monotonic_now() - Moment::ZERO).as_ns() as u64)
}

#[track_caller]
pub(crate) fn wait_for(what: &str, is_so: impl Fn() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < Duration::from_secs(30), "waited for {what}");
        thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn without_a_machine_a_run_is_refused_and_one_that_dies_ends_it() {
    let Some(interface) = Interface::new() else { return };
    let folder = TempDir::new().unwrap();
    // Patience is a length of time, not a moment: it must not grow with the time since boot.
    thread::sleep(Duration::from_secs(10).saturating_sub(up_time()));
    let asked = Instant::now();
    let output = circle(&on(&interface, &SMALL), folder.path()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(asked.elapsed() < Duration::from_secs(8), "{:?} until it was refused", asked.elapsed());
    for part in [&interface.name, "no simulated machine answered within 2 s", "hil-sim --bus"] {
        assert!(said.contains(part), "does not say `{part}`: {said}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing was begun");

    let mut machine = Machine::start(&interface, "1");
    let host = circle(&on(&interface, &[]), folder.path()).spawn().unwrap();
    wait_for("the run to begin", || std::fs::read_dir(folder.path()).unwrap().next().is_some());
    thread::sleep(Duration::from_millis(1_500));
    machine.kill();
    let killed = Instant::now();
    let output = host.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(killed.elapsed() < Duration::from_secs(20), "{:?} until it ended", killed.elapsed());
    for part in ["no simulated machine answered within 2 s", "docs/faults/", "the log is kept"] {
        assert!(said.contains(part), "does not say `{part}`: {said}");
    }
    let kept = cycles(folder.path());
    assert!(kept.len() > 100, "{} cycles in the log", kept.len());
    // A machine that is started again serves the next run.
    let machine = Machine::start(&interface, "5");
    let folder = TempDir::new().unwrap();
    result(&circle(&on(&interface, &SMALL), folder.path()).output().unwrap());
    assert!(machine.end("-INT").starts_with("1 sessions, "));
}

#[test]
fn a_second_host_ends_the_run() {
    let Some(interface) = Interface::new() else { return };
    let _machine = Machine::start(&interface, "1");
    let folder = TempDir::new().unwrap();
    let host = circle(&on(&interface, &[]), folder.path()).spawn().unwrap();
    wait_for("the run to begin", || std::fs::read_dir(folder.path()).unwrap().next().is_some());
    thread::sleep(Duration::from_millis(1_500));
    // A command that no board takes, but no board has sent either.
    let command = Command::new("cansend").args([&interface.name, "201#00"]).status().expect(CAN_UTILS);
    assert!(command.success());
    let output = host.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("docs/faults/19-second-host.md"), "{said}");
}

#[test]
fn an_interface_that_is_not_there_is_named_before_anything_is_begun() {
    let folder = TempDir::new().unwrap();
    let output = circle(&["--bus", "can77"], folder.path()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    // On a kernel without CAN it is that which is said.
    let has_can = std::env::var_os("QUADRANT_VCAN").is_some();
    let expected = if has_can { ["there is no interface can77", "ip -brief link"] } else { ["can", "error"] };
    expected.iter().for_each(|part| assert!(said.contains(part), "does not say `{part}`: {said}"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// Random frames with an identifier of ours, one in so many milliseconds, while a circle is run: how it ended,
/// what was said, and its records.
fn disturbed(interface: &Interface, gap_ms: &str) -> (Option<i32>, String, Vec<CycleRecord>) {
    let folder = TempDir::new().unwrap();
    // As long as the feedback of x, with anything in it.
    let words = [&interface.name, "-g", gap_ms, "-I", "181", "-f", "-b", "-L", "24"];
    let mut noise = Command::new("cangen").args(words).spawn().expect(CAN_UTILS);
    let output = circle(&on(interface, &SMALL), folder.path()).output().unwrap();
    noise.kill().unwrap();
    noise.wait().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let log = log_of(folder.path()).expect("a log");
    (output.status.code(), said, Reader::open(&log).unwrap().map(Result::unwrap).collect())
}

#[test]
fn random_frames_under_a_boards_identifier_are_counted_and_never_believed() {
    let Some(interface) = Interface::new() else { return };
    let _machine = Machine::start(&interface, "1");
    for (gap_ms, expected) in [("400", None), ("5", Some("docs/faults/01-feedback-lost.md"))] {
        let (code, said, records) = disturbed(&interface, gap_ms);
        let last = records.last().unwrap();
        let link = last.axes[AxisId::X].link;
        let unusable = link.late + link.repeated + link.malformed;
        assert!(unusable > 3, "{unusable} of the random frames were counted");
        match expected {
            None => assert_eq!(code, Some(0), "{unusable} unusable frames: {said}"),
            Some(page) => {
                assert!(code == Some(2) && said.contains(page), "{unusable} unusable frames: {said}")
            }
        }
        for pair in records.windows(2) {
            let [before, after] = [&pair[0], &pair[1]].map(|record| record.axes[AxisId::X].sample.position);
            let step_um = (after - before).as_um().abs();
            assert!(step_um < 100.0, "x went {step_um} um in cycle {}", pair[1].cycle);
        }
    }
}
