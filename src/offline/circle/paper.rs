//! What the paper's circular tests showed, to hold a run of its machine against.
//!
//! Figs. 5 and 6 and the text of section 7: 25 um of protrusion and 50 um less radius with the standard
//! gains, 12 um (52 % less) with the optimal ones, at 2000 mm/min and 150 mm, measured at the motor
//! encoder. 12.2 um and the tolerances are those of an independent simulation of the same machine.

use super::CircularTest;
use crate::offline::report::Expectation;

/// Feed and radius of the paper's test.
const RADIUS_MM: f64 = 150.0;
const FEED_MM_PER_MIN: f64 = 2000.0;

/// Expectations for a test of the paper's machine; empty where the paper says nothing.
pub fn expectations(gains: &str, test: &CircularTest) -> Vec<Expectation> {
    let is_its_test =
        (test.radius_mm - RADIUS_MM).abs() < 1e-6 && (test.feed_mm_per_min - FEED_MM_PER_MIN).abs() < 1e-6;
    if !is_its_test {
        return Vec::new();
    }
    let expect = |quantity: &str, measured_um: f64, expected_um: f64, source: &str| Expectation {
        quantity: quantity.to_owned(),
        measured_um,
        expected_um,
        tolerance_um: 0.1,
        source: source.to_owned(),
    };
    let protrusion_um = test.motor.protrusion_um.max;
    match gains {
        "standard" => vec![
            expect("protrusion, motor encoder", protrusion_um, 25.0, "paper, Fig. 5"),
            expect("radius decrease, motor encoder", test.motor.radius_decrease_um, 50.0, "paper, Fig. 5"),
        ],
        "optimal" => vec![expect("protrusion, motor encoder", protrusion_um, 12.2, "paper, Fig. 6")],
        _ => Vec::new(),
    }
}
