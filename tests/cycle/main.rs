//! The shipped cycle, and machines simulated in memory around it: what it does with all that is ordered and all that fails.

mod candump;
#[path = "../common/circle_run.rs"]
#[expect(dead_code, reason = "the seed is chosen by each test")]
mod circle_run;
mod closed_loop;
#[path = "../common/mod.rs"]
mod common;
mod corrupted;
mod determinism;
mod encoder_jumps;
mod ending;
#[path = "../common/eventful.rs"]
mod eventful;
mod excitation;
mod experiments;
mod faults;
mod limits;
mod live_rack;
mod lock_step;
mod replay;
