//! The current loop from the current that was asked for and the current that came: a dead time and a first-order lag.
//!
//! ```text
//!   I(k+1) = p I(k) + q₁ u(k-n-1) + q₂ u(k-n)      p = exp(-T/τ), q₂ = 1 - exp(-(1-φ)T/τ), q₁ = 1 - p - q₂
//! ```
//!
//! The command takes effect after `n` periods and the share `φ` of another: what the board adds before it applies a
//! command is whole periods and known, the rest is the drive's dead time. The lag runs on its own output, not
//! on the measured current, so noise of the measurement does not pull it. Units: A, s.
//! Of both together the delay is told best, so their intervals are wide where that of the sum is not. Fitted to all
//! stretches at once: of one alone a lag may come out anywhere.
//! Invariant: where the command hardly changes, the loop is unknown.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::{DVector, Matrix2, Matrix2xX, Vector2};

use super::Finding;
use super::measured::{Measured, Piece};
use super::stretches::{Stretch, Stretches};
use super::{Estimate, least_squares::student95};
use crate::config::machine::Axis;
use crate::rt::drive::sheet::CommandApplies;

/// Longest dead time, periods, and largest logarithm of the lag in periods.
const DEAD_MAX: usize = 12;
const LAG_MAX: f64 = 5.0;
/// Rows before those compared, in which the lag forgets where it started.
const RUN_UP: usize = 100;
/// Over so many rows a difference of means counts as an error of measurement.
const BLOCK_ROWS: usize = 40;
/// Steps of Gauss-Newton, and how often one is halved.
const STEPS_MAX: usize = 20;
const HALVINGS_MAX: usize = 8;
/// Stretches that are needed.
const STRETCHES_MIN: usize = 3;
/// Most that half an interval of the lag may be, as a share of it: more tells nothing.
const TELLING: f64 = 0.5;

/// Bandwidth and dead time.
pub fn findings(measured: &Measured, stretches: &Stretches, axis: &Axis) -> [Finding; 2] {
    let all = stretches.accelerations.iter().chain(&stretches.reversals);
    let all: Vec<&Stretch> = all.filter(|stretch| stretch.rows.start >= RUN_UP + DEAD_MAX).collect();
    match fit(measured, &all, axis) {
        Some([lag_s, dead_s]) => {
            let source = format!("{} accelerations and reversals", all.len());
            let hz = 1.0 / (TAU * lag_s.value);
            let half_hz = hz * lag_s.half / lag_s.value;
            let lag = Estimate::within(hz, half_hz, "Hz", source.clone());
            [lag.into(), Estimate::within(1e6 * dead_s.value, 1e6 * dead_s.half, "us", source).into()]
        }
        None => {
            let needs =
                "at least 3 accelerations or reversals in which the current changes much within a period";
            [Finding::unknown(needs), Finding::unknown(needs)]
        }
    }
}

struct Told {
    value: f64,
    half: f64,
}

/// Lag and dead time that leave least of all stretches together; the interval from what each of them says.
fn fit(measured: &Measured, stretches: &[&Stretch], axis: &Axis) -> Option<[Told; 2]> {
    if stretches.len() < STRETCHES_MIN {
        return None;
    }
    let wait = match axis.sheet.command_applies {
        CommandApplies::OnNextSync => 1,
        CommandApplies::OnReceipt => 0,
    };
    let period_s = measured.period_s;
    // In periods: the lag by its logarithm, so that it stays above zero.
    let lag = |place: &Vector2<f64>| Lag { lag_s: period_s * place[0].exp(), dead_s: period_s * place[1] };
    let left = |place: &Vector2<f64>| -> Vec<DVector<f64>> {
        let one = |stretch: &&Stretch| {
            let piece = &measured.pieces[stretch.piece];
            let rows = stretch.rows.start - RUN_UP..stretch.rows.end;
            DVector::from_vec(left_a(piece, &rows, wait, period_s, lag(place)))
        };
        stretches.iter().map(one).collect()
    };
    let square = |left: &[DVector<f64>]| left.iter().map(DVector::norm_squared).sum::<f64>();
    let actuator = &axis.plant.actuator;
    let mut place = Vector2::new((actuator.lag_s() / period_s).ln(), actuator.dead_time.as_s() / period_s);
    let mut here = left(&place);
    let mut inverse = Matrix2::zeros();
    let mut gradients = Vec::new();
    for _ in 0..STEPS_MAX {
        const SMALL: f64 = 1e-4;
        let slopes = [Vector2::x(), Vector2::y()].map(|axis| left(&(place + axis * SMALL)));
        let mut normal = Matrix2::zeros();
        gradients.clear();
        for (row, here) in here.iter().enumerate() {
            let jacobian = Matrix2xX::from_fn(here.len(), |k, at| (slopes[k][row][at] - here[at]) / SMALL);
            normal += &jacobian * jacobian.transpose();
            gradients.push(&jacobian * here);
        }
        inverse = normal.try_inverse()?;
        let step = inverse * gradients.iter().sum::<Vector2<f64>>();
        let next = (0..HALVINGS_MAX).find_map(|halved| {
            let next = place - step * 0.5_f64.powi(halved as i32);
            let is_possible = next[0].abs() < LAG_MAX && next[1] > -1.0 && next[1] < DEAD_MAX as f64 - 2.0;
            let there = if is_possible { left(&next) } else { return None };
            (square(&there) < square(&here)).then_some((next, there))
        });
        let Some(next) = next else { break };
        (place, here) = next;
    }
    let count = stretches.len() as f64;
    let scatter: Matrix2<f64> = gradients.iter().map(|gradient| gradient * gradient.transpose()).sum();
    let covariance = inverse * scatter * inverse * (count / (count - 1.0));
    let half = |k: usize| student95(count - 1.0) * covariance[(k, k)].sqrt();
    let Lag { lag_s, dead_s } = lag(&place);
    (half(0) < TELLING).then(|| {
        [Told { value: lag_s, half: lag_s * half(0) }, Told { value: dead_s, half: period_s * half(1) }]
    })
}

#[derive(Clone, Copy, Debug)]
struct Lag {
    lag_s: f64,
    dead_s: f64,
}

/// What a lag leaves, A, less what changes slowly: a zero that the measurement has for itself is not the loop's.
fn left_a(
    piece: &Piece,
    rows: &Range<usize>,
    wait: usize,
    period_s: f64,
    Lag { lag_s, dead_s }: Lag,
) -> Vec<f64> {
    let whole = (dead_s / period_s).floor();
    let late_s = period_s - (dead_s - whole * period_s);
    let kept = (-period_s / lag_s).exp();
    let newer = 1.0 - (-late_s / lag_s).exp();
    let older = 1.0 - kept - newer;
    let behind = (wait as i64 + whole as i64).max(0) as usize;
    let mut current = piece.current_a[rows.start];
    let mut left = Vec::with_capacity(rows.len());
    for row in rows.clone() {
        left.push(piece.current_a[row] - current);
        let command = |back: usize| row.checked_sub(back).map_or(0.0, |at| piece.current_command_a[at]);
        current = kept * current + older * command(behind + 1) + newer * command(behind);
    }
    let mut left = left.split_off(RUN_UP);
    for block in left.chunks_mut(BLOCK_ROWS) {
        let mean = block.iter().sum::<f64>() / block.len() as f64;
        block.iter_mut().for_each(|value| *value -= mean);
    }
    left
}
