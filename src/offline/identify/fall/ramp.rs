//! A slow ramp from rest of a log, and the same ramp as the shipped loops make it of another axis.
//!
//! Below `D_v'` the table creeps under `F_max`, and what the loops make of the counts of a coarse encoder there is as large
//! as what is asked: only loops with the same counts show it. A setpoint that rests is not an axis that rests: after a
//! motion it creeps on for a second, and the screw stays wound up. So the run begins where the axis last slid before the
//! ramp, as a reversal does; where it has not, with the current that held it.
//! Units: SI, N at the table, positive along the ramp.
//! Invariant: both ramps are looked at in the same rows, by the same `signature`.

use super::super::measured::Measured;
use super::super::stretches::Stretch;
use super::Chance;
use super::passage::{Believed, Passage};
use super::signature::{Signature, of_ramp};
use crate::config::machine::Axis;

/// Of a ramp with the rest before it, s: the screw winds up in less than half of that.
const LOOKED_AT_S: f64 = 1.2;
/// Rest at its beginning that tells the current that holds the axis, s.
const REST_S: f64 = 0.04;
/// Faster than this the axis slides, m/s; if it did so long before a ramp, s, it still creeps.
const SLIDES_M_PER_S: f64 = 2.5e-3;
const CREEPS_ON_S: f64 = 2.0;

/// A ramp of a log.
#[derive(Clone, Debug)]
pub struct Ramp {
    passage: Passage,
    /// What held the axis in the first row, N, unless it slid.
    held_n: Option<f64>,
    /// Rows before those that are looked at.
    before: usize,
    /// Asked for in the log, of each row that is looked at, N.
    asked_n: Vec<f64>,
    /// Friction where it breaks away, as a multiple of its mean.
    factor: f64,
}

impl Ramp {
    /// A stretch that begins with a setpoint at rest; `None` where it is too short.
    pub fn new(measured: &Measured, stretch: &Stretch, believed: &Believed<'_>) -> Option<Self> {
        let piece = &measured.pieces[stretch.piece];
        let ramp = stretch.rows.start;
        let looked_at = ramp..ramp + measured.rows(LOOKED_AT_S);
        let slides = |row: &usize| piece.velocity_m_per_s[*row].abs() > SLIDES_M_PER_S;
        let slid = (ramp.saturating_sub(measured.rows(CREEPS_ON_S))..ramp).rev().find(slides);
        let first = believed.position_tick(piece, slid.unwrap_or(ramp))?;
        if looked_at.end > stretch.rows.end {
            return None;
        }
        let way = piece.setpoint_m_per_s[looked_at.end - 1].signum();
        let asked_n = |row: usize| believed.asked_n(piece, row, way);
        let rest = first..first + measured.rows(REST_S);
        let mean_n = rest.clone().map(asked_n).sum::<f64>() / rest.len() as f64;
        Some(Self {
            passage: Passage::new(piece, first..looked_at.end, believed, way)?,
            held_n: slid.is_none().then_some(mean_n),
            before: ramp - first,
            factor: believed.ripple.factor(piece.position_m[looked_at.end - 1], way),
            asked_n: looked_at.map(asked_n).collect(),
        })
    }

    /// Whether the axis goes forwards in it.
    pub const fn is_forward(&self) -> bool {
        self.passage.is_forward()
    }

    /// How it looks in the log.
    pub fn signature(&self, period_s: f64) -> Signature {
        of_ramp(&self.asked_n, period_s)
    }

    /// How it looks of an axis.
    pub(super) fn simulated(&self, axis: &Axis, chance: Chance) -> Signature {
        let rows = self.before + self.asked_n.len();
        let asked_n = self.passage.asked_n(axis, chance, self.factor, rows, self.held_n);
        of_ramp(&asked_n[self.before..], axis.control.tick.as_s())
    }
}
