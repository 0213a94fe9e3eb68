//! The map of a tuning: the objective over `V_p` and `V_i`, with the borders of the constraints.
//!
//! Both axes are logarithmic. Shades go around the least objective that keeps all constraints; what breaks one
//! lies under a veil. Borders are drawn through the cells in which a constraint changes sides.
//! Invariant: drawn is what was judged, cell by cell; nothing is smoothed.

use super::chart::legend;
use super::scale::Scale;
use super::svg::{Anchor, Stroke, Svg, TextStyle};
use super::{INK, SOFT_INK, text};
use crate::offline::tune::map::Map;
use crate::offline::tune::space::Choice;

const SIZE: [f64; 2] = [760.0, 560.0];
const CORNER: [f64; 2] = [76.0, 96.0];
const FRAME: [f64; 2] = [560.0, 400.0];
/// From the least objective to the largest shown, told apart by their grey as well.
const SHADES: [&str; 9] =
    ["#08306b", "#13529f", "#2b76b9", "#5098cb", "#7fb6da", "#abcfe6", "#cddff1", "#e3edf8", "#f7fbff"];
/// Of the least objective that keeps all constraints: what has the darkest shade, and the lightest.
const SHOWN: [f64; 2] = [0.4, 2.2];
/// A line for each constraint that has a border here.
const BORDERS: [Stroke; 6] = [
    Stroke::solid("#a3121f", 2.2),
    Stroke::dashed("#e08a00", 2.2, [8.0, 4.0]),
    Stroke::dashed("#11622b", 2.2, [2.5, 3.0]),
    Stroke::solid("#6a3d9a", 1.4),
    Stroke::dashed("#555555", 1.4, [8.0, 4.0]),
    Stroke::dashed("#1a1a1a", 1.4, [2.5, 3.0]),
];

/// Draws a map with the gains before and after; `label` is the name of the objective.
pub fn draw(map: &Map, before: &Choice, after: &Choice, title: &str, label: &str) -> String {
    let mut svg = Svg::new(SIZE[0], SIZE[1]);
    let ends = |values: &[f64]| [values[0].ln(), values[values.len() - 1].ln()];
    let x = Scale::new(ends(&map.v_p), [CORNER[0], CORNER[0] + FRAME[0]]);
    let y = Scale::new(ends(&map.v_i), [CORNER[1] + FRAME[1], CORNER[1]]);
    let heading = TextStyle { is_bold: true, ..text(15.0, Anchor::Middle) };
    svg.text([SIZE[0] / 2.0, 26.0], heading, title);
    cells(&mut svg, map, &x, &y);
    let mut entries = Vec::new();
    let mut strokes = BORDERS.into_iter();
    for (index, name) in map.constraints.iter().enumerate() {
        let border = border(map, index);
        if border.is_empty() {
            continue;
        }
        let Some(stroke) = strokes.next() else { break };
        for [from, to] in border {
            let place = |[v_p, v_i]: [f64; 2]| [x.place(v_p), y.place(v_i)];
            svg.line(place(from), place(to), stroke);
        }
        entries.push((name.clone(), stroke));
    }
    // Two to a row: names of constraints are long.
    for (row, pair) in entries.chunks(3).enumerate() {
        legend(&mut svg, [SIZE[0] / 2.0, 52.0 + 20.0 * row as f64], pair);
    }
    axes(&mut svg, &x, &y);
    for (choice, name, fill) in [(before, "before", "white"), (after, "after", "#ffd21f")] {
        let at = [x.place(choice.v_p.ln()), y.place(choice.v_i.ln())];
        svg.circle(at, 5.5, fill, Stroke::solid(INK, 1.8));
        let style = TextStyle { is_bold: true, ..text(12.5, Anchor::Start) };
        svg.text_on_lines([at[0] + 9.0, at[1] - 8.0], style, name);
    }
    shades(&mut svg, map, label);
    svg.finish(title)
}

/// Least objective that keeps all constraints, or of all if there is none.
fn least(map: &Map) -> f64 {
    if let Some(best) = map.best() {
        return best.objective;
    }
    map.points
        .iter()
        .map(|point| point.objective)
        .filter(|value| value.is_finite())
        .fold(f64::INFINITY, f64::min)
}

