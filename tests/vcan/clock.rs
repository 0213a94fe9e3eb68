//! Two processes on the wall clock: what a circle shows, and what is left when one of them is killed.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use quadrant::base::axis::AxisId;
use quadrant::base::record::{CycleRecord, ModeTag};
use quadrant::base::time::Span;
use quadrant::log::Reader;
use quadrant::rt::drive::state::DriveState;
use quadrant::rt::wire::state::{Emergency, decode_emergency};
use serde_json::Value;
use tempfile::TempDir;

use crate::machine::{Machine, circle, log_of, result, wait_for};
use crate::rig::{CAN_UTILS, Interface, say};
use crate::slow::{self, CIRCLE};

/// How far a figure may be from that of the run in memory, um.
const OFF_UM_MAX: f64 = 0.3;

/// The simulated machine on the wall clock.
fn live(interface: &Interface, machine: &Path) -> Machine {
    Machine::start_with(interface, &["--pace", "realtime", "--machine", machine.to_str().unwrap()])
}

/// The tool, about to run the circle on that machine.
fn on_the_clock(interface: &Interface, machine: &Path, folder: &Path, words: &[&str]) -> Command {
    let place = ["--bus", &interface.name, "--pace", "realtime", "--allow-jitter", "--machine"];
    circle(&[&place, &[machine.to_str().unwrap()][..], words].concat(), folder)
}

/// Protrusion at the motor encoders, and how much smaller the circle is, um.
fn figures(told: &Value) -> [f64; 2] {
    [&told["protrusion_um"]["motor"]["max"], &told["radius_decrease_um"]].map(|um| um.as_f64().unwrap())
}

/// Runs the circle on a machine; its figures if it kept up, else why not. One cycle that is missed as an axis breaks
/// away moves its protrusion by up to 0.26 um, and a few of them by more than the bound.
fn run_at(interface: &Interface, machine: &Path) -> Result<[f64; 2], String> {
    let folder = TempDir::new().unwrap();
    let simulated = live(interface, machine);
    let output = on_the_clock(interface, machine, folder.path(), &CIRCLE).output().unwrap();
    let simulator_said = simulated.end("-TERM");
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let last = said.lines().rfind(|line| line.contains("fault")).unwrap_or(&said).to_owned();
        return Err(format!("{last}; the simulator: {}", simulator_said.trim()));
    }
    let told = result(&output);
    let [cycles, skipped, stale] =
        ["cycles", "overruns", "stale_samples"].map(|count| told[count].as_u64().unwrap());
    if skipped + stale > 0 {
        return Err(format!("{skipped} of {cycles} cycles skipped, {stale} samples stale"));
    }
    Ok(figures(&told))
}

#[test]
fn a_circle_on_the_clock_shows_what_it_shows_in_memory_at_the_fastest_rate_that_is_held() {
    let Some(interface) = Interface::new() else { return };
    let folder = TempDir::new().unwrap();
    let reference = (2_000, PathBuf::from("reference"));
    let slower = [2, 4, 10].map(|ms| (1_000 / ms, slow::machine(folder.path(), Span::ms(ms))));
    for (rate, machine) in std::iter::once(reference).chain(slower) {
        let [protrusion, decrease] = match run_at(&interface, &machine) {
            Ok(figures) => figures,
            Err(why) => {
                say(&format!("did not keep up at {rate} Hz: {why}"));
                continue;
            }
        };
        let words = [&["--machine", machine.to_str().unwrap()], &CIRCLE[..]].concat();
        let in_memory = result(&circle(&words, &folder.path().join("memory")).output().unwrap());
        let [protrusion_in_memory, decrease_in_memory] = figures(&in_memory);
        say(&format!(
            "kept up at {rate} Hz: motor protrusion {protrusion:.2} um against {protrusion_in_memory:.2} in \
             memory, circle smaller by {decrease:.2} um against {decrease_in_memory:.2}"
        ));
        for (measured, reference) in [(protrusion, protrusion_in_memory), (decrease, decrease_in_memory)] {
            let off_um = (measured - reference).abs();
            assert!(off_um <= OFF_UM_MAX, "{off_um} um off at {rate} Hz, bound {OFF_UM_MAX} um");
        }
        return;
    }
    panic!("no rate was held; tests/preempt-rt/on-clock has a computer that nobody else uses");
}

