//! Cross coupling: the frame gives way to the force of the next axis, and this axis shows it, most at the other's
//! reversals; or part of that force goes into this axis, where guides are not square to each other.
//!
//! ```text
//!   x_shown = x_t + q F        F_x = ... + s F on the table        F = F_y, or M_y a_y
//! ```
//!
//! The next axis is the one after it in the machine file, of the last one the first; `F_y` is the force of its
//! screw on its table. What holds the screw gives way to all of that; what carries screw and guides, to what accelerates
//! the table alone, for friction is between them. Valid far below the resonances of the frame.
//! Invariant: no force where the next axis has none.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Crossing, Neighbour};
use super::parameter::Parameter;
use crate::base::units::Force as Newtons;

pub(super) const ENTRY: Entry = Entry {
    name: "cross-coupling",
    summary: "an axis that gives way to the force of the next",
    equation: "x_shown = x_t + q F_y",
    parameters: &[Parameter::new("compliance-um-per-kn", "um/kN", [-100.0, 100.0], 1.0, 1.0)],
    coordinate: Coordinate::OtherAxis,
    experiment: Experiment::Circles,
    aliases: &[],
    law_of: None,
    action: Action::NextAxis(|values, _| Box::new(Yield { m_per_n: 1e-9 * values[0], to: of_screw })),
};

pub(super) const OF_INERTIA: Entry = Entry {
    name: "cross-coupling-of-inertia",
    summary: "an axis that gives way to what accelerates the next",
    equation: "x_shown = x_t + q M_y a_y",
    law_of: Some("cross-coupling"),
    action: Action::NextAxis(|values, _| Box::new(Yield { m_per_n: 1e-9 * values[0], to: of_inertia })),
    ..ENTRY
};

fn of_screw(next: &Neighbour) -> Newtons {
    next.force
}

fn of_inertia(next: &Neighbour) -> Newtons {
    next.accelerating
}

#[derive(Debug)]
struct Yield {
    m_per_n: f64,
    to: fn(&Neighbour) -> Newtons,
}

impl Crossing for Yield {
    fn error_m(&self, other: &Neighbour) -> f64 {
        self.m_per_n * (self.to)(other).as_n()
    }
}

pub(super) const PUSH: Entry = Entry {
    name: "cross-coupling-push",
    summary: "an axis that the next one pushes",
    equation: "F = ... + s F_y",
    parameters: &[Parameter::new("share-percent", "%", [-100.0, 100.0], 2.0, 2.0)],
    law_of: Some("cross-coupling"),
    action: Action::NextAxis(|values, _| Box::new(Push { share: 1e-2 * values[0], of: of_screw })),
    ..ENTRY
};

pub(super) const PUSH_OF_INERTIA: Entry = Entry {
    name: "cross-coupling-push-of-inertia",
    summary: "an axis that is pushed by what accelerates the next one",
    equation: "F = ... + s M_y a_y",
    action: Action::NextAxis(|values, _| Box::new(Push { share: 1e-2 * values[0], of: of_inertia })),
    ..PUSH
};

#[derive(Debug)]
struct Push {
    share: f64,
    of: fn(&Neighbour) -> Newtons,
}

impl Crossing for Push {
    fn on_table_n(&self, other: &Neighbour) -> f64 {
        self.share * (self.of)(other).as_n()
    }
}
