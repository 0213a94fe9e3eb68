//! Whether what a model leaves has a shape: one that all other runs foretell of each; or sounds at a frequency; or comes again along the way.
//!
//! ```text
//!   all runs but one ──► means over bins of a coordinate, each way ──► what they explain of that one, block by block
//! ```
//!
//! Noise foretells nothing; nor does what belongs to one run, as somebody who leaned on the table. A physical effect that has
//! no name does, although it may be far less than noise in each row.
//! Units: what is left is whitened, so that noise has variance 1; gains are sums of squares of that.
//! Invariant: no run foretells itself.

use rayon::prelude::*;

use super::along::{Row, periods};
use super::rest::{Rest, Shows};
use super::tones::tones;
use super::{Coordinates, coordinates, place_of};
use crate::offline::gap::fit::share_that_holds;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::{Linear, Loss, residuals};
use crate::offline::gap::model::problem::{Problem, Residual};
use crate::offline::gap::model::steps::Steps;
use crate::plant::effects::Coordinate;

/// Over what a shape is looked for, each way of the axis by itself: what comes again in other runs. Not over the current,
/// which has the same noise in it as what is left of it.
const OVER: [Coordinate; 6] = [
    Coordinate::Position,
    Coordinate::Velocity,
    Coordinate::Angle,
    Coordinate::WaySinceReversal,
    Coordinate::TimeSinceReversal,
    Coordinate::Acceleration,
];
/// Bins of a coordinate for each way.
const BINS: usize = 24;
/// Blocks that are independent of each other, s.
const BLOCK_S: f64 = 1.0;
/// Fewer tell no scatter.
const LEAST_BLOCKS: usize = 8;
/// A row that is further off, in standard deviations of noise, counts as one that is so far: stick and slip are events.
const FAR: f64 = 4.0;
/// The gain of all blocks must be so many of its own standard deviations, and so much: where nothing is missing, formulations of
/// the same physics differed by 315 and 3.7, and the loudest of a thousand tones of noise by 103 and 3.6.
const SURE: f64 = 4.0;
/// The same along the way, where the surest of thousands of lines of noise was 3.4.
const SURE_ALONG: f64 = 5.0;
const LEAST: f64 = 200.0;

/// What a model leaves that is foretold.
#[derive(Clone, Copy, Debug)]
pub(in crate::offline::gap) struct Foretold {
    /// How much, as a sum of squares.
    pub(in crate::offline::gap) gain: f64,
    /// Where and over what.
    pub(in crate::offline::gap) rest: Rest,
}

/// The largest sure shape or tone of what a model leaves and its coordinates do not make up for; nothing where none is sure.
pub(in crate::offline::gap) fn foretold(problem: &Problem<'_>, model: &Model) -> Option<Foretold> {
    let parts = [Part::Fit, Part::Held].map(|part| (part, residuals(problem, model, part)));
    largest(problem, &parts.each_ref().map(|(_, left)| left.iter().collect()))?;
    // Rows of stick and slip in one signal may hold the base where all others want a little less friction: that is no shape of
    // something else. So each signal has the base that it wants.
    let linear = parts.map(|left| Linear::new(problem, model, left, None, &Steps::widest(model)));
    let signals = problem.signals().len();
    let by_signal: Vec<[Vec<Residual>; 2]> = (0..signals)
        .into_par_iter()
        .map(|place| made_up_for(linear.each_ref(), place))
        .collect::<Option<_>>()?;
    let together = |part: usize| -> Vec<Residual> {
        let runs = by_signal[0][part].len();
        (0..runs).map(|run| by_signal.iter().map(|signal| signal[part][run][0].clone()).collect()).collect()
    };
    let left = [0, 1].map(together);
    largest(problem, &left.each_ref().map(|left| left.iter().collect()))
}

/// What is left of one signal of both parts where the model makes up for it as far as it may, whatever others say.
fn made_up_for(linear: [&Linear; 2], signal: usize) -> Option<[Vec<Residual>; 2]> {
    let alone = linear.map(|linear| linear.of_signal(signal));
    let [fit, held] = alone.each_ref().map(|linear| linear.normal(usize::MAX, Loss::LAST));
    let step = fit.plus(held).with_beliefs(&alone[0].model).step()?;
    let step = &step * share_that_holds(&step);
    Some(alone.map(|linear| linear.runs.iter().map(|run| run.moved(&step)).collect()))
}

