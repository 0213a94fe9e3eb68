//! Real time.
pub mod control;
