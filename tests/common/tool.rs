//! The tool as a process, and what it leaves.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;

/// A short circle: 9 s of machine time.
pub(crate) const SHORT: [&str; 5] = ["circle", "--radius-mm", "20", "--feed-mm-per-min", "4000"];

pub(crate) fn quadrant() -> Command {
    Command::cargo_bin("quadrant").unwrap()
}

/// Standard output as JSON, standard error, exit code.
pub(crate) fn run(arguments: &[&str]) -> (Option<Value>, String, i32) {
    let output = quadrant().args(arguments).output().unwrap();
    let code = output.status.code().expect("not ended by a signal");
    let said = String::from_utf8(output.stderr).unwrap();
    (serde_json::from_slice(&output.stdout).ok(), said, code)
}

pub(crate) fn with<'a>(base: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    [base, more].concat()
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

pub(crate) fn only_log(folder: &Path) -> PathBuf {
    let mut logs = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "mcap"));
    let log = logs.next().expect("a log");
    assert!(logs.next().is_none(), "one log only");
    log
}
