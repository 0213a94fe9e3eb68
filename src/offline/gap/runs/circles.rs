//! Which circles setpoints follow.
//!
//! ```text
//!   setpoints of X and Y ──► stretches that bend one way ──► least-squares circle ──► whole turns at an even feed
//! ```
//!
//! Invariant: what makes no whole turn is no circle.

use std::f64::consts::TAU;
use std::ops::Range;

use crate::base::motion::{Circle, Direction};
use crate::base::units::{Position, Velocity};
use crate::offline::circle::fit::least_squares_circle;
use crate::offline::circle::path::wrapped;

/// A setpoint so near to it is on the circle, m; its angle steps differ from their median by no more than this share.
const ON_CIRCLE_M: f64 = 2e-6;
const STEADY: f64 = 0.02;
/// Rows to either side over which a path has a heading, and by how much it turns from one to the other where it bends, rad.
const HEADING_ROWS: usize = 50;
const BENT: f64 = 2e-3;
/// Every so many rows of a path tell its circle.
const EVERY: usize = 16;

/// The circles that setpoints follow one after another, each with as many whole turns as they make at its feed, and the rows of
/// these: the last.
pub(in crate::offline::gap) fn circles_of(period_s: f64, path_m: [&[f64]; 2]) -> Vec<(Circle, Range<usize>)> {
    let rows = path_m[0].len().min(path_m[1].len());
    let heading = |row: usize| {
        let [x, y] = path_m.map(|column| column[row + HEADING_ROWS] - column[row - HEADING_ROWS]);
        (x.hypot(y) > ON_CIRCLE_M).then(|| y.atan2(x))
    };
    // Which way the path bends at a row; by how much it turns over the rows about it.
    let turns = |row: usize| {
        let [before, after] = [heading(row - HEADING_ROWS)?, heading(row + HEADING_ROWS)?];
        Some(wrapped(after - before)).filter(|turn| turn.abs() > BENT)
    };
    let mut found = Vec::new();
    let mut row = 2 * HEADING_ROWS;
    while row + 2 * HEADING_ROWS < rows {
        let Some(first) = turns(row) else {
            row += 1;
            continue;
        };
        let bends_on = |row: &usize| turns(*row).is_some_and(|turn| turn * first > 0.0);
        let end = row + (row..rows - 2 * HEADING_ROWS).take_while(bends_on).count();
        found.extend(circle_of(period_s, path_m, row..end));
        row = end.max(row + 1);
    }
    found
}

