//! What nearly every axis has a little of and few machine files know: friction that rises with the speed, and a force that
//! is always there.
//!
//! ```text
//!   base and both ─► whatever else is missing ─► each of both: is it sure, and needed? ─► named, or left with the base
//! ```
//!
//! Left out they bend the base, and what they leave hides what is small and lends itself to what is not there. So they are
//! fitted from the beginning, as parameters of the base; named they are in the end (`told`), by the gates that every effect
//! has to pass.
//! Invariant: what the machine file knows is not there twice.

use super::{Model, Tried};
use crate::plant::effects::{Entry, entry};

/// Names of these effects.
const USUAL: [&str; 2] = ["viscous-friction", "constant-force"];

/// A base with these effects, of no size, but for those that its machine file knows.
pub(in crate::offline::gap) fn with(start: &Model) -> Model {
    let plant = &start.nominal;
    let is_known = |entry: &Entry| match entry.name {
        "viscous-friction" => plant.friction.viscous_n_s_per_m != 0.0,
        name => plant.effects.present().any(|(known, _)| known.name == name),
    };
    let entries = USUAL.iter().filter_map(|name| entry(name)).filter(|entry| !is_known(entry));
    entries.fold(start.clone(), |model, entry| model.with(Tried { entry, values: Default::default() }))
}

/// Whether an effect is one of them.
pub(in crate::offline::gap) fn is_usual(entry: &Entry) -> bool {
    USUAL.contains(&entry.name)
}
