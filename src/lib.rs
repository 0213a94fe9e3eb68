//! Quadrant: the controller that runs on the Linux PC beside a machine tool.
//!
//! The floors, in the order the work flows; imports point down this list only in the other
//! direction (`tests/tidy.rs` holds them to it, `ARCHITECTURE.md` tells the story):

pub mod base; //    words: units, time, axis, sample, setpoint, command, fault, record
#[cfg(feature = "cli")]
pub mod cli;
pub mod config; //  machine files become checked settings
#[cfg(feature = "log")]
pub mod log; //     records to MCAP and back: where online and offline meet
#[cfg(feature = "offline")]
pub mod offline; // logs in, numbers, pictures and pages out
pub mod plant; //   friction, mechanics, actuator, encoder: the physics, written once
pub mod rt; //      real time: bus, wire, drive, control, cycle
#[cfg(feature = "service")]
pub mod service; // the daemon around the cycle
pub mod sim; //     the machine in memory //     the verbs of the tool
