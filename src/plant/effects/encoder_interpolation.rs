//! Interpolation error of an encoder: sine and cosine of its signal are not alike, so that what it shows swings once in
//! each period of the signal, or twice. Of the motor encoder it is in the loops, of the table scale in the log alone.
//!
//! ```text
//!   x_shown = x_m + A sin(2π x_m / p + φ)
//! ```
//!
//! 1 % of the period is usual; what swings twice beside it is a harmonic with values of its own. The period is that in travel: of an encoder with 2048 lines on a screw of 10 mm,
//! 4.9 um.
//! Invariant: a function of the place alone; no force.

use super::super::params::Parameters;
use super::catalogue::{Coordinate, Entry, Experiment, Values};
use super::hooks::{Action, Reading};
use super::parameter::Parameter;
use super::swing::Swing;

pub(super) const ENTRY: Entry = Entry {
    name: "encoder-interpolation",
    summary: "a motor encoder that shows a swing in each period of its signal",
    equation: "x_shown = x_m + A sin(2π x_m / p + φ)",
    parameters: &[
        Parameter::new("amplitude-um", "um", [0.0, 10.0], 0.05, 0.05),
        Parameter::new("period-um", "um", [0.5, 10_000.0], 4.8828125, 5.0).along(1e-6),
        Parameter::PHASE,
    ],
    coordinate: Coordinate::SignalPeriod,
    experiment: Experiment::Sweep,
    aliases: &[],
    law_of: None,
    action: Action::MotorEncoder(interpolation),
};

pub(super) const HARMONIC: Entry = Entry {
    name: "encoder-interpolation-harmonic",
    summary: "another swing that a motor encoder shows in each period of its signal",
    law_of: Some("encoder-interpolation"),
    ..ENTRY
};

pub(super) const SCALE: Entry = Entry {
    name: "encoder-interpolation-scale",
    summary: "a table scale that shows a swing in each period of its signal",
    equation: "x_shown = x_t + A sin(2π x_t / p + φ)",
    parameters: &[
        Parameter::new("amplitude-um", "um", [0.0, 10.0], 0.2, 0.2),
        Parameter::new("period-um", "um", [0.5, 1_000.0], 20.0, 20.0).along(1e-6),
        Parameter::PHASE,
    ],
    law_of: Some("encoder-interpolation"),
    action: Action::TableScale(interpolation),
    ..ENTRY
};

pub(super) const SCALE_HARMONIC: Entry = Entry {
    name: "encoder-interpolation-scale-harmonic",
    summary: "another swing that a table scale shows in each period of its signal",
    law_of: Some("encoder-interpolation"),
    ..SCALE
};

fn interpolation(values: &Values, _: &Parameters) -> Box<dyn Reading> {
    Box::new(Swing::new(1e-6 * values[0], 1e-6 * values[1], values[2]))
}
