//! A run of one axis, and which of its rows models are fitted to and judged by.
//!
//! Invariant: a row is of one part at most.

use super::problem::SIGNALS;
use crate::offline::gap::measure::floor::Loudness;
use crate::offline::gap::measure::forward::{Course, Signals};

/// A run of one axis.
#[derive(Clone, Debug)]
pub struct AxisData {
    /// Which run.
    pub run: usize,
    /// Its first row in that run: an axis that has nothing to do yet begins later.
    pub from: usize,
    /// Its command.
    pub course: Course,
    /// What was measured.
    pub measured: Signals,
    /// How much louder than the floor the noise of each signal is, row by row; empty where it is as loud.
    pub loudness: [Loudness; SIGNALS.len()],
    /// Power of what a model that is nearly right is off by there, in that of the floor; empty where it is straight.
    pub bend: [Vec<f64>; SIGNALS.len()],
    /// By how much noise of the torque moves the mean of each signal there; empty where it was not asked.
    pub moved: [Vec<f64>; SIGNALS.len()],
    /// Rows that models are fitted to.
    pub fit: Vec<bool>,
    /// Rows that no model is fitted to: they judge it.
    pub held: Vec<bool>,
    /// After so many rows its command only repeats what this run or one before it has had.
    pub first_pass: usize,
    /// Runs of the same command have the same number.
    pub command: usize,
}

/// Which rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Those that models are fitted to.
    Fit,
    /// Those that judge them.
    Held,
}

impl AxisData {
    /// The rows of a part.
    pub fn rows(&self, part: Part) -> &[bool] {
        match part {
            Part::Fit => &self.fit,
            Part::Held => &self.held,
        }
    }

    /// The part that tells what is left of it: that which models are fitted to, if it has one.
    pub fn main_part(&self) -> Part {
        if self.has(Part::Fit) { Part::Fit } else { Part::Held }
    }

    /// Whether it has any.
    pub fn has(&self, part: Part) -> bool {
        self.rows(part).contains(&true)
    }
}
