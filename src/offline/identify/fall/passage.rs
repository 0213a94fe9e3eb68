//! A piece of a log that the shipped loops make again of another axis: its setpoints under its gains, from a place and a
//! speed on.
//!
//! Compared is the current that was asked for, as a force at the table: the loops make it of encoder counts and setpoints
//! alone, so it is without the noise of a current measurement.
//! Units: SI, N at the table, positive along one way.
//! Invariant: it begins with a tick of the position loop, and is all of one gain set.

use std::ops::Range;

use super::super::measured::Piece;
use super::super::ripple::Ripple;
use super::Chance;
use crate::base::setpoint::Setpoint;
use crate::base::time::Span;
use crate::base::units::{Acceleration, Current, Position, Velocity};
use crate::config::machine::Axis;
use crate::offline::closed_axis::{ClosedAxis, Start};
use crate::plant::{Parameters, Plant};

/// What of an axis a log of it is looked at with.
#[derive(Clone, Copy, Debug)]
pub struct Believed<'a> {
    /// Of the log.
    pub axis: &'a Axis,
    /// As far as it is known, its falling part left aside.
    pub plant: &'a Parameters,
    /// How friction varies along the screw.
    pub ripple: &'a Ripple,
    /// What the current holds both ways alike, N.
    pub offset_n: f64,
}

impl Believed<'_> {
    /// What was asked for in a row, N along a way.
    pub(super) fn asked_n(&self, piece: &Piece, row: usize, way: f64) -> f64 {
        piece.current_command_a[row] * self.newtons_per_a(way) - self.offset_n * way
    }

    fn newtons_per_a(&self, way: f64) -> f64 {
        self.plant.actuator.torque_constant_nm_per_a * self.plant.mechanics.force_per_torque() * way
    }

    /// The last tick of the position loop up to a row.
    pub(super) fn position_tick(&self, piece: &Piece, row: usize) -> Option<usize> {
        let cycle = piece.first_cycle + row as u64;
        row.checked_sub((cycle % u64::from(self.axis.control.position_every)) as usize)
    }
}

/// Rows of a log with what is needed to make them again.
#[derive(Clone, Debug)]
pub(super) struct Passage {
    setpoints: Vec<Setpoint>,
    gain_set: u8,
    /// In the first row.
    position: Position,
    velocity: Velocity,
    newtons_per_a: f64,
}

impl Passage {
    /// Of rows in which the axis slides along `way`, or at rest; `None` where the gains change in them.
    pub(super) fn new(piece: &Piece, rows: Range<usize>, believed: &Believed<'_>, way: f64) -> Option<Self> {
        let gain_set = piece.gain_set[rows.start];
        let is_of_one = rows.clone().all(|row| piece.gain_set[row] == gain_set);
        if !is_of_one || gain_set >= believed.axis.control.gain_set_count {
            return None;
        }
        let setpoint = |row: usize| Setpoint {
            position: Position::m(piece.setpoint_m[row]),
            velocity: Velocity::m_per_s(piece.setpoint_m_per_s[row]),
            acceleration: Acceleration::ZERO,
        };
        Some(Self {
            gain_set,
            position: Position::m(piece.position_m[rows.start]),
            velocity: Velocity::m_per_s(piece.velocity_m_per_s[rows.start]),
            newtons_per_a: believed.newtons_per_a(way),
            setpoints: rows.map(setpoint).collect(),
        })
    }

    /// Whether its way is forwards.
    pub(super) const fn is_forward(&self) -> bool {
        self.newtons_per_a > 0.0
    }

    /// Asked for by the loops of an axis in the first so many rows, N, where friction is `factor` times its mean. The axis
    /// slides at the beginning, or is held by this force.
    pub(super) fn asked_n(
        &self,
        axis: &Axis,
        chance: Chance,
        factor: f64,
        rows: usize,
        held_n: Option<f64>,
    ) -> Vec<f64> {
        let mut axis = *axis;
        axis.plant.friction = axis.plant.friction.scaled(factor * chance.friction);
        let position = self.position + axis.scale.motor_resolution() * chance.count;
        let mut run = if let Some(held_n) = held_n {
            let current = Current::a(held_n / self.newtons_per_a);
            let start = Start { position, velocity: Velocity::ZERO, current, time: Span::ZERO };
            ClosedAxis::taken_over(&axis, self.gain_set, &axis.plant, &start)
        } else {
            let plant = Plant::sliding(&axis.plant, axis.control.tick, self.velocity, position);
            let gains = axis.control.gain_sets[usize::from(self.gain_set)];
            ClosedAxis::sliding(&axis, plant, position, self.velocity, &gains)
        };
        let every = axis.control.position_every as usize;
        let row = |(row, setpoint): (usize, &Setpoint)| {
            run.row(setpoint, row.is_multiple_of(every), None);
            run.pass();
            run.asked().as_a() * self.newtons_per_a
        };
        self.setpoints[..rows].iter().enumerate().map(row).collect()
    }
}
