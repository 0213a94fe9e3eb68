//! Which runs judge: those that no model is fitted to.
//!
//! Invariant: runs of one command are on the same side.

use std::collections::BTreeMap;

use super::repeats::Repeat;
use super::runs::Run;

/// Which runs have the same command: a number for each run.
pub(super) fn groups(runs: &[Run], repeats: &[Repeat]) -> Vec<usize> {
    let mut groups: Vec<usize> = (0..runs.len()).collect();
    for repeat in repeats {
        let [first, second] = repeat.runs.map(|run| groups[run]);
        for group in &mut groups {
            if *group == second {
                *group = first;
            }
        }
    }
    groups
}

/// Runs that judge: those that are called so, or of three circles and more one whose feed lies between the others'.
pub(super) fn held_groups(runs: &[Run], groups: &[usize]) -> Option<Vec<usize>> {
    let is_called = |run: &Run| ["held", "holdout"].iter().any(|word| run.name.to_lowercase().contains(word));
    let called: Vec<usize> =
        runs.iter().zip(groups).filter(|(run, _)| is_called(run)).map(|(_, group)| *group).collect();
    if !called.is_empty() && called.len() < runs.len() {
        return Some(called);
    }
    let feed = |run: &Run| -> f64 {
        let steps = run.axes.values().map(|axis| {
            axis.setpoint_m.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max)
                / run.period_s
        });
        steps.fold(0.0, f64::max)
    };
    let is_circle = |run: &Run| {
        let moving = run
            .axes
            .values()
            .filter(|axis| axis.setpoint_m.iter().any(|at| (at - axis.setpoint_m[0]).abs() > 1e-4));
        moving.count() >= 2
    };
    let mut circles: BTreeMap<usize, f64> = BTreeMap::new();
    for (run, group) in runs.iter().zip(groups) {
        if is_circle(run) {
            circles.entry(*group).or_insert_with(|| feed(run));
        }
    }
    if circles.len() < 3 {
        return None;
    }
    let mut by_feed: Vec<(usize, f64)> = circles.into_iter().collect();
    by_feed.sort_by(|a, b| a.1.total_cmp(&b.1));
    Some(vec![by_feed[by_feed.len() / 2].0])
}
