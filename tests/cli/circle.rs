//! Promise: `quadrant circle` shows the circles of the paper, refuses what cannot be done by name, and loses nothing when it is stopped.

use std::fs;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, Stdio};
use std::time::{Duration, SystemTime};

use serde_json::Value;
use tempfile::TempDir;

use crate::tool::{SHORT, only_log, quadrant, run, text, with};

fn close(name: &str, value: &Value, expected: f64, bound: f64) {
    let got = value.as_f64().unwrap_or(f64::NAN);
    assert!((got - expected).abs() <= bound, "{name}: {got} um, expected {expected} +- {bound} um");
}

#[test]
fn the_paper_machine_shows_the_circles_of_the_paper() {
    for (gains, protrusion_um) in [("standard", 25.0), ("optimal", 12.2)] {
        let folder = TempDir::new().unwrap();
        let arguments =
            ["circle", "--machine", "paper", "--gains", gains, "--json", "--out", text(folder.path())];
        let (json, said, code) = run(&arguments);
        assert_eq!(code, 0, "{said}");
        let json = json.expect("JSON on standard output and nothing else");
        for quadrant in ["max", "x_plus", "y_plus", "x_minus", "y_minus"] {
            close(quadrant, &json["protrusion_um"]["motor"][quadrant], protrusion_um, 0.1);
            let table_um = json["protrusion_um"]["table"][quadrant].as_f64().unwrap();
            assert!(table_um > protrusion_um + 6.3, "wind-up adds to the table: {table_um} um");
        }
        close("radius decrease", &json["radius_decrease_um"], 50.0, 0.1);
        for key in ["machine", "gains", "direction", "radius_mm", "feed_mm_per_min", "log", "report"] {
            assert!(!json[key].is_null(), "{key} is missing");
        }
        assert_eq!((&json["overruns"], &json["lost_records"]), (&0.into(), &0.into()));
        assert!(json["cycles"].as_u64().unwrap() > 100_000);
        for key in ["circular_deviation_um", "bidirectional_circular_deviation_um"] {
            assert!(json[key].as_f64().unwrap() > protrusion_um, "{key}: {}", json[key]);
        }
        for file in ["circle.html", "circle.svg", "circle.png"] {
            assert!(fs::metadata(folder.path().join(file)).unwrap().len() > 10_000, "{file}");
        }
    }
}

#[test]
fn height_over_the_friction_free_response_and_over_the_arc_agree() {
    let folder = TempDir::new().unwrap();
    for feed in ["1000", "2000", "8000"] {
        let arguments = [
            "circle",
            "--feed-mm-per-min",
            feed,
            "--direction",
            "ccw",
            "--json",
            "--out",
            text(folder.path()),
        ];
        let json = run(&arguments).0.expect("JSON");
        assert!(json["bidirectional_circular_deviation_um"].is_null(), "one direction has no G(b)");
        for point in ["motor", "table"] {
            let protrusions = &json["detail"][point]["directions"][0]["protrusions"];
            assert_eq!(protrusions.as_array().map(Vec::len), Some(4));
            for protrusion in protrusions.as_array().unwrap() {
                let over_twin_um = protrusion["height_um"].as_f64().unwrap();
                let name = format!("height over the arc, {point}, {feed} mm/min");
                close(&name, &protrusion["height_over_arc_um"], over_twin_um, 0.1);
            }
        }
    }
}

#[test]
fn a_log_is_judged_like_the_run_it_came_from() {
    let folder = TempDir::new().unwrap();
    let out = ["--json", "--seed", "5", "--out", text(folder.path())];
    let (live, said, _) = run(&with(&SHORT, &out));
    let live = live.expect(&said);
    let log = only_log(folder.path());
    let (judged, said, code) = run(&["circle", "--from", text(&log), "--json"]);
    let judged = judged.expect(&said);
    assert_eq!(code, 0, "{said}");
    for key in ["protrusion_um", "radius_decrease_um", "circular_deviation_um", "machine", "gains", "seed"] {
        assert_eq!(live[key], judged[key], "{key}");
    }
}

