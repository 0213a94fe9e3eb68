//! Pitch error: the screw carries the table on by more than its angle and by less, again and again.
//!
//! ```text
//!   x_shown = x_t + A sin(2π x_t / p + φ)
//! ```
//!
//! It stands in what the table scale shows against the motor encoder; the forces by which it shakes the table
//! are left out, below 1 N at 100 mm/s and 10 mm. With the lead as its period it is what an eccentric motor encoder looks like.
//! A further harmonic has values of its own.
//! Invariant: a function of the place alone; no force.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::Action;
use super::parameter::Parameter;
use super::swing::Swing;

pub(super) const ENTRY: Entry = Entry {
    name: "pitch-error",
    summary: "a screw whose lead swings along it",
    equation: "x_shown = x_t + A sin(2π x_t / p + φ)",
    parameters: &[
        Parameter::new("amplitude-um", "um", [0.0, 100.0], 3.0, 2.0),
        Parameter::new("period-mm", "mm", [0.5, 2_000.0], 10.0, 10.0).along(1e-3),
        Parameter::PHASE,
    ],
    coordinate: Coordinate::Angle,
    experiment: Experiment::Sweep,
    aliases: &["encoder-eccentricity"],
    law_of: None,
    action: Action::TableScale(|values, _| {
        Box::new(Swing::new(1e-6 * values[0], 1e-3 * values[1], values[2]))
    }),
};

pub(super) const HARMONIC: Entry = Entry {
    name: "pitch-error-harmonic",
    summary: "another swing of the lead along the screw",
    aliases: &[],
    law_of: Some("pitch-error"),
    ..ENTRY
};