/// The circle of a stretch that bends one way.
fn circle_of(
    period_s: f64,
    [x_m, y_m]: [&[f64]; 2],
    stretch: Range<usize>,
) -> Option<(Circle, Range<usize>)> {
    let rows = x_m.len().min(y_m.len());
    let middle = (3 * stretch.start + stretch.end) / 4..(stretch.start + 3 * stretch.end) / 4;
    let some: Vec<[f64; 2]> = middle.clone().step_by(EVERY).map(|row| [x_m[row], y_m[row]]).collect();
    if some.len() < 8 {
        return None;
    }
    let fitted = least_squares_circle(&some).filter(|fitted| fitted.radius_m.is_finite())?;
    let [centre_x, centre_y] = fitted.centre_m;
    let is_on =
        |row: usize| ((x_m[row] - centre_x).hypot(y_m[row] - centre_y) - fitted.radius_m).abs() < ON_CIRCLE_M;
    let angle = |row: usize| (y_m[row] - centre_y).atan2(x_m[row] - centre_x);
    let turned = |row: usize| wrapped(angle(row + 1) - angle(row));
    if !middle.clone().all(is_on) {
        return None;
    }
    let usual = middle.clone().map(turned).sum::<f64>() / middle.len() as f64;
    // A setpoint may come in counts: over some rows its feed is even.
    let is_steady = |row: usize| {
        let (from, to) = (row.saturating_sub(EVERY / 2), (row + EVERY / 2).min(rows - 1));
        let mean = (from..to).map(turned).sum::<f64>() / (to - from) as f64;
        is_on(row) && (mean / usual - 1.0).abs() < STEADY
    };
    let from = (0..middle.start).rev().take_while(|row| is_steady(*row)).last().unwrap_or(middle.start);
    let to = (middle.end..rows - 1).take_while(|row| is_steady(*row)).last().unwrap_or(middle.end - 1);
    let whole = (from..to).map(turned).sum::<f64>().abs();
    // The last row lies up to a period before the end.
    let revolutions = ((whole + 1.5 * usual.abs()) / TAU).floor();
    let (mut start, mut left) = (to, TAU * revolutions);
    while start > from && left > 0.5 * usual.abs() {
        start -= 1;
        left -= turned(start).abs();
    }
    let rounded = |m: f64| Position::m((1e6 * m).round() * 1e-6);
    let radius = rounded(fitted.radius_m);
    let feed = Velocity::m_per_s(usual.abs() / period_s * radius.as_m());
    let nominal = Circle {
        centre_x: rounded(centre_x),
        centre_y: rounded(centre_y),
        radius,
        feed: Velocity::mm_per_min(feed.as_mm_per_min().round()),
        direction: if usual > 0.0 { Direction::Ccw } else { Direction::Cw },
        start_angle_rad: angle(start),
        revolutions: revolutions as u32,
    };
    (nominal.revolutions > 0).then_some((nominal, start..to + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 5e-4;

    /// Two and a quarter turns clockwise about a point, with a way from it and back to it.
    fn path(turns: f64) -> [Vec<f64>; 2] {
        let feed_m_per_s = 0.03;
        let radius_m: f64 = 0.012;
        let (centre, way) = ([0.1, -0.05], 200);
        let rows = (TAU * turns * radius_m / feed_m_per_s / PERIOD_S) as usize;
        let point = |row: usize| {
            let share = (row as f64 / way as f64).min((rows + 2 * way - row) as f64 / way as f64).min(1.0);
            let on = row.saturating_sub(way).min(rows);
            let angle = 0.4 - on as f64 * PERIOD_S * feed_m_per_s / radius_m;
            [centre[0] + share * radius_m * angle.cos(), centre[1] + share * radius_m * angle.sin()]
        };
        [0, 1].map(|axis: usize| (0..rows + 2 * way).map(|row| point(row)[axis]).collect())
    }

    #[test]
    fn setpoints_tell_their_circles() {
        // The same way, and back along it.
        let [x_m, y_m] = path(2.25).map(|column| {
            let back: Vec<f64> = column.iter().rev().copied().collect();
            [column, back].concat()
        });
        let circles = circles_of(PERIOD_S, [&x_m, &y_m]);
        let senses: Vec<Direction> = circles.iter().map(|(circle, _)| circle.direction).collect();
        assert_eq!(senses, [Direction::Cw, Direction::Ccw], "{circles:?}");
        for (circle, rows) in circles {
            assert!((circle.radius.as_mm() - 12.0).abs() < 1e-3, "{circle:?}");
            assert!((circle.centre_x.as_mm() - 100.0).abs() < 1e-3, "{circle:?}");
            assert!((circle.feed.as_mm_per_min() - 1800.0).abs() < 1.5, "{circle:?}");
            assert_eq!(circle.revolutions, 2);
            let lap_rows = TAU * 0.012 / 0.03 / PERIOD_S;
            assert!(
                (rows.len() as f64 - 2.0 * lap_rows).abs() < 3.0,
                "{rows:?}, a lap takes {lap_rows} rows"
            );
        }
    }

    #[test]
    fn what_is_no_whole_circle_is_none() {
        let [x_m, y_m] = path(0.9);
        let still = vec![0.0; 4_000];
        let line: Vec<f64> = (0..4_000).map(|row| 1e-6 * f64::from(row)).collect();
        for path in [[&x_m, &y_m], [&still, &still], [&line, &still], [&line[..90].to_vec(), &still]] {
            assert!(circles_of(PERIOD_S, path.map(Vec::as_slice)).is_empty());
        }
    }
}
