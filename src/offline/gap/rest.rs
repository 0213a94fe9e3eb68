//! What is left without a name, and how it shows that it is something real.
//!
//! Invariant: noise has no rest.

use std::fmt;

use super::model::Model;
use super::problem::shown;
use crate::plant::effects::Coordinate;

/// What stands in data sheets, and how many times as much or as little of it is no machine that the file could mean: a file is
/// off by a factor of two, and damping, which is guessed, by a bit more.
const OF_DATA_SHEETS: [&str; 5] = ["mass", "motor_inertia", "stiffness", "damping", "sliding"];
const STRAINED: f64 = 4.0;

/// Something that is left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rest {
    /// In a signal.
    In {
        /// Its place in [`SIGNALS`](super::problem::SIGNALS).
        signal: usize,
        /// How it shows there.
        shows: Shows,
    },
    /// Nothing is left, by a machine that its file cannot mean.
    Strained {
        /// The base parameter that is furthest off.
        parameter: &'static str,
        /// What it is, as a multiple of what the file says.
        ratio: f64,
    },
}

impl Rest {
    /// Of a base that explains all, and is no machine that the file could mean: a play of the scale head of 4 um passed for a damping
    /// of 8.7 times as much.
    pub(super) fn strained(base: &Model) -> Option<Self> {
        let filed = Model::new(base.nominal).base_values();
        let ratios = base
            .base_values()
            .into_iter()
            .zip(filed)
            .map(|((base, value), (_, filed))| (base.name, value / filed));
        let of_data_sheets =
            ratios.filter(|(name, ratio)| OF_DATA_SHEETS.contains(name) && ratio.is_finite());
        let size = |ratio: f64| ratio.ln().abs();
        let (parameter, ratio) = of_data_sheets.max_by(|(_, a), (_, b)| size(*a).total_cmp(&size(*b)))?;
        (size(ratio) > STRAINED.ln()).then_some(Self::Strained { parameter, ratio })
    }
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
        let (place, shows) = match *self {
            Self::In { signal, shows } => (signal, shows),
            Self::Strained { parameter, ratio } => {
                return write!(
                    out,
                    "only with {} {ratio:.1} times that of the machine file do the runs come out: it stands for something else, or the file is wrong",
                    parameter.replace('_', " ")
                );
            }
        };
        let (signal, ..) = shown(place);
        match shows {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::offline::gap::twin::BASE;
    use crate::plant::tests::paper_axis;

    #[test]
    fn a_base_that_no_file_could_mean_is_told_with_what_is_furthest_off() {
        let moved = |factors: &[(&str, f64)]| {
            let mut model = Model::new(paper_axis());
            for (name, factor) in factors {
                let place = BASE.iter().position(|base| base.name == *name).unwrap();
                model.base[place] = factor.ln() / BASE[place].prior;
            }
            Rest::strained(&model)
        };
        assert_eq!(moved(&[("mass", 2.0), ("damping", 3.5), ("stiffness", 0.4)]), None);
        // How friction falls is in no data sheet.
        assert_eq!(moved(&[("fall_end", 6.0)]), None);
        for factor in [8.0, 0.2] {
            let Some(Rest::Strained { parameter, ratio }) = moved(&[("mass", 2.0), ("damping", factor)])
            else {
                panic!("nothing is said of a damping of {factor}");
            };
            assert_eq!(parameter, "damping");
            assert!((ratio / factor - 1.0).abs() < 1e-9, "{ratio}");
        }
    }
}
