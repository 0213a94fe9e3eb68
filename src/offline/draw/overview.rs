//! Velocity and current of both axes over the whole run, run-in and run-out included.
//!
//! Invariant: one column for each run, in the order of the runs.

use super::chart::{BELOW, Chart, LEFT, Line};
use super::scale::range;
use super::svg::{Stroke, Svg, TextStyle};
use super::{Anchor, sense, text};
use crate::offline::circle::Run;
use crate::offline::trace::AxisTrace;

const WIDTH: f64 = 1080.0;
const HEAD: f64 = 78.0;
const ROW: f64 = 150.0;
/// Points of the whole drawing: 2 charts with 2 lines for each run.
const POINTS_MAX: usize = 8000;
const GAP: f64 = 22.0;

/// Lines of X and Y: apart by colour, by grey and by dash.
const STROKES: [Stroke; 2] = [Stroke::solid("#117733", 1.4), Stroke::dashed("#aa4499", 1.4, [6.0, 3.0])];

/// Draws all runs side by side.
pub fn draw(runs: &[Run<'_>]) -> String {
    let title = "Velocity and current over the whole motion";
    let mut svg = Svg::new(WIDTH, HEAD + 2.0 * ROW + GAP + BELOW + 6.0);
    svg.text([WIDTH / 2.0, 22.0], TextStyle { is_bold: true, ..text(15.0, Anchor::Middle) }, title);
    let entries = [("X motor".to_owned(), STROKES[0]), ("Y motor".to_owned(), STROKES[1])];
    super::chart::legend(&mut svg, [WIDTH / 2.0, 46.0], &entries);
    let velocity = |axis: &AxisTrace| axis.velocity_m_per_s.iter().map(|v| 1e3 * v).collect();
    let current = |axis: &AxisTrace| axis.current_a.clone();
    row(&mut svg, runs, "velocity / mm/s", 0, velocity);
    row(&mut svg, runs, "current / A", 1, current);
    svg.finish(title)
}

fn row(svg: &mut Svg, runs: &[Run<'_>], label: &str, place: usize, values: impl Fn(&AxisTrace) -> Vec<f64>) {
    let columns: Vec<Vec<Line>> = runs.iter().map(|run| lines(run, &values)).collect();
    let seen = columns.iter().flatten().flat_map(|line| &line.points);
    let range_y = range(seen.map(|point| point[1]), 0.06);
    let width = (WIDTH - LEFT - 14.0) / runs.len().max(1) as f64;
    for (column, (run, lines)) in runs.iter().zip(columns).enumerate() {
        let chart = Chart {
            title: if place == 0 { sense(run.nominal.direction).to_owned() } else { String::new() },
            label_x: if place == 1 { "time / s".to_owned() } else { String::new() },
            label_y: if column == 0 { label.to_owned() } else { String::new() },
            range_x: range(run.trace.time_s.iter().copied(), 0.0),
            range_y,
            lines,
            points_max: POINTS_MAX / (4 * runs.len()),
        };
        let corner = [LEFT + width * column as f64, HEAD + (ROW + GAP) * place as f64];
        chart.draw(svg, corner, [width - 16.0, ROW]);
    }
}

fn lines(run: &Run<'_>, values: impl Fn(&AxisTrace) -> Vec<f64>) -> Vec<Line> {
    let points =
        |axis: &AxisTrace| run.trace.time_s.iter().copied().zip(values(axis)).map(|(x, y)| [x, y]).collect();
    run.trace.axes.iter().zip(STROKES).map(|(axis, stroke)| Line { points: points(axis), stroke }).collect()
}
