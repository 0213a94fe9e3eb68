//! What real axes have and the two-mass model lacks: one file for each effect, with its equation, its
//! parameters, where it acts and how far it may be believed.
//!
//! An effect that is absent costs nothing and changes no bit: its hook in the step is one branch.
//! Invariant: an effect never gives the axis energy of its own.

pub(super) mod backlash;
pub(super) mod ripple;
