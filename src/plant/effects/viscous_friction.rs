//! Viscous friction: more of the rise `m` of Eq. (1) with the speed, of grease and seals.
//!
//! Invariant: adds to the law's own parameter, so that control and identification know it as well.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::Action;
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "viscous-friction",
    summary: "friction that rises with the speed",
    equation: "F(v) + b (|v| - D_v)",
    parameters: &[Parameter::new("viscous-n-s-per-mm", "N s/mm", [0.0, 1_000.0], 2.0, 2.0)],
    coordinate: Coordinate::Velocity,
    experiment: Experiment::Sweep,
    aliases: &[],
    law_of: None,
    action: Action::Parameter(|values, axis| axis.friction.viscous_n_s_per_m += 1e3 * values[0]),
};