#[test]
fn a_circle_of_a_degree_per_period_is_whole() {
    let folder = TempDir::new().unwrap();
    let small = ["--radius-mm", "1", "--feed-mm-per-min", "2000", "--json", "--out", text(folder.path())];
    let (json, said, code) = run(&[&["circle"][..], &small].concat());
    assert_eq!(code, 0, "{said}");
    let protrusion_um = json.unwrap()["protrusion_um"]["motor"]["max"].as_f64().unwrap();
    assert!((1.0..20.0).contains(&protrusion_um), "{protrusion_um} um");
}

#[test]
fn the_same_seed_gives_the_same_records_and_another_does_not() {
    let export = |seed: &str| {
        let folder = TempDir::new().unwrap();
        run(&with(&SHORT, &["--json", "--seed", seed, "--out", text(folder.path())]));
        let output = quadrant().args(["log", text(&only_log(folder.path())), "--csv", "-"]).output().unwrap();
        assert!(output.status.success());
        output.stdout
    };
    let (one, again, other) = (export("1"), export("1"), export("2"));
    assert!(one.len() > 1_000_000, "{} bytes of CSV", one.len());
    assert!(one == again, "the same seed gave other records");
    assert!(one != other, "another seed gave the same records");
}

#[test]
fn what_cannot_be_done_is_refused_with_key_value_bound_and_unit() {
    let folder = TempDir::new().unwrap();
    let out = text(folder.path());
    let cases: [(&[&str], &[&str]); 8] = [
        (&["circle", "--radius-mm", "260"], &["radius = 260 mm", "250 mm", "axis x", "travel-max-mm"]),
        (&["circle", "--centre-y-mm", "-120"], &["radius = 150 mm", "130 mm", "axis y"]),
        (
            &["circle", "--feed-mm-per-min", "20000"],
            &["feed = 20000 mm/min", "15000 mm/min", "velocity-mm-per-s"],
        ),
        (&["circle", "--radius-mm", "NaN"], &["radius", "NaN"]),
        (&["circle", "--radius-mm", "1", "--feed-mm-per-min", "9000"], &["acceleration", "5 m/s^2"]),
        (&["circle", "--gains", "best"], &["\"best\"", "standard, optimal"]),
        (&["circle", "--revolutions", "0"], &["revolutions = 0", "1 to 1000"]),
        (&["circle", "--machine", "nowhere.toml"], &["nowhere.toml", "No such file"]),
    ];
    for (arguments, expected) in cases {
        let (_, said, code) = run(&with(arguments, &["--out", out]));
        assert_eq!(code, 2, "{arguments:?}: {said}");
        for part in expected {
            assert!(said.contains(part), "{arguments:?} does not say `{part}`: {said}");
        }
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing was begun");
}

#[test]
fn a_machine_file_with_problems_is_shown_like_a_compiler_would() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("mine.toml");
    let reference = fs::read_to_string("firmware-config/machines/reference.toml").unwrap();
    fs::write(
        &file,
        reference.replace("mass-kg = 335.0", "mass-g = 335000").replace("node = 2", "node = 200"),
    )
    .unwrap();
    for verb in ["check", "circle"] {
        let arguments: &[&str] =
            if verb == "check" { &["check", text(&file)] } else { &["circle", "--machine", text(&file)] };
        let (_, said, code) = run(arguments);
        assert_eq!(code, 2, "{said}");
        for part in ["mine.toml:", "axis.x.mechanics.mass-kg", "`mass-kg` meant?", "axis.y.board.node", "200"]
        {
            assert!(said.contains(part), "{verb} does not say `{part}`:\n{said}");
        }
    }
}

