//! A stretch of a log beside the model: `plant::driven` behind the measured motion of the motor.
//!
//! ```text
//!   measured motion ──► screw, table, friction ──► force ──► low-pass ──┐
//!          └──────────► acceleration × motor as a mass ─────────────────┴─ + ──► to be compared with
//!   measured current ──► force ──► low-pass ─────────────────────────────────► this
//! ```
//!
//! Motion and current are latched in the same instant, so no delay of estimator, bus or current loop is in the
//! comparison. Invariant: rows in which the filter or the start can be felt are not compared.

use super::measured::{Measured, Piece};
use super::smoothing::LowPass;
use super::stretches::Stretch;
use crate::base::time::Span;
use crate::base::units::{Force, Position, Velocity};
use crate::plant::driven::Driven;
use crate::plant::encoder::Knot;
use crate::plant::friction::Law;
use crate::plant::{Mechanics, friction};

/// Share of the way to the measured force that a standing table is taken in a row. With all of it what is found
/// scatters least over machines.
const FOLLOWED: f64 = 1.0;

/// The sliding at either end of a reversal that tells the friction of its place, s.
const ENDS_S: f64 = 0.05;
/// Friction does not differ by more along a screw, as a factor.
const SCALE_MAX: f64 = 1.3;

/// How the table stands at the beginning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// It slides with the motor.
    Sliding,
    /// It stands, and the screw pulls as the current says.
    Standing,
}

/// An axis as the model has it.
#[derive(Clone, Copy, Debug)]
pub struct Model {
    /// Screw and table.
    pub mechanics: Mechanics,
    /// Motor and screw as a mass at the table, kg.
    pub motor_kg: f64,
    /// Friction at the table.
    pub friction: friction::Parameters,
}

impl Model {
    /// All that moves, kg at the table.
    pub const fn moving_kg(&self) -> f64 {
        self.motor_kg + self.mechanics.mass_kg
    }
}

/// One stretch, ready to be compared.
#[derive(Clone, Debug)]
pub struct Comparison {
    period: Span,
    low_pass: LowPass,
    start: Start,
    /// First row that is compared, and how many.
    first: usize,
    compared: usize,
    knots: Vec<Knot>,
    /// Measured, of all knots.
    force_n: Vec<f64>,
    acceleration_m_per_s2: Vec<f64>,
}

impl Comparison {
    /// A stretch with room around it for the filter; `None` where there is none.
    pub fn new(measured: &Measured, stretch: &Stretch, start: Start) -> Option<Self> {
        let piece = &measured.pieces[stretch.piece];
        let room = measured.low_pass.memory_rows();
        // A table that stands may have stood for no longer; the filter hardly feels what was before that.
        let ahead = if start == Start::Standing { room / 2 } else { room };
        let from = stretch.rows.start.checked_sub(ahead)?.max(1);
        let to = stretch.rows.end + room;
        if to >= piece.len() {
            return None;
        }
        Some(Self {
            period: Span::s(measured.period_s),
            low_pass: measured.low_pass,
            knots: (from..to).map(|row| knot(piece, row, measured.period_s)).collect(),
            start,
            first: stretch.rows.start - from,
            compared: stretch.rows.len(),
            force_n: piece.force_n[from..to].to_vec(),
            acceleration_m_per_s2: piece.acceleration_m_per_s2[from..to].to_vec(),
        })
    }

    /// Rows per second.
    pub fn rate_hz(&self) -> f64 {
        1.0 / self.period.as_s()
    }

    /// Measured force of the rows that are compared, N.
    pub fn measured_n(&self) -> &[f64] {
        &self.force_n[self.first..self.first + self.compared]
    }

    /// What the motor would feel of a model, N, in the rows that are compared.
    pub fn felt_n(&self, model: &Model) -> Vec<f64> {
        let of_screw =
            |row: usize| Force::n(self.force_n[row] - model.motor_kg * self.acceleration_m_per_s2[row]);
        let driven = Driven::new(&model.mechanics, model.friction, self.period);
        let mut driven = match self.start {
            Start::Sliding => driven.sliding(self.knots[0].velocity),
            Start::Standing => driven.standing(of_screw(0)),
        };
        let mut screw_n = Vec::with_capacity(self.knots.len());
        for (row, ends) in self.knots.windows(2).enumerate() {
            screw_n.push(driven.step(&ends[0], &ends[1]).as_n());
            driven.follow(of_screw(row + 1), FOLLOWED);
        }
        // The first row is where it starts; the filter has forgotten it where rows are compared.
        screw_n.insert(0, screw_n[0]);
        let screw_n = self.low_pass.smooth(&screw_n);
        let rows = self.first..self.first + self.compared;
        rows.map(|row| screw_n[row] + model.motor_kg * self.acceleration_m_per_s2[row]).collect()
    }

    /// A model with the friction of this place: it differs by a few per cent along the screw, and the sliding at both
    /// ends of a reversal tells by how much.
    pub fn here(&self, model: &Model) -> Model {
        let rows = ((ENDS_S / self.period.as_s()) as usize).clamp(1, self.compared / 2);
        let moving_kg = model.moving_kg();
        let mean = |first: usize, of: &dyn Fn(usize) -> f64| {
            (first..first + rows).map(of).sum::<f64>() / rows as f64
        };
        let force_n = |row: usize| self.force_n[row] - moving_kg * self.acceleration_m_per_s2[row];
        let law = Law::new(model.friction);
        let slides_n = |row: usize| law.sliding(self.knots[row].velocity).as_n();
        let [before, after] = [self.first, self.first + self.compared - rows];
        let apart = |of: &dyn Fn(usize) -> f64| mean(after, of) - mean(before, of);
        let scale = apart(&force_n) / apart(&slides_n);
        let is_likely = (1.0 / SCALE_MAX..SCALE_MAX).contains(&scale);
        Model { friction: if is_likely { model.friction.scaled(scale) } else { model.friction }, ..*model }
    }

    /// Measured less modelled, N.
    pub fn residuals_n(&self, model: &Model) -> Vec<f64> {
        self.measured_n().iter().zip(self.felt_n(model)).map(|(measured, felt)| measured - felt).collect()
    }
}

fn knot(piece: &Piece, row: usize, period_s: f64) -> Knot {
    let velocity = (piece.driving_m[row + 1] - piece.driving_m[row - 1]) / (2.0 * period_s);
    Knot { position: Position::m(piece.driving_m[row]), velocity: Velocity::m_per_s(velocity) }
}
