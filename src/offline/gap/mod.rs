//! The gap: where simulation and measurement disagree, which physical effect is missing, and proof that the gap
//! shrinks with it.
//!
//! ```text
//!   runs ──► measure ──► locate ──► name ──► add ──► show
//!            floor,      controller, joint    machine held-out runs from their
//!            residuals   coordinate  fits     file    command, before and after
//! ```
//!
//! Folders, each of which imports from those above it alone:
//!
//! ```text
//!   runs       what was measured, looked at before it is believed; what comes again in it
//!   measure    noise from what comes again; a run simulated from its command, and its loops alone
//!   model      parameters and effects of an axis, what they leave of its runs, and derivatives of that
//!   fit        the model that leaves least
//!   locate     over which coordinate, and in which rows, something is left
//!   shortlist  which effects could explain it, each tried once
//!   gates      what an effect must pass, on rows that no fit has seen
//!   name       the search from one effect to the next, forwards and backwards
//!   show       verdict, gap in numbers, circles, what would falsify it
//! ```
//!
//! [`analysis`] puts the steps together, for axes that are [`asked`]; [`write_back`] adds what was named to the machine
//! file, [`plan`] has the runs that would show every effect, and [`demo`] a machine to show it on.
//! Invariant: what is named was better on rows that no model had seen, and what cannot be told apart is named together.

pub mod analysis;
pub mod asked;
pub mod demo;
pub mod fit;
pub mod gates;
pub mod locate;
pub mod measure;
pub mod model;
pub mod name;
pub mod plan;
pub mod runs;
pub mod shortlist;
pub mod show;
pub mod write_back;
