//! A model where it stands: what it leaves of each run, what each of its coordinates changes of that, and the normal
//! equations of both.
//!
//! ```text
//!   slope = Tᵀ W r     curvature = Tᵀ W T     spread = Σ over blocks of (Tᵀ W r) (Tᵀ W r)ᵀ     T = ∂r / ∂coordinate
//! ```
//!
//! Stick and slip are events: near a reversal rows jump where a model lands on another branch, and one event that comes
//! at another moment would outvote minutes of motion. So rows beyond `K` standard deviations count by a bounded loss
//! (the tail of Geman and McClure's), or where it is asked what could explain them by their size (Huber's).
//! Invariant: a coordinate that moves nothing has no column.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::Model;
use super::data::Part;
use super::problem::{Problem, Residual};
use super::steps::Steps;
use super::twin::{BASE, Base};
use crate::offline::product::product;

/// Rows beyond this count by less than their square, in standard deviations.
pub const K: f64 = 4.0;
/// What is left is independent from block to block of this length, s: longer than anything a loop remembers.
pub const BLOCK_S: f64 = 0.25;
/// Fewer runs do not tell how much they differ.
const RUNS: usize = 5;
/// Of a coordinate that nothing tells.
pub(in crate::offline::gap) const LEAST_CURVATURE: f64 = 1e-12;

/// How much a row counts: its square up to a knee, and beyond it less.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    knee: f64,
    is_bounded: bool,
}

impl Loss {
    /// What judges: no row counts more than twice the square of [`K`].
    pub const LAST: Self = Self::bounded(K);

    /// Of Huber: straight beyond the knee, so that what is far off still tells where to go.
    pub const fn straight(knee: f64) -> Self {
        Self { knee, is_bounded: false }
    }

    /// Bounded by twice the square of the knee.
    pub const fn bounded(knee: f64) -> Self {
        Self { knee, is_bounded: true }
    }

    /// Of a row, `ρ`.
    pub fn of(self, value: f64) -> f64 {
        let (size, Self { knee, is_bounded }) = (value.abs(), self);
        if size <= knee {
            size * size
        } else if is_bounded {
            knee * knee * (2.0 - (knee / size).powi(2))
        } else {
            knee * (2.0 * size - knee)
        }
    }

    /// How much a row weighs: half the slope of `ρ`, of a value.
    pub fn weight(self, value: f64) -> f64 {
        let within = (self.knee / value.abs()).min(1.0);
        if self.is_bounded { within.powi(4) } else { within }
    }

    /// Sum over a residual.
    pub fn sum(self, residual: &Residual) -> f64 {
        residual.iter().flatten().map(|value| self.of(*value)).sum()
    }
}

/// What a model leaves of all runs that have rows of a part, in their order.
pub fn residuals(problem: &Problem<'_>, model: &Model, part: Part) -> Vec<Residual> {
    problem.places(part).into_par_iter().map(|place| problem.residual(place, model, part)).collect()
}

/// What one coordinate changes of what is left of a run; nothing where it is at its end.
pub type Column = Option<Arc<Residual>>;

/// A run at a model.
#[derive(Clone, Debug)]
pub struct LinearRun {
    /// What the model leaves of it.
    pub residual: Residual,
    /// By coordinate.
    pub columns: Vec<Column>,
}

impl LinearRun {
    /// What is left of it a step further, where all is linear.
    pub(in crate::offline::gap) fn moved(&self, step: &DVector<f64>) -> Residual {
        let mut moved = self.residual.clone();
        for (column, step) in
            self.columns.iter().zip(step).filter_map(|(column, step)| Some((column.as_ref()?, step)))
        {
            for (moved, column) in moved.iter_mut().zip(column.iter()) {
                moved.iter_mut().zip(column).for_each(|(value, by)| *value += step * by);
            }
        }
        moved
    }
}

/// A model with its derivatives.
#[derive(Clone, Debug)]
pub struct Linear {
    /// The model.
    pub model: Model,
    /// The runs it is fitted to, in the order of their places.
    pub runs: Vec<LinearRun>,
}

impl Linear {
    /// Of a model of which nothing is known well yet, on the fitted rows.
    pub(in crate::offline::gap) fn widest(problem: &Problem<'_>, model: &Model) -> Self {
        let left = (Part::Fit, residuals(problem, model, Part::Fit));
        Self::new(problem, model, left, None, &Steps::widest(model))
    }

