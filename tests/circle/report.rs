//! Promise: the report of a circular test stands alone, says what the analysis found and never changes
//! for the same test.

use quadrant::base::motion::{Circle, Direction};
use quadrant::offline::circle::{CircularTest, Run, analyse};
use quadrant::offline::draw::{overview, polar, reversals};
use quadrant::offline::report::{self, Expectation, TestSheet};
use quadrant::offline::trace::Trace;

use crate::circle_model::{Model, REFERENCE, circle};

/// Bytes a drawing may have: a report with three of them still goes by mail.
const SVG_BYTES_MAX: usize = 150_000;

struct Tested {
    circles: [Circle; 2],
    traces: [[Trace; 2]; 2],
}

impl Tested {
    fn new(model: &Model, feed_mm_per_min: f64) -> Self {
        let circles = [Direction::Ccw, Direction::Cw].map(|direction| circle(feed_mm_per_min, direction, 1));
        let trace = |model: &Model, circle: &Circle| {
            Trace::from_records(model.records(circle)).unwrap().stretch(1).unwrap()
        };
        Self {
            circles,
            traces: circles.map(|circle| [trace(model, &circle), trace(&model.friction_free(), &circle)]),
        }
    }
    fn runs(&self) -> Vec<Run<'_>> {
        let pairs = self.circles.iter().zip(&self.traces);
        pairs
            .map(|(nominal, [trace, twin])| Run { nominal: *nominal, trace, friction_free: Some(twin) })
            .collect()
    }
    fn test(&self) -> CircularTest {
        analyse(&self.runs()).unwrap()
    }
}

fn sheet() -> TestSheet {
    TestSheet {
        machine: "model <A&B>".to_owned(),
        gains: "standard".to_owned(),
        date: "2026-01-31".to_owned(),
        log: "circle.mcap".to_owned(),
        commit: "0123abc".to_owned(),
        pace: "virtual time, seed 1".to_owned(),
        cycles: 62_549,
        overruns: 0,
        lost_records: 7,
        notes: vec!["the log ends in the middle of a chunk".to_owned()],
        expectations: vec![Expectation {
            quantity: "protrusion".to_owned(),
            measured_um: 27.5,
            expected_um: 25.0,
            tolerance_um: 0.1,
            source: "model".to_owned(),
        }],
    }
}

#[test]
fn the_page_stands_alone_and_says_what_was_found() {
    let tested = Tested::new(&REFERENCE, 4000.0);
    let test = tested.test();
    let page = report::page(&sheet(), &test, &tested.runs());
    for alien in ["<script", "http://", "https://", "<img", "<link", "url("] {
        let found = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "").contains(alien);
        assert!(!found, "the page refers to something outside: {alien}");
    }
    for word in
        ["model &lt;A&amp;B&gt;", "0123abc", "2026-01-31", "circle.mcap", "7 records were lost", "outside"]
    {
        assert!(page.contains(word), "the page does not say {word:?}");
    }
    let height = format!("<td>{:.1}</td>", test.motor.protrusion_um.max);
    assert!(page.contains(&height), "the page does not show the height {height}");
    assert_eq!(page.matches("<svg").count(), 3);
}

#[test]
fn drawings_are_small_and_the_same_every_time() {
    let noisy = Model { noise_um: 0.2, ..REFERENCE };
    let tested = Tested::new(&noisy, 1000.0);
    let (test, runs) = (tested.test(), tested.runs());
    let draw = || [polar::draw(&test, "t"), reversals::draw(&test, &runs), overview::draw(&runs)];
    let (first, second) = (draw(), draw());
    for (name, svg) in ["polar", "reversals", "overview"].into_iter().zip(&first) {
        assert!(svg.len() < SVG_BYTES_MAX, "{name} has {} bytes, at most {SVG_BYTES_MAX}", svg.len());
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{name} has a place that is no number");
    }
    assert!(first == second, "the same test drew two different pictures");
}

#[test]
fn the_polar_plot_names_every_height() {
    let model = Model { pulse_um: [25.0, 12.0, 18.0, 7.0], wind_up_um: [0.0; 2], ..REFERENCE };
    let tested = Tested::new(&model, 4000.0);
    let test = tested.test();
    let svg = polar::draw(&test, "t");
    for analysis in &test.motor.directions {
        for protrusion in &analysis.protrusions {
            let label = format!(" {:.1} µm</text>", protrusion.height_um);
            assert!(svg.contains(&label), "no label {label:?}");
        }
    }
}

#[test]
fn files_are_complete_and_an_unwritable_folder_is_named() {
    let tested = Tested::new(&REFERENCE, 8000.0);
    let (test, runs) = (tested.test(), tested.runs());
    let folder = tempfile::tempdir().unwrap();
    let files = report::write(&folder.path().join("new/report"), &sheet(), &test, &runs).unwrap();
    assert!(std::fs::read_to_string(&files.html).unwrap().ends_with("</html>"));
    assert!(std::fs::read_to_string(&files.svg).unwrap().ends_with("</svg>\n"));
    assert!(std::fs::read(&files.png).unwrap().starts_with(b"\x89PNG"));
    let blocked = folder.path().join("a-file");
    std::fs::write(&blocked, "in the way").unwrap();
    let refused = report::write(&blocked.join("report"), &sheet(), &test, &runs).unwrap_err().to_string();
    assert!(
        refused.contains("a-file/report") && refused.contains("cannot create the report folder"),
        "{refused}"
    );
}
