//! How far the axes are from the path that they were told to follow.
//!
//! The path is the line through the setpoints of the last second in which an axis had its loop closed, so
//! the lag of the position loop along the path is no distance, and a cut of a corner is one.
//! Invariant: lengths in metres; a place on the path has the distance zero.

use std::collections::VecDeque;

use crate::base::axis::{AXES_MAX, PerAxis};
use crate::base::units::Position;

/// A place in the space of the axes, m.
type Place = [f64; AXES_MAX];

/// One setpoint of so many is kept; the others lie between them.
const EVERY: usize = 4;
/// Setpoints that are kept: more than the way of the lag, at 2 kHz a second.
const KEPT: usize = 500;

/// The path of the last second.
#[derive(Clone, Debug, Default)]
pub(super) struct Path {
    places: VecDeque<Place>,
    skipped: usize,
}

fn place(positions: &PerAxis<Position>) -> Place {
    let mut place = [0.0; AXES_MAX];
    for (own, position) in place.iter_mut().zip(positions.as_slice()) {
        *own = position.as_m();
    }
    place
}

fn minus(a: &Place, b: &Place) -> Place {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn dot(a: &Place, b: &Place) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Path {
    /// The axes were told to be here.
    pub(super) fn lead(&mut self, setpoints: &PerAxis<Position>) {
        self.skipped += 1;
        if self.skipped < EVERY && !self.places.is_empty() {
            return;
        }
        self.skipped = 0;
        if self.places.len() == KEPT {
            self.places.pop_front();
        }
        self.places.push_back(place(setpoints));
    }

    /// Distance of the axes from the path; none where there is no path yet.
    pub(super) fn distance(&self, positions: &PerAxis<Position>) -> Option<Position> {
        let at = place(positions);
        let whole = self.places.iter().zip(self.places.iter().skip(1));
        let to_points = self.places.iter().map(|place| square(&minus(&at, place)));
        let nearest = whole.map(|(from, to)| to_segment(&at, from, to)).chain(to_points);
        nearest.reduce(f64::min).map(|square| Position::m(square.sqrt()))
    }
}

fn square(place: &Place) -> f64 {
    dot(place, place)
}

/// Square of the distance from the line between two places.
fn to_segment(at: &Place, from: &Place, to: &Place) -> f64 {
    let (along, away) = (minus(to, from), minus(at, from));
    let length = square(&along);
    let share = if length > 0.0 { (dot(&away, &along) / length).clamp(0.0, 1.0) } else { 0.0 };
    square(&std::array::from_fn(|axis| away[axis] - share * along[axis]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_mm: f64, y_mm: f64) -> PerAxis<Position> {
        PerAxis::from_fn(2, |axis| Position::mm([x_mm, y_mm][axis.index()]))
    }

    #[test]
    fn a_distance_is_square_to_the_path_or_from_its_end() {
        let mut path = Path::default();
        assert_eq!(path.distance(&at(1.0, 1.0)), None);
        for step in 0..=40 {
            path.lead(&at(f64::from(step) * 0.1, 0.0));
        }
        let mm = |x_mm, y_mm| path.distance(&at(x_mm, y_mm)).map_or(f64::NAN, Position::as_mm);
        assert!((mm(2.03, 0.5) - 0.5).abs() < 1e-12, "{} mm", mm(2.03, 0.5));
        assert!(mm(1.234, 0.0) < 1e-12);
        assert!((mm(7.0, 4.0) - 5.0).abs() < 1e-9, "{} mm from the end", mm(7.0, 4.0));
    }

    #[test]
    fn an_old_part_of_the_path_is_forgotten() {
        let mut path = Path::default();
        for step in 0..(EVERY * (KEPT + 100)) {
            path.lead(&at(step as f64 * 1e-3, 0.0));
        }
        let from_start = path.distance(&at(0.0, 0.0)).map_or(f64::NAN, Position::as_mm);
        assert!((from_start - 0.4).abs() < 0.01, "{from_start} mm to what is left");
    }
}
