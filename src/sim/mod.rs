//! The machine in memory: what stands at the other end of the bus when there is no machine.
//!
//! The shipped `rt` code runs against it unchanged; only bus and clock are replaced.
//! Invariant: no wall clock, no socket; everything random has a seed.

pub mod board; //       a board and its drive, seen from the bus
mod axis; //            a board, its plant and the sensors between them
pub mod rack; //        all boards of a machine, in virtual time
pub mod live_rack; //   the same on the wall clock
pub mod script; //      what goes wrong, and when
pub mod closed_loop; // the shipped cycle and a rack in one process
pub mod truth; //       what the axes really did, told beside the bus
pub mod session; //     a rack behind a bus of another process
