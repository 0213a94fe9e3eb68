//! Which runs judge: those that no model is fitted to.
//!
//! Invariant: runs of one command are on the same side.

use std::collections::BTreeMap;

use super::Run;
use super::circles::circles_of;
use super::repeat::{Repeat, What};
use crate::base::axis::AxisId;

/// Which runs have the same command: a number for each run.
pub(in crate::offline::gap) fn groups(runs: &[Run], repeats: &[Repeat]) -> Vec<usize> {
    let mut groups: Vec<usize> = (0..runs.len()).collect();
    for repeat in repeats.iter().filter(|repeat| repeat.what == What::Run) {
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
pub(in crate::offline::gap) fn held_groups(runs: &[Run], groups: &[usize]) -> Option<Vec<usize>> {
    let is_called = |run: &Run| ["held", "holdout"].iter().any(|word| run.name.to_lowercase().contains(word));
    let called: Vec<usize> =
        runs.iter().zip(groups).filter(|(run, _)| is_called(run)).map(|(_, group)| *group).collect();
    if !called.is_empty() && called.len() < runs.len() {
        return Some(called);
    }
    // Small reversals and strokes of two axes at once are none: how a table creeps in them is left to chance, and they would judge alone.
    let feed = |run: &Run| {
        let [x, y] = [AxisId::X, AxisId::Y].map(|id| run.axes.get(&id));
        let found = circles_of(run.period_s, [&x?.setpoint_m, &y?.setpoint_m]);
        found.first().map(|(circle, _)| circle.feed.as_mm_per_min())
    };
    let mut circles: BTreeMap<usize, f64> = BTreeMap::new();
    for (run, group) in runs.iter().zip(groups) {
        if let Some(feed) = feed(run) {
            circles.entry(*group).or_insert(feed);
        }
    }
    if circles.len() < 3 {
        return None;
    }
    let mut by_feed: Vec<(usize, f64)> = circles.into_iter().collect();
    by_feed.sort_by(|a, b| a.1.total_cmp(&b.1));
    Some(vec![by_feed[by_feed.len() / 2].0])
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    const PERIOD_S: f64 = 5e-4;

    /// A run of two axes whose setpoints are so at a time.
    fn run(seconds: f64, at: impl Fn(f64) -> [f64; 2]) -> Run {
        let rows = (seconds / PERIOD_S) as usize;
        let column = |which: usize| (0..rows).map(|row| at(row as f64 * PERIOD_S)[which]).collect();
        Run::of_setpoints(PERIOD_S, [(AxisId::X, column(0)), (AxisId::Y, column(1))])
    }

    #[test]
    fn the_middle_feed_of_circles_judges_and_nothing_else_that_two_axes_do_at_once() {
        let circle = |feed_m_per_s: f64| {
            let turn_s = TAU * 0.012 / feed_m_per_s;
            run(2.2 * turn_s, |t_s| {
                let angle = TAU * t_s / turn_s;
                [0.012 * angle.cos(), 0.012 * angle.sin()]
            })
        };
        // Along a line, with speeds between those of the circles.
        let strokes =
            |amplitude_m: f64| run(6.0, |t_s| [1.0, 0.8].map(|of| of * amplitude_m * (TAU * t_s).sin()));
        let runs = [strokes(0.004), circle(0.03), strokes(0.008), circle(0.15), circle(0.06)];
        let groups = groups(&runs, &[]);
        assert_eq!(held_groups(&runs, &groups), Some(vec![4]));
        assert_eq!(held_groups(&runs[..4], &groups[..4]), None, "two circles have none between them");
    }
}
