//! Promise: the daemon says what this computer lacks for real time and how to mend it, and runs on the
//! simulated machine all the same, as a user without any privilege too. A full log and a talk that nobody
//! hears end no cycle, and who supervises it hears the truth.
#![cfg(feature = "service")]
#![expect(clippy::unwrap_used, reason = "a test stops at the first surprise")]

mod systemd;

use std::fs::{self, Permissions};
use std::io::{PipeReader, PipeWriter, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use tempfile::TempDir;

/// Nobody: owns nothing, may do nothing.
const NOBODY: u32 = 65_534;

fn daemon() -> PathBuf {
    assert_cmd::cargo::cargo_bin("quadrantd")
}

fn is_root() -> bool {
    fs::metadata("/proc/self").is_ok_and(|own| own.uid() == 0)
}

/// The daemon where anybody may run it and write beside it, as somebody without any privilege.
struct Unprivileged(TempDir);

impl Unprivileged {
    fn new() -> Self {
        let folder = TempDir::new().unwrap();
        fs::copy(daemon(), folder.path().join("quadrantd")).unwrap();
        fs::set_permissions(folder.path(), Permissions::from_mode(0o777)).unwrap();
        Self(folder)
    }

    fn folder(&self) -> &Path {
        self.0.path()
    }

    fn run(&self, words: &str) -> Output {
        let mut shell = Command::new("bash");
        let script = format!("ulimit -r 0; ulimit -l 64; cd \"$0\"; {words}");
        shell.args(["-euc", &script]).arg(self.folder());
        if is_root() {
            shell.uid(NOBODY).gid(NOBODY);
        }
        shell.output().unwrap()
    }
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// The self-check as programs read it.
fn checked(output: &Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", said(output)))
}

fn is_held<'j>(json: &'j serde_json::Value, name: &str) -> (bool, &'j str) {
    let check = json["checks"].as_array().unwrap().iter().find(|check| check["name"] == name);
    let check = check.unwrap_or_else(|| panic!("no check {name}: {json}"));
    (check["state"] == "held", check["found"].as_str().unwrap())
}

#[test]
fn the_check_ends_as_its_list_says() {
    let output = Command::new(daemon()).args(["--check", "--json"]).output().unwrap();
    let json = checked(&output);
    let checks = json["checks"].as_array().unwrap();
    assert!(checks.len() >= 12, "{json}");
    for check in checks {
        let needs_mending = check["state"] == "missing";
        let mend = check["mend"].as_str().unwrap_or_default();
        assert_eq!(needs_mending, !mend.is_empty(), "{check}");
    }
    let is_missing = |check: &serde_json::Value| check["is_required"] == true && check["state"] == "missing";
    let is_fit = !checks.iter().any(is_missing);
    assert_eq!((&json["is_fit"], output.status.code()), (&is_fit.into(), Some(i32::from(!is_fit))), "{json}");

    let table = Command::new(daemon()).arg("--check").output().unwrap();
    let text = String::from_utf8(table.stdout).unwrap();
    for check in checks {
        let name = check["name"].as_str().unwrap();
        assert!(text.contains(&format!(" {name} ")), "{name} is not in\n{text}");
    }
}

#[test]
fn without_privileges_each_missing_thing_is_said() {
    let output = Unprivileged::new().run("./quadrantd --check --json");
    let json = checked(&output);
    assert_eq!(output.status.code(), Some(1), "{json}");
    let (is_locked, found) = is_held(&json, "memory");
    assert!(!is_locked && found.contains("64 KiB"), "{found}");
    let (is_fifo, found) = is_held(&json, "scheduling");
    assert!(!is_fifo && found.contains("SCHED_OTHER") && found.contains("EPERM"), "{found}");
    for name in ["heap", "affinity", "signals"] {
        assert!(is_held(&json, name).0, "{name} needs no privilege: {json}");
    }
}

#[test]
fn without_privileges_the_simulated_machine_runs() {
    let user = Unprivileged::new();
    let output = user.run("timeout --preserve-status -s TERM 2 ./quadrantd --hold --logs logs");
    let said = said(&output);
    assert!(said.contains("borne, because nothing real moves"), "{said}");
    assert!(said.contains("a signal: coming to rest") && said.contains("stopped"), "{said}");
    let logs: Vec<_> = fs::read_dir(user.folder().join("logs")).unwrap().collect();
    assert_eq!(logs.len(), 1, "{said}");
}

/// The daemon in a shell that is told what to do about it, until it is ended after two seconds.
fn run_in_shell(script: &str) -> (Output, TempDir) {
    let folder = TempDir::new().unwrap();
    let script = format!("cd \"$1\"; {script}");
    let output = Command::new("bash").args(["-uc", &script]).arg(daemon()).arg(folder.path()).output();
    (output.unwrap(), folder)
}

#[test]
fn a_log_that_reaches_the_size_limit_is_an_error_of_the_log() {
    // 64 blocks of 1024 bytes: a quarter of a second.
    let (output, folder) =
        run_in_shell("ulimit -f 64; timeout --preserve-status -s TERM 2 \"$0\" --hold --logs logs");
    let said = said(&output);
    assert_eq!(output.status.code(), Some(1), "records are lost, the daemon is not: {said}");
    assert!(said.contains("File too large") && said.contains("a signal: coming to rest"), "{said}");
    let log = fs::read_dir(folder.path().join("logs")).unwrap().next().unwrap().unwrap();
    assert!(log.metadata().unwrap().len() <= 64 << 10, "the limit holds");
}

/// A pipe that takes no byte more: whoever writes to it waits.
fn full_pipe() -> (PipeReader, PipeWriter) {
    let (reader, mut writer) = std::io::pipe().unwrap();
    let size = nix::fcntl::fcntl(&writer, nix::fcntl::FcntlArg::F_GETPIPE_SZ).unwrap();
    writer.write_all(&vec![b'-'; size as usize]).unwrap();
    (reader, writer)
}

#[test]
fn a_signal_is_heard_while_a_reader_of_its_talk_stands_still() {
    let folder = TempDir::new().unwrap();
    for signal in ["TERM", "INT", "HUP", "QUIT"] {
        let (reader, writer) = full_pipe();
        let mut child = Command::new(daemon())
            .args(["--hold", "--logs"])
            .arg(folder.path().join(signal))
            .stderr(writer)
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(1_500));
        Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status().unwrap();
        let ended = (0..150).find_map(|_| {
            std::thread::sleep(Duration::from_millis(100));
            child.try_wait().unwrap()
        });
        drop(reader);
        if ended.is_none() {
            child.kill().unwrap();
        }
        // A busy computer may make it fault before; ended it has by itself.
        let code = ended.and_then(|status| status.code());
        assert!(matches!(code, Some(0 | 1)), "SIG{signal}: {ended:?}");
    }
}

#[test]
fn a_daemon_that_nobody_listens_to_goes_on() {
    // The reader of its talk is gone after the first line.
    let script = "set -o pipefail; timeout --preserve-status -s TERM 2 \"$0\" --logs logs 2>&1 | head -n 1";
    let (output, folder) = run_in_shell(script);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let log = fs::read_dir(folder.path().join("logs")).unwrap().next().unwrap().unwrap();
    let mut reader = quadrant::log::Reader::open(&log.path()).unwrap();
    assert!(reader.by_ref().map(Result::unwrap).count() > 1000, "it ran to its end");
    assert!(!reader.is_truncated(), "and the log is complete");
}
