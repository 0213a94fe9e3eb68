//! An axis with its answer.
//!
//! Invariant: numbers and words are of the same model and the same runs.

use super::consequence::Consequence;
use super::verdict::{SignalGap, Verdict, verdict};
use crate::base::axis::AxisId;
use crate::offline::gap::locate::rest::Rest;
use crate::offline::gap::locate::{Located, RunLeft};
use crate::offline::gap::measure::controller::Match;
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::name::named::Named;
use crate::rt::drive::velocity::VelocityEstimate;

/// An axis with its answer.
pub struct AxisGap<'m> {
    /// Which axis.
    pub id: AxisId,
    /// Its runs.
    pub problem: Problem<'m>,
    /// How well the loops alone explain the current.
    pub controller: Option<Match>,
    /// What it lacks.
    pub named: Named,
    /// In a word.
    pub verdict: Verdict,
    /// What is left without a name and is something real.
    pub rest: Option<Rest>,
    /// Where it lives: over which coordinates what the base leaves has a shape.
    pub located: Vec<Located>,
    /// And in which runs.
    pub runs_left: Vec<RunLeft>,
    /// The gap in rms, by signal: before, after, floor; on the rows that were not fitted.
    pub gap: Vec<SignalGap>,
    /// What follows from each effect that was named, in their order.
    pub consequences: Vec<Option<Consequence>>,
}

impl AxisGap<'_> {
    /// It leaves something real.
    pub(in crate::offline::gap) fn leaves(&mut self, rest: Rest) {
        self.rest = Some(rest);
        self.verdict = verdict(&self.named, &self.gap, true, self.problem.is_noise_told());
    }

    /// How its loops see the velocity, where that is not as the machine file says.
    pub fn other_estimate(&self) -> Option<VelocityEstimate> {
        let filed = self.problem.machine.axes[self.id].velocity_estimate;
        self.controller.map(|found| found.velocity_estimate).filter(|seen| *seen != filed)
    }
}
