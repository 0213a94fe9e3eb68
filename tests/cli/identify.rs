//! Promise: `quadrant identify` says what it will move, leaves a log whose header names machine and motions, and
//! finds what the controller does not know of the plant behind the boards.

use std::fs;
use std::path::Path;

use quadrant::log::Reader;
use tempfile::TempDir;

use crate::machine_file::machine_file;
use crate::tool::{run, text};

/// Travel of the machines, mm.
const TRAVEL_MM: [f64; 2] = [-8.0, 60.0];

#[test]
fn experiments_find_the_plant_that_the_machine_file_does_not_know() {
    let folder = TempDir::new().unwrap();
    let file = |name, edits: &[_]| text(&machine_file(folder.path(), name, TRAVEL_MM, edits)).to_owned();
    let machine = file("machine.toml", &[]);
    let plant = file("plant.toml", &[("mass-kg = 335.0", "mass-kg = 400.0")]);
    let [log, report] = ["run.mcap", "report"].map(|name| text(&folder.path().join(name)).to_owned());
    let words = [
        "identify",
        "--machine",
        &machine,
        "--plant",
        &plant,
        "--axes",
        "y",
        "--log-to",
        &log,
        "--report",
        &report,
        "--json",
    ];
    let (told, said, code) = run(&words);
    assert_eq!(code, 0, "{said}");
    assert!(said.contains("axis x stays where it stands") && said.contains("axis y moves between"), "{said}");
    let told = told.unwrap();
    let mass = &told["y"]["mass"];
    let kg = mass["value"].as_f64().unwrap();
    assert!((kg - 400.0).abs() < 20.0, "{mass}");
    let sliding = told["y"]["sliding"]["value"].as_f64().unwrap();
    assert!((sliding - 951.3).abs() < 5.0, "{sliding}");
    assert!(told["x"]["mass"]["value"].is_null(), "x was not excited");
    for file in
        ["frequency-y.svg", "frequency-y.png", "frequency-y.json", "friction-y.png", "identification.html"]
    {
        assert!(fs::metadata(Path::new(&report).join(file)).unwrap().len() > 1_000, "{file}");
    }

    let log = Reader::open(Path::new(&log)).unwrap();
    let header = log.header();
    assert!(header.machine_text.contains("mass-kg = 335.0"), "the machine file of the controller");
    assert_eq!(header.extra["plant"], plant);
    let purposes: Vec<&str> =
        header.motions.values().filter_map(|motion| motion["purpose"].as_str()).collect();
    for purpose in
        ["frequency-response", "inertia", "steady-friction", "break-away", "reversal", "positioning"]
    {
        assert!(purposes.contains(&purpose), "{purpose} is not in {purposes:?}");
    }
}

#[test]
fn what_cannot_be_run_is_refused_before_anything_moves() {
    let folder = TempDir::new().unwrap();
    let log = text(&folder.path().join("run.mcap")).to_owned();
    for (words, refusal) in [
        (&["--axes", "x,w"][..], "no axis \"w\" in machine reference; it has x, y"),
        (&["--gains", "stiff"], "gain set \"stiff\" is not in the machine file"),
        (&["--plant", "classic"], "machine reference has 2 every 500 us"),
        (&["--data", "run.csv"], "--columns"),
        (&["--bus", "can0", "--pace", "realtime"], "--yes says yes beforehand"),
        (&["--bus", "can0", "--plant", "paper"], "cannot be used with"),
    ] {
        let words = [&["identify", "--log-to", &log], words].concat();
        let (_, said, code) = run(&words);
        assert_eq!(code, 2, "{words:?}: {said}");
        assert!(said.contains(refusal), "{words:?}: {said}");
        assert!(!Path::new(&log).exists(), "{words:?} left a log");
    }
}