#[test]
fn results_that_cannot_be_printed_are_an_error_and_a_closed_pipe_is_none() {
    for arguments in [&["check"][..], &["check", "--json"]] {
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let tool = || Process::new(assert_cmd::cargo::cargo_bin("quadrant"));
        let output = tool().args(arguments).stdout(full).stderr(Stdio::piped()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains("standard output") && said.contains("No space left"), "{said}");

        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = tool().args(arguments).stdout(writer).stderr(Stdio::piped()).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{arguments:?}");
        assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn a_full_disk_costs_the_log_and_nothing_else() {
    let folder = TempDir::new().unwrap();
    let out = ["--json", "--log", "/dev/full", "--out", text(folder.path())];
    let (json, said, code) = run(&with(&SHORT, &out));
    let json = json.expect(&said);
    assert_eq!(code, 1, "{said}");
    assert!(said.contains("/dev/full") && said.contains("No space left"), "{said}");
    assert!(said.contains("records are not in the log"), "{said}");
    assert_eq!(json["lost_records"], json["cycles"], "every record is lost, and counted");
    assert!(json["protrusion_um"]["motor"]["max"].as_f64().unwrap() > 5.0, "the test itself went on");
}

#[test]
fn a_folder_that_cannot_be_written_is_named_before_anything_moves() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "in the way").unwrap();
    let below = file.join("below");
    let (_, said, code) = run(&with(&SHORT, &["--out", text(&below)]));
    assert_eq!(code, 2);
    assert!(said.contains("cannot create the output folder") && said.contains(text(&below)), "{said}");
}

#[test]
fn a_report_that_cannot_be_written_leaves_the_numbers() {
    let folder = TempDir::new().unwrap();
    // A folder in the page's place refuses it for every user.
    fs::create_dir(folder.path().join("circle.html")).unwrap();
    let (json, said, code) = run(&with(&SHORT, &["--json", "--out", text(folder.path())]));
    assert_eq!(code, 1, "{said}");
    assert!(said.contains("cannot write circle.html"), "{said}");
    assert!(json.unwrap()["report"].is_null());
    only_log(folder.path());
}

#[test]
fn damaged_logs_are_refused_by_name_and_recovered() {
    let folder = TempDir::new().unwrap();
    run(&with(&SHORT, &["--json", "--direction", "cw", "--out", text(folder.path())]));
    let log = only_log(folder.path());
    let whole = run(&["log", text(&log), "--json"]).0.unwrap();
    let bytes = fs::read(&log).unwrap();

    let cut = folder.path().join("cut.mcap");
    fs::write(&cut, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let (json, said, code) = run(&["log", text(&cut), "--json"]);
    assert_eq!(code, 1, "{said}");
    assert!(said.contains("ends without its index"), "{said}");
    let json = json.unwrap();
    assert_eq!(json["is_truncated"], true);
    assert!(json["cycles"].as_u64() < whole["cycles"].as_u64());

    let corrupt = folder.path().join("corrupt.mcap");
    fs::write(&corrupt, &bytes).unwrap();
    let mut file = fs::File::options().write(true).open(&corrupt).unwrap();
    file.seek(SeekFrom::Start(bytes.len() as u64 / 2)).unwrap();
    // Longer than the index of a chunk, so that records are hit wherever it falls.
    file.write_all(&[0x5A; 64 << 10]).unwrap();
    let (_, said, code) = run(&["log", text(&corrupt)]);
    assert_eq!(code, 2, "{said}");
    assert!(said.contains("damaged at byte") && said.contains("--recover"), "{said}");
    let rescued = folder.path().join("rescued.mcap");
    let (json, said, code) = run(&["log", text(&corrupt), "--recover", text(&rescued), "--json"]);
    assert_eq!(code, 1, "{said}");
    let lost = json.unwrap()["records_lost"].as_u64().unwrap();
    assert!((1..5_000).contains(&lost), "{lost} records lost by 64 KiB");
    let again = run(&["log", text(&rescued), "--json"]).0.unwrap();
    assert_eq!(again["cycles"].as_u64().unwrap() + lost, whole["cycles"].as_u64().unwrap());

    let (_, said, code) = run(&["log", "Cargo.toml"]);
    assert_eq!(code, 2);
    assert!(said.contains("not a log of this project"), "{said}");
}

/// A machine that bears a busy desk: half a second without a command before its boards or its cycle
/// give up. These tests are about logs and stops, not about timing.
fn patient_machine(folder: &Path) -> PathBuf {
    let read = |file: &str| fs::read_to_string(Path::new("firmware-config").join(file)).unwrap();
    let sheet = read("encoder-board.toml").replace("value = 20_000", "value = 500_000");
    fs::write(folder.join("encoder-board.toml"), sheet).unwrap();
    let machine = read("machines/reference.toml")
        .replace("pause-cycles-max = 8 ", "pause-cycles-max = 900")
        .replace("overrun-misses-max = 60 ", "overrun-misses-max = 60000");
    let path = folder.join("patient.toml");
    fs::write(&path, machine).unwrap();
    path
}

/// A realtime circle that runs until it is stopped, and its folder.
fn start_realtime() -> (Child, TempDir) {
    let folder = TempDir::new().unwrap();
    let machine = patient_machine(folder.path());
    let child = Process::new(assert_cmd::cargo::cargo_bin("quadrant"))
        .args(["circle", "--pace", "realtime", "--machine", text(&machine), "--out", text(folder.path())])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_millis(2_500));
    (child, folder)
}