    /// Of a model that leaves these residuals of a part of the rows. The columns of coordinates that `known` has are taken from
    /// there.
    pub fn new(
        problem: &Problem<'_>,
        model: &Model,
        (part, left): (Part, Vec<Residual>),
        known: Option<&Self>,
        steps: &Steps,
    ) -> Self {
        let coordinates = model.coordinates();
        let shared = known.map_or(0, |known| known.model.coordinate_count());
        let of = |(run, (place, residual)): (usize, (usize, Residual))| {
            let column = |coordinate: usize| match known {
                _ if !model.is_free(coordinate) => None,
                Some(known) if coordinate < shared => known.runs[run].columns[coordinate].clone(),
                _ => column(
                    problem,
                    model,
                    &coordinates,
                    (place, part),
                    &residual,
                    coordinate,
                    steps.of_coordinate(coordinate),
                )
                .map(Arc::new),
            };
            let columns = (0..coordinates.len()).into_par_iter().map(column).collect();
            LinearRun { residual, columns }
        };
        let places = problem.places(part).into_par_iter().zip(left);
        Self { model: model.clone(), runs: places.enumerate().map(of).collect() }
    }

    /// The same where some coordinates make up for nothing.
    #[must_use]
    pub fn holding(&self, coordinates: &[usize]) -> Self {
        let mut holding = self.clone();
        for run in &mut holding.runs {
            coordinates.iter().for_each(|coordinate| run.columns[*coordinate] = None);
        }
        holding
    }

    /// The same of one signal alone.
    #[must_use]
    pub(in crate::offline::gap) fn of_signal(&self, signal: usize) -> Self {
        let alone = |residual: &Residual| vec![residual[signal].clone()];
        let of = |run: &LinearRun| LinearRun {
            residual: alone(&run.residual),
            columns: run.columns.iter().map(|column| Some(Arc::new(alone(column.as_ref()?)))).collect(),
        };
        Self { model: self.model.clone(), runs: self.runs.iter().map(of).collect() }
    }

    /// Sum of `ρ` over what is left.
    pub fn cost(&self) -> f64 {
        self.runs.iter().map(|run| Loss::LAST.sum(&run.residual)).sum()
    }

    /// The same derivatives where another model leaves this.
    pub fn leaves(&mut self, left: Vec<Residual>) {
        self.runs.iter_mut().zip(left).for_each(|(run, residual)| run.residual = residual);
    }

    /// Their sums over all runs; blocks are of so many rows.
    pub fn normal(&self, block: usize, loss: Loss) -> Normal {
        let count = self.model.coordinate_count();
        let one = |run: &LinearRun| {
            let columns: Vec<Option<&Residual>> = run.columns.iter().map(Option::as_deref).collect();
            Normal::of(&run.residual, &columns, block, loss)
        };
        // In their order: sums of threads as they come would end a search elsewhere each time.
        let all: Vec<Normal> = self.runs.par_iter().map(one).collect();
        all.into_iter().fold(Normal::zero(count), Normal::plus)
    }
}

fn column(
    problem: &Problem<'_>,
    model: &Model,
    coordinates: &[f64],
    (place, part): (usize, Part),
    residual: &Residual,
    coordinate: usize,
    step: f64,
) -> Option<Residual> {
    if !problem.tells(model, coordinate) {
        return None;
    }
    // What is of a sensor alone moves nothing that would have to be simulated.
    let shown = |base: &Base| {
        let enlarged = || Some(problem.enlarged(place, (base.scale_of?, base.prior), part, residual));
        base.zero_of.map_or_else(enlarged, |of| problem.shifted(place, (of, base.prior), part))
    };
    if let Some(column) = BASE.get(coordinate).and_then(shown) {
        return Some(column);
    }
    // Away from a bound where one is near.
    [step, -step].into_iter().find_map(|by| {
        let mut moved = coordinates.to_vec();
        moved[coordinate] += by;
        let other = model.at(&moved);
        let step = other.coordinates()[coordinate] - coordinates[coordinate];
        if (step / by - 1.0).abs() > 0.5 {
            return None;
        }
        let mut column = problem.residual(place, &other, part);
        for (column, residual) in column.iter_mut().zip(residual) {
            for (value, here) in column.iter_mut().zip(residual) {
                *value = (*value - here) / step;
            }
        }
        Some(column)
    })
}

/// Normal equations.
#[derive(Clone, Debug)]
pub struct Normal {
    /// Second derivatives of half the cost, by coordinates.
    pub curvature: DMatrix<f64>,
    /// First derivatives of half the cost.
    pub slope: DVector<f64>,
    /// Variance of the slope, from block to block.
    pub spread: DMatrix<f64>,
    /// The same from run to run, and of how many: what is wrong in one way all along a run shows here alone.
    pub by_run: (DMatrix<f64>, usize),
    /// Sum of `ρ`.
    pub cost: f64,
}

impl Normal {
    fn zero(count: usize) -> Self {
        let zeros = || DMatrix::zeros(count, count);
        Self {
            curvature: zeros(),
            slope: DVector::zeros(count),
            spread: zeros(),
            by_run: (zeros(), 0),
            cost: 0.0,
        }
    }

