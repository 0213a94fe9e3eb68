//! The controller alone: measured positions through the loops of the machine file, the current they ask for beside
//! the current that was measured. No plant takes part, so what differs is the controller's, or behind it the drive's.
//!
//! Invariant: a difference here is no matter of friction or mechanics.

use std::collections::{BTreeMap, VecDeque};

use rayon::prelude::*;

use super::forward::resting;
use crate::base::axis::AxisId;
use crate::base::sample::{Freshness, Sample};
use crate::base::setpoint::Setpoint;
use crate::base::units::{Current, Position};
use crate::config::Machine;
use crate::offline::closed_axis::gains_of;
use crate::offline::gap::runs::sparse::{between, cycles};
use crate::offline::gap::runs::{AxisRun, Run, SETTLE_S, setpoints};
use crate::offline::product::product;
use crate::plant::effects::control::Remembered;
use crate::rt::control::{AxisLoop, Settings};
use crate::rt::drive::sheet::CommandApplies;
use crate::rt::drive::velocity::{VelocityEstimate, VelocityEstimator};

/// Latest that a current is looked for behind what the loops ask for, and lags that it may have beside, in ticks.
const LATE_MAX: usize = 8;
const LAGS: [f64; 7] = [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0];

/// Loops that leave less of the current than this are those of the file; others must leave this share of what they leave.
pub(super) const WELL: f64 = 0.1;
pub(in crate::offline::gap) const OTHER: f64 = 0.5;

/// Rows on either side beside which a step of the position loop shows, in its periods.
const STEPS: usize = 2;

/// So many rows the loops need to forget the noise of that in which they took over, and as many tell what they begin with.
const FIRST: usize = 16;

/// What the loops ask for along measured positions, behind the way of a command to the drive and the lag of the current
/// loop, A.
fn replayed(
    machine: &Machine,
    id: AxisId,
    (gain_set, estimate): (u8, VelocityEstimate),
    (run, setpoints): (&AxisRun, &[Setpoint]),
    phase: usize,
) -> Vec<f64> {
    let axis = &machine.axes[id];
    let every = machine.cycle.position_every as usize;
    let tick = axis.control.tick;
    let mut settings = Settings { gain_set_count: 1, ..axis.control };
    let otherwise = axis.plant.otherwise();
    let mut remembered = Remembered::default();
    settings.gain_sets[0] = gains_of(&otherwise, axis.control.gain_sets[usize::from(gain_set)]);
    let mut loops = AxisLoop::new(&settings);
    let mut estimator = VelocityEstimator::new(estimate, tick);
    let keep = (-tick.as_s() / axis.plant.actuator.lag_s()).exp();
    let applies = usize::from(axis.sheet.command_applies == CommandApplies::OnNextSync);
    let late = applies + (axis.plant.actuator.dead_time / tick) as usize;
    // The newest last.
    let mut on_their_way_a = VecDeque::from(vec![run.current_a[0]; late]);
    let mut behind_a = run.current_a[0];
    (0..setpoints.len())
        .map(|row| {
            let position = Position::m(run.position_m[row]);
            let velocity = estimator.advance(position, 1);
            let sample = Sample {
                freshness: Freshness::Fresh,
                position,
                velocity,
                current: Current::a(run.current_a[row]),
                ..Sample::default()
            };
            let late = otherwise.late(&mut remembered, &setpoints[row], tick);
            let setpoint = late.as_ref().unwrap_or(&setpoints[row]);
            // The velocity of the first rows is not known yet.
            if row == 3 {
                loops.take_over(
                    setpoint,
                    &sample,
                    axis.plant.actuator.torque(Current::a(run.current_a[row])),
                );
            }
            let shown_a = behind_a;
            if row >= 3 {
                let answer = loops.step(setpoint, &sample, row % every == phase);
                loops.pass(1);
                on_their_way_a.push_back(answer.current.as_a());
                let acting_a = on_their_way_a.pop_front().unwrap_or_default();
                behind_a = keep * behind_a + (1.0 - keep) * acting_a;
            }
            shown_a
        })
        .collect()
}

/// What the loops saw of the first rows of an axis, between two of them as well, and what it was asked for.
fn seen(run: &Run, axis: &AxisRun, rows: usize, cycles: usize) -> (AxisRun, Vec<Setpoint>) {
    let seen = axis.by_columns(|column| between(&column[..rows], cycles));
    let setpoints = setpoints(&seen.setpoint_m, run.period_s / cycles as f64);
    (seen, setpoints)
}