/// The largest sure shape or tone of what is left of both parts of all runs.
fn largest(problem: &Problem<'_>, left: &[Vec<&Residual>; 2]) -> Option<Foretold> {
    let places = (0..problem.data.len()).into_par_iter();
    let runs: Vec<Run> = places.map(|place| Run::new(problem, left, place)).collect();
    // What is left has no place for a signal without noise.
    let signals = problem.signals();
    let places = || signals.iter().copied().enumerate();
    let shapes: Vec<(usize, usize, Coordinate)> =
        places().flat_map(|(place, signal)| OVER.map(|over| (place, signal, over))).collect();
    let length = problem.rows_in(BLOCK_S);
    let sure = |gains: &[f64], deviations: f64, signal: usize, shows: Shows| {
        Some(Foretold { gain: sure_sum(gains, deviations)?, rest: Rest::In { signal, shows } })
    };
    let shape = |(place, signal, over): &(usize, usize, Coordinate)| {
        sure(&gains(&binned(&runs, *place, *over), length), SURE, *signal, Shows::Over(*over))
    };
    let of_tones = places().flat_map(|(place, signal)| {
        let left: Vec<&[f64]> = runs.iter().filter_map(|run| Some(run.left.get(place)?.as_slice())).collect();
        tones(&left, length, problem.rows_of_loop())
            .into_iter()
            .filter_map(move |(line, gains)| sure(&gains, SURE, signal, Shows::Tone(line as f64 / BLOCK_S)))
    });
    let of_ways = |(place, signal): (usize, usize)| {
        let rows: Vec<Vec<Row>> = runs.iter().filter_map(|run| run.along(place)).collect();
        let of_period = move |(period_mm, gains): (f64, Vec<f64>)| {
            sure(&gains, SURE_ALONG, signal, Shows::Period(period_mm))
        };
        periods(&rows).into_iter().filter_map(of_period)
    };
    let of_ways: Vec<Foretold> =
        places().collect::<Vec<_>>().into_par_iter().flat_map_iter(of_ways).collect();
    let of_shapes: Vec<Foretold> = shapes.par_iter().filter_map(shape).collect();
    of_tones.chain(of_ways).chain(of_shapes).max_by(|a, b| a.gain.total_cmp(&b.gain))
}

/// The rows of a run that count.
struct Run {
    coordinates: Vec<Coordinates>,
    /// By signal: what the model leaves, whitened; empty where the run has it not.
    left: Vec<Vec<f64>>,
}

impl Run {
    /// Of a place, of what is left of the runs that have rows of each part.
    fn new(problem: &Problem<'_>, left: &[Vec<&Residual>; 2], place: usize) -> Self {
        let data = &problem.data[place];
        let counting: Vec<usize> =
            (0..data.fit.len()).filter(|row| data.fit[*row] || data.held[*row]).collect();
        let parts = [Part::Fit, Part::Held].into_iter().zip(left).filter_map(|(part, left)| {
            let number = problem.places(part).iter().position(|other| *other == place)?;
            Some(left[number])
        });
        let parts: Vec<&Residual> = parts.collect();
        // A row that is of another part is zero.
        let of = |signal: usize| -> Vec<f64> {
            let row = |row: &usize| parts.iter().map(|part| part[signal].get(*row)).sum::<Option<f64>>();
            counting.iter().filter_map(row).map(|left| left.clamp(-FAR, FAR)).collect()
        };
        let left = (0..parts.first().map_or(0, |part| part.len())).map(of).collect();
        let all = coordinates(problem, place);
        Self { coordinates: counting.iter().map(|row| all[*row]).collect(), left }
    }
}

impl Run {
    /// Its rows along the way, of a signal that it has.
    fn along(&self, signal: usize) -> Option<Vec<Row>> {
        let [place, way] = [Coordinate::Position, Coordinate::Direction].map(place_of);
        let row = |(at, left): (&Coordinates, &f64)| Row { place_mm: at[place], way: at[way], left: *left };
        Some(self.coordinates.iter().zip(self.left.get(signal)?).map(row).collect())
    }
}

/// Of each run that has a signal, the bin of each row and what is left there; as many rows in each bin of all runs.
fn binned(runs: &[Run], signal: usize, over: Coordinate) -> Vec<(Vec<usize>, &[f64])> {
    let [over, way] = [over, Coordinate::Direction].map(place_of);
    let runs = || runs.iter().filter(|run| run.left.get(signal).is_some_and(|left| !left.is_empty()));
    let mut sorted: Vec<f64> = runs().flat_map(|run| run.coordinates.iter().map(|row| row[over])).collect();
    sorted.sort_by(f64::total_cmp);
    let mut ends: Vec<f64> =
        (1..BINS).filter_map(|bin| sorted.get(bin * sorted.len() / BINS).copied()).collect();
    // Values that are the same stay together.
    ends.dedup();
    let bin =
        |row: &Coordinates| 2 * ends.partition_point(|end| *end <= row[over]) + usize::from(row[way] < 0.0);
    runs().map(|run| (run.coordinates.iter().map(bin).collect(), run.left[signal].as_slice())).collect()
}

