//! The polar plot of a circular test: the deviation, magnified, around the nominal circle.
//!
//! `r = r0 + k d(θ)`, with the actual angle `θ` and the radial deviation `d`; the rings stand at round
//! deviations. Where the whole path lies far inside (a fast circle on a soft loop), the rings zoom in on
//! the path and the nominal circle is named instead of drawn.
//!
//! Invariant: heights are printed outside the rings, one line each, so no label meets a curve.

use super::decimate::{extremes, limited};
use super::scale::{Scale, range, round_step, signed};
use super::svg::{Anchor, Stroke, Svg, TextStyle};
use super::{GRID, INK, REFERENCE, SOFT_INK, colour, sense, text};
use crate::base::motion::Direction;
use crate::offline::circle::protrusion::Protrusion;
use crate::offline::circle::{CircularTest, PathAnalysis, PointAnalysis, Quadrant, UM};

/// Width of one panel.
const PANEL: f64 = 570.0;
/// Height above the panels: title and legend.
const HEAD: f64 = 76.0;
/// Height of one panel.
const PANEL_HEIGHT: f64 = 540.0;
/// Outermost ring.
const RADIUS: f64 = 182.0;
/// Points of each of up to eight curves: two directions, with and without friction, motor and table.
const CURVE_POINTS_MAX: usize = 1100;
/// Innermost ring, as a share of the outermost.
const INNER_SHARE: f64 = 0.42;

/// Draws all measuring points side by side.
pub fn draw(test: &CircularTest, title: &str) -> String {
    let panels = test.points().count() as f64;
    let width = PANEL * panels;
    let mut svg = Svg::new(width, HEAD + PANEL_HEIGHT);
    let heading = TextStyle { is_bold: true, ..text(17.0, Anchor::Middle) };
    svg.text([width / 2.0, 28.0], heading, title);
    legend(&mut svg, test, width);
    for (index, point) in test.points().enumerate() {
        let centre = [PANEL * (index as f64 + 0.5), HEAD + PANEL_HEIGHT / 2.0 - 18.0];
        panel(&mut svg, test, point, centre, point.point.name(), deviation_range_um(point));
    }
    svg.finish(title)
}

/// Draws a point of tests of the same circle side by side, on one scale.
pub fn compare(tests: &[(&str, &CircularTest, &PointAnalysis)], title: &str) -> String {
    let width = PANEL * tests.len() as f64;
    let mut svg = Svg::new(width, HEAD + PANEL_HEIGHT);
    let heading = TextStyle { is_bold: true, ..text(17.0, Anchor::Middle) };
    svg.text([width / 2.0, 28.0], heading, title);
    if let Some((_, first, _)) = tests.first() {
        legend(&mut svg, first, width);
    }
    let ranges = tests.iter().map(|(.., point)| deviation_range_um(point));
    let wider = |one: [f64; 2], other: [f64; 2]| [one[0].min(other[0]), one[1].max(other[1])];
    let values_um = ranges.reduce(wider).unwrap_or_default();
    for (index, (name, test, point)) in tests.iter().enumerate() {
        let centre = [PANEL * (index as f64 + 0.5), HEAD + PANEL_HEIGHT / 2.0 - 18.0];
        panel(&mut svg, test, point, centre, name, values_um);
    }
    svg.finish(title)
}

fn legend(svg: &mut Svg, test: &CircularTest, width: f64) {
    let directions = test.motor.directions.iter().map(|analysis| analysis.direction);
    let mut entries: Vec<(String, Stroke)> =
        directions.map(|direction| (sense(direction).to_owned(), super::stroke(direction))).collect();
    entries.push(("nominal circle".to_owned(), Stroke::solid(INK, 1.0)));
    if test.motor.directions.iter().any(|analysis| analysis.friction_free_m.is_some()) {
        entries.push(("without friction (simulated)".to_owned(), friction_free_stroke()));
    }
    super::chart::legend(svg, [width / 2.0, 56.0], &entries);
}

const fn friction_free_stroke() -> Stroke {
    Stroke::dashed(REFERENCE, 1.1, [5.0, 4.0])
}