/// A slow machine that every computer should keep up with.
fn slowest(folder: &Path) -> PathBuf {
    slow::machine(folder, Span::ms(10))
}

/// What somebody who only listens hears of the emergencies of the boards.
struct Listener(Child);

impl Listener {
    fn start(interface: &Interface, file: &Path) -> Self {
        // Emergencies are 081h and on, SYNC is 080h.
        let filter = format!("{},080:780", interface.name);
        let file = fs::File::create(file).unwrap();
        let mut candump = Command::new("candump");
        candump.args(["-L", &filter]).stdin(Stdio::null()).stdout(file);
        Self(candump.spawn().expect(CAN_UTILS))
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        let _gone = self.0.kill();
        let _reaped = self.0.wait();
    }
}

/// How many boards reported that their watchdog has taken the current away.
fn tripped(heard: &Path) -> usize {
    let file = std::io::BufReader::new(fs::File::open(heard).unwrap());
    let mut lines = quadrant::candump::Lines::new(file);
    // The last line may still be on its way.
    std::iter::from_fn(|| lines.next_frame().ok().flatten())
        .filter_map(|line| decode_emergency(&line.frame).ok())
        .filter(|emergency| emergency.code == Emergency::CODE_WATCHDOG)
        .count()
}

/// The records of a log that may have been cut off.
#[track_caller]
fn records(log: &Path) -> Vec<CycleRecord> {
    Reader::open(log).unwrap().map(Result::unwrap).collect()
}

/// Waits until a run has got its axes to move.
#[track_caller]
fn wait_until_moving(folder: &Path) {
    let moves = || log_of(folder).is_some_and(|log| is_moving(&log));
    wait_for("the axes to move", moves);
    // Into the circle.
    thread::sleep(Duration::from_secs(2));
}

fn is_moving(log: &Path) -> bool {
    let Ok(reader) = Reader::open(log) else { return false };
    let is_moving =
        |record: CycleRecord| record.axes.as_slice().iter().all(|axis| axis.mode == ModeTag::Moving);
    reader.filter_map(Result::ok).any(is_moving)
}

/// When the axes got their current they stayed where they were.
#[track_caller]
fn assert_bumpless(log: &Path) {
    let records = records(log);
    for axis in [AxisId::X, AxisId::Y] {
        // From the moment it has its loop until it is moved.
        let is_ready = |record: &&CycleRecord| record.axes[axis].mode == ModeTag::Ready;
        let standing: Vec<_> =
            records.iter().skip_while(|record| !is_ready(record)).take_while(is_ready).collect();
        let row = &standing.first().expect("it was enabled").axes[axis];
        let off_um = (row.setpoint.position - row.sample.position).as_um();
        assert!(off_um.abs() < 1.0, "axis {axis} was enabled {off_um} um from where it stood");
        let moved_um =
            standing.iter().map(|record| (record.axes[axis].sample.position - row.sample.position).as_um());
        let moved_um = moved_um.fold(0.0, |most: f64, um| most.max(um.abs()));
        assert!(moved_um < 1.0, "axis {axis} moved by {moved_um} um when it was enabled");
    }
}

#[test]
fn boards_whose_host_was_killed_let_go_and_the_next_host_starts_from_where_they_stand() {
    let Some(interface) = Interface::new() else { return };
    let folder = TempDir::new().unwrap();
    let machine = slowest(folder.path());
    let heard = folder.path().join("heard.log");
    let _listener = Listener::start(&interface, &heard);
    let simulated = live(&interface, &machine);
    let cut = folder.path().join("cut");
    let mut host = on_the_clock(&interface, &machine, &cut, &CIRCLE).spawn().unwrap();
    wait_until_moving(&cut);
    assert_eq!(tripped(&heard), 0);
    host.kill().unwrap();
    host.wait().unwrap();
    wait_for("the watchdogs of both boards", || tripped(&heard) == 2);
    let left = records(&log_of(&cut).unwrap());
    let stood = left.last().unwrap().axes.map(|_, row| row.sample.velocity.abs().as_mm_per_s());
    assert!(stood.as_slice().iter().any(|mm_per_s| *mm_per_s > 1.0), "it was killed at rest: {stood:?} mm/s");
    // One that coasts would be braked, and so move. Its friction needs a fifth of a second.
    thread::sleep(Duration::from_secs(1));

    let next = folder.path().join("next");
    result(&on_the_clock(&interface, &machine, &next, &CIRCLE).output().unwrap());
    assert_bumpless(&log_of(&next).unwrap());
    assert_eq!(tripped(&heard), 2, "it ended well");
    let said = simulated.end("-TERM");
    assert!(said.contains("frames dropped by the kernel"), "{said}");
}

