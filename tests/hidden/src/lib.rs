//! Machines with an effect that their machine file does not know, as measured data with the truth beside them, and
//! the score of who names it.
//!
//! ```text
//!   seed ──► machine ──► runs ──► rows ──► CSV             what is judged reads these
//!              │  effect ──┘                 machine file
//!              └─► signature ──► severity    truth.json     what judges reads this
//! ```
//!
//! The physics is written a second time on purpose: RK4 at a fine step, friction by events instead of maps, springs
//! that slip instead of an internal state, no line of the product. What judges a model must be able to disagree with
//! it.
//! Invariant: a seed gives the same cases to the bit; nothing here depends on the product.

pub mod axis;
pub mod case;
pub mod controller;
pub mod effect;
pub mod features;
pub mod linear;
pub mod machine;
pub mod machine_file;
pub mod path;
pub mod plan;
pub mod plant;
pub mod rig;
pub mod score;
pub mod session;
pub mod severity;
pub mod trace;
