//! Quadrant: the controller that runs on the Linux PC beside a machine tool.
//!
//! The floors, from the ground up; a floor imports only from those above it in this list
//! (`tests/tidy` holds them to it, `ARCHITECTURE.md` tells the story):

pub mod base; //    words: units, time, axis, sample, setpoint, command, fault, record
pub mod plant; //   friction, mechanics, actuator, encoder: the physics, written once
pub mod rt; //      real time: bus, wire, drive, control, cycle
pub mod sim; //     the machine in memory
pub mod config; //  machine files become checked settings
pub mod candump; // frames as text, as can-utils writes them
#[cfg(feature = "log")]
pub mod log; //     records to MCAP and back: where online and offline meet
#[cfg(feature = "run")]
pub mod run; //     what a run needs before its first cycle
#[cfg(feature = "service")]
pub mod service; // the daemon around the cycle
#[cfg(feature = "offline")]
pub mod offline; // logs in, numbers, pictures and pages out
#[cfg(feature = "cli")]
pub mod cli; //     the verbs of the tool
