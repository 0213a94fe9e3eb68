//! Analysis: logs in, numbers and files out. Nothing here runs while a machine moves.
//!
//! Order of the work: records become a [`trace`], which the analyses read.
//!
//! Invariant: pure functions of their input; the same input gives the same bytes.

pub mod trace;
