//! Promise: an effect that stands in a machine file is in every simulation of the machine, as its equation says.
//! Each key of the catalogue goes through a file and back and is refused outside its bounds; in a circular test
//! of two axes, effects that have a closed form show it, and one reversal as tuning runs it has what the whole circle
//! has; and `docs/effects.md` is the catalogue.
#![cfg(feature = "offline")]

#[expect(dead_code, reason = "a test uses the part it needs")]
mod common;

use std::f64::consts::{FRAC_PI_4, TAU};
use std::fmt::Write as _;
use std::sync::Arc;

use quadrant::base::axis::AxisId;
use quadrant::base::motion::{Circle, Direction};
use quadrant::base::record::CycleRecord;
use quadrant::base::units::{Acceleration, Position, Velocity};
use quadrant::config::{self, Machine};
use quadrant::offline::tune::whole::circular_test;
use quadrant::offline::tune::window::{Path, Window};
use quadrant::plant::effects::{CATALOGUE, Entry, Values};
use quadrant::rt::control::profile::CircleMotion;

const SEED: u64 = 7;
const HEADER: &str = "[axis.x.velocity-loop]";

/// The text of a machine with an effect on its first axis.
fn text_with(entry: &Entry, values: &Values, more: &str) -> String {
    let (_, text) = config::EMBEDDED[0];
    let mut section = format!("[axis.x.effects.{}]\n", entry.name);
    for (parameter, value) in entry.parameters.iter().zip(values) {
        writeln!(section, "{} = {value:?}", parameter.key).expect("a string takes all");
    }
    text.replacen(HEADER, &format!("{section}{more}\n{HEADER}"), 1)
}

fn read(text: &str) -> Result<Machine, String> {
    config::from_texts("a test", text, &Default::default()).map_err(|problems| problems.render(false))
}

fn machine_with(name: &str, values: Values) -> Machine {
    let entry = quadrant::plant::effects::entry(name).expect("an effect of the catalogue");
    read(&text_with(entry, &values, "")).unwrap_or_else(|problems| panic!("{problems}"))
}

#[test]
fn every_key_goes_through_a_machine_file() {
    let base = common::machine("reference").axes[AxisId::X].plant;
    for entry in CATALOGUE {
        let origin = "source = \"two circles\"\ndate = \"2026-11-21\"\ncommit = \"4f1c2d3\"";
        let around = entry.nominal()[0];
        let key = entry.parameters[0].key;
        let interval = format!("{origin}\n{key}-ci95 = [{:?}, {:?}]", around - 1.5, around + 2.0);
        let machine = read(&text_with(entry, &entry.nominal(), &interval))
            .unwrap_or_else(|problems| panic!("{problems}"));
        let axis = &machine.axes[AxisId::X];
        assert_eq!(axis.plant, base.with_effect(entry, entry.nominal()), "{}", entry.name);
        assert_ne!(axis.plant, base, "{} is not in the axis", entry.name);
        // The control knows of an effect only what is a parameter of its own.
        assert_eq!(axis.control.axis, axis.plant.without_effects(), "{}", entry.name);
        assert_eq!(machine.axes[AxisId::Y].plant, base, "{} is in the other axis too", entry.name);
    }
}

#[test]
fn what_is_out_of_bounds_is_refused_with_all_that_helps() {
    for entry in CATALOGUE {
        for (index, parameter) in entry.parameters.iter().enumerate() {
            let [least, most] = parameter.bounds;
            let step = 1e-3 * (most - least);
            for (value, is_right) in
                [(least, true), (most, true), (least - step, false), (most + step, false)]
            {
                let mut values = entry.nominal();
                values[index] = value;
                // What takes too long for the cycle is refused by another rule.
                if entry.name == "actuator-delay" && value == most {
                    continue;
                }
                match read(&text_with(entry, &values, "")) {
                    Ok(_) => assert!(is_right, "{}: {} = {value} passes", entry.name, parameter.key),
                    Err(said) => {
                        assert!(!is_right, "{said}");
                        let key = format!("axis.x.effects.{}.{}", entry.name, parameter.key);
                        let range = format!("allowed is a number from {least} to {most} {}", parameter.unit);
                        for part in [key.as_str(), range.trim_end(), &format!("{value} {}", parameter.unit)] {
                            assert!(said.contains(part.trim_end()), "{said}\nlacks {part:?}");
                        }
                    }
                }
            }
        }
    }
    let entry = &CATALOGUE[0];
    for (more, part) in [
        ("made-up = 1.0", "unknown key"),
        ("viscous-n-s-per-mm-ci95 = [3.0, 4.0]", "does not contain the value"),
        ("viscous-n-s-per-mm-ci95 = 3.0", "wanted is [low, high]"),
        ("date = 2026", "wanted is a text"),
    ] {
        let said = read(&text_with(entry, &entry.nominal(), more)).expect_err("a wrong file");
        assert!(said.contains(part), "{said}\nlacks {part:?}");
    }
    let said = read(&text_with(entry, &entry.nominal(), "").replace("viscous-friction", "viscous-frction"));
    assert!(said.expect_err("a wrong name").contains("is `viscous-friction` meant?"));
}

