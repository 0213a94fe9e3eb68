//! The open velocity loop over frequency (Bode): lines as measured with their spread, and the computed loop.
//!
//! Invariant: the horizontal axis is the logarithm of frequency, its labels are frequencies.

use super::chart::{BELOW, Chart, LEFT, Line, legend};
use super::scale::{Scale, range};
use super::svg::{Anchor, Stroke, Svg, TextStyle};
use super::{INK, text};

const SIZE: [f64; 2] = [760.0, 620.0];
/// A spread that is smaller than its dot is not drawn.
const STD_MIN: f64 = 1e-3;
/// Room for title and legend.
const TOP: f64 = 66.0;
const POINTS_MAX: usize = 1_000;
const MEASURED: &str = "#0b5394";
const COMPUTED: Stroke = Stroke::solid("#e08a00", 1.8);
/// Frequencies that are labelled, Hz.
const LABELS_HZ: [f64; 12] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1e3, 2e3, 5e3];

/// One measured line.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Hz.
    pub frequency_hz: f64,
    /// Magnitude, dB.
    pub db: f64,
    /// Phase, degrees.
    pub deg: f64,
    /// Standard deviation as a share of the magnitude.
    pub std: f64,
}

/// Draws measured lines and a computed curve (frequency in Hz, magnitude in dB, phase in degrees).
pub fn draw(title: &str, measured: &[Point], computed: &[[f64; 3]]) -> String {
    let mut svg = Svg::new(SIZE[0], SIZE[1]);
    svg.text([SIZE[0] / 2.0, 22.0], TextStyle { is_bold: true, ..text(15.0, Anchor::Middle) }, title);
    let across = range(measured.iter().map(|point| point.frequency_hz.log10()), 0.04);
    let width = SIZE[0] - LEFT - 26.0;
    let height = 0.5 * (SIZE[1] - TOP - 2.0 * BELOW - 14.0);
    let named: Vec<(f64, String)> = LABELS_HZ
        .into_iter()
        .map(|hz| (hz.log10(), hz.to_string()))
        .filter(|(place, _)| (across[0]..=across[1]).contains(place))
        .collect();
    let parts: [(usize, &str, f64, f64); 2] =
        [(1, "magnitude / dB", 8.686, TOP), (2, "phase / degrees", 57.296, TOP + height + BELOW + 8.0)];
    for (column, label, per_share, top) in parts {
        let value = |point: &Point| if column == 1 { point.db } else { point.deg };
        // A share of the magnitude is as many decibel, or degrees, across; both ends of two deviations.
        let spread = |point: &Point| 2.0 * per_share * point.std;
        let ends = measured.iter().flat_map(|p| [value(p) - spread(p), value(p) + spread(p)]);
        let chart = Chart {
            title: String::new(),
            label_x: "frequency / Hz".to_owned(),
            label_y: label.to_owned(),
            range_x: across,
            range_y: range(ends, 0.06),
            lines: std::iter::once(Line {
                points: computed.iter().map(|row| [row[0].log10(), row[column]]).collect(),
                stroke: COMPUTED,
            })
            .chain(measured.iter().filter(|point| point.std > STD_MIN).map(|point| {
                let here = point.frequency_hz.log10();
                let (middle, half) = (value(point), spread(point));
                Line {
                    points: vec![[here, middle - half], [here, middle + half]],
                    stroke: Stroke::solid(MEASURED, 1.2),
                }
            }))
            .collect(),
            points_max: POINTS_MAX,
        };
        let (corner, size) = ([LEFT + 6.0, top], [width, height]);
        chart.draw_with(&mut svg, corner, size, &named);
        let dots: Vec<[f64; 2]> = measured.iter().map(|p| [p.frequency_hz.log10(), value(p)]).collect();
        dots_of(&mut svg, &chart, corner, size, &dots);
    }
    let entries = [
        ("measured, with two standard deviations".to_owned(), Stroke::solid(MEASURED, 4.0)),
        ("computed from the machine file".to_owned(), COMPUTED),
    ];
    legend(&mut svg, [SIZE[0] / 2.0, 48.0], &entries);
    svg.finish(title)
}

fn dots_of(svg: &mut Svg, chart: &Chart, corner: [f64; 2], size: [f64; 2], dots: &[[f64; 2]]) {
    let x = Scale::new(chart.range_x, [corner[0], corner[0] + size[0]]);
    let y = Scale::new(chart.range_y, [corner[1] + size[1], corner[1]]);
    for [across, up] in dots {
        svg.circle([x.place(*across), y.place(*up)], 3.0, MEASURED, Stroke::solid(INK, 0.4));
    }
}
