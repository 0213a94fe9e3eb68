//! Encoder eccentricity: the disc of the motor encoder runs out of true, so that what it shows swings about the
//! angle of the motor once a turn.
//!
//! ```text
//!   x_shown = x_m + A sin(2π x_m / lead + φ)
//! ```
//!
//! The loops make what is shown go straight, so the motor swings the other way, and the table with it. A screw
//! whose lead swings once a turn looks the same: only a second encoder, or the first on another place of the
//! shaft, tells them apart.
//! Invariant: once a turn, whatever the speed; no force.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::Action;
use super::parameter::Parameter;
use super::swing::Swing;

pub(super) const ENTRY: Entry = Entry {
    name: "encoder-eccentricity",
    summary: "a motor encoder that shows a swing of once a turn",
    equation: "x_shown = x_m + A sin(2π x_m / lead + φ)",
    parameters: &[Parameter::new("amplitude-um", "um", [0.0, 100.0], 2.0, 1.5), Parameter::PHASE],
    coordinate: Coordinate::Angle,
    experiment: Experiment::Sweep,
    aliases: &["pitch-error"],
    law_of: None,
    action: Action::MotorEncoder(|values, axis| {
        Box::new(Swing::new(1e-6 * values[0], axis.mechanics.lead_m, values[1]))
    }),
};