#[test]
fn a_machine_that_is_killed_is_a_fault_with_a_name_and_the_log_is_kept() {
    let Some(interface) = Interface::new() else { return };
    let folder = TempDir::new().unwrap();
    let machine = slowest(folder.path());
    let mut simulated = live(&interface, &machine);
    let out = folder.path().join("out");
    let host = on_the_clock(&interface, &machine, &out, &CIRCLE).spawn().unwrap();
    wait_until_moving(&out);
    simulated.kill();
    let output = host.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    for part in ["fault 1 (feedback-lost)", "docs/faults/01-feedback-lost.md", "the log is kept"] {
        assert!(said.contains(part), "does not say `{part}`: {said}");
    }
    let kept = records(&log_of(&out).unwrap());
    assert!(kept.len() > 100, "{} cycles in the log", kept.len());
    let last = kept.last().unwrap();
    assert!(last.axes.as_slice().iter().all(|axis| axis.mode == ModeTag::Faulted), "{last:?}");
}

/// The daemon on an interface, holding its axes; killed with its value.
struct Daemon {
    child: Child,
    logs: PathBuf,
    status: PathBuf,
}

impl Daemon {
    fn start(interface: &Interface, machine: &Path, folder: &Path) -> Self {
        let (logs, status) = (folder.join("logs"), folder.join("status.json"));
        let mut daemon = Command::new(assert_cmd::cargo::cargo_bin("quadrantd"));
        daemon.args(["--bus", &interface.name, "--hold", "--machine"]).arg(machine);
        daemon.arg("--logs").arg(&logs).arg("--status").arg(&status);
        daemon.stdin(Stdio::null()).stderr(Stdio::null());
        Self { child: daemon.spawn().unwrap(), logs, status }
    }

    /// Waits until all axes are in a mode.
    #[track_caller]
    fn wait_until(&self, mode: &str) {
        let are_so = || {
            let Ok(text) = fs::read_to_string(&self.status) else { return false };
            let status: Value = serde_json::from_str(&text).unwrap();
            status["axes"].as_array().unwrap().iter().all(|axis| axis["mode"] == mode)
        };
        wait_for(&format!("the axes of the daemon to be {mode}"), are_so);
    }

    #[track_caller]
    fn terminate(mut self) -> (Option<i32>, PathBuf) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
        (self.child.wait().unwrap().code(), log_of(&self.logs).unwrap())
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _gone = self.child.kill();
        let _reaped = self.child.wait();
    }
}

#[test]
fn a_daemon_that_is_killed_and_started_again_holds_its_axes_where_they_stand() {
    let Some(interface) = Interface::new() else { return };
    let folder = TempDir::new().unwrap();
    let machine = slowest(folder.path());
    let heard = folder.path().join("heard.log");
    let _listener = Listener::start(&interface, &heard);
    let simulated = live(&interface, &machine);
    let [first, second] = ["first", "second"].map(|name| folder.path().join(name));
    let mut killed = Daemon::start(&interface, &machine, &first);
    killed.wait_until("ready");
    killed.child.kill().unwrap();
    killed.child.wait().unwrap();
    // As systemd does it: once more, after a while.
    wait_for("the watchdogs of both boards", || tripped(&heard) == 2);
    let cut = records(&log_of(&killed.logs).unwrap());
    assert!(cut.len() > 20, "{} cycles in the log", cut.len());
    let again = Daemon::start(&interface, &machine, &second);
    again.wait_until("ready");
    let (code, log) = again.terminate();
    assert_eq!(code, Some(0));
    assert_bumpless(&log);
    let last = *records(&log).last().unwrap();
    for axis in last.axes.as_slice() {
        let drive = DriveState::decode(axis.sample.raw.status_word);
        assert_ne!(drive, Some(DriveState::OperationEnabled), "it left the current on");
    }
    simulated.end("-TERM");
}

