//! A reversal beside its model: measured and modelled force over time, and what the model leaves.
//!
//! Invariant: both charts have the same time; what is left has its own scale, so that it is seen.

use super::chart::{BELOW, Chart, LEFT, Line, legend};
use super::scale::range;
use super::svg::{Anchor, Stroke, Svg, TextStyle};
use super::text;

const SIZE: [f64; 2] = [760.0, 560.0];
/// Most points of a line.
const POINTS_MAX: usize = 1_500;
const MEASURED: Stroke = Stroke::solid("#0b5394", 3.0);
const MODELLED: Stroke = Stroke::solid("#e08a00", 1.4);
const LEFT_OVER: Stroke = Stroke::solid("#1a1a1a", 1.0);

/// Draws rows of time in s, measured and modelled force in N.
pub fn draw(title: &str, rows: &[[f64; 3]]) -> String {
    let mut svg = Svg::new(SIZE[0], SIZE[1]);
    let line = |of: &dyn Fn(&[f64; 3]) -> f64, stroke| Line {
        points: rows.iter().map(|row| [row[0], of(row)]).collect(),
        stroke,
    };
    let range_x = range(rows.iter().map(|row| row[0]), 0.0);
    let width = SIZE[0] - LEFT - 26.0;
    let left_over = |row: &[f64; 3]| row[1] - row[2];
    let chart = |label_x: &str, label_y: &str, range_y, lines| Chart {
        title: String::new(),
        label_x: label_x.to_owned(),
        label_y: label_y.to_owned(),
        range_x,
        range_y,
        lines,
        points_max: POINTS_MAX,
    };
    let forces = range(rows.iter().flat_map(|row| [row[1], row[2]]), 0.06);
    let lines = vec![line(&|row| row[1], MEASURED), line(&|row| row[2], MODELLED)];
    chart("", "force at the table / N", forces, lines).draw(&mut svg, [LEFT + 6.0, 70.0], [width, 260.0]);
    let left = range(rows.iter().map(left_over), 0.06);
    let below = [LEFT + 6.0, 360.0];
    chart("time / s", "measured - model / N", left, vec![line(&left_over, LEFT_OVER)]).draw(
        &mut svg,
        below,
        [width, SIZE[1] - below[1] - BELOW - 6.0],
    );
    svg.text([SIZE[0] / 2.0, 22.0], TextStyle { is_bold: true, ..text(15.0, Anchor::Middle) }, title);
    let names = [("measured", MEASURED), ("model", MODELLED), ("what the model leaves", LEFT_OVER)];
    legend(&mut svg, [SIZE[0] / 2.0, 48.0], &names.map(|(name, stroke)| (name.to_owned(), stroke)));
    svg.finish(title)
}
