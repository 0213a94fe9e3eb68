//! The falling part of friction, `F_max`, `D_v'` and `D_v`, from reversals and slow ramps: the shipped loops run each of
//! them in the log again, on likely axes with any falling part, and what they ask for is compared with what was asked for.
//!
//! ```text
//!   axis as it is known so far, drawn within its intervals ──┐
//!   (F_max, D_v, D_v'), drawn in a region ───────────────────┴─► the same in the loops ──► signature ──┐
//!                                                                                                       ▼
//!   log ──► signature ────────────────────────────────► how likely is each (F_max, D_v, D_v') ──► smaller region
//! ```
//!
//! `F_max` is known before (`breakaway`), with a coarse encoder to some per cent only, and where the fall begins hangs by
//! it. So it is searched with the falling part: what was known is how likely it is before the log is looked at.
//!
//! It is not compared row by row: the table sticks and slips on its way through the fall, and whether once more
//! hangs by a hair. It is compared by numbers that scatter little (`signature`), of which a line makes one for each of the
//! three (`compressed`); how these depend on the three, and scatter with all that is not known, is taken from the draws
//! (`surface`). So no constant of a simulated machine enters, and the interval holds the errors of what was found before.
//!
//! Whether friction falls as a parabola (`nonlinear`) or drops (`linear`) is decided, where it is in doubt, by
//! reversals that were not looked at: the half of them makes some falling parts likely, and these foretell the other half.
//! Units: mm/s, N.
//! Invariant: where no falling part explains the reversals, or many do, it is said and not guessed.

mod compressed;
pub mod known;
pub mod passage;
pub mod ramp;
pub mod reversal;
pub mod search;
mod signature;
mod surface;

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use crate::config::machine::Axis;
use crate::plant::friction::Variant;
use known::Known;
use ramp::Ramp;
use reversal::Reversal;
use search::Search;
use signature::Signature;

/// Fewest reversals.
const REVERSALS_MIN: usize = 2;

/// How much of a log is looked at, and how thoroughly.
#[derive(Clone, Copy, Debug)]
pub struct Depth {
    /// Most reversals.
    pub reversals: usize,
    /// Most ramps of each way.
    pub ramps: usize,
    /// Axes drawn in a region.
    pub draws: u64,
}

/// A variant is named where it is so much more probable than the other, as a logarithm: 20 to 1.
const ODDS_MIN: f64 = 3.0;

/// What tells the falling part of a log: reversals, in two halves, and ramps.
#[derive(Clone, Debug)]
pub struct Evidence {
    halves: [Vec<Reversal>; 2],
    ramps: Vec<Ramp>,
    seen: Seen,
    draws: u64,
}

/// What it looks like: the reversals of either half, and the ramps, each on average.
#[derive(Clone, Debug)]
struct Seen {
    halves: [Signature; 2],
    ramps: Signature,
}

impl Seen {
    /// All of it, with the mean of both halves.
    fn whole(&self) -> Signature {
        let [one, other] = &self.halves;
        one.iter().zip(other).map(|(a, b)| 0.5 * (a + b)).chain(self.ramps.iter().copied()).collect()
    }

    /// A half with the ramps.
    fn half(&self, half: usize) -> Signature {
        [&self.halves[half][..], &self.ramps].concat()
    }
}

/// What is a matter of chance in a simulated passage.
#[derive(Clone, Copy, Debug)]
struct Chance {
    /// Where the motor is beside the place of the first row, as a share of a count, -0.5 to 0.5.
    count: f64,
    /// Friction of this place, as a multiple of what is known of it.
    friction: f64,
}

impl Chance {
    /// None.
    const NONE: Self = Self { count: 0.0, friction: 1.0 };
}

impl Evidence {
    /// Reversals in turn in either half, and ramps of both ways, no more than so many; rows so long apart. `None` if there
    /// are too few reversals.
    pub fn new(all: &[Reversal], ramps: &[Ramp], depth: Depth, period_s: f64) -> Option<Self> {
        if all.len() < REVERSALS_MIN {
            return None;
        }
        let count = all.len().min(depth.reversals);
        let mut halves = [Vec::new(), Vec::new()];
        for number in 0..count {
            halves[number % 2].push(all[number * all.len() / count].clone());
        }
        let of_way =
            |way: bool| ramps.iter().filter(move |ramp| ramp.is_forward() == way).take(depth.ramps).cloned();
        let ramps: Vec<Ramp> = [true, false].into_iter().flat_map(of_way).collect();
        let seen = Seen {
            halves: halves.each_ref().map(|half| mean(half.iter().map(|one| one.signature(period_s)))),
            ramps: mean(ramps.iter().map(|one| one.signature(period_s))),
        };
        Some(Self { halves, ramps, seen, draws: depth.draws })
    }

