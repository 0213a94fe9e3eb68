//! Pictures of a circular test and of a run's timing, as SVG text and as PNG.
//!
//! [`polar`] draws the magnified deviation around the circle, [`reversals`] the four reversals over
//! time, [`overview`] velocity and current of the whole run, [`latency`] where the time of the periods went,
//! [`friction`] what friction an axis was found to have, [`reversal`] its model beside the measurement, [`bode`] its
//! velocity loop over frequency; [`map`] and [`tuning`] what gains are worth; below them [`chart`], [`scale`],
//! [`decimate`] and [`svg`] know nothing of circles.
//!
//! Colours are told apart by colour-blind readers and by their grey: counter-clockwise dark blue,
//! clockwise light orange. Invariant: no text over text, the same test gives the same bytes.

pub mod bode;
pub mod chart;
pub mod decimate;
pub mod friction;
pub mod latency;
pub mod map;
pub mod overview;
pub mod png;
pub mod polar;
pub mod residual;
pub mod reversal;
pub mod reversals;
pub mod scale;
pub mod svg;
pub mod tuning;

use self::svg::{Anchor, Stroke, TextStyle};
use crate::base::motion::Direction;

/// Text and nominal lines.
pub(crate) const INK: &str = "#1a1a1a";
/// Labels of axes.
pub(crate) const SOFT_INK: &str = "#555555";
/// Grids.
pub(crate) const GRID: &str = "#dddddd";
/// What a simulation says.
pub(crate) const REFERENCE: &str = "#222222";

/// Colour of curves in one direction.
pub(crate) const fn colour(direction: Direction) -> &'static str {
    match direction {
        Direction::Ccw => "#0b5394",
        Direction::Cw => "#e08a00",
    }
}

/// Line of curves in one direction. Counter-clockwise is broad and clockwise narrow on top of it, so
/// that both are seen where they agree, as on a good machine they do.
pub(crate) const fn stroke(direction: Direction) -> Stroke {
    match direction {
        Direction::Ccw => Stroke::solid(colour(direction), 2.8),
        Direction::Cw => Stroke::solid(colour(direction), 1.3),
    }
}

/// Name of one direction with its arrow.
pub(crate) const fn sense(direction: Direction) -> &'static str {
    match direction {
        Direction::Ccw => "↺ counter-clockwise",
        Direction::Cw => "↻ clockwise",
    }
}

/// Arrow of one direction.
pub(crate) const fn arrow(direction: Direction) -> &'static str {
    match direction {
        Direction::Ccw => "↺",
        Direction::Cw => "↻",
    }
}

/// Text of a size, in ink.
pub(crate) const fn text(size: f64, anchor: Anchor) -> TextStyle {
    TextStyle { size, colour: INK, anchor, is_bold: false }
}
