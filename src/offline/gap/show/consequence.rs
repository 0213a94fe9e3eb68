//! What follows from an effect that was named, and so what would show that it is none.
//!
//! Invariant: of the model that was named and the same without the effect, nothing else changed.

use rayon::prelude::*;

use crate::offline::gap::model::Model;
use crate::offline::gap::model::problem::{Problem, SIGNALS};

/// The signal and the run in which a model without an effect is furthest from that with it, in units of noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Consequence {
    /// Which run.
    pub run: usize,
    /// Place of the signal in [`SIGNALS`].
    pub signal: usize,
    /// How far, rms, m or A.
    pub rms: f64,
    /// Noise of that signal, rms, m or A.
    pub noise: f64,
}

/// Of the effect of a place in the list of a model; nothing where no run shows it.
pub fn consequence(problem: &Problem<'_>, model: &Model, place: usize) -> Option<Consequence> {
    let without = model.without(place);
    let of_run = |run: usize| {
        let both = [model, &without].map(|model| problem.simulated(run, model));
        let data = &problem.data[run];
        let part = data.main_part();
        let of_signal = |signal: usize| {
            let noise = problem.noises[signal].as_ref()?.rms;
            let [with, without] = both.each_ref().map(|made| problem.left(run, made, signal, part));
            let counting = with.iter().zip(&without).zip(data.rows(part)).filter(|(_, counts)| **counts);
            let (sum, count) =
                counting.fold((0.0, 0usize), |(sum, count), ((a, b), _)| (sum + (a - b).powi(2), count + 1));
            let rms = (sum / count.max(1) as f64).sqrt();
            Some(Consequence { run: data.run, signal, rms, noise })
        };
        (0..SIGNALS.len()).filter_map(of_signal).collect::<Vec<_>>()
    };
    let all: Vec<Consequence> = (0..problem.data.len()).into_par_iter().flat_map_iter(of_run).collect();
    let in_noise = |one: &Consequence| one.rms / one.noise.max(f64::MIN_POSITIVE);
    all.into_iter().filter(|one| one.rms > 0.0).max_by(|a, b| in_noise(a).total_cmp(&in_noise(b)))
}
