//! The falling part of friction, `D_v'` and `D_v`, from reversals: the whole plane of both is searched, because chatter
//! makes what is left rugged, and what is probable of it is taken, because its lowest point is an accident.
//!
//! ```text
//!   for each (D_v, D_v'): model behind the measured motion ──► measured less modelled ──► 15 Hz ──► mean square
//!   probability ~ exp(-½ independent values · mean square / least mean square)   ──► mean and 95 % of either
//! ```
//!
//! Force is known below the cut-off of the filters only, and the table follows it while it stands, so chatter is
//! smeared in the comparison, and the fall comes out too narrow: on simulated machines `D_v` at 0.78 of the truth
//! and `D_v'` at 1.61, alike for all (friction, stiffness, damping, inertia and ripple were drawn at random). What is
//! found is corrected by that. Single machines differ from it by 4 % and 17 % with an encoder of 0.1 um, and the
//! reference machine with its 10 nm has 0.67; the intervals hold 10 % and 20 %, rms.
//!
//! Below 15 Hz it is the mean force of the chatter that is compared, and not at which moment the table stuck.
//! Whether friction falls as a parabola (`nonlinear`) or drops (`linear`) is decided by reversals that the
//! fit has not seen. Units: mm/s, N. Invariant: where the plane does not tell, nothing is said but that.

use super::comparison::{Comparison, Model};
use super::smoothing::LowPass;
use crate::base::units::Velocity;
use crate::plant::friction::Variant;

/// Cut-off of what is compared, Hz.
const CUTOFF_HZ: f64 = 15.0;
/// Where `D_v` is looked for, mm/s, and in how many steps; `D_v'` as a share of it.
const END_MM_PER_S: [f64; 2] = [0.1, 4.0];
const END_POINTS: usize = 15;
const SHARES: [f64; 7] = [0.05, 0.1, 0.17, 0.27, 0.4, 0.6, 0.85];
/// The second look: so much to either side of the best point of the first, as a factor.
const NEAR: [f64; 2] = [1.7, 2.2];
const NEAR_POINTS: [usize; 2] = [15, 9];
/// What the fit finds of a truth of 1, and how much it differs between machines, rms of the logarithm: `D_v`, `D_v'`.
const FOUND: [[f64; 2]; 2] = [[0.784, 0.1], [1.61, 0.2]];
/// An interval wider than this, as a factor, says nothing.
const TELLING: f64 = 4.0;

/// What the reversals tell, corrected.
#[derive(Clone, Debug, PartialEq)]
pub struct Fall {
    /// `D_v` and `D_v'` of the model that leaves least, mm/s: those that go with the other parameters of a fit.
    pub found: [f64; 2],
    /// `D_v`, mm/s, and its interval.
    pub end_mm_per_s: (f64, [f64; 2]),
    /// `D_v'`, mm/s, and its interval.
    pub start_mm_per_s: (f64, [f64; 2]),
    /// What the best model leaves below 15 Hz, rms, N.
    pub left_n: f64,
}

/// A point of the plane with what it leaves of each reversal.
struct Point {
    end_mm_per_s: f64,
    share: f64,
    left_n2: Vec<f64>,
}

impl Point {
    fn new(reversals: &[Comparison], model: &Model, end_mm_per_s: f64, share: f64) -> Self {
        let model = with(model, Variant::Nonlinear, end_mm_per_s, share);
        let left_n2 = reversals.iter().map(|reversal| left_n2(reversal, &model)).collect();
        Self { end_mm_per_s, share, left_n2 }
    }

    fn sum(&self) -> f64 {
        self.left_n2.iter().sum()
    }
}

/// The model with another falling part.
pub fn with(model: &Model, variant: Variant, end_mm_per_s: f64, share: f64) -> Model {
    let mut model = *model;
    model.friction.variant = variant;
    model.friction.fall_end = Velocity::mm_per_s(end_mm_per_s);
    model.friction.fall_start = Velocity::mm_per_s(end_mm_per_s * share);
    model
}

/// What a model with the friction of the place leaves of a reversal below 15 Hz, but for a constant. Mean square, N².
pub fn left_n2(reversal: &Comparison, model: &Model) -> f64 {
    let left = reversal.residuals_n(&reversal.here(model));
    let Some(low_pass) = LowPass::new(CUTOFF_HZ, reversal.rate_hz()) else { return f64::INFINITY };
    let left = low_pass.smooth(&left);
    let mean = left.iter().sum::<f64>() / left.len() as f64;
    left.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / left.len() as f64
}

