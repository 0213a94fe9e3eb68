//! One axis of a log as identification looks at it: motion and force through the same filter, in pieces without a
//! hole.
//!
//! The measured current becomes the force at the table that it balances (Eq. 4, `F = η K_t I 2π / lead`); the motor's
//! position, the velocity and acceleration made of it, and the force all go through one low-pass without delay, so
//! that what the filter takes is missing on both sides of a comparison. Rows that are stale, without current or in
//! a fault are left out, and a missing cycle ends a piece. Units: SI, in travel.
//! Invariant: rows of a piece are consecutive cycles; no value is made up.

use std::f64::consts::TAU;
use std::ops::Range;

use super::smoothing::{LowPass, derivative};
use crate::base::record::ModeTag;
use crate::offline::trace::{AxisTrace, Trace};
use crate::plant::{Actuator, Mechanics};

/// The cut-off of the low-pass, Hz, is as high as the encoder allows: chatter is at 60 to 100 Hz.
const CUTOFF_HZ: [f64; 2] = [60.0, 200.0];
/// Counts of the encoder may look like so much acceleration, rms, m/s²: 30 N on 2.5 t.
const COUNTS_M_PER_S2: f64 = 0.012;
/// Most of the rate that the cut-off for what drives the model is: chatter is in it.
const DRIVING_SHARE_MAX: f64 = 0.2;
/// Counts of the encoder may look like so much speed, rms, m/s: a fifth of where friction begins to fall.
const COUNTS_M_PER_S: f64 = 0.02e-3;
/// Shortest piece worth looking at, s.
const PIECE_MIN_S: f64 = 0.3;

/// Consecutive cycles of an axis.
#[derive(Clone, Debug, Default)]
pub struct Piece {
    /// Cycle of the first row.
    pub first_cycle: u64,
    /// Motion that each row belongs to.
    pub motion: Vec<u32>,
    /// Gain set that acts.
    pub gain_set: Vec<u8>,
    /// Wanted position, m.
    pub setpoint_m: Vec<f64>,
    /// Wanted velocity, m/s.
    pub setpoint_m_per_s: Vec<f64>,
    /// Motor, m.
    pub position_m: Vec<f64>,
    /// Motor, m/s.
    pub velocity_m_per_s: Vec<f64>,
    /// Motor as it drives the model of the table: with less taken away, m.
    pub driving_m: Vec<f64>,
    /// Motor, m/s².
    pub acceleration_m_per_s2: Vec<f64>,
    /// Force at the table that the current balances, N.
    pub force_n: Vec<f64>,
    /// Current as it was measured, A.
    pub current_a: Vec<f64>,
    /// Current as it was asked for, A.
    pub current_command_a: Vec<f64>,
}

impl Piece {
    /// How many rows.
    pub const fn len(&self) -> usize {
        self.position_m.len()
    }
    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.position_m.is_empty()
    }
}

/// An axis in pieces.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Time between rows, s.
    pub period_s: f64,
    /// Of the filter, Hz.
    pub cutoff_hz: f64,
    /// In order.
    pub pieces: Vec<Piece>,
    /// The filter that all columns went through.
    pub low_pass: LowPass,
    /// Rows of the log that are in no piece.
    pub left_out_rows: usize,
}

impl Measured {
    /// An axis of a trace. `None` where the log is too slow for the filter.
    pub fn new(
        trace: &Trace,
        axis: &AxisTrace,
        mechanics: &Mechanics,
        actuator: &Actuator,
        resolution_m: f64,
    ) -> Option<Self> {
        let cutoff_hz = cutoff_hz(resolution_m, trace.period_s);
        let low_pass = LowPass::new(cutoff_hz, 1.0 / trace.period_s)?;
        let driving = LowPass::new(driving_hz(resolution_m, trace.period_s), 1.0 / trace.period_s)?;
        let newtons_per_a = actuator.torque_constant_nm_per_a * mechanics.force_per_torque();
        let rows_min = (PIECE_MIN_S / trace.period_s) as usize;
        let pieces: Vec<Piece> = usable(trace, axis)
            .into_iter()
            .filter(|rows| rows.len() >= rows_min)
            .map(|rows| piece(trace, axis, rows, [&low_pass, &driving], newtons_per_a))
            .collect();
        let left_out_rows = trace.len() - pieces.iter().map(Piece::len).sum::<usize>();
        Some(Self { period_s: trace.period_s, cutoff_hz, pieces, low_pass, left_out_rows })
    }

    /// Least cut-off of the filter that all columns go through, Hz.
    pub const fn cutoff_hz_min() -> f64 {
        CUTOFF_HZ[0]
    }

    /// Rows in a time.
    pub fn rows(&self, time_s: f64) -> usize {
        (time_s / self.period_s).round() as usize
    }
}

/// Cut-off at which the rounding of positions makes an acceleration of `COUNTS_M_PER_S2`.
fn cutoff_hz(resolution_m: f64, period_s: f64) -> f64 {
    // Acceleration of white noise below f: rms · (2π f)² · √(2 f T / 5).
    let per_hz = resolution_m / 12f64.sqrt() * TAU * TAU * (2.0 * period_s / 5.0).sqrt();
    (COUNTS_M_PER_S2 / per_hz).powf(0.4).clamp(CUTOFF_HZ[0], CUTOFF_HZ[1]).min(DRIVING_SHARE_MAX / period_s)
}

/// Cut-off at which the rounding of positions, `resolution / √12` and white, makes a speed of `COUNTS_M_PER_S`.
fn driving_hz(resolution_m: f64, period_s: f64) -> f64 {
    // Speed of white noise below f: rms · 2π f · √(2 f T / 3).
    let per_hz = resolution_m / 12f64.sqrt() * TAU * (2.0 * period_s / 3.0).sqrt();
    (COUNTS_M_PER_S / per_hz).powf(2.0 / 3.0).clamp(0.5 * CUTOFF_HZ[0], DRIVING_SHARE_MAX / period_s)
}

