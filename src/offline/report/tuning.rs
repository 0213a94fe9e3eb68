//! The page of a tuning: before and after, what holds the gains where they are, the map, the circles, the loop.
//!
//! Invariant: everything drawn is of the request and the gains that are printed beside it.

use std::fs;
use std::path::{Path, PathBuf};

use maud::{PreEscaped, html};

use super::page::whole;
use super::{PNG_SCALE, ReportError, put};
use crate::config::Machine;
use crate::offline::circle::CircularTest;
use crate::offline::draw::{map, png, polar, tuning};
use crate::offline::loops::Loops;
use crate::offline::tune::map::Map;
use crate::offline::tune::{Goal, Judged, Objective, Request, Tuned};

/// Values of `V_p` and of `V_i` in the map.
const STEPS: usize = 37;
/// Frequencies in the picture of the loop, and the last of them in multiples of the crossover.
const FREQUENCIES: u32 = 600;
const CROSSOVERS: f64 = 6.0;

/// What the page shows.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// Tuned for.
    pub machine: &'a Machine,
    /// Asked for.
    pub request: &'a Request,
    /// The gains before.
    pub before: &'a Judged,
    /// What was found.
    pub tuned: &'a Tuned,
    /// The whole circle, before and after.
    pub circles: &'a [CircularTest; 2],
}

/// Where the files are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TuningFiles {
    /// The page.
    pub html: PathBuf,
    /// Each drawing, as drawing and as picture.
    pub drawings: Vec<[PathBuf; 2]>,
}

/// Writes `tuning.html`, and `map`, `circle-before`, `circle-after`, `loop` and with two objectives `front` as
/// `.svg` and `.png`, into a folder, which is made if need be. `rows` are name, before and after of each figure,
/// `sentences` what holds the gains and what is open.
///
/// # Errors
/// When the folder cannot be made or written to; no half-written file is left behind.
pub fn write(
    folder: &Path,
    shown: &Shown<'_>,
    rows: &[[String; 3]],
    sentences: &[String],
) -> Result<TuningFiles, ReportError> {
    fs::create_dir_all(folder).map_err(|cause| ReportError::Folder { folder: folder.to_owned(), cause })?;
    let drawn = drawn(shown);
    let mut drawings = Vec::new();
    for (name, svg) in &drawn {
        let picture = png::render(svg, PNG_SCALE)?;
        let svg = put(folder, &format!("{name}.svg"), svg.as_bytes())?;
        drawings.push([svg, put(folder, &format!("{name}.png"), &picture)?]);
    }
    let page = page(shown, &drawn, rows, sentences);
    Ok(TuningFiles { html: put(folder, "tuning.html", page.as_bytes())?, drawings })
}

fn labels(request: &Request) -> Vec<&'static str> {
    match &request.goal {
        Goal::Paper(_) => vec!["1 / (a V_p (1 + b V_i))"],
        Goal::Machine { objectives, .. } => {
            objectives.iter().map(|objective: &Objective| objective.label()).collect()
        }
    }
}

fn drawn(shown: &Shown<'_>) -> Vec<(&'static str, String)> {
    let Shown { machine, request, before, tuned, circles } = shown;
    let after = &tuned.best;
    let labels = labels(request);
    let around = |one: f64, other: f64| [0.5 * one.min(other), 2.0 * one.max(other)];
    let ends = [around(before.choice.v_p, after.choice.v_p), around(before.choice.v_i, after.choice.v_i)];
    let found = Map::everywhere(machine, request, after.choice, ends, STEPS);
    let title = format!("What gains are worth · {}", machine.name);
    let mut drawn = vec![("map", map::draw(&found, &before.choice, &after.choice, &title, labels[0]))];
    for (name, when, test) in
        [("circle-before", "before", &circles[0]), ("circle-after", "after", &circles[1])]
    {
        let title = format!("Circle {when} · R {} mm · {:.0} mm/min", test.radius_mm, test.feed_mm_per_min);
        drawn.push((name, polar::draw(test, &title)));
    }
    let allowed = request.requirements.sensitivity_max;
    let curves = [before, after].map(|judged| amplification(machine, judged, after.figures.crossover_hz));
    drawn.push(("loop", tuning::sensitivity("Velocity loop at its real delays, axis x", curves, allowed)));
    if let [first, second] = labels[..] {
        let points: Vec<[f64; 2]> =
            tuned.front.iter().map(|judged| [judged.objectives[0], judged.objectives[1]]).collect();
        let given = [before.objectives[0], before.objectives[1]];
        let given = given.iter().all(|value| value.is_finite()).then_some(given);
        drawn.push(("front", tuning::front("Front of the objectives", [first, second], &points, given)));
    }
    drawn
}

/// `|1 / (1 + L)|` of the velocity loop of the first axis, over the frequency in Hz.
fn amplification(machine: &Machine, judged: &Judged, crossover_hz: f64) -> Vec<[f64; 2]> {
    let axis = &machine.axes.as_slice()[0];
    let gains = judged.choice.gains(axis);
    let loops = Loops::with_gains(machine, axis, &gains);
    let highest_hz = (CROSSOVERS * crossover_hz).min(0.5 / machine.cycle.period.as_s());
    let point = |step: u32| {
        let hz = highest_hz * f64::from(step) / f64::from(FREQUENCIES);
        [hz, (loops.velocity_open(std::f64::consts::TAU * hz) + 1.0).norm().recip()]
    };
    (1..=FREQUENCIES).map(point).collect()
}

fn page(
    shown: &Shown<'_>,
    drawn: &[(&'static str, String)],
    rows: &[[String; 3]],
    sentences: &[String],
) -> String {
    let Shown { machine, request, tuned, .. } = shown;
    let body = html! {
        h1 { "Tuning · " (machine.name) }
        p.sub {
            "least " (labels(request).join("; ")) ", " (tuned.evaluations) " evaluations on " (tuned.cases)
            " plants, seed " (request.seed)
            @if !tuned.is_complete { ", interrupted" }
        }
        @if !tuned.broken.is_empty() { p.no { "No gains within the bounds keep all constraints." } }
        table {
            thead { tr { th { "" } th { "before" } th { "after" } } }
            @for [name, before, after] in rows { tr { td { (name) } td { (before) } td { (after) } } }
        }
        h2 { "What holds them" }
        ul { @for sentence in sentences { li { (sentence) } } }
        @for (name, svg) in drawn {
            h2 { (heading(name)) }
            figure { (PreEscaped(svg)) }
        }
    };
    whole(&format!("Tuning · {}", machine.name), &body)
}

fn heading(name: &str) -> &'static str {
    match name {
        "map" => "Map of the objective",
        "circle-before" => "Circle before",
        "circle-after" => "Circle after",
        "loop" => "Velocity loop",
        _ => "Front",
    }
}