/// The falling part of the nonlinear variant; `None` where the reversals do not tell it.
pub fn fit(reversals: &[Comparison], model: &Model) -> Option<Fall> {
    let coarse = plane(reversals, model, &spread(END_MM_PER_S, END_POINTS), &SHARES);
    let best = coarse.iter().min_by(|a, b| a.sum().total_cmp(&b.sum()))?;
    let near =
        |middle: f64, axis: usize| spread([middle / NEAR[axis], middle * NEAR[axis]], NEAR_POINTS[axis]);
    let shares: Vec<f64> = near(best.share, 1).into_iter().filter(|share| *share < 0.95).collect();
    let fine = plane(reversals, model, &near(best.end_mm_per_s, 0), &shares);
    let independent: f64 = reversals.iter().map(|r| 2.0 * CUTOFF_HZ * r.duration_s()).sum();
    // The spacing of the two planes differs: what lies in both counts by the area that a point stands for.
    let spacing = |count: usize, ratio: f64| ratio.ln() / (count - 1) as f64;
    let fine_area = spacing(NEAR_POINTS[0], NEAR[0] * NEAR[0]) * spacing(NEAR_POINTS[1], NEAR[1] * NEAR[1]);
    let coarse_area = spacing(END_POINTS, END_MM_PER_S[1] / END_MM_PER_S[0])
        * spacing(SHARES.len(), SHARES[SHARES.len() - 1] / SHARES[0]);
    let is_near = |point: &&Point| {
        let is_in = |value: f64, middle: f64, factor: f64| (value / middle).ln().abs() <= factor.ln();
        !(is_in(point.end_mm_per_s, best.end_mm_per_s, NEAR[0]) && is_in(point.share, best.share, NEAR[1]))
    };
    let weighed: Vec<(&Point, f64)> = fine
        .iter()
        .map(|point| (point, fine_area))
        .chain(coarse.iter().filter(is_near).map(|point| (point, coarse_area)))
        .collect();
    let least = weighed.iter().map(|(point, _)| point.sum()).fold(f64::INFINITY, f64::min);
    let weight =
        |(point, area): &(&Point, f64)| area * (-0.5 * independent * (point.sum() / least - 1.0)).exp();
    let told = |of: fn(&Point) -> f64| {
        tell(&weighed.iter().map(|entry| (of(entry.0), weight(entry))).collect::<Vec<_>>())
    };
    let end = told(|point| point.end_mm_per_s)?;
    let start = told(|point| point.end_mm_per_s * point.share)?;
    let [end_mm_per_s, start_mm_per_s] = [corrected(end, FOUND[0])?, corrected(start, FOUND[1])?];
    let left_n = (least / reversals.len() as f64).sqrt();
    Some(Fall { found: [end.0, start.0], end_mm_per_s, start_mm_per_s, left_n })
}

fn plane(reversals: &[Comparison], model: &Model, ends: &[f64], shares: &[f64]) -> Vec<Point> {
    let points = ends.iter().flat_map(|end| shares.iter().map(move |share| (*end, *share)));
    points.map(|(end, share)| Point::new(reversals, model, end, share)).collect()
}

/// Points at even ratios.
fn spread([low, high]: [f64; 2], points: usize) -> Vec<f64> {
    (0..points).map(|point| low * (high / low).powf(point as f64 / (points - 1) as f64)).collect()
}

/// Mean of weighed values and their spread, both by ratios.
fn tell(weighed: &[(f64, f64)]) -> Option<(f64, f64)> {
    let total: f64 = weighed.iter().map(|(_, weight)| weight).sum();
    let mean = (weighed.iter().map(|(value, weight)| value.ln() * weight).sum::<f64>() / total).exp();
    let square = |(value, weight): &(f64, f64)| (value / mean).ln().powi(2) * weight;
    let spread = (weighed.iter().map(square).sum::<f64>() / total).sqrt();
    (mean.is_finite() && spread.is_finite()).then_some((mean, spread))
}

/// What was found and its spread, as the truth with its interval; `None` where that says nothing.
fn corrected((found, spread): (f64, f64), [of_one, differs]: [f64; 2]) -> Option<(f64, [f64; 2])> {
    let value = found / of_one;
    let factor = (1.96 * spread.hypot(differs)).exp();
    (factor * factor < TELLING).then(|| (value, [value / factor, value * factor]))
}

/// How much better one variant explains reversals that it was not fitted to: mean squares that the linear and the
/// nonlinear variant leave of them, N². `None` with fewer than four reversals.
pub fn held_out_n2(reversals: &[Comparison], model: &Model) -> Option<[f64; 2]> {
    if reversals.len() < 4 {
        return None;
    }
    let ends = spread(END_MM_PER_S, END_POINTS);
    let linear = |end: &f64| -> Vec<f64> {
        let model = with(model, Variant::Linear, *end, 1.0);
        reversals.iter().map(|reversal| left_n2(reversal, &model)).collect()
    };
    let linear: Vec<Vec<f64>> = ends.iter().map(linear).collect();
    let nonlinear: Vec<Vec<f64>> =
        plane(reversals, model, &ends, &SHARES).into_iter().map(|point| point.left_n2).collect();
    Some([crossed(&linear), crossed(&nonlinear)])
}

/// Each half of the reversals is judged by the point that is best for the other half.
fn crossed(points: &[Vec<f64>]) -> f64 {
    let half = |point: &[f64], odd: usize| -> f64 { point.iter().skip(odd).step_by(2).sum() };
    let judged = |odd: usize| {
        let best = points.iter().min_by(|a, b| half(a, 1 - odd).total_cmp(&half(b, 1 - odd)));
        best.map_or(f64::INFINITY, |point| half(point, odd))
    };
    let count = points.first().map_or(1, Vec::len);
    (judged(0) + judged(1)) / count as f64
}