fn piece(
    trace: &Trace,
    axis: &AxisTrace,
    rows: Range<usize>,
    filters: [&LowPass; 2],
    newtons_per_a: f64,
) -> Piece {
    let [low_pass, driving] = filters;
    let position_m = low_pass.smooth(&axis.motor_position_m[rows.clone()]);
    let driving_m = driving.smooth(&axis.motor_position_m[rows.clone()]);
    let velocity_m_per_s = derivative(&position_m, trace.period_s);
    let acceleration_m_per_s2 = second_derivative(&position_m, trace.period_s);
    let current_a = axis.current_a[rows.clone()].to_vec();
    let force_n = low_pass.smooth(&current_a).iter().map(|a| a * newtons_per_a).collect();
    Piece {
        first_cycle: trace.cycle[rows.start],
        motion: trace.motion[rows.clone()].to_vec(),
        gain_set: axis.gain_set[rows.clone()].to_vec(),
        setpoint_m: axis.setpoint_position_m[rows.clone()].to_vec(),
        setpoint_m_per_s: axis.setpoint_velocity_m_per_s[rows.clone()].to_vec(),
        current_command_a: axis.current_command_a[rows].to_vec(),
        position_m,
        driving_m,
        velocity_m_per_s,
        acceleration_m_per_s2,
        force_n,
        current_a,
    }
}

/// Second differences; those beside them at the ends.
fn second_derivative(column: &[f64], step: f64) -> Vec<f64> {
    let last = column.len() - 1;
    let at = |row: usize| {
        let middle = row.clamp(1, last - 1);
        (column[middle + 1] - 2.0 * column[middle] + column[middle - 1]) / (step * step)
    };
    (0..column.len()).map(at).collect()
}

/// Stretches of rows in which the axis was under control and seen in every cycle.
fn usable(trace: &Trace, axis: &AxisTrace) -> Vec<Range<usize>> {
    let is_usable = |row: usize| {
        axis.is_fresh[row]
            && axis.current_a[row].is_finite()
            && axis.motor_position_m[row].is_finite()
            && match axis.mode[row] {
                ModeTag::Ready | ModeTag::Moving | ModeTag::Stopping | ModeTag::Unknown => true,
                ModeTag::Off | ModeTag::Enabling | ModeTag::Faulted => false,
            }
    };
    let mut stretches: Vec<Range<usize>> = Vec::new();
    for row in (0..trace.len()).filter(|row| is_usable(*row)) {
        match stretches.last_mut() {
            Some(last) if last.end == row && trace.cycle[row] == trace.cycle[row - 1] + 1 => {
                last.end = row + 1
            }
            _ => stretches.push(row..row + 1),
        }
    }
    stretches
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;
    use crate::base::record::{AxisRecord, CycleRecord};
    use crate::base::sample::Freshness;
    use crate::base::time::{Moment, Span};
    use crate::plant::tests::paper_axis;

    const ROWS: u64 = 4_000;

    /// A log of an axis that stands, with what becomes of single rows.
    fn pieces(spoil: impl Fn(u64, &mut AxisRecord), is_missing: impl Fn(u64) -> bool) -> Vec<[u64; 2]> {
        let records = (0..ROWS).filter(|cycle| !is_missing(*cycle)).map(|cycle| {
            let mut record = CycleRecord::empty(1);
            record.cycle = cycle;
            record.timing.scheduled = Moment::ZERO + Span::us(500) * cycle as i64;
            let axis = &mut record.axes[AxisId::X];
            axis.mode = ModeTag::Ready;
            axis.sample.freshness = Freshness::Fresh;
            spoil(cycle, axis);
            record
        });
        let trace = Trace::from_records(records).expect("a trace");
        let axis = paper_axis();
        let measured = Measured::new(&trace, &trace.axes[0], &axis.mechanics, &axis.actuator, 1e-8);
        let pieces = measured.expect("fast enough").pieces;
        pieces.iter().map(|piece| [piece.first_cycle, piece.len() as u64]).collect()
    }

    #[test]
    fn what_cannot_be_used_ends_a_piece() {
        assert_eq!(pieces(|_, _| {}, |_| false), [[0, ROWS]]);
        let stale = |cycle, axis: &mut AxisRecord| {
            if cycle == 1_500 {
                axis.sample.freshness = Freshness::Stale;
            }
        };
        assert_eq!(pieces(stale, |_| false), [[0, 1_500], [1_501, ROWS - 1_501]]);
        assert_eq!(pieces(|_, _| {}, |cycle| cycle == 1_500), [[0, 1_500], [1_501, ROWS - 1_501]]);
        let faulted = |cycle, axis: &mut AxisRecord| {
            if cycle >= 1_500 {
                axis.mode = ModeTag::Faulted;
            }
        };
        assert_eq!(pieces(faulted, |_| false), [[0, 1_500]]);
        let short = |cycle| cycle % 500 == 0;
        assert_eq!(pieces(|_, _| {}, short), [[0_u64; 2]; 0], "0.25 s are too short for the filter");
    }

    #[test]
    fn a_coarse_encoder_gets_a_slower_filter() {
        let at = |resolution_m| cutoff_hz(resolution_m, 0.5e-3);
        assert_eq!(at(1e-8), CUTOFF_HZ[1]);
        assert_eq!(at(0.1e-6), CUTOFF_HZ[1]);
        assert!((80.0..100.0).contains(&at(1e-6)), "{} Hz for 1 um", at(1e-6));
    }
}
