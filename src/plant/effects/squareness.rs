//! Squareness: this axis leans towards the next one, so that its place changes as the other moves.
//!
//! ```text
//!   x_shown = x_t + b y_t
//! ```
//!
//! The next axis is the one after it in the machine file, of the last one the first. In a circle of radius `R` it
//! is `(b R / 2) sin 2θ`, the same both ways.
//! Invariant: a function of places alone; no force.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Crossing, Neighbour};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "squareness",
    summary: "an axis that leans towards the next",
    equation: "x_shown = x_t + b y_t",
    parameters: &[Parameter::new("angle-um-per-m", "um/m", [-1_000.0, 1_000.0], 20.0, 20.0)],
    coordinate: Coordinate::OtherAxis,
    experiment: Experiment::Circles,
    aliases: &[],
    law_of: None,
    action: Action::NextAxis(|values, _| Box::new(Lean { share: 1e-6 * values[0] })),
};

#[derive(Debug)]
struct Lean {
    share: f64,
}

impl Crossing for Lean {
    fn error_m(&self, other: &Neighbour) -> f64 {
        self.share * other.table.as_m()
    }
}
