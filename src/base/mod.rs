//! Ground floor: the words every other floor speaks.
//!
//! Plain `Copy` types with no behaviour beyond algebra: quantities with their units, moments and
//! spans, axes, frames, and the record of one control cycle. What reads a clock, a file or the meaning
//! of a frame does not belong here.
//!
//! Invariant: imports nothing of ours; no floor is too low to use it.

pub mod axis;
pub mod command;
pub mod fault;
pub mod frame;
pub mod input;
pub mod motion;
pub mod order;
pub mod record;
pub mod sample;
pub mod setpoint;
pub mod time;
pub mod units;
