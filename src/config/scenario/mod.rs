//! A scenario: what a simulated machine is put through, and what must come of it, as one TOML text.
//!
//! ```text
//!   name, shows, machine, seed
//!   [motion]    a circle with the keys of `quadrant circle`, or a hold
//!   [[fault]]   any number: kind, axis, at-s, for-s and what the kind has beside (faults.rs)
//!   [expect]    how it ends, and bounds of what is measured on the way
//! ```
//!
//! Read like a machine file: every problem at once, each at its place.
//! Invariant: a scenario that was read can be run; what it expects is stated, nothing is assumed.

mod faults;

use std::path::Path;

use super::machine::AXIS_NAMES;
use super::plan::CircleRequest;
use super::problem::FileProblems;
use super::reader::{Notes, Section, parse};
use super::{LoadError, Machine, load};
use crate::base::axis::AxisId;
use crate::base::fault::Fault;
use crate::base::motion::{Circle, Direction};
use crate::base::time::Span;
use crate::base::units::{Position, Velocity};
use crate::rt::cycle::procedure::CircleTest;
use crate::sim::script::Script;

/// Longest hold, s.
const HOLD_S_MAX: f64 = 600.0;
/// Most cycles that a bound can allow.
const CYCLES_MAX: i64 = 1_000_000;

/// A checked scenario.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// What it calls itself.
    pub name: String,
    /// What it shows, in a sentence.
    pub shows: String,
    /// The machine it is about.
    pub machine: Machine,
    /// What the axes do meanwhile.
    pub motion: Motion,
    /// What goes wrong; its seed is the machine's too.
    pub script: Script,
    /// What must come of it.
    pub expect: Expectations,
}

/// What the axes do.
#[derive(Clone, Debug)]
pub enum Motion {
    /// A circular test.
    Circle {
        /// As asked for.
        request: CircleRequest,
        /// As it is run.
        test: Box<CircleTest>,
    },
    /// They hold their position, and come to rest after this time.
    Hold(Span),
}

impl Motion {
    /// How long it takes; enabling and settling come on top.
    pub fn duration(&self) -> Span {
        match self {
            Self::Circle { test, .. } => Span::s(test.duration_s()),
            Self::Hold(lasts) => *lasts,
        }
    }
}

/// How a run must end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExpectedEnding {
    /// The motion was carried out.
    Complete,
    /// A fault stopped it.
    Faulted {
        /// Which.
        fault: Fault,
        /// The axis that has it; `None`: every axis has it as its own.
        axis: Option<AxisId>,
    },
    /// The boards were refused; nothing was enabled.
    Refused,
}

/// What must come of a scenario. Bounds that are absent are not judged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectations {
    /// How it ends.
    pub ending: ExpectedEnding,
    /// Cycles from the first fault until the drives of axes with a fault of their own give no current.
    pub own_current_zero_within_cycles: Option<u64>,
    /// Cycles from the first fault until no drive gives current, at most.
    pub current_zero_within_cycles: Option<u64>,
    /// Cycles from the first fault until every motor and table stands, at most.
    pub rest_within_cycles: Option<u64>,
    /// Largest error of a position that control acted on.
    pub position_error_max: Option<Position>,
    /// Largest distance from the path of the setpoints after the first fault.
    pub path_error_max: Option<Position>,
    /// Highest protrusion at the motor encoders: from, to.
    pub protrusion: Option<(Position, Position)>,
}

/// The scenario of a file.
pub fn load_scenario(path: &Path) -> Result<Scenario, LoadError> {
    let text = std::fs::read_to_string(path)
        .map_err(|cause| LoadError::NoScenario { path: path.to_owned(), cause })?;
    Ok(from_text(&path.display().to_string(), &text)?)
}

/// The scenario of a text.
pub fn from_text(source: &str, text: &str) -> Result<Scenario, Box<FileProblems>> {
    let table = parse(source, text).map_err(Box::new)?;
    let notes = Notes::default();
    let root = Section::root(&table, &notes);
    let name = root.text("name");
    let shows = root.text("shows");
    for (key, text) in [("name", &name), ("shows", &shows)] {
        if text.trim().is_empty() {
            root.conflict(key, &[], "is empty", "wanted are words");
        }
    }
    let machine = machine(&root);
    let seed = root.whole("seed", 0..=i64::MAX, "") as u64;
    let motion = motion(&root, machine.as_ref());
    let expect = expectations(root.section("expect"), &motion);
    let faults = faults::read(&root, machine.as_ref(), motion.as_ref().map(Motion::duration));
    root.close();
    // Where either is missing there is a problem, and nothing leaves here.
    let read = machine.zip(motion).map(|(machine, motion)| Scenario {
        name,
        shows,
        machine,
        motion,
        script: Script { seed, faults },
        expect,
    });
    match notes.into_result(source, text, read).map_err(Box::new)? {
        Some(scenario) => Ok(scenario),
        None => unreachable!("what is missing was noted"),
    }
}

