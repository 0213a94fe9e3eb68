//! Where an axis moves: rows that a small error of the base does not send to another branch of stick and slip.
//!
//! ```text
//!   |setpoint velocity| > v for some time     v: several times where the fall of friction ends
//! ```
//!
//! From a machine file that is a fifth off, minutes of sticking say nothing of which way to go, and outvote the rest. Rows in motion
//! tell mass, friction, stiffness and the loops by themselves, and their cost has one valley. So they do by how much an axis breaks away,
//! for it rings as it sets out: taken from a file that is half off, mass and stiffness make up for it, and the sticking
//! rows lead nowhere from there. And they alone tell the force that is always there: a table that sticks hangs where it came to rest,
//! and what one run of small reversals seems to say of that force outvotes what all others know of it. What they say nothing of,
//! over which velocities friction falls, stays as it is.
//! Invariant: the same setpoints give the same rows, whatever was measured.

use std::sync::Arc;

use super::Model;
use super::data::{AxisData, Part};
use super::problem::Problem;
use crate::base::units::Velocity;

/// How many times faster than the end of the fall of friction, and for how long already, s.
const FASTER: f64 = 4.0;
pub(in crate::offline::gap) const SINCE_S: f64 = 0.05;
/// Fewer rows tell no base, s.
const LEAST_S: f64 = 2.0;
/// What rows in motion say nothing of, as [`super::twin::BASE`] names it.
const UNTOLD: &[&str] = &["fall_end", "fall_start", "presliding_way"];

impl Problem<'_> {
    /// The same with the rows alone in which the axis moves; nothing where these are too few.
    #[must_use]
    pub fn in_motion(&self, model: &Model) -> Option<Self> {
        let of = |data: &AxisData| {
            let moves = self.has_moved(data, model, SINCE_S);
            let fit = data.fit.iter().zip(moves).map(|(counts, moves)| *counts && moves).collect();
            AxisData { fit, ..data.clone() }
        };
        let data: Vec<AxisData> = self.data.iter().map(of).filter(|data| data.has(Part::Fit)).collect();
        let rows = data.iter().flat_map(|data| &data.fit).filter(|counts| **counts).count();
        (rows > self.rows_in(LEAST_S))
            .then(|| self.with_data(Arc::new(data)).holding_force(false).not_telling(UNTOLD))
    }

    /// In which rows of a run the axis has been moving for so long already, s.
    pub(in crate::offline::gap) fn has_moved(
        &self,
        data: &AxisData,
        model: &Model,
        since_s: f64,
    ) -> impl Iterator<Item = bool> {
        let least = model.twin().plant.friction.fall_end * FASTER;
        moves(data.course.setpoints().map(|setpoint| setpoint.velocity), least, self.rows_in(since_s))
    }
}

/// In which rows an axis has been faster for so many rows already.
fn moves(
    velocities: impl Iterator<Item = Velocity>,
    least: Velocity,
    rows: usize,
) -> impl Iterator<Item = bool> {
    velocities.scan(0, move |since, velocity| {
        *since = if velocity.as_m_per_s().abs() > least.as_m_per_s() { *since + 1 } else { 0 };
        Some(*since > rows)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_moves_when_it_has_done_so_for_a_while() {
        let way = [0.0, 3.0, 3.0, 3.0, 1.0, -3.0, -3.0, -3.0].map(Velocity::mm_per_s);
        let moving: Vec<bool> = moves(way.into_iter(), Velocity::mm_per_s(2.0), 1).collect();
        assert_eq!(moving, [false, false, true, true, false, false, true, true]);
    }
}