    /// Of the rows of both.
    #[must_use]
    pub(in crate::offline::gap) fn plus(mut self, other: Self) -> Self {
        self.curvature += other.curvature;
        self.slope += other.slope;
        self.spread += other.spread;
        self.by_run = (self.by_run.0 + other.by_run.0, self.by_run.1 + other.by_run.1);
        self.cost += other.cost;
        self
    }

    /// Of one run.
    pub fn of<'r>(residual: &Residual, columns: &[Option<&'r Residual>], block: usize, loss: Loss) -> Self {
        let count = columns.len();
        let mut sum = Self { cost: loss.sum(residual), ..Self::zero(count) };
        let longest = residual.iter().map(Vec::len).max().unwrap_or(0);
        let mut slopes = DMatrix::zeros(count, longest.div_ceil(block));
        for (signal, rows) in residual.iter().enumerate() {
            // Block by block: the rows of all columns stay near at hand.
            for (number, rows) in rows.chunks(block).enumerate() {
                let weights: Vec<f64> = rows.iter().map(|value| loss.weight(*value)).collect();
                let of_block =
                    |column: &Option<&'r Residual>| Some(&(*column)?[signal][number * block..][..rows.len()]);
                let columns: Vec<Option<&[f64]>> = columns.iter().map(of_block).collect();
                for (i, a) in columns.iter().enumerate() {
                    let Some(a) = a else { continue };
                    let weighed: Vec<f64> = a.iter().zip(&weights).map(|(a, weight)| a * weight).collect();
                    slopes[(i, number)] += product(&weighed, rows);
                    for (j, b) in columns.iter().enumerate().take(i + 1) {
                        let Some(b) = b else { continue };
                        sum.curvature[(i, j)] += product(&weighed, b);
                    }
                }
            }
        }
        sum.curvature.fill_upper_triangle_with_lower_triangle();
        sum.slope = slopes.column_sum();
        sum.spread = &slopes * slopes.transpose();
        sum.by_run = (&sum.slope * sum.slope.transpose(), 1);
        sum
    }

    /// By how much a step to where all is linear lowers the cost; without bound where nobody knows such a place. A coordinate that moves nothing
    /// promises nothing.
    pub(in crate::offline::gap) fn promise(&self) -> f64 {
        let mut curvature = self.curvature.clone();
        for place in 0..curvature.nrows() {
            curvature[(place, place)] = curvature[(place, place)].max(LEAST_CURVATURE);
        }
        curvature.cholesky().map_or(f64::INFINITY, |of| self.slope.dot(&of.solve(&self.slope)))
    }

    /// The same with what is believed of each coordinate beforehand.
    #[must_use]
    pub fn with_beliefs(mut self, model: &Model) -> Self {
        let (at, expected, sureness) = (model.coordinates(), model.expected(), model.sureness());
        for (place, ((at, expected), sure)) in at.iter().zip(expected).zip(sureness).enumerate() {
            self.curvature[(place, place)] += sure.powi(-2);
            self.spread[(place, place)] += sure.powi(-2);
            self.slope[place] += (at - expected) * sure.powi(-2);
        }
        self
    }

    /// The same with what is known of some coordinates from elsewhere, where they stand: the inverse of its covariance.
    #[must_use]
    pub(in crate::offline::gap) fn with_known(mut self, curvature: &DMatrix<f64>) -> Self {
        self.curvature += curvature;
        self.spread += curvature;
        self
    }

    /// How far the minimum is, if all were linear.
    pub(in crate::offline::gap) fn step(&self) -> Option<DVector<f64>> {
        Some(-(regular(&self.curvature)? * &self.slope))
    }

    /// Covariance of the coordinates at the minimum, of rows that depend on each other within a block, and within a
    /// run where there are `RUNS` and more, as much as they do; nothing where the curvature is none.
    pub fn covariance(&self) -> Option<DMatrix<f64>> {
        let inverse = regular(&self.curvature)?;
        let by_block = &inverse * &self.spread * &inverse;
        let (by_run, runs) = &self.by_run;
        // At the minimum the slopes of all runs make zero together: one less is free.
        let free = if *runs >= RUNS { *runs as f64 / (*runs as f64 - 1.0) } else { 0.0 };
        let by_run = free * &inverse * by_run * &inverse;
        // A few blocks, or runs, may agree by chance: never surer than independent rows of noise would be.
        let mut covariance = inverse.clone();
        for place in 0..covariance.nrows() {
            let found = by_block[(place, place)].max(by_run[(place, place)]);
            let by = (found / inverse[(place, place)]).max(1.0).sqrt();
            for other in 0..covariance.ncols() {
                covariance[(place, other)] *= by;
                covariance[(other, place)] *= by;
            }
        }
        Some(covariance)
    }
}