/// The current of an axis at the first row of a run, A, where it rests long enough to tell it better than a few rows do: a single one has
/// noise, and is what its screw is wound up by. While it rests the loops change it by what they make of the positions.
pub(in crate::offline::gap) fn resting_a(
    machine: &Machine,
    id: AxisId,
    gain_set: u8,
    run: &Run,
    phase: usize,
) -> Option<f64> {
    let (axis, cycles) = (run.axes.get(&id)?, cycles(run, machine));
    let rest = resting(axis);
    if rest < 4 * FIRST {
        return None;
    }
    let (seen, setpoints) = seen(run, axis, rest, cycles);
    let loops = (gain_set, machine.axes[id].velocity_estimate);
    let asked_a = replayed(machine, id, loops, (&seen, &setpoints), phase);
    let asked_a: Vec<f64> = asked_a.into_iter().step_by(cycles).skip(FIRST).collect();
    let mean = |column: &[f64]| column.iter().sum::<f64>() / column.len() as f64;
    Some(mean(&axis.current_a[FIRST..rest]) - mean(&asked_a) + mean(&asked_a[..FIRST]))
}

/// How well loops explain the current of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Which gains.
    pub gain_set: u8,
    /// How they see the velocity.
    pub velocity_estimate: VelocityEstimate,
    /// In which row the position loop acts first.
    pub phase: usize,
    /// By how many ticks the current comes later than is known.
    pub late: usize,
    /// Rms of what they do not explain as a share of the rms of the current; its mean is left out.
    pub left_share: f64,
    /// The same of rows beside those about them: a gain that is off adds up over seconds to what hides the steps of the position
    /// loop.
    pub steps_share: f64,
}

/// The current of an axis in the rows that count, as it is held against what was asked for.
struct Measured {
    /// The first row that counts; a row is so many ticks.
    first: usize,
    ticks: usize,
    /// Rows on either side beside which a step of the position loop shows.
    about: usize,
    /// One where a row is sound, or nothing.
    weights: Vec<f64>,
    /// The current, A, as it is and beside the rows about it.
    current_a: [Vec<f64>; 2],
    /// Sound rows, and the sum of the squares of their current, A².
    count: f64,
    whole_a2: f64,
}

impl Measured {
    fn new(run: &Run, axis: &AxisRun, ticks: usize, about: usize) -> Self {
        let first = ((SETTLE_S / run.period_s) as usize).max(LATE_MAX.div_ceil(ticks)).min(run.len());
        let current_a = [axis.current_a.clone(), beside(&axis.current_a, 1, about)];
        let current_a = current_a.map(|column| column[first..].to_vec());
        let weights: Vec<f64> =
            run.is_sound[first..].iter().map(|is_sound| f64::from(u8::from(*is_sound))).collect();
        let weighed: Vec<f64> =
            current_a[0].iter().zip(&weights).map(|(is_a, weight)| weight * is_a).collect();
        let (count, whole_a2) = (product(&weights, &weights), product(&weighed, &current_a[0]));
        Self { first, ticks, about, weights, current_a, count, whole_a2 }
    }

    /// What is asked for in each tick, as it is and beside the rows about it.
    fn asked(&self, asked_a: Vec<f64>) -> [Vec<f64>; 2] {
        let beside_a = beside(&asked_a, self.ticks, self.about);
        [asked_a, beside_a]
    }

    /// What is left of the current but what was asked for so many ticks before, as two shares of the rms of the current: of all rows about
    /// their mean, and of each about those near it.
    fn left_shares(&self, asked_a: &[Vec<f64>; 2], late: usize) -> [f64; 2] {
        let off = |of: usize| -> Vec<f64> {
            // A run that is over before its rows count was asked for nothing there.
            let asked_a =
                asked_a[of].get((self.first * self.ticks).saturating_sub(late)..).unwrap_or_default();
            let rows = self.current_a[of].iter().zip(asked_a.iter().step_by(self.ticks)).zip(&self.weights);
            rows.map(|((is_a, asked_a), weight)| weight * (is_a - asked_a)).collect()
        };
        let [all, near] = [0, 1].map(off);
        let sum = product(&all, &self.weights);
        let left = [product(&all, &all) - sum * sum / self.count.max(1.0), product(&near, &near)];
        left.map(|left| (left.max(0.0) / self.whole_a2).sqrt())
    }
}

