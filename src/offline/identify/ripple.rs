//! Friction that comes and goes with the angle of the screw: nut and bearings, once and a few times per turn.
//!
//! Found from steady stretches, each direction for itself, as a share of the friction at their speed: so what is found
//! at all speeds holds at break-away. What accelerates is taken away before, as a ripple makes the axis do it too.
//! Positions in m of the motor, forces in N. Invariant: without a whole turn at steady speed there is no ripple.

use std::f64::consts::TAU;
use std::ops::Range;

use super::comparison::Model;
use super::least_squares;
use super::measured::Measured;
use super::stretches::Stretch;
use crate::base::units::Velocity;
use crate::plant::friction::Law;

/// Times per turn that are looked for.
const HARMONICS: usize = 3;
/// Rows between those that are fitted.
const EVERY: usize = 20;
/// Fewest rows of a direction.
const ROWS_MIN: usize = 60;

/// Ripple over the angle of the screw.
#[derive(Clone, Debug)]
pub struct Ripple {
    lead_m: f64,
    law: Law,
    /// Sine and cosine of each harmonic, as shares of friction; forwards, backwards.
    waves: [Option<[f64; 2 * HARMONICS]>; 2],
}

impl Ripple {
    /// That of an axis, whose sliding friction and masses are known well enough to scale it.
    pub fn of(measured: &Measured, steady: &[Stretch], model: &Model) -> Self {
        let (lead_m, law) = (model.mechanics.lead_m, Law::new(model.friction));
        let none = Self { lead_m, law, waves: [None, None] };
        let waves = [1.0, -1.0].map(|way| none.waves(measured, steady, model.moving_kg(), way));
        Self { waves, ..none }
    }

    /// Travel of a turn, m.
    pub const fn lead_m(&self) -> f64 {
        self.lead_m
    }

    /// Friction at a place as a multiple of its mean, on the way there.
    pub fn factor(&self, position_m: f64, way: f64) -> f64 {
        let waves = &self.waves[usize::from(way < 0.0)];
        let wave = |waves: &[f64; 2 * HARMONICS]| -> f64 {
            angles(position_m, self.lead_m).iter().zip(waves).map(|(wave, share)| wave * share).sum()
        };
        1.0 + waves.as_ref().map_or(0.0, wave)
    }

    /// Force at a place at a speed, N.
    pub fn force_n(&self, position_m: f64, velocity_m_per_s: f64) -> f64 {
        self.sliding_n(velocity_m_per_s) * (self.factor(position_m, velocity_m_per_s) - 1.0)
    }

    fn sliding_n(&self, velocity_m_per_s: f64) -> f64 {
        self.law.sliding(Velocity::m_per_s(velocity_m_per_s)).as_n()
    }

    fn waves(
        &self,
        measured: &Measured,
        steady: &[Stretch],
        moving_kg: f64,
        way: f64,
    ) -> Option<[f64; 2 * HARMONICS]> {
        let mut columns = vec![Vec::new(); 2 * HARMONICS];
        let mut force_n = Vec::new();
        for stretch in steady {
            let piece = &measured.pieces[stretch.piece];
            let Range { start, end } = stretch.rows;
            let way_m = piece.position_m[end - 1] - piece.position_m[start];
            if way_m * way < self.lead_m {
                continue;
            }
            let rows: Vec<usize> = stretch.rows.clone().step_by(EVERY).collect();
            let friction_n =
                |row: &usize| piece.force_n[*row] - moving_kg * piece.acceleration_m_per_s2[*row];
            force_n.extend(less_line(rows.iter().map(friction_n).collect()));
            let mean_m_per_s = way_m / ((end - 1 - start) as f64 * measured.period_s);
            let mean_n = self.sliding_n(mean_m_per_s);
            // Each wave as well: over a turn or two a line takes much of it.
            for (wave, column) in columns.iter_mut().enumerate() {
                let of = |row: &usize| mean_n * angles(piece.position_m[*row], self.lead_m)[wave];
                column.extend(less_line(rows.iter().map(of).collect()));
            }
        }
        if force_n.len() < ROWS_MIN {
            return None;
        }
        let fit = least_squares::fit(&columns, &force_n, 0).ok()?;
        fit.coefficients.try_into().ok()
    }
}

fn angles(position_m: f64, lead_m: f64) -> [f64; 2 * HARMONICS] {
    std::array::from_fn(|k| {
        let angle = TAU * position_m / lead_m * (k / 2 + 1) as f64;
        if k % 2 == 0 { angle.sin() } else { angle.cos() }
    })
}

/// Less the straight line through it: friction itself, and how the axis still settles.
fn less_line(force_n: Vec<f64>) -> Vec<f64> {
    let columns = [vec![1.0; force_n.len()], (0..force_n.len()).map(|row| row as f64).collect()];
    least_squares::fit(&columns, &force_n, 0).map(|fit| fit.residuals).unwrap_or(force_n)
}
