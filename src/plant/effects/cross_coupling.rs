//! Cross coupling: the frame gives way to the force of the next axis, and this axis shows it, most at the other's
//! reversals; or part of that force goes into this axis, where guides are not square to each other.
//!
//! ```text
//!   x_shown = x_t + q F_y        F = ... + s F_y on the table
//! ```
//!
//! The next axis is the one after it in the machine file, of the last one the first; `F_y` is the force of its
//! screw on its table. Valid far below the resonances of the frame.
//! Invariant: no force where the next axis has none.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Crossing, Neighbour};
use super::parameter::Parameter;

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

pub(super) const PUSH: Entry = Entry {
    name: "cross-coupling-push",
    summary: "an axis that the next one pushes",
    equation: "F = ... + s F_y",
    parameters: &[Parameter::new("share-percent", "%", [-50.0, 50.0], 2.0, 2.0)],
    law_of: Some("cross-coupling"),
    action: Action::NextAxis(|values, _| Box::new(Push { share: 1e-2 * values[0] })),
    ..ENTRY
};

#[derive(Debug)]
struct Push {
    share: f64,
}

impl Crossing for Push {
    fn on_table_n(&self, other: &Neighbour) -> f64 {
        self.share * other.force.as_n()
    }
}
