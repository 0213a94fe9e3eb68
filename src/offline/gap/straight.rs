//! Where a model is straight: what it makes of a row changes in proportion while its base parameters change a little.
//!
//! ```text
//!   bend = (f(θ + δ) + f(θ - δ)) / 2 - f(θ)      δ: each base parameter up or down by a reach, in priors, at random
//! ```
//!
//! A table that breaks away a little earlier, or once less, bends some rows by many standard deviations of their noise. Until
//! the parameters are known more closely than that, such rows say nothing of which way to go, and what they cost hangs
//! on chance. So their bend counts as noise: widely at first, and more narrowly as the fit comes nearer.
//! Invariant: the same model, reach and seed give the same rows the same weight.

use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::floor::Pick;
use super::forward::Signals;
use super::model::Model;
use super::problem::{AxisData, Problem, SIGNALS};
use super::twin::BASE;
use crate::offline::running_mean::running_mean;

/// How many pairs of models are held against the one.
const PAIRS: usize = 6;
/// A row is as bent as those so near to it, s: an event may come that much earlier or later.
const NEAR_S: f64 = 0.02;

impl Problem<'_> {
    /// The same where rows count less if a model is not straight about them within a reach, in priors.
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
        let about = self.rows_in(2.0 * NEAR_S);
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
            for (loudness, squares) in data.loudness.iter_mut().zip(&squares) {
                loudness.resize(squares.len(), 1.0);
                let power = running_mean(squares, about);
                loudness
                    .iter_mut()
                    .zip(power)
                    .for_each(|(loud, power)| *loud = (*loud * *loud + power).sqrt());
            }
            data
        };
        let data: Vec<AxisData> = (0..self.data.len()).into_par_iter().map(of).collect();
        self.with_data(Arc::new(data))
    }
}

fn bend(here: &Signals, sides: &[Signals; 2], pick: Pick) -> Vec<f64> {
    let [up, down] = sides.each_ref().map(pick);
    pick(here).iter().zip(up).zip(down).map(|((here, up), down)| 0.5 * (up + down) - here).collect()
}