/// Each value of a column less the mean of those that are up to so many times so many ticks away.
fn beside(column: &[f64], ticks: usize, about: usize) -> Vec<f64> {
    let mut sums = vec![0.0; column.len() + ticks];
    for (tick, value) in column.iter().enumerate() {
        sums[tick + ticks] = sums[tick] + value;
    }
    let of = |(tick, value): (usize, &f64)| {
        let [back, forth] = [tick, column.len() - 1 - tick].map(|ticks_away| about.min(ticks_away / ticks));
        let sum = sums[tick + (forth + 1) * ticks] - sums[tick - back * ticks];
        value - sum / (back + forth + 1) as f64
    };
    column.iter().enumerate().map(of).collect()
}

/// What was asked for behind a lag of so many ticks.
fn lagged(asked_a: &[f64], lag: f64) -> Vec<f64> {
    // A lag of nothing keeps nothing.
    let keep = (-1.0 / lag).exp();
    let mut behind_a = asked_a.first().copied().unwrap_or_default();
    let of = |asked_a: &f64| {
        behind_a = keep * behind_a + (1.0 - keep) * asked_a;
        behind_a
    };
    asked_a.iter().map(of).collect()
}

/// How well loops explain the current: of each axis, of each run, with velocities estimated as the machine file says; or where that
/// leaves much on all axes and another estimate does not on one of them, with that one: by half a period the integral of the
/// velocity is off in proportion to it. What an axis lacks may hide it, as a filter of its commands does; the loops of all are of one kind.
pub fn explained(machine: &Machine, ids: &[AxisId], runs: &[Run]) -> Vec<Vec<Vec<Match>>> {
    let of = |estimate: Option<VelocityEstimate>| -> Vec<Vec<Vec<Match>>> {
        let of_axis = |id: &AxisId| {
            let estimate = estimate.unwrap_or(machine.axes[*id].velocity_estimate);
            runs.par_iter().map(|run| matches(machine, *id, run, estimate)).collect()
        };
        ids.iter().map(of_axis).collect()
    };
    let as_filed = of(None);
    let filed_left = least_left(&as_filed);
    if filed_left < WELL {
        return as_filed;
    }
    let is_other =
        |estimate: &VelocityEstimate| ids.iter().any(|id| machine.axes[*id].velocity_estimate != *estimate);
    let others = VelocityEstimate::NAMED.into_iter().map(|(_, estimate)| estimate).filter(is_other);
    let best =
        others.map(|estimate| of(Some(estimate))).min_by(|a, b| least_left(a).total_cmp(&least_left(b)));
    best.filter(|best| least_left(best) < OTHER * filed_left).unwrap_or(as_filed)
}

/// What loops leave of the current of the axis that they explain best.
fn least_left(all: &[Vec<Vec<Match>>]) -> f64 {
    all.iter().map(|axis| left_of(axis, best_gains(axis))).fold(f64::INFINITY, f64::min)
}

/// The gain set whose loops explain the current, by the axis that they explain best; the first where that of others says no
/// more.
pub fn by_the_current(all: &[Vec<Vec<Match>>]) -> u8 {
    let left = |axis: &&Vec<Vec<Match>>| left_of(axis, best_gains(axis));
    let Some(axis) = all.iter().min_by(|a, b| left(a).total_cmp(&left(b))) else { return 0 };
    let best = best_gains(axis);
    if left_of(axis, best) < OTHER * left_of(axis, 0) { best } else { 0 }
}

/// The gain set that leaves least of the current.
pub(super) fn best_gains(all: &[Vec<Match>]) -> u8 {
    let sets = all.iter().flatten().map(|found| found.gain_set);
    sets.min_by(|a, b| left_of(all, *a).total_cmp(&left_of(all, *b))).unwrap_or_default()
}

/// What the loops of a gain set leave of the current of a run, as a share of it, on average.
pub(in crate::offline::gap) fn left_of(all: &[Vec<Match>], set: u8) -> f64 {
    let of = |matches: &Vec<Match>| {
        matches.iter().find(|found| found.gain_set == set).map(|found| found.left_share)
    };
    let count = all.iter().filter(|matches| !matches.is_empty()).count().max(1) as f64;
    all.iter().filter_map(of).sum::<f64>() / count
}