fn machine(root: &Section<'_>) -> Option<Machine> {
    let name = root.text("machine");
    if name.is_empty() {
        root.conflict("machine", &[], "is empty", "wanted is an embedded machine or a file");
        return None;
    }
    let problem = |text: String| root.conflict("machine", &[], format!("no machine {name:?}"), text);
    load(&name).map_err(|error| problem(error.to_string().replace('\n', "; "))).ok()
}

fn motion(root: &Section<'_>, machine: Option<&Machine>) -> Option<Motion> {
    let section = root.section("motion");
    if section.choice("kind", &[("circle", false), ("hold", true)]) {
        let lasts = Span::s(section.number("for-s", 0.01..=HOLD_S_MAX, "s"));
        section.close();
        return Some(Motion::Hold(lasts));
    }
    let request = circle(section);
    match machine?.circle_test(&request) {
        Ok(test) => Some(Motion::Circle { request, test: Box::new(test) }),
        Err(error) => {
            root.conflict("motion", &["machine"], "cannot be run on the machine", error.to_string());
            None
        }
    }
}

fn circle(section: Section<'_>) -> CircleRequest {
    let mm = |key: &str, range| Position::mm(section.number(key, range, "mm"));
    let directions: &[Direction] = section.choice(
        "direction",
        &[
            ("ccw", &[Direction::Ccw][..]),
            ("cw", &[Direction::Cw]),
            ("both", &[Direction::Ccw, Direction::Cw]),
        ],
    );
    let request = CircleRequest {
        gains: section.text("gains"),
        circle: Circle {
            centre_x: mm("centre-x-mm", -1e5..=1e5),
            centre_y: mm("centre-y-mm", -1e5..=1e5),
            radius: mm("radius-mm", 0.01..=1e5),
            feed: Velocity::mm_per_min(section.number("feed-mm-per-min", 1.0..=1e6, "mm/min")),
            direction: directions[0],
            start_angle_rad: section.number("start-angle-deg", -360.0..=360.0, "deg").to_radians(),
            revolutions: section.whole("revolutions", 1..=1_000, "turns") as u32,
        },
        directions: directions.to_vec(),
    };
    section.close();
    request
}

fn expectations(section: Section<'_>, motion: &Option<Motion>) -> Expectations {
    #[derive(Clone, Copy)]
    enum Word {
        Complete,
        Faulted,
        Refused,
    }
    let words = [("complete", Word::Complete), ("faulted", Word::Faulted), ("refused", Word::Refused)];
    let ending = match section.choice("ending", &words) {
        Word::Complete => ExpectedEnding::Complete,
        Word::Faulted => ExpectedEnding::Faulted {
            fault: section.choice("fault", &Fault::ALL.map(|fault| (fault.name(), fault))),
            axis: axis(&section, "axis"),
        },
        Word::Refused => ExpectedEnding::Refused,
    };
    let cycles =
        |key: &str| section.optional_whole(key, 0..=CYCLES_MAX, "cycles").map(|cycles| cycles as u64);
    let um = |key: &str| section.optional_number(key, 0.0..=1e6, "um").map(Position::um);
    let is_circle = matches!(motion, Some(Motion::Circle { .. }) | None);
    let has_protrusion = ending == ExpectedEnding::Complete && is_circle;
    let expect = Expectations {
        ending,
        own_current_zero_within_cycles: cycles("own-current-zero-within-cycles"),
        current_zero_within_cycles: cycles("current-zero-within-cycles"),
        rest_within_cycles: cycles("rest-within-cycles"),
        position_error_max: um("position-error-max-um"),
        path_error_max: um("path-error-max-um"),
        protrusion: if has_protrusion { protrusion(&section) } else { None },
    };
    section.close();
    expect
}

fn protrusion(section: &Section<'_>) -> Option<(Position, Position)> {
    let bounds = section.optional_section("protrusion-um")?;
    let [low, high] = ["min", "max"].map(|key| bounds.number(key, -1e6..=1e6, "um"));
    if low > high {
        bounds.conflict(
            "max",
            &["min"],
            format!("{high} um is below min"),
            format!("allowed is {low} um or more"),
        );
    }
    bounds.close();
    Some((Position::um(low), Position::um(high)))
}

/// An axis by name, or all of them.
fn axis(section: &Section<'_>, key: &str) -> Option<AxisId> {
    let names = AXIS_NAMES.iter().enumerate().map(|(index, name)| (*name, Some(AxisId::new(index))));
    let choices: Vec<_> = names.chain([("all", None)]).collect();
    section.choice(key, &choices)
}
