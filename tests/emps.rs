//! Promise: on the published record of a real ball-screw axis (EMPS: Janot, Gautier, Brunot 2019), the
//! identification finds what its authors found, and a simulation of the axis it found follows the record as
//! closely as theirs. The record is not part of this project: `QUADRANT_DATA` names the folder it is in.

use std::fs::File;
use std::io::Write;
use std::path::PathBuf;

use quadrant::offline::identify::foreign::Foreign;
use quadrant::offline::identify::rigid::{self, RigidFit, Shape};

const COLUMNS: &str = include_str!("data/emps-columns.toml");

/// The record, or `None`, said loudly, where the machine does not have it.
fn record() -> Option<Foreign> {
    let Some(folder) = std::env::var_os("QUADRANT_DATA") else {
        // Past the capture of the test harness.
        let said = "SKIPPED: QUADRANT_DATA does not name the folder that has the record emps/emps_train.csv";
        let _unheard = writeln!(std::io::stderr(), "{said}");
        return None;
    };
    let path = PathBuf::from(folder).join("emps/emps_train.csv");
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