/// In which row of a run the position loop of a gain set acts first, by all axes together: their loops act in the same row. Steps tell it
/// whatever a gain makes of the rest, but hardly from steps that come later; so all of the current has a say where the loops explain it.
pub(in crate::offline::gap) fn phase_of<'a>(axes: impl Iterator<Item = &'a [Match]>, set: u8) -> usize {
    let mut left: BTreeMap<usize, f64> = BTreeMap::new();
    for matches in axes {
        let own = || matches.iter().filter(|found| found.gain_set == set);
        let is_explained = own().any(|found| found.left_share < WELL);
        for found in own() {
            let all = if is_explained { found.left_share } else { 1.0 };
            *left.entry(found.phase).or_default() += (all * found.steps_share).max(f64::MIN_POSITIVE).ln();
        }
    }
    left.into_iter().min_by(|(_, a), (_, b)| a.total_cmp(b)).map_or(0, |(phase, _)| phase)
}

/// What all gain sets and phases leave, the least first. Delays and lags that are not known must not pass for another phase: each
/// is held against the current that came so many ticks later.
fn matches(machine: &Machine, id: AxisId, run: &Run, velocity_estimate: VelocityEstimate) -> Vec<Match> {
    let Some(axis) = run.axes.get(&id) else { return Vec::new() };
    let cycles = cycles(run, machine);
    let (seen, setpoints) = seen(run, axis, run.len(), cycles);
    let about = (STEPS * machine.cycle.position_every as usize).div_ceil(cycles);
    let measured = Measured::new(run, axis, cycles, about);
    let mut all = Vec::new();
    for gain_set in 0..machine.gain_sets.len() {
        for phase in 0..machine.cycle.position_every as usize {
            let asked =
                replayed(machine, id, (gain_set as u8, velocity_estimate), (&seen, &setpoints), phase);
            let left: Vec<(usize, [f64; 2])> = LAGS
                .into_iter()
                .flat_map(|lag| {
                    let asked = measured.asked(lagged(&asked, lag));
                    (0..=LATE_MAX).map(|late| (late, measured.left_shares(&asked, late))).collect::<Vec<_>>()
                })
                .collect();
            let steps_share = left.iter().map(|(_, [_, steps])| *steps).fold(f64::INFINITY, f64::min);
            let best = left.into_iter().min_by(|(_, [a, _]), (_, [b, _])| a.total_cmp(b));
            all.extend(best.map(|(late, [left_share, _])| Match {
                gain_set: gain_set as u8,
                velocity_estimate,
                phase,
                late,
                left_share,
                steps_share,
            }));
        }
    }
    all.sort_by(|a, b| a.left_share.total_cmp(&b.left_share));
    all
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::config;
    use crate::offline::gap::measure::forward::Course;

    #[test]
    fn an_axis_that_rests_tells_its_current_by_all_of_its_rest_though_its_loops_change_it() {
        const REST: usize = 700;
        const NOISE_A: f64 = 0.2;
        let machine = config::load("paper").expect("a machine");
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let mut drawn = || -> f64 { StandardNormal.sample(&mut random) };
        // A micrometre behind, so that the integral goes on; then it moves.
        let setpoint_m: Vec<f64> =
            (0..REST + 100).map(|row| 1e-6 * row.saturating_sub(REST - 1) as f64).collect();
        let rows = setpoint_m.len();
        let resting =
            AxisRun { position_m: vec![-1e-6; rows], table_m: None, current_a: vec![1.5; rows], setpoint_m };
        let loops = (0, machine.axes[AxisId::X].velocity_estimate);
        let courses = setpoints(&resting.setpoint_m, 5e-4);
        let asked_a = replayed(&machine, AxisId::X, loops, (&resting, &courses), 0);
        let gone_on_a = asked_a[REST - 2] - asked_a[FIRST];
        assert!(gone_on_a.abs() > 0.05, "they went on by {gone_on_a} A");
        let current_a = asked_a.iter().map(|asked_a| asked_a + NOISE_A * drawn()).collect();
        let axes = BTreeMap::from([(AxisId::X, AxisRun { current_a, ..resting })]);
        let run =
            Run { name: "rest".to_owned(), start_s: 0.0, period_s: 5e-4, axes, is_sound: vec![true; rows] };
        let told_a = resting_a(&machine, AxisId::X, 0, &run, 0).expect("a rest");
        assert!((told_a - 1.5).abs() < 0.02, "{told_a} A");
        let short = run.axes[&AxisId::X].by_columns(|column| column[REST - 20..].to_vec());
        let short = Run { axes: BTreeMap::from([(AxisId::X, short)]), is_sound: vec![true; 120], ..run };
        assert_eq!(resting_a(&machine, AxisId::X, 0, &short, 0), None, "it hardly rests");
    }

    #[test]
    fn a_run_that_is_over_before_its_rows_count_says_nothing() {
        let machine = config::load("paper").expect("a machine");
        for (rows, every) in [(20, 1.0), (20, 4.0), (2, 1.0)] {
            let columns = || vec![0.1; rows];
            let axis =
                AxisRun { position_m: columns(), table_m: None, current_a: columns(), setpoint_m: columns() };
            let run = Run {
                name: "moment".to_owned(),
                start_s: 0.0,
                period_s: every * machine.cycle.period.as_s(),
                axes: BTreeMap::from([(AxisId::X, axis)]),
                is_sound: vec![true; rows],
            };
            let all = matches(&machine, AxisId::X, &run, machine.axes[AxisId::X].velocity_estimate);
            assert!(all.iter().all(|found| found.left_share.is_nan()), "{rows} rows: {all:?}");
        }
    }

    #[test]
    fn a_gain_that_is_off_hides_no_step_of_the_position_loop() {
        const PHASE: usize = 2;
        let mut machine = config::load("paper").expect("a machine");
        assert!(machine.cycle.position_every as usize > PHASE);
        let (id, period_s) = (AxisId::X, machine.cycle.period.as_s());
        machine.axes[id].control.gain_sets[0].position.velocity_feed_forward = 0.6;
        // Laps of half a second: between two steps of the position loop the feed-forward changes.
        let setpoint_m: Vec<f64> =
            (0..20_000).map(|row| 2e-3 * (1.0 - (TAU * 2.0 * f64::from(row) * period_s).cos())).collect();
        let rows = setpoint_m.len();
        let columns = || vec![0.0; rows];
        let axis = AxisRun { position_m: columns(), table_m: None, current_a: columns(), setpoint_m };
        let axes = BTreeMap::from([(id, axis)]);
        let mut run =
            Run { name: "laps".to_owned(), start_s: 0.0, period_s, axes, is_sound: vec![true; rows] };
        let course = Course::new(&run, &machine, id, PHASE, 0.0).expect("an axis");
        let mut other = machine.axes[id];
        other.control.gain_sets[0].position.gain_per_s *= 1.02;
        let made = course.run(&other, machine.cycle.position_every, 0, &other.plant);
        let mut random = Pcg64Mcg::seed_from_u64(6);
        let mut noisy_a = |current_a: f64| -> f64 {
            let drawn: f64 = StandardNormal.sample(&mut random);
            current_a + 0.005 * drawn
        };
        let axis = run.axes.get_mut(&id).expect("an axis");
        axis.position_m = axis.setpoint_m.iter().zip(&made.following_error_m).map(|(s, e)| s - e).collect();
        axis.current_a = made.current_a.iter().map(|current_a| noisy_a(*current_a)).collect();
        let all = matches(&machine, id, &run, machine.axes[id].velocity_estimate);
        assert_eq!(phase_of([all.as_slice()].into_iter(), 0), PHASE, "{all:?}");
    }

    #[test]
    fn steps_that_come_later_are_told_by_the_rest_of_the_current_and_by_the_other_axis() {
        let found = |phase: usize, left_share: f64, steps_share: f64| Match {
            gain_set: 0,
            velocity_estimate: VelocityEstimate::SecondOrder,
            phase,
            late: 0,
            left_share,
            steps_share,
        };
        // Of moves that a loop explains: steps in another row that come three later are the same.
        let explained = [found(1, 0.038, 0.0216), found(0, 0.0235, 0.0217), found(3, 0.026, 0.0228)];
        // Of an axis whose gain is off nothing but the steps is told, and they hardly.
        let off = [found(1, 5.1, 0.0216), found(0, 5.9, 0.0217), found(3, 5.7, 0.0228)];
        assert_eq!(phase_of([explained.as_slice()].into_iter(), 0), 0);
        assert_eq!(phase_of([off.as_slice()].into_iter(), 0), 1);
        assert_eq!(phase_of([off.as_slice(), explained.as_slice()].into_iter(), 0), 0);
        let plain = [found(1, 5.1, 0.0316), found(0, 5.9, 0.0217)];
        assert_eq!(phase_of([plain.as_slice()].into_iter(), 0), 0);
        assert_eq!(phase_of(std::iter::empty(), 0), 0);
    }
}