fn panel(
    svg: &mut Svg,
    test: &CircularTest,
    point: &PointAnalysis,
    centre: [f64; 2],
    name: &str,
    values_um: [f64; 2],
) {
    let ring_um = round_step((values_um[1] - values_um[0]) / 4.5);
    let low_um = (values_um[0] / ring_um).floor() * ring_um;
    let high_um = (values_um[1] / ring_um).ceil() * ring_um;
    let scale = Scale::new([low_um, high_um], [INNER_SHARE * RADIUS, RADIUS]);
    let polar = Polar { centre, scale };
    rings(svg, &polar, ring_um);
    for analysis in &point.directions {
        if let Some(friction_free_m) = &analysis.friction_free_m {
            curve(svg, &polar, analysis, friction_free_m, friction_free_stroke());
        }
    }
    for analysis in &point.directions {
        curve(
            svg,
            &polar,
            analysis,
            &analysis.path.deviation_m,
            Stroke::solid(colour(analysis.direction), 1.6),
        );
    }
    peaks(svg, &polar, point);
    ring_labels(svg, &polar, ring_um);
    heights(svg, centre, point);
    let bold = TextStyle { is_bold: true, ..text(15.0, Anchor::Middle) };
    svg.text([centre[0], centre[1] - 6.0], bold, name);
    svg.text(
        [centre[0], centre[1] + 14.0],
        text(12.0, Anchor::Middle),
        &format!("G {:.1} µm", point.circular_deviation_um),
    );
    if let Some(both_um) = point.bidirectional_circular_deviation_um {
        svg.text([centre[0], centre[1] + 30.0], text(12.0, Anchor::Middle), &format!("G(b) {both_um:.1} µm"));
    }
    foot(svg, test, &polar, ring_um);
}

/// Angles and deviations on the sheet.
struct Polar {
    centre: [f64; 2],
    scale: Scale,
}

impl Polar {
    fn place(&self, angle_rad: f64, deviation_um: f64) -> [f64; 2] {
        self.place_at(angle_rad, self.scale.place(deviation_um))
    }
    fn place_at(&self, angle_rad: f64, radius: f64) -> [f64; 2] {
        let (sin, cos) = angle_rad.sin_cos();
        [self.centre[0] + radius * cos, self.centre[1] - radius * sin]
    }
    fn shows_nominal(&self) -> bool {
        let [low_um, high_um] = self.scale.values();
        (low_um..=high_um).contains(&0.0)
    }
}

/// The deviations to be seen; the nominal circle too if it is not far off.
fn deviation_range_um(point: &PointAnalysis) -> [f64; 2] {
    let all = point.directions.iter().flat_map(|analysis| {
        let columns = std::iter::once(&analysis.path.deviation_m).chain(&analysis.friction_free_m);
        columns.flat_map(|column| analysis.path.measured_rows().map(|row| UM * column[row]))
    });
    let [low_um, high_um] = range(all, 0.02);
    let span_um = high_um - low_um;
    let distance_um = low_um.max(-high_um).max(0.0);
    if distance_um < 2.0 * span_um { [low_um.min(0.0), high_um.max(0.0)] } else { [low_um, high_um] }
}

fn rings(svg: &mut Svg, polar: &Polar, ring_um: f64) {
    for ring in ring_values(polar, ring_um) {
        svg.circle(polar.centre, polar.scale.place(ring), "none", Stroke::solid(GRID, 0.8));
    }
    for eighth in 0..8 {
        let angle_rad = f64::from(eighth) * std::f64::consts::FRAC_PI_4;
        let [inner, outer] = polar.scale.places();
        svg.line(
            polar.place_at(angle_rad, inner),
            polar.place_at(angle_rad, outer),
            Stroke::solid(GRID, 0.8),
        );
    }
    if polar.shows_nominal() {
        svg.circle(polar.centre, polar.scale.place(0.0), "none", Stroke::solid(INK, 1.0));
    }
}

fn ring_values(polar: &Polar, ring_um: f64) -> Vec<f64> {
    let [low_um, high_um] = polar.scale.values();
    let count = ((high_um - low_um) / ring_um).round() as usize;
    (0..=count).map(|ring| low_um + ring_um * ring as f64).collect()
}

/// At 67.5°, between two spokes and away from all reversals.
fn ring_labels(svg: &mut Svg, polar: &Polar, ring_um: f64) {
    let style = TextStyle { colour: SOFT_INK, ..text(10.5, Anchor::Middle) };
    let decimals = usize::from(ring_um < 1.0);
    for ring in ring_values(polar, ring_um) {
        let at = polar.place(67.5_f64.to_radians(), ring);
        svg.text_on_lines([at[0], at[1] + 3.5], style, &signed(ring, decimals));
    }
}

fn curve(svg: &mut Svg, polar: &Polar, analysis: &PathAnalysis, deviation_m: &[f64], stroke: Stroke) {
    // Bins of equal time; the spikes' flanks last longer than a bin of a quarter of a degree.
    let bins = 1440 * analysis.path.nominal.revolutions as usize;
    let rows: Vec<[f64; 2]> = analysis
        .path
        .measured_rows()
        .filter(|row| deviation_m[*row].is_finite())
        .map(|row| [analysis.path.angle_rad(row), UM * deviation_m[row]])
        .collect();
    let places: Vec<[f64; 2]> =
        extremes(&rows, bins, |row| row[1]).iter().map(|row| polar.place(row[0], row[1])).collect();
    svg.polyline(&limited(&places, 0.08, CURVE_POINTS_MAX), stroke);
}

