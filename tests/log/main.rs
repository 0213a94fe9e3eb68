//! The promises of a log: what was recorded is what is read, whatever happened to disk, process or
//! file in between.
#![cfg(feature = "log")]
#![expect(clippy::unwrap_used, reason = "a test stops at the first surprise")]

mod damage;
mod disk;
mod example;
mod kill;
mod round_trip;
mod tools;
