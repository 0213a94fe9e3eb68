//! What is said of an axis in the end: a word, numbers and circles, before and after.
//!
//! ```text
//!   what was named ─┬► verdict: a word, and the gap before and after ─┬► answer ──► contour: what it does to circles
//!                   └► consequence: what would show that it is none ──┘
//! ```
//!
//! Invariant: numbers are of rows that no model was fitted to.

pub mod answer;
pub mod consequence;
pub mod contour;
pub mod verdict;
