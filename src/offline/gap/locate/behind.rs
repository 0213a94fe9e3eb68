//! Where all axes are behind their commands by the same time: somebody turned the feed down, or a command was held, and no axis is
//! to blame.
//!
//! ```text
//!   what is left of the following errors e ──► d of each block of a run: the best of  e = d v  for all axes at once
//! ```
//!
//! An effect of one axis shows in that, and what is wrong with two of them is not in step with both their velocities. What an axis is
//! behind all the time is a lag of its own.
//! Units: m, s. Invariant: an axis alone tells nothing.

use std::collections::BTreeMap;

use super::rest::Rest;
use crate::offline::gap::measure::forward::FOLLOWING_ERROR;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::problem::Problem;
use crate::offline::gap::runs::Run;
use crate::offline::median::median;

/// Rows of so long are one mean, and so many of these a block; blocks lap over by half. s.
const MEAN_S: f64 = 0.025;
const BLOCK: usize = 16;
/// An axis that is slower says nothing of it, m/s.
const SLOW_M_PER_S: f64 = 1e-3;
/// A feed that somebody turned leaves axes further behind, s: by less two models of the same loops differ, which shows on quiet encoders.
const LEAST_S: f64 = 1e-6;
/// What all axes explain together, and each by itself, as sums of squares in what is usually left. Where nobody turned the feed the most
/// was 12 and 4.
const GAIN: f64 = 100.0;
const EACH: f64 = 25.0;
/// Share of that by which times of axes may differ, and share of what is left that one time explains at least: in each block of a
/// stretch, and in one of them.
const APART: f64 = 0.15;
const EXPLAINED: [f64; 2] = [0.5, 0.6];

/// A stretch of a run in which all axes are behind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Behind {
    /// Which run.
    pub run: usize,
    /// Its first row there, and that after its last.
    pub rows: [usize; 2],
    /// By how much at most, s; ahead if it is less than zero.
    pub by_s: f64,
}

impl Behind {
    /// Runs in which these rows are none that anybody believes.
    pub(in crate::offline::gap) fn without(all: &[Self], runs: &[Run]) -> Vec<Run> {
        let mut runs = runs.to_vec();
        for Self { run, rows: [from, to], .. } in all {
            let to = runs[*run].len().min(*to);
            runs[*run].is_sound[*from..to].fill(false);
        }
        runs
    }
}

/// What is left of all axes where they are behind, if they are.
pub(in crate::offline::gap) fn rest(all: &[Behind]) -> Option<Rest> {
    let by_s = all.iter().map(|one| one.by_s).reduce(further)?;
    Some(Rest::Behind { runs: all.len(), by_s })
}

/// The time that is further from none.
fn further(a: f64, b: f64) -> f64 {
    if b.abs() > a.abs() { b } else { a }
}

/// A mean: what is left of the following error, and the velocity that was asked for; by number, of those that count.
type Means = BTreeMap<usize, [f64; 2]>;

