//! A chart of lines over a common horizontal axis: frame, ticks, grid, lines.
//!
//! Invariant: what lies outside the ranges is not drawn; labels stay inside the given box.

use super::decimate::{extremes, limited};
use super::scale::Scale;
use super::svg::{Anchor, Stroke, Svg, TextStyle};
use super::{GRID, SOFT_INK, text};

/// One line.
#[derive(Clone, Debug)]
pub struct Line {
    /// Horizontal and vertical value of each point, in horizontal order.
    pub points: Vec<[f64; 2]>,
    /// Look.
    pub stroke: Stroke,
}

/// Axes and lines.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Above the frame.
    pub title: String,
    /// Below the ticks; empty for none, then the ticks have no numbers either.
    pub label_x: String,
    /// Left of the ticks; empty for none, then the ticks have no numbers either.
    pub label_y: String,
    /// Horizontal range.
    pub range_x: [f64; 2],
    /// Vertical range.
    pub range_y: [f64; 2],
    /// Drawn in order.
    pub lines: Vec<Line>,
    /// Most points of each line, so that noise does not fill the file.
    pub points_max: usize,
}

/// Room left of the frame for ticks and label.
pub const LEFT: f64 = 62.0;
/// Room below the frame for ticks and label.
pub const BELOW: f64 = 40.0;

impl Chart {
    /// Draws the frame with its upper left corner at `corner`; ticks and labels go outside it.
    pub fn draw(&self, svg: &mut Svg, corner: [f64; 2], size: [f64; 2]) {
        let ticks = Scale::new(self.range_x, [0.0, size[0]]).ticks((size[0] / 45.0) as usize);
        let named: Vec<(f64, String)> = ticks.values.iter().map(|at| (*at, ticks.label(*at))).collect();
        self.draw_with(svg, corner, size, &named);
    }

    /// The same with ticks of the caller on the horizontal axis, which may be a logarithm: their values and
    /// names.
    pub fn draw_with(&self, svg: &mut Svg, corner: [f64; 2], size: [f64; 2], ticks: &[(f64, String)]) {
        let x = Scale::new(self.range_x, [corner[0], corner[0] + size[0]]);
        let y = Scale::new(self.range_y, [corner[1] + size[1], corner[1]]);
        self.grid(svg, &x, &y, ticks);
        for line in &self.lines {
            draw_line(svg, line, &x, &y, self.points_max);
        }
        svg.frame(corner, size, Stroke::solid(SOFT_INK, 0.8));
        let bold = TextStyle { is_bold: true, ..text(12.5, Anchor::Middle) };
        svg.text([corner[0] + size[0] / 2.0, corner[1] - 7.0], bold, &self.title);
    }

    /// Marks points inside the ranges of a chart that was drawn at `corner`.
    pub fn dots(
        &self,
        svg: &mut Svg,
        corner: [f64; 2],
        size: [f64; 2],
        points: &[[f64; 2]],
        colour: &'static str,
        radius: f64,
    ) {
        let x = Scale::new(self.range_x, [corner[0], corner[0] + size[0]]);
        let y = Scale::new(self.range_y, [corner[1] + size[1], corner[1]]);
        let is_in = |value: f64, [low, high]: [f64; 2]| (low..=high).contains(&value);
        for [across, up] in points {
            if is_in(*across, self.range_x) && is_in(*up, self.range_y) {
                svg.circle([x.place(*across), y.place(*up)], radius, colour, Stroke::solid(colour, 0.0));
            }
        }
    }

    fn grid(&self, svg: &mut Svg, x: &Scale, y: &Scale, ticks_x: &[(f64, String)]) {
        let soft = |anchor| TextStyle { colour: SOFT_INK, ..text(11.0, anchor) };
        let ([left, right], [bottom, top]) = (x.places(), y.places());
        for (value, name) in ticks_x {
            let place = x.place(*value);
            svg.line([place, top], [place, bottom], Stroke::solid(GRID, 0.7));
            if !self.label_x.is_empty() {
                svg.text([place, bottom + 14.0], soft(Anchor::Middle), name);
            }
        }
        let ticks = y.ticks(((bottom - top) / 28.0) as usize);
        for value in &ticks.values {
            let place = y.place(*value);
            svg.line([left, place], [right, place], Stroke::solid(GRID, 0.7));
            if !self.label_y.is_empty() {
                svg.text([left - 6.0, place + 4.0], soft(Anchor::End), &ticks.label(*value));
            }
        }
        svg.text([(left + right) / 2.0, bottom + 31.0], soft(Anchor::Middle), &self.label_x);
        svg.text_upwards([left - 46.0, (top + bottom) / 2.0], soft(Anchor::Middle), &self.label_y);
    }
}

fn draw_line(svg: &mut Svg, line: &Line, x: &Scale, y: &Scale, points_max: usize) {
    let ([first, last], [low, high]) = (x.values(), y.values());
    let is_inside = |point: &&[f64; 2]| (first..=last).contains(&point[0]) && point[1].is_finite();
    let inside: Vec<[f64; 2]> = line.points.iter().filter(is_inside).copied().collect();
    let bins = x.places_per_unit() * (last - first);
    let places: Vec<[f64; 2]> = extremes(&inside, bins as usize, |point| point[1])
        .iter()
        .map(|point| [x.place(point[0]), y.place(point[1].clamp(low, high))])
        .collect();
    svg.polyline(&limited(&places, 0.1, points_max), line.stroke);
}

/// Names of lines in a row around a middle.
pub fn legend(svg: &mut Svg, middle: [f64; 2], entries: &[(String, Stroke)]) {
    const SAMPLE: f64 = 26.0;
    const GAP: f64 = 22.0;
    // Width of text is not known here; 7 units for each character of 12.5 is a little generous.
    let width = |name: &str| SAMPLE + 6.0 + 7.0 * name.chars().count() as f64;
    let total: f64 = entries.iter().map(|(name, _)| width(name) + GAP).sum::<f64>() - GAP;
    let mut x = middle[0] - total / 2.0;
    for (name, stroke) in entries {
        svg.line([x, middle[1] - 4.0], [x + SAMPLE, middle[1] - 4.0], *stroke);
        svg.text([x + SAMPLE + 6.0, middle[1]], text(12.5, Anchor::Start), name);
        x += width(name) + GAP;
    }
}
