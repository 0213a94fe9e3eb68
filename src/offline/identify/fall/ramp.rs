//! A slow ramp from rest of a log, and the same ramp as the shipped loops make it of another axis.
//!
//! Below `D_v'` the table creeps under `F_max`, and what the loops make of the counts of a coarse encoder there is as large
//! as what is asked: only loops with the same counts show it. A setpoint that rests is not an axis that rests: after a
//! motion it creeps on for a second, and the screw stays wound up. So the run begins where the axis last slid before the
//! ramp, as a reversal does; where it has not, with the current that held it. Compared is the current that was asked for.
//! Units: SI, N at the table, positive along the ramp.
//! Invariant: both ramps are looked at in the same rows, by the same `signature`.

use super::super::measured::Measured;
use super::super::stretches::Stretch;
use super::Chance;
use super::reversal::Believed;
use super::signature::{Signature, of_ramp};
use crate::base::setpoint::Setpoint;
use crate::base::time::Span;
use crate::base::units::{Acceleration, Current, Position, Velocity};
use crate::config::machine::Axis;
use crate::offline::closed_axis::{ClosedAxis, Start};
use crate::plant::Plant;

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
    /// Of each row from the first.
    setpoints: Vec<Setpoint>,
    gain_set: u8,
    /// In the first row: sliding, or at rest.
    start: Start,
    /// Rows before those that are looked at.
    before: usize,
    /// Asked for in the log, of each row that is looked at, N.
    asked_n: Vec<f64>,
    /// Friction where it breaks away, as a multiple of its mean.
    factor: f64,
    newtons_per_a: f64,
}

impl Ramp {
    /// A stretch that begins with a setpoint at rest; `None` where it is too short.
    pub fn new(measured: &Measured, stretch: &Stretch, believed: &Believed<'_>) -> Option<Self> {
        let piece = &measured.pieces[stretch.piece];
        let control = &believed.axis.control;
        let ramp = stretch.rows.start;
        let looked_at = ramp..ramp + measured.rows(LOOKED_AT_S);
        let slides = |row: &usize| piece.velocity_m_per_s[*row].abs() > SLIDES_M_PER_S;
        let slid = (ramp.saturating_sub(measured.rows(CREEPS_ON_S))..ramp).rev().find(slides);
        // It begins with a tick of the position loop.
        let wanted = slid.unwrap_or(ramp);
        let cycle = piece.first_cycle + wanted as u64;
        let first = wanted.checked_sub((cycle % u64::from(control.position_every)) as usize)?;
        let rows = first..looked_at.end;
        let gain_set = piece.gain_set[first];
        let is_whole = rows.end <= stretch.rows.end
            && rows.clone().all(|row| piece.gain_set[row] == gain_set)
            && gain_set < control.gain_set_count;
        if !is_whole {
            return None;
        }
        let way = piece.setpoint_m_per_s[rows.end - 1].signum();
        let setpoint = |row: usize| Setpoint {
            position: Position::m(piece.setpoint_m[row]),
            velocity: Velocity::m_per_s(piece.setpoint_m_per_s[row]),
            acceleration: Acceleration::ZERO,
        };
        let newtons_per_a = believed.plant.actuator.torque_constant_nm_per_a
            * believed.plant.mechanics.force_per_torque()
            * way;
        let asked_n = |row: usize| piece.current_command_a[row] * newtons_per_a - believed.offset_n * way;
        let rest = first..first + measured.rows(REST_S);
        let mean_n = rest.clone().map(asked_n).sum::<f64>() / rest.len() as f64;
        let velocity_m_per_s = if slid.is_some() { piece.velocity_m_per_s[first] } else { 0.0 };
        Some(Self {
            setpoints: rows.map(setpoint).collect(),
            gain_set,
            start: Start {
                position: Position::m(piece.position_m[first]),
                velocity: Velocity::m_per_s(velocity_m_per_s),
                current: Current::a(mean_n / newtons_per_a),
                time: Span::ZERO,
            },
            before: ramp - first,
            factor: believed.ripple.factor(piece.position_m[looked_at.end - 1], way),
            asked_n: looked_at.map(asked_n).collect(),
            newtons_per_a,
        })
    }

    /// Whether the axis goes forwards in it.
    pub const fn is_forward(&self) -> bool {
        self.newtons_per_a > 0.0
    }

    /// How it looks in the log.
    pub fn signature(&self, period_s: f64) -> Signature {
        of_ramp(&self.asked_n, period_s)
    }

    /// How it looks of an axis.
    pub(super) fn simulated(&self, axis: &Axis, chance: Chance) -> Signature {
        let mut axis = *axis;
        axis.plant.friction = axis.plant.friction.scaled(self.factor * chance.friction);
        let Start { velocity, .. } = self.start;
        let position = self.start.position + axis.scale.motor_resolution() * chance.count;
        let mut run = if velocity == Velocity::ZERO {
            ClosedAxis::taken_over(&axis, self.gain_set, &axis.plant, &Start { position, ..self.start })
        } else {
            let plant = Plant::sliding(&axis.plant, axis.control.tick, velocity, position);
            let gains = axis.control.gain_sets[usize::from(self.gain_set)];
            ClosedAxis::sliding(&axis, plant, position, velocity, &gains)
        };
        let every = axis.control.position_every as usize;
        let row = |(row, setpoint): (usize, &Setpoint)| {
            run.row(setpoint, row.is_multiple_of(every), None);
            run.pass();
            run.asked().as_a() * self.newtons_per_a
        };
        let asked_n: Vec<f64> = self.setpoints.iter().enumerate().map(row).collect();
        of_ramp(&asked_n[self.before..], axis.control.tick.as_s())
    }
}
