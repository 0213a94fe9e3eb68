//! Promise: on a CAN interface of Linux the bus does what `rt/bus` says, and the simulated machine behind it
//! gives the numbers of the one in memory.
//!
//! Needs a virtual interface: run it by `tests/vcan/with-vcan`, which says where. Without one each test says
//! loudly that it was skipped, and the last line of the output must be read with that in mind.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod rig;

mod clock;
mod flood;
#[path = "../common/heap.rs"]
mod heap;
mod frames;
mod interface;
mod machine;
mod playback;
mod scenarios;
mod slow;
mod times;
mod tools;
