//! A reversal of a log, and the same reversal as the shipped loops make it of another axis.
//!
//! What the log commanded is commanded again, from the same place and speed, with the same gains, encoder and
//! delays. Friction is that of the place: the sliding at both ends of the reversal and the ripple of the screw tell
//! how much it is there.
//! Units: SI, N at the table, positive along the motion before the reversal.
//! Invariant: both reversals are looked at in the same rows, by the same `signature`.

use std::ops::Range;

use super::super::measured::Measured;
use super::super::stretches::Stretch;
use super::Chance;
use super::passage::{Believed, Passage};
use super::signature::{Signature, of_reversal};
use crate::base::units::Velocity;
use crate::config::machine::Axis;
use crate::plant::friction::Law;

/// Before the rows of a stretch, for what is left of the beginning to fade, s.
const SETTLE_S: f64 = 0.25;
/// Slower than this the axis does not surely slide before it, m/s.
const SLIDES_M_PER_S: f64 = 1.5e-3;
/// The sliding at either end of a stretch that tells the friction of its place, s.
const ENDS_S: f64 = 0.05;
/// Friction does not differ by more along a screw, as a factor.
const FACTOR_MAX: f64 = 1.3;
/// Sixteenths of a stretch that are looked at: what goes before and comes after is sliding.
const LOOKED_AT: Range<usize> = 3..14;

/// A reversal of a log.
#[derive(Clone, Debug)]
pub struct Reversal {
    passage: Passage,
    /// Rows of the stretch, and those of it that are looked at.
    stretch: Range<usize>,
    seen: Range<usize>,
    /// Asked for in the log, of each row, N.
    asked_n: Vec<f64>,
    /// Friction where the axis reverses, as a multiple of its mean.
    factor: f64,
}

impl Reversal {
    /// A stretch with the sliding before it; `None` where that is too short.
    pub fn new(measured: &Measured, stretch: &Stretch, believed: &Believed<'_>) -> Option<Self> {
        let piece = &measured.pieces[stretch.piece];
        let settled = stretch.rows.start.checked_sub(measured.rows(SETTLE_S))?;
        let first = believed.position_tick(piece, settled)?;
        let rows = first..stretch.rows.end;
        let way = piece.velocity_m_per_s[first].signum();
        let slides = |row: usize| piece.velocity_m_per_s[row] * way > SLIDES_M_PER_S;
        if !(first..stretch.rows.start).all(slides) {
            return None;
        }
        let asked_n = |row: usize| believed.asked_n(piece, row, way);
        let sixteenth = |number: usize| (stretch.rows.start - first) + number * stretch.rows.len() / 16;
        Some(Self {
            passage: Passage::new(piece, rows.clone(), believed, way)?,
            stretch: stretch.rows.start - first..rows.len(),
            seen: sixteenth(LOOKED_AT.start)..sixteenth(LOOKED_AT.end),
            asked_n: rows.map(asked_n).collect(),
            factor: factor(measured, stretch, believed, asked_n),
        })
    }

    /// How it looks in the log.
    pub fn signature(&self, period_s: f64) -> Signature {
        of_reversal(&self.asked_n[self.seen.clone()], period_s)
    }

    /// How it looks of an axis.
    pub(super) fn simulated(&self, axis: &Axis, chance: Chance) -> Signature {
        let asked_n = &self.simulated_n(axis, chance, self.seen.end)[self.seen.clone()];
        of_reversal(asked_n, axis.control.tick.as_s())
    }

    /// Asked for by the loops of an axis in the first so many rows, N.
    fn simulated_n(&self, axis: &Axis, chance: Chance, rows: usize) -> Vec<f64> {
        self.passage.asked_n(axis, chance, self.factor, rows, None)
    }

    /// The whole stretch: time in s, asked for in the log and of an axis, N.
    pub fn beside(&self, axis: &Axis) -> Vec<[f64; 3]> {
        let simulated_n = self.simulated_n(axis, Chance::NONE, self.stretch.end);
        let time_s = |row: usize| (row - self.stretch.start) as f64 * axis.control.tick.as_s();
        self.stretch.clone().map(|row| [time_s(row), self.asked_n[row], simulated_n[row]]).collect()
    }
}

/// Friction where the axis reverses, as a multiple of its mean: what it is at both ends, and the ripple from there.
fn factor(
    measured: &Measured,
    stretch: &Stretch,
    Believed { plant, ripple, .. }: &Believed<'_>,
    asked_n: impl Fn(usize) -> f64,
) -> f64 {
    let piece = &measured.pieces[stretch.piece];
    let rows = measured.rows(ENDS_S).clamp(1, stretch.rows.len() / 2);
    let Range { start, end } = stretch.rows;
    let law = Law::new(plant.friction);
    let moving_kg = plant.mechanics.motor_mass_kg() + plant.mechanics.mass_kg;
    let before = piece.velocity_m_per_s[start].signum();
    let of_ripple = |row: usize, way: f64| ripple.factor(piece.position_m[row], way);
    let found_n = |row: usize| asked_n(row) - before * moving_kg * piece.acceleration_m_per_s2[row];
    let believed_n = |row: usize| {
        let velocity = Velocity::m_per_s(piece.velocity_m_per_s[row]);
        before * law.sliding(velocity).as_n() * of_ripple(row, velocity.as_m_per_s().signum())
    };
    let apart = |of: &dyn Fn(usize) -> f64| {
        (start..start + rows).map(of).sum::<f64>() - (end - rows..end).map(of).sum::<f64>()
    };
    // Both ways at the farthest place.
    let turned = (start..end)
        .max_by(|a, b| (before * piece.position_m[*a]).total_cmp(&(before * piece.position_m[*b])))
        .unwrap_or(start);
    let here = 0.5 * (of_ripple(turned, 1.0) + of_ripple(turned, -1.0));
    let factor = apart(&found_n) / apart(&believed_n) * here;
    if (1.0 / FACTOR_MAX..FACTOR_MAX).contains(&factor) { factor } else { 1.0 }
}
