//! What is left without a name, and how it shows that it is something real.
//!
//! Invariant: noise has no rest.

use std::fmt;

use super::problem::shown;
use crate::plant::effects::Coordinate;

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
