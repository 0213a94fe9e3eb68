//! The friction curve of an axis: measured points and what was fitted to them, over velocity.
//!
//! Invariant: the same points give the same bytes; points are thinned out, never averaged.

use super::chart::{BELOW, Chart, LEFT, Line, legend};
use super::scale::range;
use super::svg::{Anchor, Stroke, Svg, TextStyle};
use super::text;

const SIZE: [f64; 2] = [1000.0, 440.0];
const HEAD: f64 = 74.0;
/// Most points drawn.
const POINTS_MAX: usize = 1_500;
/// So few points are drawn large and on top of the fits.
const FEW: usize = 300;
/// Speeds around zero that get a drawing of their own, mm/s: there friction falls.
const SLOW: f64 = 1.5;
/// Points at such speeds that are worth it.
const SLOW_POINTS_MIN: usize = 8;
const MEASURED: &str = "#5b8fc7";
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

/// Draws measured points (velocity in mm/s, force) and at most two fits. `unit` is that of the force. Where slow
/// and fast points are measured, the slow ones are drawn a second time, on a scale of their own.
pub fn draw(title: &str, unit: &str, measured: &[[f64; 2]], fits: &[Fitted]) -> String {
    let mut svg = Svg::new(SIZE[0], SIZE[1]);
    let all = range(measured.iter().map(|point| point[0]), 0.03);
    let slow = measured.iter().filter(|point| point[0].abs() <= SLOW).count();
    let has_slow = slow >= SLOW_POINTS_MIN && all[1] - all[0] > 8.0 * SLOW;
    let ranges = if has_slow { vec![[-SLOW, SLOW], all] } else { vec![all] };
    let width = (SIZE[0] - 20.0) / ranges.len() as f64;
    let size = [width - LEFT - 14.0, SIZE[1] - HEAD - BELOW - 6.0];
    for (place, range_x) in ranges.into_iter().enumerate() {
        let chart = chart(unit, range_x, measured, fits);
        let corner = [LEFT + 6.0 + width * place as f64, HEAD];
        let dots = |svg: &mut Svg, radius| {
            let every = measured.len().div_ceil(POINTS_MAX).max(1);
            let seen: Vec<[f64; 2]> = measured.iter().step_by(every).copied().collect();
            chart.dots(svg, corner, size, &seen, MEASURED, radius);
        };
        // Of many points the fits must be seen, of few the points.
        if measured.len() > FEW {
            dots(&mut svg, 1.4);
            chart.draw(&mut svg, corner, size);
        } else {
            chart.draw(&mut svg, corner, size);
            dots(&mut svg, 3.2);
        }
    }
    svg.text([SIZE[0] / 2.0, 22.0], TextStyle { is_bold: true, ..text(15.0, Anchor::Middle) }, title);
    let mut entries = vec![("measured, less inertia".to_owned(), Stroke::solid(MEASURED, 4.0))];
    entries.extend(fits.iter().zip(FITS).map(|(fit, stroke)| (fit.name.clone(), stroke)));
    legend(&mut svg, [SIZE[0] / 2.0, 48.0], &entries);
    svg.finish(title)
}

fn chart(unit: &str, range_x: [f64; 2], measured: &[[f64; 2]], fits: &[Fitted]) -> Chart {
    let lines = (fits.iter().zip(FITS))
        .flat_map(|(fit, stroke)| {
            fit.pieces.iter().map(move |points| Line { points: points.clone(), stroke })
        })
        .collect();
    Chart {
        title: String::new(),
        label_x: "velocity / mm/s".to_owned(),
        label_y: format!("friction / {unit}"),
        range_x,
        range_y: range(measured.iter().map(|point| point[1]), 0.06),
        lines,
        points_max: POINTS_MAX,
    }
}