#[test]
fn a_daemon_whose_machine_is_killed_waits_for_a_person_and_the_next_one_runs() {
    let Some(interface) = Interface::new() else { return };
    let folder = TempDir::new().unwrap();
    let machine = slowest(folder.path());
    let mut simulated = live(&interface, &machine);
    let [first, second] = ["first", "second"].map(|name| folder.path().join(name));
    let daemon = Daemon::start(&interface, &machine, &first);
    daemon.wait_until("ready");
    simulated.kill();
    daemon.wait_until("faulted");
    let _back = live(&interface, &machine);
    thread::sleep(Duration::from_secs(1));
    daemon.wait_until("faulted");
    let (code, log) = daemon.terminate();
    assert_eq!(code, Some(1), "a fault is told by the exit code too");
    assert!(records(&log).len() > 100);
    let next = Daemon::start(&interface, &machine, &second);
    next.wait_until("ready");
    assert_eq!(next.terminate().0, Some(0));
}

/// A scenario on a machine of a file.
fn scenario(folder: &Path, name: &str, machine: &Path, rest: &str) -> PathBuf {
    let file = folder.join(name).with_extension("toml");
    let motion = "kind = \"circle\"\ngains = \"standard\"\nradius-mm = 1.0\nfeed-mm-per-min = 250.0\n\
                  direction = \"ccw\"\nrevolutions = 1\ncentre-x-mm = 0.0\ncentre-y-mm = 0.0\n\
                  start-angle-deg = 45.0";
    let machine = machine.display();
    let text = format!(
        "name = \"{name}\"\nshows = \"It.\"\nmachine = \"{machine}\"\nseed = 1\n\n[motion]\n{motion}\n\n{rest}"
    );
    fs::write(&file, text).unwrap();
    file
}

#[test]
fn scenarios_on_the_clock_are_judged_by_the_truth_of_the_machine() {
    let Some(interface) = Interface::new() else { return };
    let folder = TempDir::new().unwrap();
    let machine = slowest(folder.path());
    let clean = "[expect]\nending = \"complete\"\nposition-error-max-um = 0.02\npath-error-max-um = 1000.0\n";
    let silent = "[[fault]]\nkind = \"silent-board\"\naxis = \"y\"\nat-s = 1.5\nfor-s = 5.0\n\n\
                  [expect]\nending = \"faulted\"\nfault = \"feedback-lost\"\naxis = \"y\"\n\
                  current-zero-within-cycles = 100\nrest-within-cycles = 200\n";
    let bus_off = "[[fault]]\nkind = \"controller-bus-off\"\nat-s = 1.5\nfor-s = 0.5\n\n\
                   [expect]\nending = \"faulted\"\nfault = \"bus-down\"\naxis = \"all\"\n\
                   current-zero-within-cycles = 100\nrest-within-cycles = 200\n";
    let files = [("clean", clean), ("silent", silent), ("bus-off", bus_off)]
        .map(|(name, rest)| scenario(folder.path(), name, &machine, rest));
    let mut tool = Command::new(assert_cmd::cargo::cargo_bin("quadrant"));
    tool.args(["hil", "run", "--json", "--bus", &interface.name, "--pace", "realtime"]).args(&files);
    let output = tool.output().unwrap();
    let told: Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    assert_eq!(told["unmet"], 0, "{told:#}");
    for scenario in told["scenarios"].as_array().unwrap() {
        assert!(scenario["unjudged"].as_array().unwrap().is_empty(), "{scenario}");
        assert_eq!(scenario["findings"].as_array().unwrap().len(), 3, "{scenario}");
    }
    // What the axes really did is asked for the position error, and it is not that of another moment.
    let error = &told["scenarios"][0]["findings"][1];
    assert_eq!(error["expectation"], "position-error-max-um", "{error}");
}
