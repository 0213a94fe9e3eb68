//! The gap: where simulation and measurement disagree, which physical effect is missing, and proof that the gap
//! shrinks with it.
//!
//! ```text
//!   runs ──► measure ──► locate ──► name ──► add ──► show
//!            floor,      controller, joint    machine held-out runs from their
//!            residuals   coordinate  fits     file    command, before and after
//! ```
//!
//! [`intake`] looks at data, and [`logged`] at logs, before they are believed as [`runs`], of one kind of `motions` each;
//! an axis is [`asked`] with its runs and a base;
//! [`limits`] that these go beyond are lifted; `sparse` fills in what the loops were given where a log has not every cycle; [`floor`] finds the noise, a `process`, in
//! [`repeats`], of each of which [`mod@repeat`] says what comes again, as the `laps` of a run do, and `counts` what no encoder resolves, of which `counted` tells what the loops answer; [`forward`] runs the machine file from the command alone and [`controller`] its loops alone; [`fit`] fits a
//! [`model`] in closed loop to a [`problem`], by its derivatives ([`linear`]), first where the axis is `moving` and then where the model
//! is `straight`, with what noise does to means where its torque is `shaken`; `levels` say how loud a signal is; [`clocks`] are set where files have none in common; [`locate`] tells where the gap lives;
//! [`shortlist`], which holds `trials` against what is left, of phases `turned` by thirds and by their `sums`, and knows what is the [`smallest`] to be seen, and [`mod@name`] find the effects, in a `search` from one to the next that says where it has come to `stand`, [`named`] as they are, which have to pass the [`gates`] and to be needed (`without`), and name last what
//! nearly every axis has (`usual`) but for the `little` that every axis has; at its bottom an effect is begun once more `elsewhere`; `foretold`, `bursts` and, of all axes together, [`behind`] tell whether a [`rest`] is left that is something real, and [`verdict`] says it in a word; [`contour`] and [`consequence`] show what it does to circles, and what would
//! falsify it; `circles` are found in the setpoints; [`write_back`] adds them to the machine file. [`demo`] is a machine to show it on.
//! Invariant: what is named was better on rows that no model had seen, and what cannot be told apart is named together.

mod along;
pub mod analysis;
pub mod asked;
pub mod behind;
mod blocks;
mod bursts;
pub mod candidate;
mod circles;
pub mod clocks;
pub mod consequence;
pub mod contour;
pub mod controller;
mod counted;
mod counts;
pub mod crossed;
pub mod demo;
mod elsewhere;
pub mod fit;
pub mod floor;
mod foretold;
pub mod forward;
pub mod gates;
mod grid;
mod held;
pub mod intake;
pub mod judged;
mod kicks;
mod laps;
mod levels;
pub mod limits;
mod lines;
mod little;
pub mod linear;
pub mod locate;
pub mod logged;
mod look;
mod louder;
pub mod model;
mod motions;
mod moving;
pub mod name;
pub mod named;
mod near;
pub mod nearby;
pub mod plan;
pub mod problem;
mod process;
mod refit;
pub mod repeat;
pub mod repeats;
pub mod rest;
pub mod runs;
mod search;
mod secant;
mod sensors;
mod shaken;
pub mod shortlist;
pub mod smallest;
mod sparse;
pub mod spectrum;
mod spots;
mod stand;
pub mod steps;
mod straight;
mod sums;
mod tones;
mod trials;
mod turned;
pub mod twin;
mod usual;
pub mod verdict;
mod without;
pub mod write_back;
pub mod zeros;
