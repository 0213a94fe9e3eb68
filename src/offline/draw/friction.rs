//! The friction curve of an axis: measured points and what was fitted to them, over velocity.
//!
//! Invariant: the same points give the same bytes; points are thinned out, never averaged.

use super::chart::{BELOW, Chart, LEFT, Line, legend};
use super::scale::range;
use super::svg::{Anchor, Stroke, Svg, TextStyle};
use super::text;

const SIZE: [f64; 2] = [760.0, 440.0];
/// Most points drawn.
const POINTS_MAX: usize = 1_500;
const MEASURED: &str = "#9db8d6";
/// One line for each fit: apart by colour, by grey and by dash.
const FITS: [Stroke; 2] = [Stroke::solid("#a3121f", 1.8), Stroke::dashed("#1a1a1a", 1.6, [7.0, 4.0])];

/// A fitted curve.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// In the legend.
    pub name: String,
    /// Velocity in mm/s and force, in rising order; a step in the curve ends one piece and begins the next.
    pub pieces: Vec<Vec<[f64; 2]>>,
}

/// Draws measured points (velocity in mm/s, force) and at most two fits. `unit` is that of the force.
pub fn draw(title: &str, unit: &str, measured: &[[f64; 2]], fits: &[Fitted]) -> String {
    let mut svg = Svg::new(SIZE[0], SIZE[1]);
    let corner = [LEFT + 6.0, 70.0];
    let size = [SIZE[0] - corner[0] - 20.0, SIZE[1] - corner[1] - BELOW - 6.0];
    let strokes = || fits.iter().zip(FITS);
    let lines = strokes()
        .flat_map(|(fit, stroke)| {
            fit.pieces.iter().map(move |points| Line { points: points.clone(), stroke })
        })
        .collect();
    let chart = Chart {
        title: String::new(),
        label_x: "velocity / mm/s".to_owned(),
        label_y: format!("friction / {unit}"),
        range_x: range(measured.iter().map(|point| point[0]), 0.03),
        range_y: range(measured.iter().map(|point| point[1]), 0.06),
        lines,
        points_max: POINTS_MAX,
    };
    // Points first, so that the fits are seen on top of them.
    let every = measured.len().div_ceil(POINTS_MAX).max(1);
    let seen: Vec<[f64; 2]> = measured.iter().step_by(every).copied().collect();
    chart.dots(&mut svg, corner, size, &seen, MEASURED);
    chart.draw(&mut svg, corner, size);
    svg.text([SIZE[0] / 2.0, 22.0], TextStyle { is_bold: true, ..text(15.0, Anchor::Middle) }, title);
    let mut entries = vec![("measured, less inertia".to_owned(), Stroke::solid(MEASURED, 4.0))];
    entries.extend(strokes().map(|(fit, stroke)| (fit.name.clone(), stroke)));
    legend(&mut svg, [SIZE[0] / 2.0, 48.0], &entries);
    svg.finish(title)
}
