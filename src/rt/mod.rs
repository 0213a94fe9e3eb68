//! Real time: frames in, samples, control, commands, frames out.
//!
//! Everything here runs inside the cycle or prepares for it. Settings are given at construction,
//! state is small and fixed in size, time is an argument.
//! Invariant: no heap after construction, no lock, no formatting, no clock read, no panic path in
//! what the cycle calls.

pub mod bus; //  frames in and out
pub mod drive; // frame to sample, command to frame
pub mod wire; // bytes to meaning and back
