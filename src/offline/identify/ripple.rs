//! Force that comes and goes with the angle of the screw: nut, bearings and motor, once and a few times per turn.
//!
//! Found from steady stretches, each direction for itself: what flips with the direction belongs to friction, what
//! does not belongs to the motor or the straightness of the screw, and either is taken away where it is in the way.
//! Units: N over m of the motor's position. Invariant: without a whole turn at steady speed there is no ripple.

use std::f64::consts::TAU;

use super::least_squares;
use super::measured::{Measured, Piece};
use super::stretches::Stretch;

/// Times per turn that are looked for.
const HARMONICS: usize = 3;
/// Rows between those that are fitted.
const EVERY: usize = 20;
/// Fewest rows of a direction.
const ROWS_MIN: usize = 60;

/// Ripple over the angle of the screw.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ripple {
    lead_m: f64,
    /// Sine and cosine of each harmonic, N; forwards, backwards.
    waves: [Option<[f64; 2 * HARMONICS]>; 2],
}

impl Ripple {
    /// That of an axis.
    pub fn of(measured: &Measured, steady: &[Stretch], lead_m: f64) -> Self {
        let waves = [1.0, -1.0].map(|way| waves(measured, steady, lead_m, way));
        Self { lead_m, waves }
    }

    /// Travel of a turn, m.
    pub const fn lead_m(&self) -> f64 {
        self.lead_m
    }

    /// Friction at a place as a multiple of its mean, where the mean is `sliding_n`.
    pub fn factor(&self, position_m: f64, way: f64, sliding_n: f64) -> f64 {
        1.0 + way * self.force_n(position_m, way) / sliding_n
    }

    /// Force at a place, N.
    pub fn force_n(&self, position_m: f64, way: f64) -> f64 {
        let waves = &self.waves[usize::from(way < 0.0)];
        waves.as_ref().map_or(0.0, |waves| {
            angles(position_m, self.lead_m).iter().zip(waves).map(|(wave, n)| wave * n).sum()
        })
    }
}

fn angles(position_m: f64, lead_m: f64) -> [f64; 2 * HARMONICS] {
    std::array::from_fn(|k| {
        let angle = TAU * position_m / lead_m * (k / 2 + 1) as f64;
        if k % 2 == 0 { angle.sin() } else { angle.cos() }
    })
}

fn waves(measured: &Measured, steady: &[Stretch], lead_m: f64, way: f64) -> Option<[f64; 2 * HARMONICS]> {
    let mut columns = vec![Vec::new(); 2 * HARMONICS];
    let mut force_n = Vec::new();
    for stretch in steady {
        let piece = &measured.pieces[stretch.piece];
        let way_m = piece.position_m[stretch.rows.end - 1] - piece.position_m[stretch.rows.start];
        if way_m * way < lead_m {
            continue;
        }
        let rows = || stretch.rows.clone().step_by(EVERY);
        // Less the straight line through it: friction and what is left of an acceleration.
        let line = less_line(piece, rows().collect());
        force_n.extend(line);
        for row in rows() {
            for (column, wave) in columns.iter_mut().zip(angles(piece.position_m[row], lead_m)) {
                column.push(wave);
            }
        }
    }
    if force_n.len() < ROWS_MIN {
        return None;
    }
    let fit = least_squares::fit(&columns, &force_n, 0).ok()?;
    fit.coefficients.try_into().ok()
}

fn less_line(piece: &Piece, rows: Vec<usize>) -> Vec<f64> {
    let force_n: Vec<f64> = rows.iter().map(|row| piece.force_n[*row]).collect();
    let columns = [vec![1.0; rows.len()], (0..rows.len()).map(|row| row as f64).collect()];
    least_squares::fit(&columns, &force_n, 0).map(|fit| fit.residuals).unwrap_or(force_n)
}
