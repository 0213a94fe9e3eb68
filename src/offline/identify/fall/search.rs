//! The search for the falling part of one variant: region by region, each the likely part of the one before.
//!
//! A region is a box of the logarithms of `F_max`, `D_v` and `D_v' / D_v`. Axes are drawn all over it, and how likely
//! each of its points is comes from what they look like (`surface`), compressed to a number for each coordinate
//! (`compressed`); of `F_max` also from what was known of it before. The likely part becomes the next region, because
//! over a small one what the axes look like is nearly a parabola. Whether the best of it explains what was seen is asked
//! of all the numbers.
//! Units: N, mm/s.
//! Invariant: all chance comes from the number of the round and of the draw, so the answer is the same on any number of
//! threads.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::compressed::Compressed;
use super::known::Known;
use super::signature::PARTS_SEEN;
use super::surface::Surface;
use super::{Evidence, Seen, Signature};
use crate::base::units::{Force, Velocity};
use crate::plant::friction::{Parameters, Variant};

/// Where `D_v` is looked for, mm/s, and `D_v'` as a share of it.
const END_MM_PER_S: [f64; 2] = [0.1, 2.0];
const SHARE: [f64; 2] = [0.03, 0.95];
/// Coordinates of a region; the linear variant has no `SHARE_AT`.
const BREAKAWAY_AT: usize = 0;
const END_AT: usize = 1;
const SHARE_AT: usize = 2;
/// Of what the first region is bounded by what was known before.
const ANYWHERE: [f64; 2] = [0.0, f64::INFINITY];
/// Over the first region what is seen bends more than over a part of it.
const DEGREES: [usize; 2] = [3, 2];
/// Points of a region each way.
const POINTS: usize = 21;
/// The next region reaches so many standard deviations to either side, and no less than this share of the region
/// before: what looks likely over all of the plane is sometimes beside it.
const REACH: f64 = 3.0;
const REACH_MIN: f64 = 0.35;
/// Least `F_max`, as a multiple of `F_low`.
const BREAKAWAY_MIN: f64 = 1.001;
/// Half of a 95 % interval in standard deviations.
const OF_95: f64 = 1.96;
/// An interval wider than this, as a factor, says nothing.
const TELLING: f64 = 4.0;
/// Reversals farther than this from all axes, as the ratio of squares, are not explained by the law.
const EXPLAINED: f64 = 5.0;

/// A parameter and its interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// Most likely value.
    pub value: f64,
    /// Interval that contains the true value in 95 of 100 measurements.
    pub ci95: [f64; 2],
}

/// Mean and standard deviation of a logarithm.
#[derive(Clone, Copy, Debug)]
struct Spread {
    mean: f64,
    std: f64,
}

impl Spread {
    fn told(self) -> Option<Told> {
        let factor = (OF_95 * self.std).exp();
        let value = self.mean.exp();
        (factor * factor < TELLING).then(|| Told { value, ci95: [value / factor, value * factor] })
    }

    /// All that is likely, and some more.
    fn reach(self) -> [f64; 2] {
        [self.mean - REACH * self.std, self.mean + REACH * self.std]
    }

    /// Whether all that is likely lies within bounds: outside nobody looked.
    fn is_within(self, bounds: [f64; 2]) -> bool {
        let [low, high] = bounds.map(f64::ln);
        self.mean - OF_95 * self.std > low && self.mean + OF_95 * self.std < high
    }
}

/// What a region showed.
#[derive(Clone, Debug)]
struct Look {
    draws: Vec<Draw>,
    /// The region they were drawn from.
    region: Vec<[f64; 2]>,
    /// Of each coordinate.
    spreads: Vec<Spread>,
    /// Of `D_v'`, which a drop has not.
    start: Option<Spread>,
    misfit: f64,
    left_n: f64,
}

/// A drawn axis: where its falling part is in the region, from -1 to 1, and what its reversals look like.
#[derive(Clone, Debug)]
struct Draw {
    place: Vec<f64>,
    seen: Seen,
}

