//! What is noise, and what a run would have been: the first of the five steps.
//!
//! ```text
//!   repeats ──────────────► floor: noise as a process, less lines and what counts of encoders hide
//!   commands ─────────────► forward: loops and plant ──► what the axis would have done, within its limits
//!   measured positions ───► controller: loops alone ───► the current that they ask for
//! ```
//!
//! Invariant: noise is what passes of one command differ by, never what a model leaves.

pub mod controller;
pub(super) mod counted;
pub(super) mod counts;
pub mod floor;
pub mod forward;
pub mod limits;
mod lines;
pub(super) mod power;
mod process;
