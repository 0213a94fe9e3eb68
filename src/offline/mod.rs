//! Analysis: logs in, numbers and files out. Nothing here runs while a machine moves.
//!
//! Order of the work: records become a [`trace`], the trace of a circular path is judged by
//! [`circle`], [`draw`] makes the pictures and [`report`] puts numbers and pictures on one page.
//!
//! Any log goes through today's cycle again in [`replay`], or its boards speak to a live host again in
//! [`playback`]; [`traffic`] turns logs into frames and back. [`simulated`] runs any programme in memory.
//!
//! [`tune`] looks for gains, by the shipped loops and the plant themselves ([`closed_axis`]).
//!
//! What a machine file implies before anything runs is in [`check`], from the figures of its
//! [`loops`] ([`margins`]).
//! Invariant: pure functions of their input (the one exception writes the finished report); the same
//! input gives the same bytes.

pub mod autotune;
pub mod check;
pub mod circle;
pub mod closed_axis;
pub mod draw;
pub mod gap;
pub mod hil;
pub mod identify;
pub mod loops;
pub mod margins;
pub mod playback;
pub mod recorded;
pub mod replay;
pub mod report;
mod median;
mod product;
mod running_mean;
pub mod simulated;
pub mod trace;
pub mod traffic;
pub mod tune;
