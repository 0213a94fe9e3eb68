//! Stiffness from the rows in which friction holds the table while the motor winds up the screw: `F = K x + C v`.
//!
//! A reversal has such rows, and so has a ramp from rest that pulls the other way than the motion before it. Position
//! is fitted to force, not the other way round: the motor moves a few micrometres there, so a coarse encoder is the
//! larger part of the noise. Damping and the motor's own acceleration are taken from the model.
//! Invariant: no rows near break-away, where the table may already creep.

use super::comparison::Model;
use super::least_squares;
use super::measured::Measured;
use super::stretches::Stretch;

/// Share of sliding friction up to which the table surely stands.
const HELD: f64 = 0.8;
/// Least span of the force, as a share of sliding friction.
const SPAN_MIN: f64 = 0.8;
/// Fewest rows.
const ROWS_MIN: usize = 10;

/// Stiffness of each stretch that tells one, N/m.
pub fn values_n_per_m(measured: &Measured, stretches: &[Stretch], model: &Model, offset_n: f64) -> Vec<f64> {
    stretches.iter().filter_map(|stretch| value(measured, stretch, model, offset_n)).collect()
}

fn value(measured: &Measured, stretch: &Stretch, model: &Model, offset_n: f64) -> Option<f64> {
    let piece = &measured.pieces[stretch.piece];
    let way = piece.setpoint_m_per_s[stretch.rows.end - 1].signum();
    let held_n = HELD * model.friction.sliding.as_n();
    let pull_n = |row: usize| {
        let motor_n = model.motor_kg * piece.acceleration_m_per_s2[row];
        let damping_n = model.mechanics.damping_n_s_per_m * piece.velocity_m_per_s[row];
        way * (piece.force_n[row] - motor_n - damping_n - offset_n)
    };
    let end = stretch.rows.clone().find(|row| pull_n(*row) > held_n)?;
    let is_below = |row: &usize| pull_n(*row) < -held_n;
    let start = (stretch.rows.start..end).rev().find(is_below).map_or(stretch.rows.start, |row| row + 1);
    let rows = start..end;
    if rows.len() < ROWS_MIN || pull_n(end) - pull_n(start) < SPAN_MIN * model.friction.sliding.as_n() {
        return None;
    }
    let pulls: Vec<f64> = rows.clone().map(pull_n).collect();
    let places: Vec<f64> = rows.map(|row| way * (piece.position_m[row] - piece.position_m[start])).collect();
    let fit = least_squares::fit(&[pulls.clone(), vec![1.0; pulls.len()]], &places, 0).ok()?;
    (fit.coefficients[0] > 0.0).then(|| 1.0 / fit.coefficients[0])
}
