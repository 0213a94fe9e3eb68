//! What is said of an axis in a word, and the gap in numbers, on rows that no model has seen.
//!
//! Units: those of the signals, in um and A.
//! Invariant: a function of costs and gaps alone.

use std::fmt;

use serde::Serialize;

use crate::offline::gap::fit::Fitted;
use crate::offline::gap::gates::candidate::Candidate;
use crate::offline::gap::locate::foretold::foretold;
use crate::offline::gap::locate::rest::Rest;
use crate::offline::gap::measure::forward::Signals;
use crate::offline::gap::model::Model;
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::linear::BLOCK_S;
use crate::offline::gap::model::moving::SINCE_S;
use crate::offline::gap::model::problem::{Problem, SIGNALS, shown};
use crate::offline::gap::model::twin::{BASE, Base};
use crate::offline::gap::name::named::Named;

/// A gap that moves an axis by less is none that anybody would look for, um.
pub const PRACTICAL_UM: f64 = 0.1;
/// Where what is left without a name has the power of noise, names must close this share of it.
const PLAIN: f64 = 1.0;
const CLOSED: f64 = 0.75;
/// A gap that is so much more than noise, in units of its power, is made no wider by a name.
const WIDE: f64 = 0.5;
/// What is as wide to a hundredth is no wider: rows that judge say nothing of it.
const WIDER: f64 = 1.01;
/// So many names that were searched for come near anything, as a series does, and must close more of it: a cable chain was a
/// pitch error, a stiffness and a friction that change along the axis, to 83 %.
const MANY: usize = 3;
const CLOSED_BY_MANY: f64 = 0.9;
/// In motion, what names close tells of them where there was this share of the power of noise and more.
const SHOWN: f64 = 0.25;
/// Share of what names explain that may be left in a shape: their equations may be off by as much.
const LEFT_SHARE: f64 = 0.05;
/// Share of the time in which what is left says nothing of what is named.
const LEANED: f64 = 0.05;
/// Most effects of a class that still says something.
const CLASS_MAX: usize = 3;

/// The verdict on an axis, or on all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Model and data agree.
    NothingMissing,
    /// They agree once the base parameters are right.
    ParameterOnly,
    /// The data do not excite what would tell.
    Insufficient,
    /// Something real is left that no effect of the catalogue explains.
    Unknown,
    /// One of several effects, which these data do not tell apart.
    Class,
    /// The effect has a name.
    Named,
}

impl fmt::Display for Verdict {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::NothingMissing => "nothing missing",
            Self::ParameterOnly => "base parameters only",
            Self::Insufficient => "runs that do not tell",
            Self::Unknown => "something unknown is missing",
            Self::Class => "one of several effects is missing",
            Self::Named => "an effect is missing",
        })
    }
}

/// The gap of one signal on rows that no model has seen.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SignalGap {
    /// Which signal.
    pub signal: &'static str,
    /// Unit of the rms values.
    pub unit: &'static str,
    /// With the machine file as it is.
    pub file: f64,
    /// With its base parameters fitted.
    pub before: f64,
    /// With the effects.
    pub after: f64,
    /// Noise.
    pub floor: f64,
}

impl SignalGap {
    /// Before and after, how much more there is than noise, in units of its power.
    pub fn excess(&self) -> [f64; 2] {
        let floor2 = self.floor.max(1e-9).powi(2);
        [self.before, self.after].map(|rms| (rms * rms / floor2 - 1.0).max(0.0))
    }

    /// Which share of the excess over the noise is gone.
    pub fn closed_share(&self) -> f64 {
        let [before, after] = self.excess();
        if before == 0.0 { 1.0 } else { 1.0 - after / before }
    }
}

