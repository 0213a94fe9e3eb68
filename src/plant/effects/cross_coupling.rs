//! Cross coupling: the frame gives way to the force of the next axis, and this axis shows it, most at the other's
//! reversals.
//!
//! ```text
//!   x_shown = x_t + q F_y
//! ```
//!
//! The next axis is the one after it in the machine file, of the last one the first; `F_y` is the force of its
//! screw on its table. Valid far below the resonances of the frame.
//! Invariant: no force of its own.

use super::catalogue::{Coordinate, Entry, Experiment, Parameter};
use super::hooks::{Action, Crossing, Neighbour};

pub(super) const ENTRY: Entry = Entry {
    name: "cross-coupling",
    summary: "an axis that gives way to the force of the next",
    equation: "x_shown = x_t + q F_y",
    parameters: &[Parameter::new("compliance-um-per-kn", "um/kN", [-100.0, 100.0], 1.0, 1.0)],
    coordinate: Coordinate::OtherAxis,
    experiment: Experiment::Circles,
    aliases: &[],
    law_of: None,
    action: Action::NextAxis(|values, _| Box::new(Yield { m_per_n: 1e-9 * values[0] })),
};

#[derive(Debug)]
struct Yield {
    m_per_n: f64,
}

impl Crossing for Yield {
    fn error_m(&self, other: &Neighbour) -> f64 {
        self.m_per_n * other.force.as_n()
    }
}
