//! What closes the circle of the work on one machine: the circle before, the circles after, and whether the new gains
//! are kept.
//!
//! ```text
//!   trace, circular test ──► CircleFigures ──► objections ──► none: the gains are written
//! ```
//!
//! [`figures`] takes from a run what is compared, [`verdict`] compares. The steps themselves run the machine and
//! are the verb's. Invariant: gains without objection are better in the highest protrusion and worse in nothing
//! that is compared.

pub mod figures;
pub mod verdict;

pub use figures::{AxisFigures, CircleFigures};
pub use verdict::{no_better, worse};