/// A point of a region and how likely it is.
type Weighed = (Vec<f64>, f64);

/// The search.
#[derive(Clone, Debug)]
pub struct Search {
    variant: Variant,
    /// Regions looked at.
    round: u64,
    region: Vec<[f64; 2]>,
    last: Option<Look>,
}

impl Search {
    /// Anywhere.
    pub fn new(variant: Variant) -> Self {
        let region = match variant {
            Variant::Linear => vec![ANYWHERE, END_MM_PER_S],
            Variant::Nonlinear => vec![ANYWHERE, END_MM_PER_S, SHARE],
        };
        let region = region.into_iter().map(|ends| ends.map(f64::ln)).collect();
        Self { variant, round: 0, region, last: None }
    }

    /// Looks at the region, and takes the likely part of it as the next.
    pub fn look(&mut self, evidence: &Evidence, known: &Known) {
        let before = before(known);
        let bounds = [before.reach(), END_MM_PER_S.map(f64::ln), SHARE.map(f64::ln)];
        for (ends, bounds) in self.region.iter_mut().zip(bounds) {
            *ends = within(*ends, bounds);
        }
        let draw = |number: u64| {
            let mut random = Pcg64Mcg::seed_from_u64((self.round << 32) + number);
            let place: Vec<f64> = self.region.iter().map(|_| random.random_range(-1.0..1.0)).collect();
            let mut axis = known.drawn(&mut random);
            let fall: Vec<f64> =
                self.region.iter().zip(&place).map(|(ends, place)| at(*ends, *place)).collect();
            put(&mut axis.plant.friction, self.variant, &fall);
            Draw { seen: evidence.simulated(&axis, known.uncertainty.place, &mut random), place }
        };
        let draws: Vec<Draw> = (0..evidence.draws).into_par_iter().map(draw).collect();
        self.last = self.judge(draws, &evidence.seen.whole(), before);
        self.round += 1;
        let Some(Look { spreads, .. }) = &self.last else { return };
        for (ends, spread) in self.region.iter_mut().zip(spreads) {
            let reach = (REACH * spread.std).max(0.5 * REACH_MIN * (ends[1] - ends[0]));
            *ends = [spread.mean - reach, spread.mean + reach];
        }
    }

    /// What draws tell of what was seen; `None` where they tell nothing apart.
    fn judge(&self, draws: Vec<Draw>, seen: &Signature, before: Spread) -> Option<Look> {
        let (likely, surface) = told(&draws, seen, self.round, &self.region, before)?;
        let coordinate = |place: &[f64], which: usize| at(self.region[which], place[which]);
        let (best, _) = likely.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        // Where the best leaves more than chance does, the spread is as much wider (Birge, 1932, Physical Review 40, 207).
        let misfit = surface.misfit(best, seen);
        let is_by_chance = misfit <= surface.misfit_by_chance(seen.len());
        let wider = if is_by_chance { 1.0 } else { misfit.sqrt() };
        // What a coordinate is between two points nobody asked.
        let between = |which: usize| {
            let [low, high] = self.region[which];
            ((high - low) / (POINTS - 1) as f64).powi(2) / 12.0
        };
        let spread = |of: &dyn Fn(&[f64]) -> f64, between: f64| {
            let mean: f64 = likely.iter().map(|(place, weight)| weight * of(place)).sum();
            let square: f64 = likely.iter().map(|(place, weight)| weight * (of(place) - mean).powi(2)).sum();
            Spread { mean, std: wider * (square + between).sqrt() }
        };
        let off_n2: f64 =
            surface.expected(best).iter().zip(seen).take(PARTS_SEEN).map(|(a, b)| (a - b).powi(2)).sum();
        let has_start = self.variant == Variant::Nonlinear;
        let of_start = |place: &[f64]| coordinate(place, END_AT) + coordinate(place, SHARE_AT);
        Some(Look {
            spreads: (0..self.region.len())
                .map(|which| spread(&|place| coordinate(place, which), between(which)))
                .collect(),
            start: has_start.then(|| spread(&of_start, between(END_AT) + between(SHARE_AT))),
            misfit,
            left_n: (off_n2 / PARTS_SEEN as f64).sqrt(),
            region: self.region.clone(),
            draws,
        })
    }

