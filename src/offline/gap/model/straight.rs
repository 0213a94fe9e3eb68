//! Where a model is straight: what it makes of a row changes in proportion while its base parameters change a little.
//!
//! ```text
//!   bend = (f(θ + δ) + f(θ - δ)) / 2 - f(θ)      δ: each base parameter up or down by a reach, in priors, at random
//! ```
//!
//! A table that breaks away a little earlier, or once less, bends some rows by many standard deviations of their noise. Until
//! the parameters are known more closely than that, such rows say nothing of which way to go, and what they cost hangs
//! on chance. So their bend counts as noise: widely at first, and more narrowly as the fit comes nearer. It is no noise of single rows: a
//! slip that comes later is as wrong in all rows near to it. What is all bend tells once for all of them together.
//! Invariant: the same model, reach and seed give the same rows the same weight.

use std::iter::repeat;
use std::sync::Arc;

use nalgebra::DVector;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::Model;
use super::data::{AxisData, Part};
use super::linear::{Linear, LinearRun, residuals};
use super::problem::{Problem, Residual, SIGNALS};
use super::twin::BASE;
use crate::offline::gap::measure::floor::Pick;
use crate::offline::gap::measure::forward::{DEFLECTION, Signals};
use crate::offline::running_mean::running_mean;

/// How many pairs of models are held against the one.
const PAIRS: usize = 6;
/// A row is as bent as those so near to it, s: an event may come that much earlier or later.
const NEAR_S: f64 = 0.02;

impl AxisData {
    /// Of each row of a signal the power of its noise and that of its bend.
    pub(in crate::offline::gap) fn powers(&self, signal: usize) -> impl Iterator<Item = [f64; 2]> + '_ {
        let noises = self.loudness[signal].iter().map(|loud| loud * loud).chain(repeat(1.0));
        noises.zip(self.bend[signal].iter().copied().chain(repeat(0.0))).map(Into::into).take(self.fit.len())
    }
}

/// By how much rows of a run count: every simulation of it asks.
#[derive(Debug)]
pub(super) struct Counting {
    /// By signal: what whitened values are multiplied with, so that they are as loud as they tell.
    pub(in crate::offline::gap) scales: [Vec<f64>; SIGNALS.len()],
    /// Of the deflection, of which its zero is asked: standard deviation of noise and bend in that of usual noise.
    pub(in crate::offline::gap) deviations: Vec<f64>,
    /// And one over its square, by part: nothing where a row does not count.
    pub(in crate::offline::gap) weights: [Vec<f64>; 2],
}

impl Counting {
    /// Of the rows of all runs, where so many are near to each other.
    pub(in crate::offline::gap) fn of(data: &[AxisData], near: usize) -> Vec<Self> {
        let weights = |data: &AxisData, part: Part| {
            let rows = data.powers(DEFLECTION).zip(data.rows(part));
            rows.map(|([noise, bend], counts)| if *counts { (noise + bend).recip() } else { 0.0 }).collect()
        };
        let of = |data: &AxisData| Self {
            scales: std::array::from_fn(|signal| {
                data.powers(signal).map(|powers| scale(powers, near)).collect()
            }),
            deviations: data.powers(DEFLECTION).map(|[noise, bend]| (noise + bend).sqrt()).collect(),
            weights: [Part::Fit, Part::Held].map(|part| weights(data, part)),
        };
        data.par_iter().map(of).collect()
    }
}

impl Problem<'_> {
    /// How many rows are as bent as one.
    pub(in crate::offline::gap) fn near(&self) -> usize {
        self.rows_in(2.0 * NEAR_S)
    }

    /// How much of each row of a run is not left to chance, as a share of its power.
    pub fn told(&self, place: usize, signal: usize) -> impl Iterator<Item = f64> + '_ {
        self.data[place].powers(signal).map(told)
    }

    /// How much each row of a run tells, by that of a row of noise.
    pub(in crate::offline::gap) fn weights(
        &self,
        place: usize,
        signal: usize,
    ) -> impl Iterator<Item = f64> + '_ {
        let near = self.near();
        self.data[place].powers(signal).map(move |powers| weight(powers, near))
    }

    /// Places in [`SIGNALS`] of what a residual is of.
    pub(in crate::offline::gap) fn signals(&self) -> Vec<usize> {
        (0..SIGNALS.len()).filter(|signal| self.noises[*signal].is_some()).collect()
    }

    /// How many values of a part count, each as much as it tells.
    pub fn count(&self, part: Part) -> usize {
        let (signals, mut count) = (self.signals(), 0.0);
        for (place, data) in self.data.iter().enumerate() {
            for signal in signals.iter().copied() {
                if !SIGNALS[signal].2(&data.measured).is_empty() {
                    let weights = self.weights(place, signal).zip(data.rows(part));
                    count += weights.filter(|(_, counts)| **counts).map(|(weight, _)| weight).sum::<f64>();
                }
            }
        }
        count as usize
    }

    /// The same of both parts.
    pub(in crate::offline::gap) fn counts(&self) -> [usize; 2] {
        [Part::Fit, Part::Held].map(|part| self.count(part))
    }

    /// The same where rows count less if a model is not straight about them within a reach, in priors, and where noise moves the mean
    /// as it does about that model.
    #[must_use]
    pub fn where_straight(&self, model: &Model, reach: f64, seed: u64) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let pairs: Vec<[Model; 2]> = (0..PAIRS)
            .map(|_| {
                let by = BASE.map(|_| if random.random_bool(0.5) { reach } else { -reach });
                [1.0, -1.0].map(|side| {
                    let mut coordinates = model.coordinates();
                    coordinates.iter_mut().zip(by).for_each(|(at, by)| *at += side * by);
                    model.at(&coordinates)
                })
            })
            .collect();
        let about = self.near();
        let of = |place: usize| {
            let here = self.simulated(place, model);
            let sides = pairs.iter().map(|pair| pair.each_ref().map(|model| self.simulated(place, model)));
            let mut squares: [Vec<f64>; SIGNALS.len()] = Default::default();
            for sides in sides {
                for (squares, (signal, noise)) in squares.iter_mut().zip(self.noises.iter().enumerate()) {
                    let Some(noise) = noise else { continue };
                    let bent = noise.whitened(&bend(&here, &sides, SIGNALS[signal].2));
                    squares.resize(bent.len(), 0.0);
                    squares.iter_mut().zip(bent).for_each(|(sum, bent)| *sum += bent * bent / PAIRS as f64);
                }
            }
            let mut data = self.data[place].clone();
            let moved = self.moved_by_noise(place, model);
            for (squares, chance) in squares.iter_mut().zip(moved.chance) {
                squares.iter_mut().zip(chance).for_each(|(sum, chance)| *sum += chance);
            }
            data.moved = moved.by;
            data.bend = squares.each_ref().map(|squares| running_mean(squares, about));
            data
        };
        let data: Vec<AxisData> = (0..self.data.len()).into_par_iter().map(of).collect();
        self.with_data(Arc::new(data))
    }
}

