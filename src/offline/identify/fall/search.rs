//! The search for the falling part of one variant: region by region, each the likely part of the one before.
//!
//! A region is a box of the logarithms of `D_v` and `D_v' / D_v`. Axes are drawn all over it, and how likely each of its
//! points is comes from what they look like (`surface`). The likely part becomes the next region, because over a
//! small one what the axes look like is nearly a parabola. Units: mm/s.
//! Invariant: all chance comes from the number of the round and of the draw, so the answer is the same on any number of
//! threads.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::known::Known;
use super::signature::PARTS_SEEN;
use super::surface::Surface;
use super::{Halves, Reversals, Signature};
use crate::base::units::Velocity;
use crate::plant::friction::{Parameters, Variant};

/// Where `D_v` is looked for, mm/s, and `D_v'` as a share of it.
const END_MM_PER_S: [f64; 2] = [0.1, 2.0];
const SHARE: [f64; 2] = [0.03, 0.95];
/// Axes drawn in a region, for each of its coordinates.
const DRAWS: u64 = 60;
/// Over the first region what is seen bends more than over a part of it.
const DEGREES: [usize; 2] = [3, 2];
/// Points of a region each way, with one coordinate and with two.
const POINTS: [usize; 2] = [201, 41];
/// The next region reaches so many standard deviations to either side, and no less than this share of the region
/// before: what looks likely over all of the plane is sometimes beside it.
const REACH: f64 = 3.0;
const REACH_MIN: f64 = 0.35;
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
    end: Spread,
    /// Of a drop there is none.
    share: Option<Spread>,
    start: Option<Spread>,
    misfit: f64,
    left_n: f64,
}

/// A drawn axis: where its falling part is in the region, from -1 to 1, and what its reversals look like.
#[derive(Clone, Debug)]
struct Draw {
    place: Vec<f64>,
    seen: Halves,
}

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
            Variant::Linear => vec![END_MM_PER_S],
            Variant::Nonlinear => vec![END_MM_PER_S, SHARE],
        };
        let region = region.into_iter().map(|ends| ends.map(f64::ln)).collect();
        Self { variant, round: 0, region, last: None }
    }

    /// Looks at the region, and takes the likely part of it as the next.
    pub fn look(&mut self, reversals: &Reversals, known: &Known) {
        let count = DRAWS * self.region.len() as u64;
        let draw = |number: u64| {
            let mut random = Pcg64Mcg::seed_from_u64(self.round * count + number);
            let place: Vec<f64> = self.region.iter().map(|_| random.random_range(-1.0..1.0)).collect();
            let mut axis = known.drawn(&mut random);
            let fall: Vec<f64> =
                self.region.iter().zip(&place).map(|(ends, place)| at(*ends, *place)).collect();
            put(&mut axis.plant.friction, self.variant, &fall);
            Draw { seen: reversals.simulated(&axis, &mut random), place }
        };
        let draws: Vec<Draw> = (0..count).into_par_iter().map(draw).collect();
        self.last = self.judge(draws, &reversals.seen.whole());
        self.round += 1;
        let Some(Look { end, share, .. }) = &self.last else { return };
        let spreads = [Some(*end), *share].into_iter().flatten();
        for ((ends, bounds), spread) in self.region.iter_mut().zip([END_MM_PER_S, SHARE]).zip(spreads) {
            let reach = (REACH * spread.std).max(0.5 * REACH_MIN * (ends[1] - ends[0]));
            *ends = [(spread.mean - reach).max(bounds[0].ln()), (spread.mean + reach).min(bounds[1].ln())];
        }
    }

    /// What draws tell of what was seen; `None` where they tell nothing apart.
    fn judge(&self, draws: Vec<Draw>, seen: &Signature) -> Option<Look> {
        let degree = DEGREES[usize::from(self.round > 0)];
        let surface = surface(&draws, degree, Halves::whole)?;
        let likely = likely(&surface, seen, self.region.len());
        let coordinate = |place: &[f64], which: usize| at(self.region[which], place[which]);
        let (best, _) = likely.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        // Where the best does not explain all, the spread is as much wider (Birge, 1932, Physical Review 40, 207).
        let misfit = surface.misfit(best, seen);
        let wider = misfit.max(1.0).sqrt();
        let spread = |of: &dyn Fn(&[f64]) -> f64| {
            let mean: f64 = likely.iter().map(|(place, weight)| weight * of(place)).sum();
            let square: f64 = likely.iter().map(|(place, weight)| weight * (of(place) - mean).powi(2)).sum();
            Spread { mean, std: wider * square.sqrt() }
        };
        let off_n2: f64 =
            surface.expected(best).iter().zip(seen).take(PARTS_SEEN).map(|(a, b)| (a - b).powi(2)).sum();
        let has_start = self.variant == Variant::Nonlinear;
        Some(Look {
            end: spread(&|place| coordinate(place, 0)),
            share: has_start.then(|| spread(&|place| coordinate(place, 1))),
            start: has_start.then(|| spread(&|place| coordinate(place, 0) + coordinate(place, 1))),
            misfit,
            left_n: (off_n2 / PARTS_SEEN as f64).sqrt(),
            draws,
        })
    }

    /// Gives a law the most likely falling part.
    pub fn put(&self, friction: &mut Parameters) {
        if let Some(Look { end, share, .. }) = &self.last {
            let fall: Vec<f64> = [Some(*end), *share].iter().flatten().map(|spread| spread.mean).collect();
            put(friction, self.variant, &fall);
        }
    }

    /// `D_v`, if the last region tells it.
    pub fn end_mm_per_s(&self) -> Option<Told> {
        let end = self.last.as_ref()?.end;
        end.told().filter(|_| self.is_explained() && end.is_within(END_MM_PER_S))
    }

    /// `D_v'`, if the last region tells it.
    pub fn start_mm_per_s(&self) -> Option<Told> {
        let Look { share, start, .. } = self.last.as_ref()?;
        let is_within = share.is_some_and(|share| share.is_within(SHARE));
        start.as_ref()?.told().filter(|_| self.is_explained() && is_within)
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

    /// Logarithm of how probable either half of the reversals was, foretold by what the other half makes likely.
    pub fn foretold(&self, reversals: &Reversals) -> Option<f64> {
        let Look { draws, .. } = self.last.as_ref()?;
        let degree = DEGREES[usize::from(self.round > 1)];
        let [one, other] =
            [0, 1].map(|half: usize| surface(draws, degree, move |seen: &Halves| seen.0[half].clone()));
        let (one, other) = (one?, other?);
        let of = |learnt: &Surface, from: &Signature, asked: &Surface, what: &Signature| {
            let each = likely(learnt, from, self.region.len());
            let most = each.iter().map(|(place, _)| asked.log_density(place, what)).fold(f64::MIN, f64::max);
            let mean =
                |(place, weight): &(Vec<f64>, f64)| weight * (asked.log_density(place, what) - most).exp();
            most + each.iter().map(mean).sum::<f64>().ln()
        };
        let [first, second] = &reversals.seen.0;
        Some(of(&one, first, &other, second) + of(&other, second, &one, first))
    }
}

