//! Reversal compensation: a control that pushes by itself once its command has turned back, as many do against
//! the quadrant glitch, and nobody told. The measured current shows it. With an exponent of 1 the push fades as a time constant
//! lets it, and none fades faster at first; with a large one it is even.
//!
//! Invariant: nothing before the first reversal.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::Action;
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "reversal-compensation",
    summary: "a control that pushes by itself after a reversal of its command",
    equation: "i_c + A sign(v_set) exp(-(t / T)^n)",
    parameters: &[
        // Along the new way: against it a control would make the glitch that it is there to mend.
        Parameter::new("current-a", "A", [0.0, 100.0], 0.5, 0.5),
        Parameter::new("decay-ms", "ms", [1.0, 1_000.0], 20.0, 20.0),
        Parameter::new("exponent", "", [1.0, 20.0], 1.0, 2.0),
    ],
    coordinate: Coordinate::TimeSinceReversal,
    experiment: Experiment::Circles,
    aliases: &[],
    law_of: None,
    action: Action::Control(|values, otherwise| {
        otherwise.pulse_a = values[0];
        otherwise.decay_s = 1e-3 * values[1];
        otherwise.exponent = values[2];
    }),
};