/// Rms of what models leave of the rows that were not fitted, each row weighed by how little of it is left to chance. Where a table creeps,
/// a slip comes a moment earlier or later whatever the model is, and one of them outweighs a minute.
pub(in crate::offline::gap) fn gaps(problem: &Problem<'_>, file: &Model, named: &Named) -> Vec<SignalGap> {
    let rms = |model: &Model| problem.rms_left(model, Part::Held);
    let [file, before, after] = [file, &named.base.model, &named.model.model].map(rms);
    let of = |signal: usize| {
        let floor = problem.floor(signal, Part::Held)?;
        let (name, factor, unit) = shown(signal);
        Some(SignalGap {
            signal: name,
            unit,
            file: factor * file[signal],
            before: factor * before[signal],
            after: factor * after[signal],
            floor: factor * floor,
        })
    };
    (0..SIGNALS.len()).filter_map(of).collect()
}

/// Before and after, how much more there is than noise in some signals together, in units of its power.
pub fn excess_of_all<'g>(gap: impl IntoIterator<Item = &'g SignalGap>) -> [f64; 2] {
    let add = |[before, after]: [f64; 2], [more, left]: [f64; 2]| [before + more, after + left];
    gap.into_iter().map(SignalGap::excess).fold([0.0; 2], add)
}

/// Whether what was named leaves most of a gap in all signals together.
pub(in crate::offline::gap) fn closes_little(gap: &[SignalGap]) -> bool {
    let [before, after] = excess_of_all(gap);
    after > (1.0 - CLOSED) * before
}

/// Whether what was named makes a plain gap on rows that it has not seen wider: rows that count by their changes may be led away from
/// what is slow, as from a friction that falls for seconds where oil comes in.
pub(in crate::offline::gap) fn widens(gap: &[SignalGap]) -> bool {
    let [before, after] = excess_of_all(gap);
    before > WIDE && after > WIDER * before
}

/// An rms also counts what is slow, which passes do not repeat.
fn costs_more_than_noise(named: &Named) -> bool {
    named.blocks[1].costs_more_than_noise()
}

/// What comes again in all that a model leaves, where that is much beside what its names explain.
pub(in crate::offline::gap) fn shape(problem: &Problem<'_>, named: &Named) -> Option<Rest> {
    let [base, model] = named.held();
    let explained = (named.base.cost - named.model.cost) + (base - model);
    let left = foretold(problem, &named.model.model).filter(|left| left.gain > LEFT_SHARE * explained)?;
    Some(left.rest)
}

/// Whether what was named leaves much of what there is: then it is something else that looks like it from afar. What is less than anybody would
/// look for does not count: bristles follow no law to the last tenth of a micrometre. Nor does what they leave at reversals, where names close
/// most of what there is in motion: of a spring or a ripple it tells nothing.
pub(in crate::offline::gap) fn explains_too_little(
    problem: &Problem<'_>,
    named: &Named,
    gap: &[SignalGap],
) -> bool {
    if !is_real(gap, |signal| signal.after) || !costs_more_than_noise(named) {
        return false;
    }
    let models = [&named.base.model, &named.model.model];
    let power = |mut blocks: Vec<[f64; 2]>| {
        // Somebody may have leaned on the table.
        blocks.sort_by(|a, b| a[1].total_cmp(&b[1]));
        blocks.truncate(blocks.len() - (LEANED * blocks.len() as f64).ceil() as usize);
        beyond_noise(&blocks)
    };
    leave_much(blocks_of_power(problem, models).map(power), named.searched())
}

/// Before and after, how much more than noise is in blocks on average, in units of its power.
fn beyond_noise(blocks: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|which| {
        let power = blocks.iter().map(|block| block[which]).sum::<f64>() / blocks.len().max(1) as f64;
        (power - 1.0).max(0.0)
    })
}

/// Whether so many names leave much of what was plain, and do not close most of it in motion either.
fn leave_much([all, in_motion]: [[f64; 2]; 2], names: usize) -> bool {
    all[0] > PLAIN && !closes_much(all, names, PLAIN) && !closes_much(in_motion, names, SHOWN)
}

/// Whether so many names close enough of more than so much.
fn closes_much([before, after]: [f64; 2], names: usize, least: f64) -> bool {
    let closed = if names >= MANY { CLOSED_BY_MANY } else { CLOSED };
    before > least && after <= (1.0 - closed) * before
}

