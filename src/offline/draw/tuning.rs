//! What gains do to the velocity loop, and the front of several objectives.
//!
//! Invariant: the same figures give the same bytes.

use super::chart::{BELOW, Chart, LEFT, Line, legend};
use super::scale::range;
use super::svg::{Anchor, Stroke, Svg, TextStyle};
use super::text;

const SIZE: [f64; 2] = [760.0, 400.0];
const POINTS_MAX: usize = 1_000;
const BEFORE: Stroke = Stroke::dashed("#555555", 1.8, [7.0, 4.0]);
const AFTER: Stroke = Stroke::solid("#0b5394", 2.2);
const BOUND: Stroke = Stroke::solid("#a3121f", 1.2);

/// Draws how much the velocity loop amplifies a disturbance, `|1 / (1 + L)|` over the frequency in Hz, before and
/// after, and what is allowed.
pub fn sensitivity(title: &str, [before, after]: [Vec<[f64; 2]>; 2], allowed: f64) -> String {
    let ends = range(after.iter().map(|point| point[0]), 0.0);
    let range_y = range(before.iter().chain(&after).map(|point| point[1]).chain([0.0, allowed]), 0.04);
    let bound = ends.map(|hz| [hz, allowed]).to_vec();
    let lines = [(before, BEFORE), (after, AFTER), (bound, BOUND)];
    let names = ["before", "after", "allowed"].map(str::to_owned);
    let entries: Vec<(String, Stroke)> = names.into_iter().zip([BEFORE, AFTER, BOUND]).collect();
    let chart = Chart {
        title: String::new(),
        label_x: "frequency / Hz".to_owned(),
        label_y: "amplification of a disturbance".to_owned(),
        range_x: ends,
        range_y,
        lines: lines.into_iter().map(|(points, stroke)| Line { points, stroke }).collect(),
        points_max: POINTS_MAX,
    };
    sheet(title, &chart, &entries, &[])
}

/// Draws the front of two objectives, and where the gains were before.
pub fn front(title: &str, labels: [&str; 2], points: &[[f64; 2]], before: Option<[f64; 2]>) -> String {
    let all = || points.iter().chain(&before);
    let chart = Chart {
        title: String::new(),
        label_x: labels[0].to_owned(),
        label_y: labels[1].to_owned(),
        range_x: range(all().map(|point| point[0]), 0.06),
        range_y: range(all().map(|point| point[1]), 0.06),
        lines: vec![Line { points: points.to_vec(), stroke: Stroke::solid("#9db8d6", 1.2) }],
        points_max: POINTS_MAX,
    };
    let marks = [(points, "#0b5394"), (before.as_slice(), "#e08a00")];
    let entries: Vec<(String, Stroke)> = [("none is better in both", "#0b5394"), ("before", "#e08a00")]
        .map(|(name, colour)| (name.to_owned(), Stroke::solid(colour, 4.0)))
        .to_vec();
    sheet(title, &chart, &entries, &marks)
}

fn sheet(
    title: &str,
    chart: &Chart,
    entries: &[(String, Stroke)],
    marks: &[(&[[f64; 2]], &'static str)],
) -> String {
    let mut svg = Svg::new(SIZE[0], SIZE[1]);
    let corner = [LEFT + 12.0, 70.0];
    let size = [SIZE[0] - corner[0] - 24.0, SIZE[1] - corner[1] - BELOW - 6.0];
    chart.draw(&mut svg, corner, size);
    for (points, colour) in marks {
        chart.dots(&mut svg, corner, size, points, colour, 1.4);
    }
    let heading = TextStyle { is_bold: true, ..text(15.0, Anchor::Middle) };
    svg.text([SIZE[0] / 2.0, 26.0], heading, title);
    legend(&mut svg, [SIZE[0] / 2.0, 52.0], entries);
    svg.finish(title)
}