    /// How many reversals are looked at.
    pub fn count(&self) -> usize {
        self.halves.iter().map(Vec::len).sum()
    }

    /// The first of them.
    pub fn first(&self) -> &Reversal {
        &self.halves[0][0]
    }

    /// What it looks like on an axis whose friction differs from place to place by so much, as a share.
    fn simulated(&self, axis: &Axis, place: f64, random: &mut Pcg64Mcg) -> Seen {
        let mut by_chance = || {
            let normal: f64 = StandardNormal.sample(random);
            Chance { count: random.random_range(-0.5..0.5), friction: 1.0 + place * normal }
        };
        Seen {
            halves: self
                .halves
                .each_ref()
                .map(|half| mean(half.iter().map(|reversal| reversal.simulated(axis, by_chance())))),
            ramps: mean(self.ramps.iter().map(|ramp| ramp.simulated(axis, by_chance()))),
        }
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

/// Both variants of the falling part. A drop is a parabola that begins where it ends, so it is looked for only where
/// the parabola may begin there, or explains nothing.
#[derive(Clone, Debug)]
pub struct Falls {
    nonlinear: Search,
    linear: Option<Linear>,
}

/// The search for a drop.
#[derive(Clone, Debug)]
struct Linear {
    search: Search,
    /// Logarithm of how much more probable either half of the reversals was by the nonlinear variant than by this one,
    /// once the other half was known.
    odds: f64,
}

impl Default for Falls {
    fn default() -> Self {
        Self { nonlinear: Search::new(Variant::Nonlinear), linear: None }
    }
}

impl Falls {
    /// Looks at so many regions more.
    pub fn look(&mut self, evidence: &Evidence, known: &Known, regions: usize) {
        (0..regions).for_each(|_| self.nonlinear.look(evidence, known));
    }

    /// Whether a drop is to be looked for.
    pub fn may_be_a_drop(&self) -> bool {
        self.nonlinear.may_be_a_drop()
    }

    /// Looks at so many regions more for a drop, and whether the last of the evidence is foretold by it or by the parabola.
    pub fn look_for_a_drop(&mut self, evidence: &Evidence, known: &Known, regions: usize) {
        let mut search =
            self.linear.take().map_or_else(|| Search::new(Variant::Linear), |linear| linear.search);
        (0..regions).for_each(|_| search.look(evidence, known));
        let [nonlinear, linear] = [&self.nonlinear, &search].map(|search| search.foretold(evidence, known));
        let odds = nonlinear.zip(linear).map_or(0.0, |(nonlinear, linear)| nonlinear - linear);
        self.linear = Some(Linear { search, odds });
    }

    /// Logarithm of how much more probable the nonlinear variant makes what it was not fitted to; `None` where no
    /// drop was looked for.
    pub fn odds(&self) -> Option<f64> {
        self.linear.as_ref().map(|linear| linear.odds)
    }

    /// The variant that explains the reversals, and foretells them better than the other; `None` where neither
    /// does.
    pub fn variant(&self) -> Option<Variant> {
        let likelier = match self.odds() {
            Some(odds) if odds.abs() <= ODDS_MIN => return None,
            Some(odds) if odds < 0.0 => Variant::Linear,
            _ => Variant::Nonlinear,
        };
        self.of(likelier).is_explained().then_some(likelier)
    }

    /// The search of the named variant; of the nonlinear one where none is.
    pub fn best(&self) -> &Search {
        self.of(self.variant().unwrap_or(Variant::Nonlinear))
    }

    fn of(&self, variant: Variant) -> &Search {
        match (&self.linear, variant) {
            (Some(linear), Variant::Linear) => &linear.search,
            _ => &self.nonlinear,
        }
    }
}