fn cells(svg: &mut Svg, map: &Map, x: &Scale, y: &Scale) {
    let least = least(map);
    let half = |values: &[f64]| 0.5 * (values[1] / values[0]).ln();
    let (half_x, half_y) = (half(&map.v_p), half(&map.v_i));
    for point in &map.points {
        let share = (point.objective / least - SHOWN[0]) / (SHOWN[1] - SHOWN[0]);
        let shade = if share.is_finite() { (share * SHADES.len() as f64) as usize } else { SHADES.len() };
        let fill = SHADES.get(shade).copied().unwrap_or("white");
        let clamp = |value: f64, [low, high]: [f64; 2]| value.clamp(low, high);
        let (v_p, v_i) = (point.choice.v_p.ln(), point.choice.v_i.ln());
        let [left, right] = [v_p - half_x, v_p + half_x].map(|value| x.place(clamp(value, x.values())));
        let [bottom, top] = [v_i - half_y, v_i + half_y].map(|value| y.place(clamp(value, y.values())));
        let (corner, size) = ([left, top], [right - left, bottom - top]);
        svg.area(corner, size, fill);
        if point.violation > 0.0 {
            // The veil: a line across each cell that breaks a constraint.
            svg.line([left, bottom], [right, top], Stroke::solid("#ffffff", 2.0));
        }
    }
}

/// Pieces of the line on which a constraint is met exactly, in logarithms.
fn border(map: &Map, constraint: usize) -> Vec<[[f64; 2]; 2]> {
    let columns = map.v_p.len();
    let value = |column: usize, row: usize| {
        map.points[row * columns + column].broken_by.get(constraint).copied().unwrap_or(f64::NAN)
    };
    let place = |column: usize, row: usize| [map.v_p[column].ln(), map.v_i[row].ln()];
    let mut pieces = Vec::new();
    for row in 0..map.v_i.len() - 1 {
        for column in 0..columns - 1 {
            let corners = [(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)];
            let mut met = Vec::new();
            for edge in 0..4 {
                let [from, to] = [corners[edge], corners[(edge + 1) % 4]];
                let [a, b] = [value(from.0, from.1), value(to.0, to.1)];
                if (a > 0.0) != (b > 0.0) && a.is_finite() && b.is_finite() {
                    let share = a / (a - b);
                    let [p, q] = [place(from.0, from.1), place(to.0, to.1)];
                    met.push([p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])]);
                }
            }
            pieces.extend(met.chunks_exact(2).map(|pair| [pair[0], pair[1]]));
        }
    }
    pieces
}

fn axes(svg: &mut Svg, x: &Scale, y: &Scale) {
    let soft = |anchor| TextStyle { colour: SOFT_INK, ..text(11.0, anchor) };
    svg.frame(CORNER, FRAME, Stroke::solid(SOFT_INK, 0.8));
    let ([left, right], [bottom, top]) = (x.places(), y.places());
    for value in round_values(x.values()) {
        let place = x.place(value.ln());
        svg.line([place, bottom], [place, bottom + 4.0], Stroke::solid(SOFT_INK, 0.8));
        svg.text([place, bottom + 17.0], soft(Anchor::Middle), &format!("{value}"));
    }
    for value in round_values(y.values()) {
        let place = y.place(value.ln());
        svg.line([left - 4.0, place], [left, place], Stroke::solid(SOFT_INK, 0.8));
        svg.text([left - 7.0, place + 4.0], soft(Anchor::End), &format!("{value}"));
    }
    svg.text([(left + right) / 2.0, bottom + 36.0], soft(Anchor::Middle), "V_p");
    svg.text_upwards([left - 52.0, (top + bottom) / 2.0], soft(Anchor::Middle), "V_i");
}

/// Round values between the logarithms of two ends.
fn round_values([low, high]: [f64; 2]) -> Vec<f64> {
    let decades =
        (low / std::f64::consts::LN_10).floor() as i32..=(high / std::f64::consts::LN_10).ceil() as i32;
    let values = decades.flat_map(|decade| {
        // Written out, so that a value has the digits of its text.
        [1, 2, 3, 5, 7].map(|digit| format!("{digit}e{decade}").parse().unwrap_or(f64::NAN))
    });
    values.filter(|value: &f64| (low..=high).contains(&value.ln())).collect()
}

/// What the shades mean.
fn shades(svg: &mut Svg, map: &Map, label: &str) {
    let least = least(map);
    let (left, height) = (CORNER[0] + FRAME[0] + 24.0, 30.0);
    for (index, fill) in SHADES.iter().enumerate() {
        let top = CORNER[1] + 24.0 + height * index as f64;
        svg.area([left, top], [22.0, height], fill);
        let from = least * (SHOWN[0] + (SHOWN[1] - SHOWN[0]) * index as f64 / SHADES.len() as f64);
        let number = if least < 0.1 { format!("{from:.2e}") } else { format!("{from:.2}") };
        svg.text([left + 28.0, top + 4.0], text(11.0, Anchor::Start), &number);
    }
    svg.frame([left, CORNER[1] + 24.0], [22.0, height * SHADES.len() as f64], Stroke::solid(SOFT_INK, 0.8));
    let foot = CORNER[1] + FRAME[1] + 58.0;
    let words = format!("shade: {label}; white lines: a constraint is broken");
    svg.text([CORNER[0] + FRAME[0] / 2.0, foot], text(11.5, Anchor::Middle), &words);
}