/// The inverse of a curvature in which some coordinates may do nothing.
pub(in crate::offline::gap) fn regular(curvature: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let mut curvature = curvature.clone();
    for place in 0..curvature.nrows() {
        curvature[(place, place)] += 1e-9;
    }
    curvature.cholesky().map(|cholesky| cholesky.inverse())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hundred blocks of ten rows that all say the same, half of them up and half of them down.
    fn in_blocks() -> Residual {
        vec![(0..1_000).map(|row| if (row / 10) % 2 == 0 { 1.0 } else { -1.0 }).collect()]
    }

    #[test]
    fn rows_that_agree_within_a_block_make_nothing_surer() {
        let column: Residual = vec![vec![1.0; 1_000]];
        let variance = |block: usize| {
            Normal::of(&in_blocks(), &[Some(&column)], block, Loss::LAST).covariance().expect("it is regular")
                [(0, 0)]
        };
        // The mean of a hundred values of variance 1; taken as a thousand, ten times as sure.
        assert!((variance(10) - 0.01).abs() < 1e-6, "{}", variance(10));
        assert!((variance(1) - 0.001).abs() < 1e-6, "{}", variance(1));
    }

    #[test]
    fn a_step_promises_what_it_gains_where_all_is_linear() {
        let (residual, column): (Residual, Residual) = (vec![vec![3.0; 100]], vec![vec![2.0; 100]]);
        let promise = |columns: &[Option<&Residual>]| {
            let equations = Normal::of(&residual, columns, 10, Loss::LAST);
            [equations.cost, equations.promise()]
        };
        let [cost, promised] = promise(&[Some(&column)]);
        assert!((promised - cost).abs() < 1e-9 && cost == 900.0, "{promised} of {cost}");
        // A coordinate that nothing tells promises nothing.
        let [_, beside] = promise(&[Some(&column), None]);
        assert!((beside - promised).abs() < 1e-9, "{beside}");
    }

    #[test]
    fn runs_that_disagree_make_a_coordinate_less_sure() {
        let column: Residual = vec![vec![1.0; 1_000]];
        let run = |by: f64| {
            let residual: Residual = vec![in_blocks()[0].iter().map(|value| value + by).collect()];
            Normal::of(&residual, &[Some(&column)], 10, Loss::LAST)
        };
        let variance = |by: f64| {
            let both = [by, -by, by, -by, by, -by].map(run).into_iter().reduce(Normal::plus).expect("six");
            both.covariance().expect("it is regular")[(0, 0)]
        };
        // Six runs that say 0.3 or -0.3 know their mean to 0.3 / √5, whatever their rows say.
        assert!((variance(0.3) - 0.09 / 5.0).abs() < 1e-6, "{}", variance(0.3));
        assert!(variance(0.0) < 0.01, "{}", variance(0.0));
    }

    #[test]
    fn a_coordinate_without_a_column_changes_nothing_of_the_others() {
        let column: Residual = vec![(0..1_000).map(f64::from).collect()];
        let alone = Normal::of(&in_blocks(), &[Some(&column)], 10, Loss::LAST);
        let beside = Normal::of(&in_blocks(), &[Some(&column), None], 10, Loss::LAST);
        assert_eq!(alone.slope[0], beside.slope[0]);
        assert_eq!(alone.curvature[(0, 0)], beside.curvature[(0, 0)]);
        assert_eq!(beside.curvature[(1, 1)], 0.0);
    }

    #[test]
    fn rows_far_off_count_by_their_size_on_the_way_and_hardly_in_the_end() {
        let column: Residual = vec![vec![1.0; 2]];
        let slopes = |loss: Loss| {
            [2.0, 4.0, 40.0].map(|far| Normal::of(&vec![vec![0.0, far]], &[Some(&column)], 10, loss).slope[0])
        };
        assert_eq!(slopes(Loss::straight(K)), [2.0, 4.0, 4.0]);
        let [near, at_the_knee, far] = slopes(Loss::LAST);
        assert_eq!([near, at_the_knee], [2.0, 4.0]);
        assert!((far - 0.004).abs() < 1e-9, "{far}");
        assert!(Loss::LAST.of(1e6) <= 2.0 * K * K);
    }

    #[test]
    fn a_loss_has_the_slope_that_its_weight_says() {
        for loss in [Loss::straight(K), Loss::LAST] {
            for value in [-30.0, -4.1, -3.9, 0.5, 3.9, 4.1, 30.0] {
                let slope = (loss.of(value + 1e-5) - loss.of(value - 1e-5)) / 2e-5;
                assert!((0.5 * slope - loss.weight(value) * value).abs() < 1e-6, "{loss:?} at {value}");
            }
        }
    }
}
