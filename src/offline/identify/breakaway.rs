//! Break-away force, by the model behind the measured motion.
//!
//! Of a slow ramp: below `D_v'` the table slides under `F_max`, so the model with the right `F_max` leaves no mean force
//! behind break-away. A ramp is taken to be slower than `D_v'`, whatever that is: what the falling part does comes
//! after this. The peak of a ramp would be the simpler measure, but it grows with noise and with the drop behind it: it
//! was 1.1 % too high at 0.1 um and 3.1 % at 1 um.
//! Of a reversal, where there are no ramps: the `F_max` that leaves least.
//! Invariant: approached from below; a model that never breaks away would agree with anything.

use super::comparison::{Comparison, Model, Start};
use super::measured::Measured;
use super::ripple::Ripple;
use super::smoothing::LowPass;
use super::stretches::Stretch;
use crate::base::units::{Force, Velocity};

/// The table has broken away where the force has come to this share of its largest.
const NEAR: f64 = 0.95;
/// Rows that must be left behind it.
const ROWS_MIN: usize = 200;
/// Steps of the iteration, and the change that ends it, N.
const STEPS_MAX: usize = 12;
const DONE_N: f64 = 0.1;
/// The falling part of the model of a ramp, in multiples of its speed: where it does not matter.
const FALLS: [f64; 2] = [4.0, 10.0];
/// Break-away forces are looked for up to this multiple of sliding friction.
const RATIO_MAX: f64 = 2.5;
/// Cut-off of what is compared of a reversal, Hz: chatter is above it.
const CUTOFF_HZ: f64 = 15.0;

/// Break-away force of each ramp, N, with the sign of its way, as it is on average along the screw.
pub fn of_ramps(
    measured: &Measured,
    ramps: &[Stretch],
    model: &Model,
    offset_n: f64,
    ripple: &Ripple,
) -> Vec<f64> {
    ramps.iter().filter_map(|ramp| of_ramp(measured, ramp, model, offset_n, ripple)).collect()
}

fn of_ramp(
    measured: &Measured,
    ramp: &Stretch,
    model: &Model,
    offset_n: f64,
    ripple: &Ripple,
) -> Option<f64> {
    let piece = &measured.pieces[ramp.piece];
    let last = ramp.rows.end - 1;
    let way = piece.setpoint_m_per_s[last].signum();
    let factor = ripple.factor(piece.position_m[last], way);
    let model = Model { friction: model.friction.scaled(factor), ..*model };
    let comparison = Comparison::new(measured, ramp, Start::Standing)?;
    let pull: Vec<f64> = comparison.measured_n().iter().map(|force| way * (force - offset_n)).collect();
    let most = pull.iter().copied().fold(f64::MIN, f64::max);
    let sliding_n = model.friction.sliding.as_n();
    let broke = pull.iter().position(|force| *force >= NEAR * most)?;
    if most < 0.9 * sliding_n || pull.len() < broke + ROWS_MIN {
        return None;
    }
    let mut model = model;
    let speed = Velocity::m_per_s(piece.setpoint_m_per_s[last].abs());
    [model.friction.fall_start, model.friction.fall_end] = FALLS.map(|times| speed * times);
    let mut breakaway_n = 0.9 * sliding_n;
    for _ in 0..STEPS_MAX {
        model.friction.breakaway = Force::n(breakaway_n);
        model.friction.sliding = Force::n(sliding_n.min(breakaway_n));
        let left = comparison.residuals_n(&model);
        let behind = &left[broke..];
        let change_n = way * behind.iter().sum::<f64>() / behind.len() as f64 - way * offset_n;
        breakaway_n += change_n;
        if change_n.abs() < DONE_N {
            break;
        }
    }
    (breakaway_n >= 0.9 * sliding_n).then_some(way * breakaway_n / factor)
}

/// Break-away force of each reversal, N: the one that leaves least, by golden section. Of no way: it is that of both.
pub fn of_reversals(reversals: &[Comparison], model: &Model) -> Vec<f64> {
    reversals
        .iter()
        .map(|reversal| {
            let sliding_n = model.friction.sliding.as_n();
            least(sliding_n, RATIO_MAX * sliding_n, |breakaway_n| {
                let mut model = *model;
                model.friction.breakaway = Force::n(breakaway_n);
                left_n2(reversal, &model)
            })
        })
        .collect()
}

/// What a model with the friction of the place leaves of a reversal below the cut-off, but for a constant. Mean
/// square, N².
fn left_n2(reversal: &Comparison, model: &Model) -> f64 {
    let left = reversal.residuals_n(&reversal.here(model));
    let Some(low_pass) = LowPass::new(CUTOFF_HZ, reversal.rate_hz()) else { return f64::INFINITY };
    let left = low_pass.smooth(&left);
    let mean = left.iter().sum::<f64>() / left.len() as f64;
    left.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / left.len() as f64
}

/// Where a function is least: a scan, then golden section around its best point.
fn least(low: f64, high: f64, of: impl Fn(f64) -> f64) -> f64 {
    const POINTS: usize = 16;
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let at = |point: usize| low + (high - low) * point as f64 / (POINTS - 1) as f64;
    let values: Vec<f64> = (0..POINTS).map(|point| of(at(point))).collect();
    let best = (0..POINTS).min_by(|a, b| values[*a].total_cmp(&values[*b])).unwrap_or(0);
    let (mut left, mut right) = (at(best.saturating_sub(1)), at((best + 1).min(POINTS - 1)));
    while right - left > 1e-3 * high {
        let (a, b) = (right - GOLDEN * (right - left), left + GOLDEN * (right - left));
        if of(a) < of(b) {
            right = b;
        } else {
            left = a;
        }
    }
    0.5 * (left + right)
}