#[test]
fn a_killed_run_leaves_a_log_that_lacks_at_most_its_last_quarter_second() {
    let (mut child, folder) = start_realtime();
    let killed_at = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_secs_f64();
    child.kill().unwrap();
    child.wait().unwrap();
    let log = only_log(folder.path());
    let (json, said, code) = run(&["log", text(&log), "--json"]);
    assert_eq!(code, 1, "{said}");
    let json = json.unwrap();
    assert_eq!(json["is_truncated"], true);
    let kept_s = json["duration_s"].as_f64().unwrap();
    // The log's own start; RFC 3339 ends in seconds and a fraction.
    let started = json["started"].as_str().unwrap();
    let second_of_minute: f64 = started[17..started.len() - 1].parse().unwrap();
    let ran_s = (killed_at - second_of_minute).rem_euclid(60.0);
    assert!(kept_s > ran_s - 0.25, "{kept_s:.3} s in the log of {ran_s:.3} s");
    assert!(kept_s > 1.0, "{kept_s} s");
}

#[test]
fn an_interrupted_run_comes_to_rest_and_keeps_its_log() {
    let (child, folder) = start_realtime();
    let interrupted = Process::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(interrupted.success());
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("interrupted"), "{said}");
    let json = run(&["log", text(&only_log(folder.path())), "--json"]).0.unwrap();
    assert_eq!(json["is_truncated"], false, "the log is complete");
    for axis in json["axes"].as_array().unwrap().iter().filter(|axis| axis.is_object()) {
        assert!(axis["cycles_by_mode"]["stopping"].as_u64() > Some(0), "{axis}");
    }
}

#[test]
fn the_daemon_holds_the_axes_and_ends_at_rest() {
    let folder = TempDir::new().unwrap();
    let daemon = assert_cmd::cargo::cargo_bin("quadrantd");
    let child = Process::new(daemon)
        .args(["--hold", "--machine", text(&patient_machine(folder.path())), "--logs", text(folder.path())])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_millis(1_500));
    Process::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
    let json = run(&["log", text(&only_log(folder.path())), "--json"]).0.unwrap();
    assert_eq!(json["is_truncated"], false);
    assert_eq!(json["faults"].as_array().map(Vec::len), Some(0), "{said}");
    let modes = &json["axes"].as_array().unwrap().last().unwrap()["cycles_by_mode"];
    assert!(modes["ready"].as_u64() > Some(500) && modes["off"].as_u64() > Some(0), "{modes}");
}
