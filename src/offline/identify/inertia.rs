//! Inertia from stretches in which the axis slides on while its speed changes: `F = M a + m v + F_c`, each stretch for
//! itself.
//!
//! Force and acceleration went through the same filter and are averaged over the same blocks, so what either
//! takes is missing in both. Friction is free in every stretch; of what was found elsewhere only the ripple of the
//! screw enters, which an acceleration over a turn or two would be taken for. `M` is all that moves, at the table:
//! motor and screw weigh `η J (2π / lead)²` there.
//! Invariant: the interval comes from the scatter between stretches.

use super::least_squares;
use super::measured::Measured;
use super::ripple::Ripple;
use super::stretches::Stretch;

/// Rows are averaged over so long a time, s: noise of a coarse encoder would make the acceleration too large.
const BLOCK_S: f64 = 0.015;

/// All that moves as a mass at the table, kg, by stretch.
pub fn masses_kg(measured: &Measured, accelerations: &[Stretch], ripple: &Ripple) -> Vec<f64> {
    accelerations.iter().filter_map(|stretch| mass_kg(measured, stretch, ripple)).collect()
}

fn mass_kg(measured: &Measured, stretch: &Stretch, ripple: &Ripple) -> Option<f64> {
    let piece = &measured.pieces[stretch.piece];
    let block = measured.rows(BLOCK_S).max(1);
    let rows: Vec<usize> = stretch.rows.clone().collect();
    let averaged = |of: &dyn Fn(usize) -> f64| -> Vec<f64> {
        rows.chunks_exact(block)
            .map(|rows| rows.iter().map(|row| of(*row)).sum::<f64>() / block as f64)
            .collect()
    };
    let ripple_n = |row: usize| ripple.force_n(piece.position_m[row], piece.velocity_m_per_s[row]);
    let force_n = averaged(&|row| piece.force_n[row] - ripple_n(row));
    let columns = [
        averaged(&|row| piece.acceleration_m_per_s2[row]),
        averaged(&|row| piece.velocity_m_per_s[row]),
        vec![1.0; force_n.len()],
    ];
    least_squares::fit(&columns, &force_n, 0).ok().map(|fit| fit.coefficients[0])
}
