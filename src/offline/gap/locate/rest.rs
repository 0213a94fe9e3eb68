//! What is left without a name, and how it shows that it is something real.
//!
//! Invariant: noise has no rest.

use std::fmt;

use super::{Located, RunLeft};
use crate::offline::gap::measure::forward::DEFLECTION;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::problem::{SIGNALS, shown};
use crate::offline::gap::model::twin::BASE;
use crate::plant::effects::Coordinate;

/// What stands in data sheets, and how many times as much or as little of it is no machine that the file could mean: a file is
/// off by a factor of two, and damping, which is guessed, by a bit more.
const OF_DATA_SHEETS: [&str; 5] = ["mass", "motor_inertia", "stiffness", "damping", "sliding"];
const STRAINED: f64 = 4.0;
/// A signal of which every run leaves so many times noise has something in it: where nothing is missing the quietest of a session left 1.1 at
/// most, however much small reversals did. Fewer runs may be alike.
const EVERYWHERE: f64 = 1.4;
const RUNS_MIN: usize = 3;

/// So much of what is left of following error or current, and so many standard deviations of chance, is a shape over a coordinate of the machine: of
/// two hundred signals of axes that lack nothing the most was 0.03, and of fifteen seconds 0.1, which is 3.3 deviations there. Nor is a place or a
/// time asked, where somebody may have leaned on the table.
const SHAPE: (f64, f64) = (0.08, 7.0);
const OF_MACHINE: [Coordinate; 6] = [
    // The deflection has a zero along the way, and tells of these two alone.
    Coordinate::Velocity,
    Coordinate::Direction,
    Coordinate::Angle,
    Coordinate::WaySinceReversal,
    Coordinate::TimeSinceReversal,
    Coordinate::Acceleration,
];

/// Something that is left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rest {
    /// In a signal.
    In {
        /// Its place in [`SIGNALS`].
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
    /// All axes are behind their commands by one time.
    Behind {
        /// In so many runs.
        runs: usize,
        /// At most, s.
        by_s: f64,
    },
}

impl Rest {
    /// Of what a base leaves in every run, in the signal that shows it most, where passes tell the noise.
    pub(in crate::offline::gap) fn everywhere(
        left: &[RunLeft],
        is_told: impl Fn(usize) -> bool,
    ) -> Option<Self> {
        let of = |signal: usize| {
            let of_signal = left.iter().filter(|left| left.signal == signal && is_told(signal));
            let runs: Vec<f64> = of_signal.map(|left| left.per_row[0]).collect();
            let least = runs.iter().copied().fold(f64::INFINITY, f64::min);
            (runs.len() >= RUNS_MIN && least > EVERYWHERE).then_some((signal, least))
        };
        let most = (0..SIGNALS.len()).filter_map(of).max_by(|a, b| a.1.total_cmp(&b.1));
        most.map(|(signal, least)| Self::In { signal, shows: Shows::Everywhere(least) })
    }

    /// Of a base that leaves a shape, though it may be no more than what passes differ by: what walks is noise to them.
    pub(in crate::offline::gap) fn shaped(located: &[Located]) -> Option<Self> {
        let told = |signal: usize| if signal == DEFLECTION { &OF_MACHINE[..2] } else { &OF_MACHINE[..] };
        let is_plain = |one: &&Located| {
            one.share > SHAPE.0 && one.deviations > SHAPE.1 && told(one.signal).contains(&one.coordinate)
        };
        let most = located.iter().filter(is_plain).max_by(|a, b| a.share.total_cmp(&b.share))?;
        Some(Self::In { signal: most.signal, shows: Shows::Shaped(most.coordinate, most.share) })
    }

    /// Of a base that is no machine that the file could mean, whatever it explains alone or beside a name: a play of the scale head of 4 um
    /// passed for a damping of 8.7 times as much, and a hose that creeps for a spring on a table of 75 kg, where the file has 335.
    pub(in crate::offline::gap) fn strained(base: &Model) -> Option<Self> {
        let of_data_sheets =
            BASE.iter().zip(&base.base).filter(|(base, _)| OF_DATA_SHEETS.contains(&base.name));
        let logarithms = of_data_sheets.map(|(base, at)| (base.name, at * base.prior));
        let (parameter, furthest) = logarithms.max_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs()))?;
        (furthest.abs() > STRAINED.ln()).then_some(Self::Strained { parameter, ratio: furthest.exp() })
    }
}

