//! Promise: `quadrant latency` shows where the time of the periods went, of any log and of this machine,
//! for people, for programs and as a picture.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use assert_cmd::Command;
use serde_json::Value;

fn quadrant(arguments: &[&str]) -> (i32, String, String) {
    let output = Command::cargo_bin("quadrant").unwrap().args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

#[test]
fn the_cycle_is_measured_here_and_now() {
    let (code, out, err) = quadrant(&["latency", "--seconds", "0.5", "--json"]);
    assert_eq!(code, 0, "{err}");
    let told: Value = serde_json::from_str(&out).unwrap();
    let cycles = told["cycles"].as_u64().unwrap();
    assert!(cycles > 100, "{cycles} cycles in half a second at 2 kHz");
    let names: Vec<&str> =
        told["shares"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["wake-up error", "collect", "control", "total"]);
    let us = |share: usize, key: &str| told["shares"][share][key].as_f64().unwrap();
    for share in 0..4 {
        assert!(us(share, "p50_us") > 0.0 && us(share, "p50_us") <= us(share, "max_us"), "{told}");
    }
    assert!(us(3, "p50_us") >= us(1, "p50_us"), "the total is less than a part of it: {told}");
}

#[test]
fn a_log_tells_the_same_and_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let [log, out, svg] = ["run.mcap", "out", "run.svg"].map(|name| folder.path().join(name));
    let [log, out, svg] = [&log, &out, &svg].map(|path| path.to_str().unwrap());
    let circle = ["circle", "--radius-mm", "5", "--direction", "cw", "--out", out, "--log", log];
    assert_eq!(quadrant(&circle).0, 0);
    let (code, text, err) = quadrant(&["latency", log, "--svg", svg]);
    assert_eq!(code, 0, "{err}");
    // In virtual time a cycle takes none: every share is in the first bin.
    assert!(text.contains("0.10 us") && text.contains("wake-up error"), "{text}");
    let drawn = std::fs::read_to_string(svg).unwrap();
    assert!(drawn.starts_with("<svg") && drawn.contains("period 500 us"), "{drawn}");
}
