//! What is left without a name, and how it shows that it is something real.
//!
//! Invariant: noise has no rest.

use std::fmt;

use super::bursts::bursts;
use super::foretold::{Again, foretold};
use super::model::Model;
use super::name::Named;
use super::problem::{Problem, shown};
use crate::plant::effects::Coordinate;

/// Share of what names explain that may be left in a shape: their equations may be off by as much.
const LEFT_SHARE: f64 = 0.05;

/// Something that is left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Place of the signal that shows it in [`SIGNALS`](super::problem::SIGNALS).
    pub signal: usize,
    /// How it shows.
    pub shows: Shows,
}

/// How something that is left shows that it is no noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shows {
    /// It comes again over a coordinate in each run.
    Over(Coordinate),
    /// It sounds at a frequency, Hz.
    Tone(f64),
    /// It pushes an axis that slides along, at moments of its own: in so many runs of so many.
    Bursts([usize; 2]),
}

impl Rest {
    /// What comes again in all that a model leaves, where that is much beside what its names explain.
    pub(super) fn with_a_shape(problem: &Problem<'_>, named: &Named) -> Option<Self> {
        let [base, model] = named.held();
        let explained = (named.base.cost - named.model.cost) + (base - model);
        let left = foretold(problem, &named.model.model).filter(|left| left.gain > LEFT_SHARE * explained)?;
        let shows = match left.again {
            Again::Over(coordinate) => Shows::Over(coordinate),
            Again::Tone(frequency_hz) => Shows::Tone(frequency_hz),
        };
        Some(Self { signal: left.signal, shows })
    }

    /// What comes and goes by itself.
    pub(super) fn of_bursts(problem: &Problem<'_>, model: &Model) -> Option<Self> {
        let (signal, runs) = bursts(problem, model)?;
        Some(Self { signal, shows: Shows::Bursts(runs) })
    }
}

impl fmt::Display for Rest {
    /// As a sentence.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (signal, ..) = shown(self.signal);
        match self.shows {
            Shows::Over(coordinate) => {
                write!(out, "what is left of the {signal} comes again in each run, over the {coordinate}")
            }
            Shows::Tone(frequency_hz) => {
                write!(out, "what is left of the {signal} sounds at {frequency_hz:.0} Hz")
            }
            Shows::Bursts([pushed, runs]) => write!(
                out,
                "the {signal} shows pushes while the axis slides along, at moments of their own, in {pushed} of {runs} runs"
            ),
        }
    }
}
