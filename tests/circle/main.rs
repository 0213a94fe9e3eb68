//! A circular test judged and told.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod analysis;
#[path = "../common/circle_model.rs"]
mod circle_model;
mod report;
