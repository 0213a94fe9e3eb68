//! What a model leaves over the coordinate on which it has a shape, before and after.
//!
//! Invariant: the same figures give the same bytes.

use super::chart::{BELOW, Chart, LEFT, Line, legend};
use super::scale::range;
use super::svg::{Anchor, Stroke, Svg, TextStyle};
use super::text;

const SIZE: [f64; 2] = [760.0, 340.0];
const BEFORE: Stroke = Stroke::dashed("#555555", 1.8, [7.0, 4.0]);
const AFTER: Stroke = Stroke::solid("#0b5394", 2.2);
const NOISE: Stroke = Stroke::solid("#e08a00", 1.0);

/// Draws means over a coordinate: its values, and what was left there before and after; and the noise of a row.
pub fn draw(title: &str, labels: [&str; 2], profile: &[[f64; 3]], noise: f64) -> String {
    let column = |place: usize| profile.iter().map(|row| [row[0], row[place]]).collect::<Vec<[f64; 2]>>();
    let range_x = range(profile.iter().map(|row| row[0]), 0.02);
    let lines = [
        (column(1), BEFORE),
        (column(2), AFTER),
        (range_x.map(|x| [x, noise]).to_vec(), NOISE),
        (range_x.map(|x| [x, -noise]).to_vec(), NOISE),
    ];
    let chart = Chart {
        title: String::new(),
        label_x: labels[0].to_owned(),
        label_y: labels[1].to_owned(),
        range_x,
        range_y: range(profile.iter().flat_map(|row| [row[1], row[2]]).chain([noise, -noise]), 0.06),
        lines: lines.into_iter().map(|(points, stroke)| Line { points, stroke }).collect(),
        points_max: profile.len().max(2),
    };
    let names = ["base fitted", "with what was named", "noise of a row"].map(str::to_owned);
    let entries: Vec<(String, Stroke)> = names.into_iter().zip([BEFORE, AFTER, NOISE]).collect();
    let mut svg = Svg::new(SIZE[0], SIZE[1]);
    let corner = [LEFT + 12.0, 70.0];
    let size = [SIZE[0] - corner[0] - 24.0, SIZE[1] - corner[1] - BELOW - 6.0];
    chart.draw(&mut svg, corner, size);
    let heading = TextStyle { is_bold: true, ..text(15.0, Anchor::Middle) };
    svg.text([SIZE[0] / 2.0, 26.0], heading, title);
    legend(&mut svg, [SIZE[0] / 2.0, 52.0], &entries);
    svg.finish(title)
}