    /// Gives a law the most likely falling part.
    pub fn put(&self, friction: &mut Parameters) {
        if let Some(Look { spreads, .. }) = &self.last {
            let fall: Vec<f64> = spreads.iter().map(|spread| spread.mean).collect();
            put(friction, self.variant, &fall);
        }
    }

    /// `F_max`, N, as all of the evidence tells it.
    pub fn breakaway_n(&self) -> Option<Told> {
        self.last.as_ref()?.spreads[BREAKAWAY_AT].told().filter(|_| self.is_explained())
    }

    /// `D_v`, if the last region tells it.
    pub fn end_mm_per_s(&self) -> Option<Told> {
        let end = self.last.as_ref()?.spreads[END_AT];
        end.told().filter(|_| self.is_explained() && end.is_within(END_MM_PER_S))
    }

    /// `D_v'`, if the last region tells it.
    pub fn start_mm_per_s(&self) -> Option<Told> {
        let Look { spreads, start, .. } = self.last.as_ref()?;
        let is_within = spreads.get(SHARE_AT).is_some_and(|share| share.is_within(SHARE));
        start.as_ref()?.told().filter(|_| self.is_explained() && is_within)
    }

    /// Whether a drop may be what a parabola was looked for: none explains what was seen, or one that begins where it ends
    /// may.
    pub fn may_be_a_drop(&self) -> bool {
        let Some(Look { spreads, .. }) = &self.last else { return true };
        !self.is_explained() || spreads.get(SHARE_AT).is_none_or(|share| share.reach()[1] > SHARE[1].ln())
    }

    /// Whether it is the search for this variant.
    pub fn is_of(&self, variant: Variant) -> bool {
        self.variant == variant
    }

    /// Whether the most likely axis may look as the log does.
    pub fn is_explained(&self) -> bool {
        self.misfit() < EXPLAINED
    }

    /// How much farther from the most likely axis the log is than the axes drawn there, as a ratio of squares.
    pub fn misfit(&self) -> f64 {
        self.last.as_ref().map_or(f64::INFINITY, |look| look.misfit)
    }

    /// What the most likely axis leaves of the mean force in the parts of a reversal, rms, N.
    pub fn left_n(&self) -> f64 {
        self.last.as_ref().map_or(f64::INFINITY, |look| look.left_n)
    }

    /// Logarithm of how probable either half of the reversals was, foretold by what the other half and the ramps make
    /// likely.
    pub fn foretold(&self, evidence: &Evidence, known: &Known) -> Option<f64> {
        let Look { draws, region, .. } = self.last.as_ref()?;
        let degree = DEGREES[usize::from(self.round > 1)];
        let of = |from: usize, what: usize| {
            let asked = surface(draws, degree, |seen: &Seen| seen.halves[what].clone())?;
            let learnt = surface(draws, degree, |seen: &Seen| seen.half(from))?;
            let (each, seen) = (
                likely(&learnt, &evidence.seen.half(from), region, before(known)),
                &evidence.seen.halves[what],
            );
            let densities: Vec<f64> = each.iter().map(|(place, _)| asked.log_density(place, seen)).collect();
            let most = densities.iter().copied().fold(f64::MIN, f64::max);
            let mean = |((_, weight), density): (&Weighed, &f64)| weight * (density - most).exp();
            Some(most + each.iter().zip(&densities).map(mean).sum::<f64>().ln())
        };
        Some(of(0, 1)? + of(1, 0)?)
    }
}

