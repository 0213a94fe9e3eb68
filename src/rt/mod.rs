//! Real time: frames in, samples, control, commands, frames out.
//!
//! Everything here runs inside the cycle or prepares for it. Settings are given at construction,
//! state is small and fixed in size, time is an argument; only pace and a real bus read a clock.
//! Invariant: in what the cycle calls no heap after construction, no lock, no formatting, and no panic
//! but for a bug or a clock that fails. From here down the lints deny the calls that `clippy.toml` lists,
//! `panic!`, `unwrap` and `expect`; `assert!`, an index and arithmetic they do not see.

#![cfg_attr(not(test), deny(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types))]
#![cfg_attr(not(test), deny(clippy::panic, clippy::expect_used, clippy::unwrap_used))]

pub mod clock; //   the clocks of the system
pub mod bus; //     frames in and out
pub mod wire; //    bytes to meaning and back
pub mod drive; //   frame to sample, command to frame
pub mod control; // sample to command: loops, feed-forward, limits, profile
pub mod door; //    orders in, records out
pub mod cycle; //   the conductor: one period, the modes, the pace
pub mod thread; //  the set-up before: scheduling, locked memory, a processor that stays awake
