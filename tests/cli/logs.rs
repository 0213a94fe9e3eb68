//! Promise: no verb spoils a log, and what a log lacks is said.

use std::fs;
use std::path::Path;

use tempfile::TempDir;

use crate::tool::{SHORT, only_log, quadrant, run, text, with};

/// The bytes of the chunk that holds the middle of the evaluated part.
fn chunk_half_way(log: &Path, bytes: &[u8]) -> std::ops::Range<usize> {
    let mut reader = quadrant::log::Reader::open(log).unwrap();
    let wall_at_zero_ns = reader.header().wall_at_zero_ns;
    let records = reader.by_ref().map(Result::unwrap);
    let measured: Vec<_> = records.filter(|record| record.stage.is_measured).collect();
    let half_way = measured[measured.len() / 2].timing.scheduled;
    let wall_ns = u64::try_from(wall_at_zero_ns + half_way.as_ns()).unwrap();
    let index = mcap::Summary::read(bytes).unwrap().unwrap();
    let holds = |chunk: &&mcap::records::ChunkIndex| {
        (chunk.message_start_time..=chunk.message_end_time).contains(&wall_ns)
    };
    let chunk = index.chunk_indexes.iter().find(holds).unwrap();
    let start = chunk.chunk_start_offset as usize;
    start..start + chunk.chunk_length as usize
}

#[test]
fn a_log_with_something_missing_is_judged_and_the_lack_is_said() {
    let folder = TempDir::new().unwrap();
    // Slow enough that a chunk is a small piece of it.
    let slow = ["circle", "--radius-mm", "20", "--feed-mm-per-min", "1000", "--direction", "cw"];
    let live = run(&with(&slow, &["--json", "--out", text(folder.path())])).0.unwrap();
    let log = only_log(folder.path());
    let bytes = fs::read(&log).unwrap();

    let cut = folder.path().join("cut.mcap");
    fs::write(&cut, &bytes[..bytes.len() - 20]).unwrap();
    let (judged, said, code) = run(&["circle", "--from", text(&cut), "--json"]);
    assert_eq!(code, 1, "{said}");
    assert!(said.contains("ends without its index"), "{said}");
    assert_eq!(judged.unwrap()["protrusion_um"], live["protrusion_um"]);

    let (corrupt, rescued) = (folder.path().join("corrupt.mcap"), folder.path().join("rescued.mcap"));
    let mut damaged = bytes.clone();
    let chunk = chunk_half_way(&log, &bytes);
    damaged[chunk.start + chunk.len() / 2..][..64].fill(0x5A);
    fs::write(&corrupt, damaged).unwrap();
    run(&["log", text(&corrupt), "--recover", text(&rescued)]);
    let (judged, said, code) = run(&["circle", "--from", text(&rescued), "--json"]);
    assert_eq!(code, 1, "{said}");
    assert!(said.contains("cycles are missing in the log"), "{said}");
    let judged = judged.unwrap();
    let missing = judged["missing_cycles"].as_u64().unwrap();
    assert!(missing > 0);
    assert_eq!(judged["stale_samples"], 0);
    let output = quadrant().args(["circle", "--from", text(&rescued)]).output().unwrap();
    let table = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(table.contains(&format!("note: {missing} cycles are missing")), "{table}");
}

#[test]
fn a_log_has_its_circle_and_takes_no_other() {
    for option in [
        "--radius-mm",
        "--feed-mm-per-min",
        "--direction",
        "--revolutions",
        "--centre-x-mm",
        "--centre-y-mm",
        "--start-angle-deg",
    ] {
        let value = if option == "--direction" { "cw" } else { "1" };
        let (_, said, code) = run(&["circle", "--from", "circle.mcap", option, value]);
        assert_eq!(code, 2, "{said}");
        assert!(said.contains("cannot be used with") && said.contains(option), "{said}");
    }
}

#[test]
fn an_export_never_overwrites_a_file_least_of_all_its_own_log() {
    let folder = TempDir::new().unwrap();
    run(&with(&SHORT, &["--json", "--direction", "cw", "--out", text(folder.path())]));
    let log = only_log(folder.path());
    let bytes = fs::read(&log).unwrap();
    let (_, said, code) = run(&["log", text(&log), "--csv", text(&log)]);
    assert_eq!(code, 2, "{said}");
    assert!(said.contains(text(&log)) && said.contains("nothing is overwritten"), "{said}");
    assert!(fs::read(&log).unwrap() == bytes, "the log is as it was");

    let table = folder.path().join("cycles.csv");
    for expected in [0, 2] {
        let (_, said, code) = run(&["log", text(&log), "--csv", text(&table)]);
        assert_eq!(code, expected, "{said}");
    }
}
