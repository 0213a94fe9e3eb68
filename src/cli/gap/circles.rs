//! Circles among the runs: what a circular test says of them, measured and simulated before and after.

use std::fmt;

use serde::Serialize;

use crate::cli::view::table;
use crate::offline::circle::PointAnalysis;
use crate::offline::circle::protrusion::QuadrantHeights;
use crate::offline::gap::runs::Run;
use crate::offline::gap::show::contour::{Contour, point};

/// A circle of some runs. Lengths in um but for the radius.
#[derive(Debug, Serialize)]
pub(super) struct Circle {
    runs: Vec<String>,
    radius_mm: f64,
    feed_mm_per_min: f64,
    /// Whether no model was fitted to any of these runs.
    pub(super) is_held_out: bool,
    /// Where it is judged.
    point: &'static str,
    measured: Judged,
    before: Judged,
    after: Judged,
    /// Radial deviation measured less simulated, rms: before, after, and of noise alone.
    contour_um: Around,
}

#[derive(Debug, Serialize)]
struct Around {
    before: f64,
    after: f64,
    floor: f64,
}

#[derive(Debug, Serialize)]
struct Judged {
    circular_deviation_um: f64,
    bidirectional_circular_deviation_um: Option<f64>,
    protrusion_um: QuadrantHeights,
}

impl Judged {
    fn new(point: &PointAnalysis) -> Self {
        Self {
            circular_deviation_um: point.circular_deviation_um,
            bidirectional_circular_deviation_um: point.bidirectional_circular_deviation_um,
            protrusion_um: point.protrusion_um,
        }
    }
}

impl Circle {
    pub(super) fn new(contour: &Contour, runs: &[Run]) -> Self {
        let Contour { measured, simulated: [before, after], contour_um, floor_um, .. } = contour;
        Self {
            runs: contour.runs.iter().map(|run| runs[*run].name.clone()).collect(),
            radius_mm: measured.radius_mm,
            feed_mm_per_min: measured.feed_mm_per_min,
            is_held_out: contour.is_held,
            point: point(measured).point.name(),
            measured: Judged::new(point(measured)),
            before: Judged::new(point(before)),
            after: Judged::new(point(after)),
            contour_um: Around { before: contour_um[0], after: contour_um[1], floor: *floor_um },
        }
    }

    /// Name, and measured, before and after in um, of each number that a circular test has.
    pub(super) fn rows(&self) -> Vec<(&'static str, [Option<f64>; 3])> {
        let each = |of: fn(&Judged) -> Option<f64>| [&self.measured, &self.before, &self.after].map(of);
        let all = [
            ("circular deviation G", each(|judged| Some(judged.circular_deviation_um))),
            ("bidirectional G(b)", each(|judged| judged.bidirectional_circular_deviation_um)),
            ("highest protrusion", each(|judged| Some(judged.protrusion_um.max))),
            ("contour off by, rms", [None, Some(self.contour_um.before), Some(self.contour_um.after)]),
        ];
        all.into_iter().filter(|(_, [.., after])| after.is_some()).collect()
    }
}

impl fmt::Display for Circle {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { radius_mm, feed_mm_per_min, point, runs, .. } = self;
        writeln!(out, "circle R {radius_mm} mm, {feed_mm_per_min:.0} mm/min, {point}: {}", runs.join(", "))?;
        let mut table = table(&["um", "measured", "base fitted", "with effects"]);
        for (name, values) in self.rows() {
            let cells = values.map(|value| value.map_or_else(String::new, |value| format!("{value:.2}")));
            table.add_row(std::iter::once(name.to_owned()).chain(cells));
        }
        write!(out, "{table}")
    }
}