/// A coordinate within the ends of a region, from its place between -1 and 1.
fn at([low, high]: [f64; 2], place: f64) -> f64 {
    low + 0.5 * (place + 1.0) * (high - low)
}

fn put(friction: &mut Parameters, variant: Variant, fall: &[f64]) {
    friction.variant = variant;
    friction.fall_end = Velocity::mm_per_s(fall[0].exp());
    if let Some(share) = fall.get(1) {
        friction.fall_start = friction.fall_end * share.exp();
    }
}

fn surface(draws: &[Draw], degree: usize, of: impl Fn(&Halves) -> Signature) -> Option<Surface> {
    let seen: Vec<Signature> = draws.iter().map(|draw| of(&draw.seen)).collect();
    let draws: Vec<(&[f64], &[f64])> =
        draws.iter().zip(&seen).map(|(draw, seen)| (&draw.place[..], &seen[..])).collect();
    Surface::new(&draws, degree)
}

/// Points of a region and how likely each is, together 1.
fn likely(surface: &Surface, seen: &Signature, coordinates: usize) -> Vec<(Vec<f64>, f64)> {
    let count = POINTS[coordinates - 1];
    let point = |number: usize| -> Vec<f64> {
        let step = |way: usize| number / count.pow(way as u32) % count;
        (0..coordinates).map(|way| -1.0 + 2.0 * step(way) as f64 / (count - 1) as f64).collect()
    };
    let all: Vec<(Vec<f64>, f64)> = (0..count.pow(coordinates as u32))
        .map(point)
        .map(|place| {
            let density = surface.log_density(&place, seen);
            (place, density)
        })
        .collect();
    let most = all.iter().map(|(_, density)| *density).fold(f64::MIN, f64::max);
    let total: f64 = all.iter().map(|(_, density)| (density - most).exp()).sum();
    all.into_iter().map(|(place, density)| (place, (density - most).exp() / total)).collect()
}