const RADIUS_MM: f64 = 20.0;

fn circle(direction: Direction, feed_mm_per_min: f64) -> CircleMotion {
    CircleMotion {
        circle: Circle {
            centre_x: Position::ZERO,
            centre_y: Position::ZERO,
            radius: Position::mm(RADIUS_MM),
            feed: Velocity::mm_per_min(feed_mm_per_min),
            direction,
            start_angle_rad: FRAC_PI_4,
            revolutions: 1,
        },
        run_in_s: 1.0,
        run_out_s: 0.1,
        acceleration: Acceleration::m_per_s2(0.5),
    }
}

/// What the table scales show of a circle without friction, cycle by cycle, mm.
fn tables(machine: &Machine, direction: Direction) -> Vec<[f64; 2]> {
    let records = common::run_circles(
        &machine.clone().without_friction(),
        "standard",
        &[circle(direction, 3_000.0)],
        SEED,
    );
    let table = |record: &CycleRecord, axis| record.axes[axis].sample.table_position.as_mm();
    let measured = records.iter().filter(|record| record.stage.is_measured);
    measured.map(|record| [table(record, AxisId::X), table(record, AxisId::Y)]).collect()
}

/// What an effect of axis X does to the radius of a circle, both ways round, beside what is expected of it.
struct Held {
    /// Measured per expected.
    gain: f64,
    /// Farthest from what is expected, um.
    off_um: f64,
    /// Farthest it moves the circle, um.
    all_um: f64,
}

/// Holds an effect against what is expected at an angle and a radius, mm, of the circle without it, um.
fn held(name: &str, values: Values, expected_um: impl Fn(f64, f64) -> f64) -> Held {
    let (mut off_um, mut all_um) = (0.0_f64, 0.0_f64);
    let (mut product, mut square) = (0.0, 0.0);
    for direction in [Direction::Ccw, Direction::Cw] {
        let base = tables(&common::machine("reference"), direction);
        let with = tables(&machine_with(name, values), direction);
        assert_eq!(base.len(), with.len());
        for ([x0, y0], [x1, y1]) in base.into_iter().zip(with) {
            let (angle, radius_mm) = (y0.atan2(x0), x0.hypot(y0));
            let outwards_um = 1e3 * (x1.hypot(y1) - radius_mm);
            let expected_um = expected_um(angle, radius_mm);
            off_um = off_um.max((outwards_um - expected_um).abs());
            all_um = all_um.max(outwards_um.abs());
            product += outwards_um * expected_um;
            square += expected_um * expected_um;
        }
    }
    Held { gain: product / square, off_um, all_um }
}

#[test]
fn on_a_circle_effects_look_as_their_closed_forms_say() {
    type Form = fn(f64, f64) -> f64;
    let forms: [(&str, Values, Form); 6] = [
        // (b R / 2) sin 2θ, the same both ways.
        ("squareness", [100.0, 0.0, 0.0], |angle, radius_mm| 0.1 * radius_mm / 2.0 * (2.0 * angle).sin()),
        // R e cos² θ.
        ("scale-error", [100.0, 0.0, 0.0], |angle, radius_mm| 0.1 * radius_mm * angle.cos().powi(2)),
        // The screw of the other axis accelerates its table: -M ω² R sin θ at 2.5 rad/s.
        ("cross-coupling", [100.0, 0.0, 0.0], |angle, radius_mm| {
            -100.0 * 1e-6 * 335.0 * 2.5_f64.powi(2) * radius_mm * angle.sin() * angle.cos()
        }),
        // A cos θ sin(2π R cos θ / p + φ); the axis calls zero what the scale shows at the start.
        ("pitch-error", [3.0, 8.0, 30.0], |angle, radius_mm| {
            let (turn, start) = (TAU * radius_mm * angle.cos() / 8.0, 30_f64.to_radians());
            3.0 * angle.cos() * ((turn + start).sin() - start.sin())
        }),
        // In two seconds next to nothing of an hour.
        ("thermal-growth", [1_000.0, 36_000.0, 0.0], |_, _| 0.0),
        // The loop makes what is shown go straight, so motor and table swing the other way.
        ("encoder-eccentricity", [3.0, 30.0, 0.0], |angle, radius_mm| {
            let (turn, start) = (TAU * radius_mm * angle.cos() / 10.0, 30_f64.to_radians());
            -3.0 * angle.cos() * ((turn + start).sin() - start.sin())
        }),
    ];
    for (name, values, form) in forms {
        let Held { gain, off_um, all_um } = held(name, values, form);
        println!("{name}: {gain:.5} times what is expected, {off_um:.4} um off it, of {all_um:.4} um");
        // Counts of 0.01 um, on both axes and in both runs. What swings fast the loop does not follow all the way, and
        // the force of a screw has the stairs of the position loop.
        let bound_um = if ["encoder-eccentricity", "cross-coupling"].contains(&name) { 0.1 } else { 0.03 };
        assert!(off_um < bound_um, "{name}: off by {off_um} um, bound {bound_um} um");
        if name != "thermal-growth" {
            assert!((gain - 1.0).abs() < 0.01, "{name}: {gain} times what is expected");
            assert!(all_um > 0.9, "{name}: {all_um} um in all");
        }
    }
}

