//! Promise: a text of candump becomes a log by one command; what is not known of its run is said wherever it
//! would be needed.

use std::fs;
use std::path::Path;

use tempfile::TempDir;

use crate::tool::{quadrant, run, text};

fn said(words: &[&str]) -> (String, String, Option<i32>) {
    let output = quadrant().args(words).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (text(output.stdout), text(output.stderr), output.status.code())
}

/// A run, its text, and the log that was made of the text.
fn imported(folder: &Path) -> [String; 3] {
    let [log, dump, again, out] =
        ["run.mcap", "run.log", "again.mcap", "out"].map(|name| text(&folder.join(name)).to_owned());
    let circle = ["circle", "--radius-mm", "5", "--direction", "cw", "--out", &out, "--log", &log];
    assert_eq!(said(&circle).2, Some(0));
    assert_eq!(said(&["log", &log, "--candump", &dump]).2, Some(0));
    let (told, complaints, code) =
        run(&["import", &dump, "--machine", "reference", "--log", &again, "--json"]);
    assert_eq!(code, 0, "{complaints}");
    let (told, summary) = (told.unwrap(), run(&["log", &log, "--json"]).0.unwrap());
    assert_eq!((&told["cycles"], &told["cycles_missing"]), (&summary["cycles"], &0.into()));
    assert_eq!((&told["interface"], &told["pace"]), (&"can0".into(), &"realtime".into()));
    [log, dump, again]
}

/// A column of a log's table.
fn column(log: &str, name: &str) -> Vec<String> {
    let (table, _, code) = said(&["log", log, "--csv", "-"]);
    assert_eq!(code, Some(0));
    let mut reader = csv::Reader::from_reader(table.as_bytes());
    let place = reader.headers().unwrap().iter().position(|column| column == name).unwrap();
    reader.records().map(|line| line.unwrap()[place].to_owned()).collect()
}

#[test]
fn a_text_becomes_a_log_that_says_what_is_not_known() {
    let folder = TempDir::new().unwrap();
    let [log, dump, again] = imported(folder.path());
    for name in ["cycle", "x.sample_position_m", "y.sample_velocity_m_per_s", "x.control_word", "sent_crc"] {
        assert_eq!(column(&again, name), column(&log, name), "{name}");
    }
    for (name, unknown) in [("x.setpoint_position_m", "NaN"), ("y.mode", "6"), ("x.gain_set", "255")] {
        assert!(column(&again, name).iter().all(|value| value == unknown), "{name}");
    }
    let (once_more, _, code) = said(&["log", &again, "--candump", "-"]);
    assert_eq!((once_more, code), (fs::read_to_string(&dump).unwrap(), Some(0)));

    let (table, _, code) = said(&["log", &again]);
    assert!(code == Some(0) && table.matches("not known").count() >= 4, "{table}");
    for words in [&["replay", &again][..], &["circle", "--from", &again], &["latency", &again]] {
        let (_, complaint, code) = said(words);
        assert!(code == Some(2) && complaint.contains("imported from a text of candump"), "{complaint}");
    }
}

#[test]
fn a_text_that_is_not_whole_says_so_in_its_exit_code() {
    let folder = TempDir::new().unwrap();
    let [_, dump, _] = imported(folder.path());
    let lines = fs::read_to_string(&dump).unwrap();
    let path = |name: &str| text(&folder.path().join(name)).to_owned();
    let import = |name: &str, contents: &str, more: &[&str]| {
        let (from, to) = (path(&format!("{name}.log")), path(&format!("{name}.mcap")));
        fs::write(&from, contents).unwrap();
        said(&[&["import", from.as_str(), "--machine", "reference", "--log", to.as_str()], more].concat())
    };
    let whole = lines.lines().position(|line| line.contains(" 202#")).unwrap();
    let without: String = lines
        .lines()
        .enumerate()
        .filter(|(at, _)| *at != whole)
        .map(|(_, line)| format!("{line}\n"))
        .collect();
    let (_, complaint, code) = import("lacking", &without, &[]);
    assert!(code == Some(1) && complaint.contains("warning: 1 commands are not in the text"), "{complaint}");

    let cut = &lines[..lines.len() / 2 - 7];
    let last = cut.lines().count();
    let (_, complaint, code) = import("cut", cut, &[]);
    assert!(code == Some(2) && complaint.contains(&format!("line {last}: ")), "{complaint}");
    let (_, complaint, code) = import("left", cut, &["--skip-damaged"]);
    assert!(code == Some(1) && complaint.contains("1 lines cannot be read and were left out"), "{complaint}");

    let (_, complaint, code) = import("cut", cut, &[]);
    assert!(code == Some(2) && complaint.contains("a log is never overwritten"), "{complaint}");
}