/// By how much the sum of squares of each block falls when the means of all other runs are taken off.
fn gains(runs: &[(Vec<usize>, &[f64])], length: usize) -> Vec<f64> {
    let sums: Vec<Vec<[f64; 2]>> = runs.iter().map(|(bins, left)| sums(bins, left)).collect();
    let of = |(own, (bins, left)): (usize, &(Vec<usize>, &[f64]))| -> Vec<f64> {
        let others = || sums.iter().enumerate().filter(|(run, _)| *run != own);
        let mean = |bin: usize| {
            let [sum, count] = others()
                .map(|(_, sums)| sums[bin])
                .fold([0.0; 2], |all, one| [all[0] + one[0], all[1] + one[1]]);
            // A mean that may be chance is nearly none.
            if count == 0.0 { 0.0 } else { sum / count * (1.0 - count / (sum * sum)).max(0.0) }
        };
        let means: Vec<f64> = (0..2 * BINS).map(mean).collect();
        let gain = |(bin, left): (&usize, &f64)| means[*bin] * (2.0 * left - means[*bin]);
        let gains: Vec<f64> = bins.iter().zip(*left).map(gain).collect();
        gains.chunks_exact(length).map(|block| block.iter().sum()).collect()
    };
    runs.iter().enumerate().flat_map(of).collect()
}

/// Sum and count of each bin.
fn sums(bins: &[usize], left: &[f64]) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0; 2]; 2 * BINS];
    for (bin, left) in bins.iter().zip(left) {
        sums[*bin] = [sums[*bin][0] + left, sums[*bin][1] + 1.0];
    }
    sums
}

/// The sum of gains that is so many of its own standard deviations more than none.
fn sure_sum(gains: &[f64], deviations: f64) -> Option<f64> {
    let (count, sum) = (gains.len() as f64, gains.iter().sum::<f64>());
    let scatter = gains.iter().map(|gain| (gain - sum / count).powi(2)).sum::<f64>() / (count - 1.0);
    let is_sure = gains.len() >= LEAST_BLOCKS && sum > LEAST && sum > deviations * (count * scatter).sqrt();
    is_sure.then_some(sum)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::offline::gap::model::linear::LinearRun;
    use crate::plant::tests::paper_axis;

    const BLOCK: usize = 200;

    /// Six runs over eight bins, with noise of variance 1 and a shape of this size: the same in all, or each its own.
    fn runs(size: f64, is_of_all: bool) -> Vec<(Vec<usize>, Vec<f64>)> {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let run = |place: usize| {
            let bins: Vec<usize> = (0..10 * BLOCK).map(|row| row % 8).collect();
            // Six rows of a Hadamard matrix have nothing in common.
            let pattern = if is_of_all { 1 } else { 1 + place };
            let sign = |bin: usize| if (bin & pattern).count_ones().is_multiple_of(2) { size } else { -size };
            let mut noise = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let left = bins.iter().map(|bin| sign(*bin) + noise()).collect();
            (bins, left)
        };
        (0..6).map(run).collect()
    }

    fn found(size: f64, is_of_all: bool) -> Option<f64> {
        let runs = runs(size, is_of_all);
        let runs: Vec<(Vec<usize>, &[f64])> =
            runs.iter().map(|(bins, left)| (bins.clone(), left.as_slice())).collect();
        sure_sum(&gains(&runs, BLOCK), SURE)
    }

    #[test]
    fn a_shape_far_below_the_noise_is_foretold_where_all_runs_have_it() {
        // Twelve thousand rows of a fifth of a standard deviation: 480 of a sum of squares.
        let gain = found(0.2, true).expect("a shape");
        assert!((300.0..600.0).contains(&gain), "{gain}");
    }

    #[test]
    fn what_a_coordinate_makes_up_for_in_one_signal_is_taken_off_whatever_another_wants() {
        let model = Model::new(paper_axis());
        let column: Residual = vec![vec![1.0; 1_000]; 2];
        // The first signal wants it up and the second down.
        let run = |size: f64| LinearRun {
            residual: vec![vec![size; 1_000], vec![-size; 1_000]],
            columns: (0..model.coordinate_count())
                .map(|coordinate| (coordinate == 0).then(|| Arc::new(column.clone())))
                .collect(),
        };
        let linear = |size: f64| Linear { model: model.clone(), runs: vec![run(size)] };
        let (fit, held) = (linear(0.2), linear(0.2));
        for signal in 0..2 {
            let [of_fit, of_held] = made_up_for([&fit, &held], signal).expect("it is regular");
            for left in [&of_fit[0][0], &of_held[0][0]] {
                assert!(left.iter().all(|left| left.abs() < 1e-3), "{signal}: {}", left[0]);
            }
        }
    }

    #[test]
    fn noise_and_what_each_run_has_of_its_own_are_not() {
        assert_eq!(found(0.0, true), None);
        assert_eq!(found(2.0, false), None);
    }
}
