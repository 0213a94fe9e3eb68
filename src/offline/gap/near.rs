//! What lies near the best explanation, and what of it the rows tell apart after all.
//!
//! Invariant: the best is the deepest, and effects that no data of this kind tell apart stay together.

use rayon::prelude::*;

use super::fit::Fitted;
use super::gates::{Candidate, PLAIN};
use super::name::RunnerUp;
use super::refit::scale;
use crate::plant::effects::CATALOGUE;

/// Candidates whose evidence is nearer than this, or than this share, cannot be told apart.
const NEAR: (f64, f64) = (20.0, 0.02);
/// The same share where noise is taken for louder than it is: all of these are fitted to the bottom.
pub(super) const ROUGHLY: f64 = 0.15;

/// How far behind a candidate with this evidence others are not told from it.
pub(super) fn margin(evidence: f64) -> f64 {
    NEAR.0.max(NEAR.1 * evidence)
}

/// Whether no data of this kind tell one effect from another.
pub(super) fn is_alias(name: &str, other: &str) -> bool {
    CATALOGUE.iter().any(|entry| {
        (entry.name == name && entry.aliases.contains(&other))
            || (entry.name == other && entry.aliases.contains(&name))
    })
}

/// Candidates that explain nearly as much as the best, at their bottoms.
pub(super) struct Near {
    /// The best first.
    pub(super) class: Vec<Candidate>,
    /// The best.
    pub(super) model: Fitted,
    /// The next that their bottoms tell from it.
    pub(super) told_apart: Option<RunnerUp>,
}

impl Near {
    /// Fits each to the bottom: a coarse fit, and a search where noise is louder than it is, may not tell what rows do. Those with
    /// `least` evidence and less are only near in such a search.
    pub(super) fn of(
        (near, least): (Vec<Candidate>, f64),
        to_the_bottom: &(dyn Fn(&Candidate) -> Fitted + Sync),
        without: &Fitted,
        rows: usize,
    ) -> Self {
        let ends: Vec<Fitted> = near.par_iter().map(to_the_bottom).collect();
        let mut ends: Vec<(Candidate, Fitted)> = near.into_iter().zip(ends).collect();
        ends.sort_by(|a, b| a.1.total.total_cmp(&b.1.total));
        let scale = scale(ends[0].1.cost, rows);
        let numbers = |end: &Fitted| end.model.coordinate_count();
        let price = |end: &Fitted| end.total / scale + numbers(end) as f64 * (rows.max(1) as f64).ln();
        ends.sort_by(|a, b| price(&a.1).total_cmp(&price(&b.1)));
        let model = ends[0].1.clone();
        let margin = margin((without.total - model.total) / scale);
        let behind = |end: &Fitted| price(end) - price(&model);
        let best = ends[0].0.name();
        // What no data tell apart ends elsewhere by chance, and so does by a little what was near before.
        let is_apart = |(candidate, end): &(Candidate, Fitted)| {
            // More numbers that say no more are no other explanation.
            let has_more = numbers(end) > numbers(&model);
            let was_far = candidate.evidence <= least || end.cost > PLAIN * model.cost;
            let is_behind = has_more || (behind(end) > margin && was_far);
            is_behind && !is_alias(best, candidate.name())
        };
        let (apart, ends): (Vec<_>, Vec<_>) = ends.into_iter().partition(is_apart);
        let told_apart = apart.first().map(|(candidate, end)| RunnerUp {
            name: candidate.name(),
            behind: behind(end),
            failed: Vec::new(),
        });
        Self { class: ends.into_iter().map(|(candidate, _)| candidate).collect(), model, told_apart }
    }
}