impl Linear {
    /// The same where rows count less if the model is not straight about them on its way to where some coordinates are zero: where a slip
    /// comes at another moment without an effect, or not at all, its derivative foretells neither.
    #[must_use]
    pub(in crate::offline::gap) fn where_straight_to_none(
        mut self,
        problem: &Problem<'_>,
        part: Part,
        coordinates: &[usize],
    ) -> Self {
        let (mut none, mut away) = (self.model.coordinates(), DVector::zeros(self.model.coordinate_count()));
        for at in coordinates {
            away[*at] = -std::mem::take(&mut none[*at]);
        }
        let there = residuals(problem, &self.model.at(&none), part);
        let near = problem.near();
        self.runs.par_iter_mut().zip(there).for_each(|(run, there)| run.weigh_by_bend(&there, &away, near));
        self
    }
}

impl LinearRun {
    /// Rows count less by how far what is left that far away is from what derivatives say, in the mean over so many rows.
    fn weigh_by_bend(&mut self, there: &Residual, away: &DVector<f64>, near: usize) {
        for (signal, (there, straight)) in there.iter().zip(self.moved(away)).enumerate() {
            let bend: Vec<f64> =
                there.iter().zip(straight).map(|(there, straight)| (there - straight).powi(2)).collect();
            let scales: Vec<f64> =
                running_mean(&bend, near).into_iter().map(|bend| scale([1.0, bend], near)).collect();
            let weigh =
                |of: &mut Residual| of[signal].iter_mut().zip(&scales).for_each(|(row, scale)| *row *= scale);
            weigh(&mut self.residual);
            self.columns.iter_mut().flatten().for_each(|column| weigh(Arc::make_mut(column)));
        }
    }
}

/// What is noise of a row, as a share of its power.
fn told([noise, bend]: [f64; 2]) -> f64 {
    noise / (noise + bend)
}

/// How much a row tells, by that of a row of noise, where its bend is that of so many.
fn weight(powers: [f64; 2], near: usize) -> f64 {
    let told = told(powers);
    told + (1.0 - told) / near as f64
}

/// What a row is multiplied with, so that it is as loud as it tells.
fn scale([noise, bend]: [f64; 2], near: usize) -> f64 {
    (weight([noise, bend], near) / (noise + bend)).sqrt()
}

/// What the mean of both sides differs by from the middle, row by row of a signal.
pub(in crate::offline::gap) fn bend(here: &Signals, sides: &[Signals; 2], pick: Pick) -> Vec<f64> {
    let [up, down] = sides.each_ref().map(pick);
    pick(here).iter().zip(up).zip(down).map(|((here, up), down)| 0.5 * (up + down) - here).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_a_slip_that_a_derivative_does_not_foretell_count_for_little_and_all_others_for_what_they_are()
    {
        let (rows, slip) = (1_000, 500..540);
        // The derivative has the slip come later with half as much of an effect; without it there is none.
        let column = (0..rows).map(|row| if slip.contains(&row) { 30.0 } else { 0.5 }).collect();
        let mut run =
            LinearRun { residual: vec![vec![1.0; rows]], columns: vec![None, Some(Arc::new(vec![column]))] };
        let there = vec![vec![0.5; rows]];
        run.weigh_by_bend(&there, &DVector::from_vec(vec![0.0, -1.0]), 20);
        let column = run.columns[1].as_ref().expect("a column");
        for (row, (left, by)) in run.residual[0].iter().zip(&column[0]).enumerate() {
            if slip.contains(&row) {
                assert!(*left < 0.02 && *by < 0.5, "{row}: {left}, {by}");
            } else if row.abs_diff(520) > 40 {
                assert!((*left, *by) == (1.0, 0.5), "{row}: {left}, {by}");
            }
        }
    }
}
