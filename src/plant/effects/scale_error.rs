//! Scale error: a table scale whose divisions, or a screw whose lead, is longer than its name says.
//!
//! Invariant: a function of the place alone; no force.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Reading};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "scale-error",
    summary: "a table scale that shows too much or too little",
    equation: "x_shown = x_t (1 + e)",
    parameters: &[Parameter::new("error-um-per-m", "um/m", [-1_000.0, 1_000.0], 20.0, 20.0)],
    coordinate: Coordinate::Position,
    experiment: Experiment::Circles,
    aliases: &[],
    law_of: None,
    action: Action::TableScale(|values, _| Box::new(Stretch { share: 1e-6 * values[0] })),
};

#[derive(Debug)]
struct Stretch {
    share: f64,
}

impl Reading for Stretch {
    fn error_m(&self, place_m: f64, _time_s: f64) -> f64 {
        self.share * place_m
    }
}