/// Both axes of the paper's machine with an effect, and the protrusion that the whole circle and one reversal as
/// tuning runs it have of it, um.
fn protrusions(effect: Option<(&str, Values)>) -> [f64; 2] {
    let mut machine = common::machine("paper");
    for (_, axis) in machine.axes.iter_mut() {
        if let Some((name, values)) = effect {
            let entry = quadrant::plant::effects::entry(name).expect("an effect of the catalogue");
            axis.plant = axis.plant.with_effect(entry, values);
        }
    }
    let path = Path { radius: Position::mm(RADIUS_MM), feed: Velocity::mm_per_min(1_000.0) };
    let gains = machine.axes.map(|id, _| *machine.gains(id, 0));
    let whole =
        circular_test(&machine, &gains, &path, SEED, &Arc::default()).expect("the circle comes to its end");
    let window = Window::new(&machine, &machine.axes[AxisId::X], path, 0.0).run(&gains[AxisId::X]);
    [whole.motor.protrusion_um.max, window.height_um]
}

#[test]
fn tuning_sees_the_effects_that_the_whole_circle_has() {
    let [bare_um, _] = protrusions(None);
    let effects: [(&str, Values); 3] = [
        ("stribeck", [150.0, 4.0, 2.0]),
        // At its most where the axes turn back, two turns of the screw from the centre.
        ("screw-ripple", [20.0, 1.0, 90.0]),
        ("presliding", [8.0, 0.0, 0.0]),
    ];
    for (name, values) in effects {
        let [whole_um, window_um] = protrusions(Some((name, values)));
        println!("{name}: {whole_um:.3} um, in one reversal {window_um:.3} um; without {bare_um:.3} um");
        assert!((whole_um - bare_um).abs() > 0.5, "{name}: {whole_um} um, without {bare_um} um");
        assert!((window_um - whole_um).abs() < 0.05, "{name}: {window_um} um, on the circle {whole_um} um");
    }
}

/// The catalogue as `docs/effects.md` has it.
fn table() -> String {
    let mut text = String::from(
        "| effect | what it is | equation | keys, bounds, usual value | a shape over | shown by |\n|---|---|---|---|---|---|\n",
    );
    for entry in CATALOGUE {
        let keys: Vec<String> = entry
            .parameters
            .iter()
            .map(|parameter| {
                let [least, most] = parameter.bounds;
                format!("`{}` {least} to {most}: {}", parameter.key, parameter.nominal)
            })
            .collect();
        let alias = match entry.aliases {
            [] => String::new(),
            aliases => format!("; not told from {}", aliases.join(", ")),
        };
        writeln!(
            text,
            "| `{}` | {}{} | `{}` | {} | {} | {} |",
            entry.name,
            entry.summary,
            alias,
            entry.equation.replace('|', "\\|"),
            keys.join("<br>"),
            entry.coordinate,
            entry.experiment
        )
        .expect("a string takes all");
    }
    text
}

#[test]
fn the_page_of_effects_is_the_catalogue() {
    let page = include_str!("../docs/effects.md");
    let (_, rest) = page.split_once("<!-- catalogue -->\n").expect("the mark before the table");
    let (written, _) = rest.split_once("<!-- /catalogue -->").expect("the mark behind the table");
    assert!(written == table(), "docs/effects.md has another table than the catalogue:\n{}", table());
}
