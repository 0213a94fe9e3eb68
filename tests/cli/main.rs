//! The tool as its user runs it: results, exit codes, what it says to bad input, and what it leaves behind.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod circle;
mod gap;
mod hil;
mod identify;
mod identify_logs;
mod import;
mod logs;
#[path = "../common/machine_file.rs"]
mod machine_file;
#[path = "../common/tool.rs"]
mod tool;
mod tune;
