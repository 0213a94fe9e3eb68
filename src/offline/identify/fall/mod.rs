//! The falling part of friction, `D_v'` and `D_v`, from reversals: the shipped loops run each reversal of the log
//! again, on likely axes with any falling part, and what they ask for is compared with what was asked for.
//!
//! ```text
//!   axis as it is known so far, drawn within its intervals ──┐
//!   (D_v, D_v'), drawn in a region ──────────────────────────┴─► reversals in the loops ──► signature ──┐
//!                                                                                                        ▼
//!   log ──► signature ──────────────────────────────────────► how likely is each (D_v, D_v') ──► smaller region
//! ```
//!
//! It is not compared row by row: the table sticks and slips on its way through the fall, and whether once more
//! hangs by a hair. It is compared by numbers that scatter little (`signature`), and how they depend on `D_v` and
//! `D_v'`, and scatter with all that is not known, is taken from the draws (`surface`). So no constant of a
//! simulated machine enters, and the interval holds the errors of what was found before.
//!
//! Whether friction falls as a parabola (`nonlinear`) or drops (`linear`) is decided by reversals that were
//! not looked at: the half of them makes some falling parts likely, and these foretell the other half. Units: mm/s, N.
//! Invariant: where no falling part explains the reversals, or many do, it is said and not guessed.

pub mod known;
pub mod reversal;
pub mod search;
mod signature;
mod surface;

use rand::RngExt;
use rand_pcg::Pcg64Mcg;

use crate::config::machine::Axis;
use crate::plant::friction::Variant;
use known::Known;
use reversal::Reversal;
use search::Search;
use signature::Signature;

/// Fewest reversals, and the most that are simulated: more tell hardly more, as most of what is unsure is common
/// to all.
const REVERSALS: [usize; 2] = [2, 6];

/// A variant is named where it is so much more probable than the other, as a logarithm: 20 to 1.
const ODDS_MIN: f64 = 3.0;

/// The reversals of a log, in two halves.
#[derive(Clone, Debug)]
pub struct Reversals {
    halves: [Vec<Reversal>; 2],
    seen: Halves,
}

/// What both halves look like, each on average.
#[derive(Clone, Debug)]
struct Halves([Signature; 2]);

impl Halves {
    fn whole(&self) -> Signature {
        self.0[0].iter().zip(&self.0[1]).map(|(a, b)| 0.5 * (a + b)).collect()
    }
}

impl Reversals {
    /// In turn in either half, their rows so long apart; `None` if there are too few.
    pub fn new(all: Vec<Reversal>, period_s: f64) -> Option<Self> {
        let [least, most] = REVERSALS;
        if all.len() < least {
            return None;
        }
        let count = all.len().min(most);
        let mut halves = [Vec::new(), Vec::new()];
        for number in 0..count {
            halves[number % 2].push(all[number * all.len() / count].clone());
        }
        let seen = Halves(halves.each_ref().map(|half| mean(half.iter().map(|one| one.signature(period_s)))));
        Some(Self { halves, seen })
    }

    /// How many are looked at.
    pub fn count(&self) -> usize {
        self.halves.iter().map(Vec::len).sum()
    }

    /// The first of them.
    pub fn first(&self) -> &Reversal {
        &self.halves[0][0]
    }

    /// What they look like on an axis.
    fn simulated(&self, axis: &Axis, random: &mut Pcg64Mcg) -> Halves {
        let mut one = |reversal: &Reversal| reversal.simulated(axis, random.random_range(-0.5..0.5));
        Halves(self.halves.each_ref().map(|half| mean(half.iter().map(&mut one))))
    }
}

fn mean(signatures: impl Iterator<Item = Signature>) -> Signature {
    let mut sum = Signature::new();
    let mut count = 0.0;
    for signature in signatures {
        sum.resize(signature.len(), 0.0);
        sum.iter_mut().zip(signature).for_each(|(sum, value)| *sum += value);
        count += 1.0;
    }
    sum.iter_mut().for_each(|sum| *sum /= count);
    sum
}

/// Both variants of the falling part, searched alike.
#[derive(Clone, Debug)]
pub struct Falls {
    nonlinear: Search,
    linear: Search,
    /// Logarithm of how much more probable either half of the reversals was by the nonlinear variant than by the
    /// linear one, once the other half was known.
    odds: f64,
}

impl Default for Falls {
    fn default() -> Self {
        let [nonlinear, linear] = [Variant::Nonlinear, Variant::Linear].map(Search::new);
        Self { nonlinear, linear, odds: 0.0 }
    }
}

impl Falls {
    /// Looks at so many regions more; the one coordinate of the linear variant is found in half as many.
    pub fn look(&mut self, reversals: &Reversals, known: &Known, regions: usize) {
        for (search, regions) in [(&mut self.nonlinear, regions), (&mut self.linear, regions.div_ceil(2))] {
            (0..regions).for_each(|_| search.look(reversals, known));
        }
        let [nonlinear, linear] = [&self.nonlinear, &self.linear].map(|search| search.foretold(reversals));
        self.odds = nonlinear.zip(linear).map_or(0.0, |(nonlinear, linear)| nonlinear - linear);
    }

    /// Logarithm of how much more probable the nonlinear variant makes what it was not fitted to.
    pub const fn odds(&self) -> f64 {
        self.odds
    }

    /// The variant that explains the reversals, and foretells them better than the other; `None` where neither
    /// does.
    pub fn variant(&self) -> Option<Variant> {
        let likelier = if self.odds > 0.0 { Variant::Nonlinear } else { Variant::Linear };
        (self.odds.abs() > ODDS_MIN && self.of(likelier).is_explained()).then_some(likelier)
    }

    /// The search of the named variant; of the nonlinear one where none is.
    pub fn best(&self) -> &Search {
        self.of(self.variant().unwrap_or(Variant::Nonlinear))
    }

    const fn of(&self, variant: Variant) -> &Search {
        match variant {
            Variant::Linear => &self.linear,
            Variant::Nonlinear => &self.nonlinear,
        }
    }
}
