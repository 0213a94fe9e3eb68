//! The four reversals over time: deviation, velocity and current of the reversing axis, aligned at the
//! command's reversal.
//!
//! Velocity and current count outward positive (towards the quadrant's pole), so that all four look
//! alike and share one scale. Invariant: one column for each quadrant, the first revolution of each.

use super::chart::{BELOW, Chart, LEFT, Line};
use super::scale::range;
use super::svg::{Stroke, Svg, TextStyle};
use super::{Anchor, INK, arrow, stroke, text};
use crate::offline::circle::path::Guard;
use crate::offline::circle::protrusion::Protrusion;
use crate::offline::circle::{CircularTest, PathAnalysis, Quadrant, Run, UM};

const WIDTH: f64 = 1080.0;
const HEAD: f64 = 62.0;
const COLUMN: f64 = 250.0;
const ROW: f64 = 176.0;
/// Points of the whole drawing, of 12 charts with up to 4 lines.
const POINTS_MAX: usize = 9000;
const ROW_GAP: f64 = 30.0;

/// What a row of charts shows.
#[derive(Clone, Copy, PartialEq)]
enum Row {
    Deviation,
    Velocity,
    Current,
}

impl Row {
    const ALL: [Self; 3] = [Self::Deviation, Self::Velocity, Self::Current];

    const fn label(self) -> &'static str {
        match self {
            Self::Deviation => "excess deviation / µm",
            Self::Velocity => "outward velocity / mm/s",
            Self::Current => "outward current / A",
        }
    }
}

/// Draws the runs that were judged, in the order they were judged.
pub fn draw(test: &CircularTest, runs: &[Run<'_>]) -> String {
    let title = "Reversals, aligned at the command's reversal";
    let mut svg = Svg::new(WIDTH, HEAD + 3.0 * (ROW + ROW_GAP) + BELOW - ROW_GAP + 8.0);
    svg.text([WIDTH / 2.0, 22.0], TextStyle { is_bold: true, ..text(15.0, Anchor::Middle) }, title);
    legend(&mut svg, test);
    let range_x = time_range_s(test);
    for (place, row) in Row::ALL.into_iter().enumerate() {
        let columns = Quadrant::ALL.map(|quadrant| lines(test, runs, quadrant, row, range_x));
        let seen = columns.iter().flatten().flat_map(|line| &line.points);
        let range_y = range(seen.filter(|p| (range_x[0]..=range_x[1]).contains(&p[0])).map(|p| p[1]), 0.06);
        for (column, (quadrant, lines)) in Quadrant::ALL.into_iter().zip(columns).enumerate() {
            let is_top = place == 0;
            let chart = Chart {
                title: if is_top {
                    format!("{} {:.0}°", quadrant.label(), quadrant.angle_deg())
                } else {
                    String::new()
                },
                label_x: if place == 2 {
                    "time since the command's reversal / s".to_owned()
                } else {
                    String::new()
                },
                label_y: if column == 0 { row.label().to_owned() } else { String::new() },
                range_x,
                range_y,
                lines,
                points_max: POINTS_MAX / (12 * 4),
            };
            let corner = [LEFT + COLUMN * column as f64, HEAD + 14.0 + (ROW + ROW_GAP - 14.0) * place as f64];
            chart.draw(&mut svg, corner, [COLUMN - 14.0, ROW]);
        }
    }
    svg.finish(title)
}

fn legend(svg: &mut Svg, test: &CircularTest) {
    let mut entries = Vec::new();
    for analysis in &test.motor.directions {
        let arrow = arrow(analysis.direction);
        let name = analysis.direction.name();
        entries.push((format!("{arrow} {name} motor"), stroke(analysis.direction)));
        if test.table.is_some() {
            entries.push((format!("{arrow} {name} table"), table_stroke(analysis)));
        }
    }
    entries.push(("command".to_owned(), command_stroke()));
    super::chart::legend(svg, [WIDTH / 2.0, 46.0], &entries);
}

const fn table_stroke(analysis: &PathAnalysis) -> Stroke {
    Stroke { dash: Some([6.0, 3.5]), ..stroke(analysis.direction) }
}

const fn command_stroke() -> Stroke {
    Stroke::dashed(INK, 0.9, [2.0, 2.0])
}

/// From a little before the command's reversal until the slowest protrusion has mostly decayed.
fn time_range_s(test: &CircularTest) -> [f64; 2] {
    let all = test.motor.directions.iter();
    let guard = test.motor.directions.first().map(|analysis| Guard::of(&analysis.path.nominal));
    let delay_ms = all.flat_map(|a| &a.protrusions).map(|p| p.delay_ms).fold(0.0, f64::max);
    let guard = guard.unwrap_or(Guard { before_s: 0.1, after_s: 0.6, is_shortened: false });
    [-guard.before_s / 2.0, (2.4e-3 * delay_ms).clamp(0.25 * guard.after_s, guard.after_s)]
}

fn lines(
    test: &CircularTest,
    runs: &[Run<'_>],
    quadrant: Quadrant,
    row: Row,
    range_s: [f64; 2],
) -> Vec<Line> {
    let mut lines = Vec::new();
    for (place, run) in runs.iter().enumerate() {
        let Some(motor) = test.motor.directions.get(place) else { continue };
        let Some(protrusion) = first(motor, quadrant) else { continue };
        let Some(axis) = run.trace.axis(quadrant.axis()) else { continue };
        let outward = if matches!(quadrant, Quadrant::XPlus | Quadrant::YPlus) { 1.0 } else { -1.0 };
        let mut add = |analysis: &PathAnalysis, stroke: Stroke, value: &dyn Fn(usize) -> f64| {
            let since_s = |at: usize| analysis.path.time_s[at] - protrusion.reversal_s;
            let rows = (0..analysis.path.time_s.len()).filter(|at| {
                analysis.path.is_fresh[*at] && (range_s[0]..=range_s[1]).contains(&since_s(*at))
            });
            lines.push(Line { points: rows.map(|at| [since_s(at), value(at)]).collect(), stroke });
        };
        let solid = stroke(motor.direction);
        match row {
            Row::Deviation => {
                add(motor, solid, &|at| excess_um(motor, at));
                if let Some(table) = test.table.as_ref().and_then(|table| table.directions.get(place)) {
                    add(table, table_stroke(table), &|at| excess_um(table, at));
                }
            }
            Row::Velocity => {
                add(motor, solid, &|at| 1e3 * outward * axis.velocity_m_per_s[at]);
                add(motor, command_stroke(), &|at| 1e3 * outward * axis.setpoint_velocity_m_per_s[at]);
            }
            Row::Current => add(motor, solid, &|at| outward * axis.current_a[at]),
        }
    }
    lines
}

fn excess_um(analysis: &PathAnalysis, row: usize) -> f64 {
    UM * (analysis.path.deviation_m[row] - analysis.baseline_m[row])
}

fn first(analysis: &PathAnalysis, quadrant: Quadrant) -> Option<&Protrusion> {
    analysis.protrusions.iter().find(|protrusion| protrusion.quadrant == quadrant)
}