/// The highest protrusion of one quadrant in one direction.
fn highest(analysis: &PathAnalysis, quadrant: Quadrant) -> Option<&Protrusion> {
    let here = analysis.protrusions.iter().filter(|protrusion| protrusion.quadrant == quadrant);
    here.max_by(|a, b| a.height_um.total_cmp(&b.height_um))
}

fn peaks(svg: &mut Svg, polar: &Polar, point: &PointAnalysis) {
    for analysis in &point.directions {
        for protrusion in Quadrant::ALL.into_iter().filter_map(|quadrant| highest(analysis, quadrant)) {
            let at = polar.place(protrusion.angle_deg.to_radians(), protrusion.peak_deviation_um);
            svg.circle(at, 3.2, "white", Stroke::solid(colour(analysis.direction), 1.6));
        }
    }
}

/// Name and heights of each quadrant, stacked outside the rings.
fn heights(svg: &mut Svg, centre: [f64; 2], point: &PointAnalysis) {
    let lines = point.directions.len() as f64 + 1.0;
    for quadrant in Quadrant::ALL {
        let (x, anchor, top) = match quadrant {
            Quadrant::XPlus => (RADIUS + 12.0, Anchor::Start, -8.0 * lines + 12.0),
            Quadrant::XMinus => (-RADIUS - 12.0, Anchor::End, -8.0 * lines + 12.0),
            Quadrant::YPlus => (0.0, Anchor::Middle, -RADIUS - 10.0 - 16.0 * (lines - 1.0)),
            Quadrant::YMinus => (0.0, Anchor::Middle, RADIUS + 22.0),
        };
        let at = |line: usize| [centre[0] + x, centre[1] + top + 16.0 * line as f64];
        let name = format!("{} {:.0}°", quadrant.label(), quadrant.angle_deg());
        svg.text(at(0), TextStyle { is_bold: true, ..text(13.0, anchor) }, &name);
        for (line, analysis) in point.directions.iter().enumerate() {
            if let Some(protrusion) = highest(analysis, quadrant) {
                let arrow = super::arrow(analysis.direction);
                let style = TextStyle { colour: dark(analysis), ..text(13.0, anchor) };
                svg.text(at(line + 1), style, &format!("{arrow} {} µm", signed(protrusion.height_um, 1)));
            }
        }
    }
}

/// The curve's colour, dark enough for small print.
fn dark(analysis: &PathAnalysis) -> &'static str {
    match analysis.direction {
        Direction::Ccw => colour(analysis.direction),
        Direction::Cw => "#a85f00",
    }
}

/// Scale bar and magnification, below the rings.
fn foot(svg: &mut Svg, test: &CircularTest, polar: &Polar, ring_um: f64) {
    let places_per_um = polar.scale.places_per_unit();
    let radius_place = polar.scale.place(polar.scale.values()[1].min(0.0));
    let magnification = two_digits(places_per_um * 1e3 * test.radius_mm / radius_place);
    let left = polar.centre[0] - PANEL / 2.0 + 28.0;
    let y = polar.centre[1] + PANEL_HEIGHT / 2.0 + 2.0;
    let bar = ring_um * places_per_um;
    let stroke = Stroke::solid(INK, 1.6);
    svg.line([left, y], [left + bar, y], stroke);
    svg.line([left, y - 5.0], [left, y + 5.0], stroke);
    svg.line([left + bar, y - 5.0], [left + bar, y + 5.0], stroke);
    let decimals = usize::from(ring_um < 1.0);
    let label = format!("{ring_um:.decimals$} µm   (deviation × {magnification:.0})");
    svg.text([left + bar + 10.0, y + 4.5], text(12.5, Anchor::Start), &label);
    if !polar.shows_nominal() {
        let far_um = -polar.scale.values()[1];
        let side = if far_um > 0.0 { "outside" } else { "inside" };
        let note = format!("nominal circle more than {:.0} µm {side}", far_um.abs());
        svg.text([polar.centre[0] + PANEL / 2.0 - 20.0, y + 4.5], text(12.5, Anchor::End), &note);
    }
}

/// Rounded to two digits that mean something.
fn two_digits(value: f64) -> f64 {
    let unit = 10_f64.powf(value.log10().floor() - 1.0);
    (value / unit).round() * unit
}