/// What was known of the logarithm of `F_max` before.
fn before(known: &Known) -> Spread {
    let breakaway_n = known.axis.plant.friction.breakaway.as_n();
    Spread { mean: breakaway_n.ln(), std: known.uncertainty.breakaway_n / breakaway_n }
}

/// The ends of a region within bounds; the bounds, where it lies beside them.
fn within([low, high]: [f64; 2], bounds: [f64; 2]) -> [f64; 2] {
    let inner = [low.max(bounds[0]), high.min(bounds[1])];
    if inner[0] < inner[1] { inner } else { bounds }
}

/// A coordinate within the ends of a region, from its place between -1 and 1.
fn at([low, high]: [f64; 2], place: f64) -> f64 {
    low + 0.5 * (place + 1.0) * (high - low)
}

fn put(friction: &mut Parameters, variant: Variant, fall: &[f64]) {
    friction.variant = variant;
    friction.breakaway = Force::n(fall[BREAKAWAY_AT].exp().max(BREAKAWAY_MIN * friction.sliding.as_n()));
    friction.fall_end = Velocity::mm_per_s(fall[END_AT].exp());
    if let Some(share) = fall.get(SHARE_AT) {
        friction.fall_start = friction.fall_end * share.exp();
    }
}

fn surface(draws: &[Draw], degree: usize, of: impl Fn(&Seen) -> Signature) -> Option<Surface> {
    let seen: Vec<Signature> = draws.iter().map(|draw| of(&draw.seen)).collect();
    let draws: Vec<(&[f64], &[f64])> =
        draws.iter().zip(&seen).map(|(draw, seen)| (&draw.place[..], &seen[..])).collect();
    Surface::new(&draws, degree)
}

/// Points of a region and how likely each is for what was seen, as the draws tell it; and all that they look like.
fn told(
    draws: &[Draw],
    seen: &Signature,
    round: u64,
    region: &[[f64; 2]],
    before: Spread,
) -> Option<(Vec<Weighed>, Surface)> {
    let signatures: Vec<Signature> = draws.iter().map(|draw| draw.seen.whole()).collect();
    let whole: Vec<(&[f64], &[f64])> =
        draws.iter().zip(&signatures).map(|(draw, seen)| (&draw.place[..], &seen[..])).collect();
    let surface = Surface::new(&whole, DEGREES[usize::from(round > 0)])?;
    // Over all of the first region no line tells anything.
    if round == 0 {
        return Some((likely(&surface, seen, region, before), surface));
    }
    let compressed = Compressed::new(&whole, seen)?;
    let few: Vec<(&[f64], &[f64])> =
        draws.iter().zip(&compressed.draws).map(|(draw, told)| (&draw.place[..], &told[..])).collect();
    Some((likely(&Surface::new(&few, DEGREES[1])?, &compressed.seen, region, before), surface))
}

/// Points of a region and how likely each is, together 1.
fn likely(surface: &Surface, seen: &Signature, region: &[[f64; 2]], before: Spread) -> Vec<Weighed> {
    let coordinates = region.len();
    let point = |number: usize| -> Vec<f64> {
        let step = |way: usize| number / POINTS.pow(way as u32) % POINTS;
        (0..coordinates).map(|way| -1.0 + 2.0 * step(way) as f64 / (POINTS - 1) as f64).collect()
    };
    let all: Vec<Weighed> = (0..POINTS.pow(coordinates as u32))
        .map(point)
        .map(|place| {
            let off = (at(region[BREAKAWAY_AT], place[BREAKAWAY_AT]) - before.mean) / before.std;
            let density = surface.log_density(&place, seen) - 0.5 * off * off;
            (place, density)
        })
        .collect();
    let most = all.iter().map(|(_, density)| *density).fold(f64::MIN, f64::max);
    let total: f64 = all.iter().map(|(_, density)| (density - most).exp()).sum();
    all.into_iter().map(|(place, density)| (place, (density - most).exp() / total)).collect()
}
