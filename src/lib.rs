//! Quadrant: the controller that runs on the Linux PC beside a machine tool.
//!
//! The floors, in the order the work flows; imports point down this list only in the other
//! direction (`tests/tidy.rs` holds them to it, `ARCHITECTURE.md` tells the story):

pub mod base; //    words: units, time, axis, sample, setpoint, command, fault, record

#[cfg(feature = "offline")]
pub mod offline; // analysis: logs in, numbers and pictures out