/// Power of what two models leave of each block of the rows that were not fitted, in units of noise, of the signal that
/// shows most: of all, and of those alone in which the axis moves. Rows count as in [`gaps`]: a second in which the table creeps outweighs
/// a minute here as well.
fn blocks_of_power(problem: &Problem<'_>, models: [&Model; 2]) -> [Vec<[f64; 2]>; 2] {
    let length = problem.rows_in(BLOCK_S);
    let floors: [Option<f64>; SIGNALS.len()] =
        std::array::from_fn(|signal| problem.floor(signal, Part::Held));
    let mut blocks = [Vec::new(), Vec::new()];
    for place in problem.places(Part::Held) {
        let data = &problem.data[place];
        let all = data.rows(Part::Held);
        let moves = problem.has_moved(data, models[0], SINCE_S);
        let in_motion: Vec<bool> = all.iter().zip(moves).map(|(counts, moves)| *counts && moves).collect();
        let simulated = models.map(|model| problem.simulated(place, model));
        let left: Vec<[Vec<f64>; 2]> = (0..SIGNALS.len())
            .filter_map(|signal| {
                let floor = floors[signal]?;
                let of = |simulated: &Signals| -> Vec<f64> {
                    let left = problem.left(place, simulated, signal, Part::Held);
                    let told = problem.told(place, signal);
                    left.iter().zip(told).map(|(value, told)| told * (value / floor).powi(2)).collect()
                };
                Some(simulated.each_ref().map(of))
            })
            .collect();
        for (blocks, rows) in blocks.iter_mut().zip([all, &in_motion]) {
            blocks.extend(powers(&left, rows, length));
        }
    }
    blocks
}

/// What is left of each block of so many rows that has any that count, of the signal that shows most of each of two models.
fn powers<'l>(
    left: &'l [[Vec<f64>; 2]],
    rows: &'l [bool],
    length: usize,
) -> impl Iterator<Item = [f64; 2]> + 'l {
    (0..rows.len()).step_by(length).filter_map(move |from| {
        let counting: Vec<usize> = (from..rows.len().min(from + length)).filter(|row| rows[*row]).collect();
        let power = |which: usize| {
            let of = |signal: &[Vec<f64>; 2]| {
                counting.iter().filter_map(|row| signal[which].get(*row)).sum::<f64>()
            };
            left.iter().map(of).fold(0.0, f64::max) / counting.len() as f64
        };
        (!counting.is_empty()).then(|| [0, 1].map(power))
    })
}

/// Whether a gap is so much beyond noise that anybody would look for what makes it.
fn is_real(gap: &[SignalGap], of: fn(&SignalGap) -> f64) -> bool {
    gap.iter().any(|signal| {
        let (value, floor) = (of(signal), signal.floor);
        let rest = (value * value - floor * floor).max(0.0).sqrt();
        rest > if signal.unit == "um" { PRACTICAL_UM.max(0.5 * floor) } else { 0.5 * floor.max(0.02) }
    })
}