/// How something that is left shows that it is no noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shows {
    /// It comes again over a coordinate in each run.
    Over(Coordinate),
    /// It has a shape over a coordinate, which is so much of all that is left.
    Shaped(Coordinate, f64),
    /// It sounds at a frequency, Hz.
    Tone(f64),
    /// It comes again after so much way, mm.
    Period(f64),
    /// It is in every run: so many times as much as noise is left of the quietest, per row.
    Everywhere(f64),
    /// It pushes an axis that slides along, at moments of its own: in so many runs of so many.
    Bursts([usize; 2]),
    /// Single readings jump while the axis slides along: in so many runs of so many.
    Jumps([usize; 2]),
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
            Self::Behind { runs, by_s } => {
                let side = if by_s < 0.0 { "ahead of" } else { "behind" };
                return write!(
                    out,
                    "for a while all axes are {side} their commands by one time, up to {:.3} ms, in {runs} of the runs: somebody turned the feed, or commands were held; what was there is left out",
                    1e3 * by_s.abs()
                );
            }
        };
        let (signal, ..) = shown(place);
        match shows {
            Shows::Over(coordinate) => {
                write!(out, "what is left of the {signal} comes again in each run, over the {coordinate}")
            }
            Shows::Shaped(coordinate, share) => write!(
                out,
                "{:.0} % of what is left of the {signal} is a shape over the {coordinate}",
                100.0 * share
            ),
            Shows::Tone(frequency_hz) => {
                write!(out, "what is left of the {signal} sounds at {frequency_hz:.0} Hz")
            }
            Shows::Period(period_mm) => {
                write!(
                    out,
                    "what is left of the {signal} comes again after each {period_mm:.2} mm of the way"
                )
            }
            Shows::Everywhere(times) => {
                write!(out, "each run leaves at least {times:.1} times as much of the {signal} as noise does")
            }
            Shows::Bursts([pushed, runs]) => write!(
                out,
                "the {signal} shows pushes while the axis slides along, at moments of their own, in {pushed} of {runs} runs"
            ),
            Shows::Jumps([jumping, runs]) => write!(
                out,
                "single readings of the {signal} jump while the axis slides along, in {jumping} of {runs} runs: look at the encoder and its line"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::offline::gap::measure::forward::{CURRENT, FOLLOWING_ERROR};
    use crate::plant::tests::paper_axis;

    #[test]
    fn what_every_run_leaves_is_real_and_what_one_does_may_be_an_event() {
        let left = |of_runs: &[f64]| -> Vec<RunLeft> {
            let run = |(run, left): (usize, &f64)| {
                [(0, 1.0), (1, *left)].map(|(signal, left)| RunLeft { run, signal, per_row: [left, left] })
            };
            of_runs.iter().enumerate().flat_map(run).collect()
        };
        let everywhere = |of_runs: &[f64]| Rest::everywhere(&left(of_runs), |_| true);
        let rest = Rest::In { signal: 1, shows: Shows::Everywhere(1.6) };
        assert_eq!(everywhere(&[1.9, 13.0, 2.4, 1.6]), Some(rest));
        assert_eq!(everywhere(&[1.9, 13.0, 2.4, 1.1]), None);
        assert_eq!(everywhere(&[1.9, 13.0]), None);
        // A floor that no passes tell is a lower bound.
        assert_eq!(Rest::everywhere(&left(&[1.9, 13.0, 2.4, 1.6]), |signal| signal != 1), None);
    }

    #[test]
    fn a_shape_over_what_the_machine_does_is_real_and_one_of_a_zero_or_an_event_is_not() {
        let located = |all: &[(usize, Coordinate, f64)], deviations: f64| -> Vec<Located> {
            let of = |(signal, coordinate, share): &(usize, Coordinate, f64)| Located {
                signal: *signal,
                coordinate: *coordinate,
                share: *share,
                deviations,
                profile: Vec::new(),
            };
            all.iter().map(of).collect()
        };
        let shaped = |all: &[(usize, Coordinate, f64)]| Rest::shaped(&located(all, 9.0));
        let event = (CURRENT, Coordinate::Time, 0.3);
        let zero = (DEFLECTION, Coordinate::Angle, 0.2);
        assert_eq!(shaped(&[event, zero, (CURRENT, Coordinate::Angle, 0.05)]), None);
        let rest = Rest::In { signal: FOLLOWING_ERROR, shows: Shows::Shaped(Coordinate::Acceleration, 0.13) };
        let shape = (FOLLOWING_ERROR, Coordinate::Acceleration, 0.13);
        assert_eq!(shaped(&[event, zero, shape]), Some(rest));
        let loose = Rest::In { signal: DEFLECTION, shows: Shows::Shaped(Coordinate::Direction, 0.11) };
        assert_eq!(shaped(&[event, zero, (DEFLECTION, Coordinate::Direction, 0.11)]), Some(loose));
        assert_eq!(Rest::shaped(&located(&[shape], 3.3)), None, "chance of a few seconds");
        assert_eq!(
            rest.to_string(),
            "13 % of what is left of the following error is a shape over the acceleration"
        );
    }

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
