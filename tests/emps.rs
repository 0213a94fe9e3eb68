//! Promise: on the published record of a real ball-screw axis (EMPS: Janot, Gautier, Brunot 2019), the
//! identification finds what its authors found, and a simulation of the axis it found follows the record as
//! closely as theirs. The record is not part of this project: `QUADRANT_DATA` names the folder it is in.

use std::fs::File;
use std::io::Write;
use std::path::PathBuf;

use quadrant::offline::identify::foreign::Foreign;
use quadrant::offline::identify::rigid::{self, RigidFit, Shape};

const COLUMNS: &str = include_str!("data/emps-columns.toml");

/// The file of the record, or `None`, said loudly, where the machine does not have it.
fn path() -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("QUADRANT_DATA") else {
        // Past the capture of the test harness.
        let said = "SKIPPED: QUADRANT_DATA does not name the folder that has the record emps/emps_train.csv";
        let _unheard = writeln!(std::io::stderr(), "{said}");
        return None;
    };
    Some(PathBuf::from(folder).join("emps/emps_train.csv"))
}

fn record() -> Option<Foreign> {
    let path = path()?;
    let data = File::open(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    Some(Foreign::read(COLUMNS, data).expect("the map fits the record"))
}

fn fitted(record: &Foreign, shape: Shape) -> RigidFit {
    rigid::fit(&record.axes["carriage"], record.period_s, shape).expect("the record tells the axis")
}

#[test]
fn the_published_axis_is_found() {
    let Some(record) = record() else { return };
    let fit = fitted(&record, Shape::Symmetric);
    let findings = fit.findings("emps");
    for (name, published, digit) in [
        ("mass", 95.109, 0.1),
        ("viscous_friction", 203.50, 0.1),
        ("coulomb_friction", 20.394, 0.1),
        ("constant_force", -3.165, 0.1),
    ] {
        let found = findings[name].estimate().expect("found");
        eprintln!("{name}: {found:?}, published {published}");
        assert!((found.value - published).abs() <= digit, "{name}: {} against {published}", found.value);
        let [low, high] = found.ci95;
        assert!((low..=high).contains(&published), "{name}: {published} outside {low} to {high}");
    }
    eprintln!("relative force error {}", fit.relative_error);
    assert!(fit.relative_error <= 0.041, "{}", fit.relative_error);
}

#[test]
fn the_asymmetric_axis_is_found() {
    let Some(record) = record() else { return };
    let fit = fitted(&record, Shape::Asymmetric);
    let findings = fit.findings("emps");
    eprintln!("{findings:#?} {}", fit.relative_error);
    for (name, published) in [
        ("viscous_friction_forwards", 166.71),
        ("coulomb_friction_forwards", 20.14),
        ("viscous_friction_backwards", 240.42),
        ("coulomb_friction_backwards", 20.63),
    ] {
        let [low, high] = findings[name].estimate().expect("found").ci95;
        assert!((low..=high).contains(&published), "{name}: {published} outside {low} to {high}");
    }
    assert!(fit.relative_error <= 0.032, "{}", fit.relative_error);
}

#[test]
fn a_simulation_of_what_was_found_follows_the_record() {
    let Some(record) = record() else { return };
    let axis = &record.axes["carriage"];
    let closed = fitted(&record, Shape::Asymmetric).closed_loop(axis, record.period_s).expect("a controller");
    eprintln!("{closed:?}");
    assert!(closed.position <= 138e-6, "{closed:?}");
    assert!(closed.velocity <= 229e-5, "{closed:?}");
    assert!(closed.force <= 585e-4, "{closed:?}");
}

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn what_an_even_friction_lacks_is_named_and_closes_the_gap() {
    let Some(path) = path() else { return };
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data");
    let mut command = assert_cmd::Command::cargo_bin("quadrant").expect("the tool");
    command.current_dir(data).args(["gap", "--json", "--machine", "emps-machine.toml"]);
    let output =
        command.args(["--columns", "emps-gap-columns.toml", "--data"]).arg(path).output().expect("an answer");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one object");
    eprintln!("{}\n{}", said["effects"], said["gap"]);
    let named: Vec<&str> = said["effects"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|effect| effect["name"].as_str())
        .collect();
    // No log tells one from the other, so both are said.
    assert!(named.contains(&"direction-asymmetry") && named.contains(&"constant-force"), "{named:?}");
    let once_a_turn = ["encoder-eccentricity", "screw-ripple", "motor-cogging"];
    assert!(named.iter().any(|name| once_a_turn.contains(name)), "no ripple of a turn: {named:?}");
    let um = |when: &str| said["gap"][when]["x.following_error_um"].as_f64().expect("a number");
    let (before, after) = (um("before"), um("after"));
    // What a careful replay of this record came to.
    assert!(after <= 1.6 && after < 0.5 * before, "{after} um, {before} um before");
    let closed = said["gap"]["heldout_closed_fraction"].as_f64().expect("a share");
    assert!(closed > 0.75, "{closed} of the gap on rows that were not fitted");
}
