//! Real time: frames in, samples, control, commands, frames out.
//!
//! Everything here runs inside the cycle or prepares for it. Settings are given at construction,
//! state is small and fixed in size, time is an argument; only `cycle/pace.rs` reads the clock.
//! Invariant: no heap after construction, no lock, no formatting, no panic path in what the cycle
//! calls. `clippy.toml` lists what that forbids, and it is denied from here down.

#![cfg_attr(not(test), deny(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types))]

pub mod bus; //     frames in and out
pub mod control; // sample to command: loops, feed-forward, limits, profile
pub mod cycle; //   the conductor: one period, the modes, the pace
pub mod door; //    orders in, records out
pub mod drive; //   frame to sample, command to frame
pub mod wire; //    bytes to meaning and back
