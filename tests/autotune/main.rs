//! Promise: gains that are tuned on what experiments tell of a machine are as good on the machine as those tuned with
//! its true parameters; `quadrant autotune` asks before it moves, and writes only what a circle has shown to be better.
//!
//! What takes long is ignored here and run by `.ci/run`, optimised.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

#[path = "../common/mod.rs"]
#[expect(dead_code, reason = "a test uses the part it needs")]
mod common;
#[path = "../common/machine_file.rs"]
mod machine_file;
#[path = "../identify_log/machines.rs"]
#[expect(dead_code, reason = "what is believed here is the file alone")]
mod machines;
#[path = "../common/tool.rs"]
#[expect(dead_code, reason = "logs are named")]
mod tool;

mod command;
mod unknown;