/// What is to be said of an axis, where something real is left or is not, and where passes told what noise is or did not: what is
/// left beyond a floor that is a lower bound may be noise.
pub(in crate::offline::gap) fn verdict(
    named: &Named,
    gap: &[SignalGap],
    has_rest: bool,
    is_noise_told: bool,
) -> Verdict {
    // So many that no name says anything.
    if named.effects.iter().any(|effect| effect.class.len() > CLASS_MAX) {
        return Verdict::Insufficient;
    }
    if !named.effects.is_empty() {
        return if named.effects.iter().any(|effect| effect.class.len() > 1) {
            Verdict::Class
        } else {
            Verdict::Named
        };
    }
    let is_shown = named.refused.iter().any(Candidate::shows_something);
    if has_rest || is_shown || (costs_more_than_noise(named) && is_real(gap, |signal| signal.after)) {
        return if is_noise_told { Verdict::Unknown } else { Verdict::Insufficient };
    }
    let moved = |fitted: &Fitted| {
        let is_off = |(at, base): (&f64, &Base)| !base.is_zero() && (at * base.prior).abs() > 0.03;
        fitted.model.base.iter().zip(&BASE).any(is_off)
    };
    if is_real(gap, |signal| signal.file) && moved(&named.base) {
        Verdict::ParameterOnly
    } else {
        Verdict::NothingMissing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_a_tenth_of_a_micrometre_beyond_noise_is_looked_for() {
        for (unit, value, floor, is) in [
            ("um", 0.147, 0.11, false),
            ("um", 0.16, 0.11, true),
            ("um", 1.1, 1.0, false),
            ("um", 1.2, 1.0, true),
            ("A", 0.02, 0.018, false),
            ("A", 0.022, 0.018, true),
            ("A", 0.1, 0.2, false),
        ] {
            let gap = SignalGap { signal: "one", unit, file: 0.0, before: 0.0, after: value, floor };
            assert_eq!(is_real(&[gap], |signal| signal.after), is, "{value} {unit} where noise is {floor}");
        }
    }

    #[test]
    fn what_is_left_of_one_signal_is_held_against_the_gap_in_all() {
        let gap = |signals: &[[f64; 2]]| -> Vec<SignalGap> {
            let of = |[before, after]: &[f64; 2]| SignalGap {
                signal: "current",
                unit: "A",
                file: *before,
                before: *before,
                after: *after,
                floor: 1.0,
            };
            signals.iter().map(of).collect()
        };
        // A friction that falls, with other events of stick and slip; a friction beside a tool that cuts.
        assert!(!closes_little(&gap(&[[3.5, 0.5], [8.0, 0.6], [4.2, 2.9]])));
        assert!(closes_little(&gap(&[[1.6, 1.6], [1.9, 1.6], [3.2, 2.9]])));
        // A friction that fell for a while, by a friction that falls with the speed; a small pulse beside a drift.
        assert!(widens(&gap(&[[0.8, 0.82], [1.36, 1.4]])));
        assert!(!widens(&gap(&[[0.8, 0.82], [1.18, 1.2]])));
        assert!(!widens(&gap(&[[0.8, 0.82], [1.4, 1.36]])));
        assert!(!widens(&gap(&[[0.8, 0.82], [1.36, 1.3605]])), "as wide");
    }

    #[test]
    fn names_that_leave_much_of_a_plain_gap_explain_too_little() {
        // In units of the power of noise.
        for (before, after, names, is_too_little) in [
            (25.0, 9.0, 1, true),
            (25.0, 4.0, 1, false),
            (25.0, 4.0, 2, false),
            // Three come near anything.
            (25.0, 4.0, 3, true),
            (25.0, 3.0, 3, false),
            // What is hardly more than noise tells nothing of what closes it.
            (1.4, 1.4, 1, false),
            (1.0, 1.0, 3, false),
        ] {
            let power = beyond_noise(&[[before, after]; 8]);
            assert_eq!(leave_much([power; 2], names), is_too_little, "{before}, {after} with {names}");
        }
        // Of all blocks together.
        assert!(!leave_much([beyond_noise(&[[4.0, 4.0], [60.0, 1.0]]); 2], 1));
    }

    #[test]
    fn what_is_left_at_reversals_says_nothing_of_a_name_that_closes_most_in_motion() {
        for (all, in_motion, is_too_little) in [
            // A spring, and a ripple, on guides of another law; a reach of a cable chain as a pitch error.
            ([1.80, 0.83], [0.45, 0.02], false),
            ([15.1, 4.2], [9.9, 0.7], false),
            ([6.3, 4.0], [2.4, 1.2], true),
            // It shows at reversals alone.
            ([6.3, 4.0], [0.1, 0.0], true),
        ] {
            assert_eq!(leave_much([all, in_motion], 1), is_too_little, "{all:?}, {in_motion:?}");
        }
    }
}