/// The stretches in which all axes are behind, one of a run, by the runs of each and a model of it.
pub(in crate::offline::gap) fn behind(axes: &[(&Problem<'_>, &Model)]) -> Vec<Behind> {
    let Some(period_s) = axes.first().map(|(problem, _)| problem.period_s()) else {
        return Vec::new();
    };
    let rows = ((MEAN_S / period_s) as usize).max(1);
    let of_axis = |(problem, model): &(&Problem<'_>, &Model)| -> BTreeMap<usize, Means> {
        let of_run = |place: usize| (problem.data[place].run, means(problem, model, place, rows));
        (0..problem.data.len()).map(of_run).collect()
    };
    let all: Vec<BTreeMap<usize, Means>> = axes.iter().map(of_axis).collect();
    stretches(&all)
        .into_iter()
        .map(|Behind { run, rows: means, by_s }| Behind { run, rows: means.map(|mean| mean * rows), by_s })
        .collect()
}

/// Means of so many rows of a run.
fn means(problem: &Problem<'_>, model: &Model, place: usize, rows: usize) -> Means {
    let (data, simulated) = (&problem.data[place], problem.simulated(place, model));
    let left = problem.left(place, &simulated, FOLLOWING_ERROR, Part::Fit);
    let speeds: Vec<f64> = data.course.setpoints().map(|setpoint| setpoint.velocity.as_m_per_s()).collect();
    let first = data.from.div_ceil(rows);
    let of = |number: usize| {
        let own = number * rows - data.from..(number + 1) * rows - data.from;
        let counts = own.clone().all(|row| data.fit[row] || data.held[row]);
        let mean = |of: &[f64]| of[own.clone()].iter().sum::<f64>() / rows as f64;
        counts.then(|| (number, [mean(&left), mean(&speeds)]))
    };
    (first..(data.from + data.fit.len()) / rows).filter_map(of).collect()
}

/// The same in numbers of means, of the runs of all axes.
fn stretches(axes: &[BTreeMap<usize, Means>]) -> Vec<Behind> {
    if axes.len() < 2 {
        return Vec::new();
    }
    let scaled: Vec<BTreeMap<usize, Means>> = axes.iter().filter_map(as_usual).collect();
    let mut found: Vec<(Behind, f64)> = Vec::new();
    let runs: Vec<usize> = scaled.iter().flat_map(BTreeMap::keys).copied().collect();
    for run in 0..=runs.into_iter().max().unwrap_or(0) {
        let of_run: Vec<&Means> = scaled.iter().filter_map(|axis| axis.get(&run)).collect();
        let last = of_run.iter().filter_map(|means| means.keys().last()).max().copied().unwrap_or(0);
        for from in (0..=last).step_by(BLOCK / 2).filter(|from| goes_on(axes, run, *from)) {
            let Some([by_s, explained]) = together(&of_run, from) else { continue };
            let rows = [from, from + BLOCK];
            match found.last_mut().filter(|(other, _)| other.run == run) {
                // What is between two of them is of the same.
                Some((other, most)) => {
                    other.rows[1] = rows[1];
                    other.by_s = further(other.by_s, by_s);
                    *most = most.max(explained);
                }
                None => found.push((Behind { run, rows, by_s }, explained)),
            }
        }
    }
    found.into_iter().filter(|(_, explained)| *explained > EXPLAINED[1]).map(|(stretch, _)| stretch).collect()
}

/// Whether some axis moves all through a block of a run: those that break away together, or come to rest, are behind for once as well.
fn goes_on(axes: &[BTreeMap<usize, Means>], run: usize, from: usize) -> bool {
    let of_run = || axes.iter().filter_map(|axis| axis.get(&run));
    let moves = |number| of_run().filter_map(|means| means.get(&number)).any(|[_, v]| v.abs() > SLOW_M_PER_S);
    (from..from + BLOCK).all(moves)
}

/// Means of an axis without the lag that it has all the time, in what is usually left of it; nothing of one that never moves.
fn as_usual(runs: &BTreeMap<usize, Means>) -> Option<BTreeMap<usize, Means>> {
    let moving = || runs.values().flat_map(BTreeMap::values).filter(|[_, v]| v.abs() > SLOW_M_PER_S);
    let lag_s = median(&mut moving().map(|[e, v]| e / v).collect::<Vec<f64>>())?;
    let left = |[e, v]: &[f64; 2]| e - lag_s * v;
    let usual = median(&mut moving().map(|mean| left(mean).abs()).collect::<Vec<f64>>())?;
    // Of normal noise, half is within two thirds of a standard deviation.
    let scale = f64::max(1.4826 * usual, f64::MIN_POSITIVE);
    let scaled = |means: &Means| -> Means {
        means.iter().map(|(number, mean)| (*number, [left(mean) / scale, mean[1] / scale])).collect()
    };
    Some(runs.iter().map(|(run, means)| (*run, scaled(means))).collect())
}

/// By how much all axes of a run that move in a block are behind, where it is one time for all of them, and sure; and what share of what
/// is left that explains.
fn together(axes: &[&Means], from: usize) -> Option<[f64; 2]> {
    let (mut sums, mut power) = (Vec::new(), 0.0);
    for means in axes {
        let block: Vec<[f64; 2]> = means.range(from..from + BLOCK).map(|(_, mean)| *mean).collect();
        if block.len() < BLOCK {
            return None;
        }
        let sum = |of: fn(&[f64; 2]) -> f64| block.iter().map(of).sum::<f64>();
        power += sum(|[e, _]| e * e);
        sums.push([sum(|[e, v]| e * v), sum(|[_, v]| v * v)]);
    }
    let own: Vec<f64> = sums.iter().map(|[ev, vv]| ev * ev / f64::max(*vv, f64::MIN_POSITIVE)).collect();
    let [ev, vv] = sums.iter().fold([0.0; 2], |all, one| [all[0] + one[0], all[1] + one[1]]);
    let gain = ev * ev / f64::max(vv, f64::MIN_POSITIVE);
    let is_sure = axes.len() > 1
        && gain > f64::max(GAIN, EXPLAINED[0] * power)
        && own.iter().all(|own| *own > EACH)
        && own.iter().sum::<f64>() - gain < APART * gain;
    (is_sure && (ev / vv).abs() > LEAST_S).then_some([ev / vv, gain / power])
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::base::axis::AxisId;

    const MEANS: usize = 400;

    /// Three runs of two axes on a circle with noise of a tenth of a micrometre, of which each axis is behind in the second by these times
    /// from a tenth of it to the third.
    fn circles(behind_s: [f64; 2], lag_s: f64) -> Vec<BTreeMap<usize, Means>> {
        let mut random = Pcg64Mcg::seed_from_u64(6);
        let axis = |axis: usize| {
            let mut means = |run: usize| -> Means {
                let mean = |number: usize| {
                    let at = TAU * number as f64 / 100.0 + 0.25 * TAU * axis as f64;
                    let late = run == 1 && (MEANS / 10..MEANS / 3).contains(&number);
                    let v = 0.05 * at.sin();
                    let noise = 1e-7 * ((0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0);
                    (number, [noise + (lag_s + if late { behind_s[axis] } else { 0.0 }) * v, v])
                };
                (0..MEANS).map(mean).collect()
            };
            (0..3).map(|run| (run, means(run))).collect()
        };
        (0..2).map(axis).collect()
    }

    #[test]
    fn both_axes_are_behind_by_one_time_or_it_is_none_of_the_feed() {
        let found = stretches(&circles([20e-6; 2], 0.0));
        let [Behind { run: 1, rows: [from, to], by_s }] = found[..] else { panic!("{found:?}") };
        assert!((by_s / 20e-6 - 1.0).abs() < 0.05, "{by_s}");
        assert!(from.abs_diff(MEANS / 10) <= BLOCK && to.abs_diff(MEANS / 3) <= BLOCK, "{from} to {to}");
        for (behind_s, lag_s) in
            [([0.0; 2], 0.0), ([20e-6, 0.0], 0.0), ([20e-6, -20e-6], 0.0), ([0.0; 2], 1e-3)]
        {
            assert_eq!(stretches(&circles(behind_s, lag_s)), [], "{behind_s:?}, {lag_s}");
        }
        assert_eq!(stretches(&circles([20e-6; 2], 0.0)[..1]), [], "one axis");
    }

    #[test]
    fn axes_that_break_away_together_are_not_behind() {
        let mut axes = circles([0.0; 2], 0.0);
        for axis in &mut axes {
            for (number, [e, v]) in axis.get_mut(&1).expect("a run") {
                match number {
                    100..140 => *v = 0.0,
                    // Held back at first, by friction.
                    140..150 => *e += 20e-6 * *v,
                    _ => {}
                }
            }
        }
        let scaled: Vec<_> = axes.iter().filter_map(as_usual).collect();
        let of_run: Vec<&Means> = scaled.iter().map(|axis| &axis[&1]).collect();
        assert!(together(&of_run, 136).is_some());
        assert_eq!(stretches(&axes), []);
    }

    #[test]
    fn what_two_models_differ_by_is_no_feed_that_was_turned() {
        // Without any noise.
        let found = |behind_s: f64| {
            let of_axis = |quarter: f64| -> Means {
                let mean = |number: usize| {
                    let v = 1e12 * (0.1 * number as f64 + quarter * TAU).sin();
                    (number, [behind_s * v, v])
                };
                (0..BLOCK).map(mean).collect()
            };
            let axes = [0.0, 0.25].map(of_axis);
            together(&axes.each_ref(), 0).is_some()
        };
        assert!(found(20e-6));
        assert!(!found(2e-8));
    }

    #[test]
    fn what_was_found_takes_part_in_nothing() {
        let run = Run::of_setpoints(5e-4, [(AxisId::X, vec![0.0; 100])]);
        let found = Behind { run: 1, rows: [50, 130], by_s: 1e-3 };
        let runs = Behind::without(&[found], &[run.clone(), run]);
        assert!(runs[0].is_sound.iter().all(|sound| *sound));
        let sound: Vec<bool> = (0..100).map(|row| row < 50).collect();
        assert_eq!(runs[1].is_sound, sound);
    }
}
