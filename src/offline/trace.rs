//! Records of cycles as columns on an even time grid: the shape every analysis takes.
//!
//! `CycleRecord`s come from a log or straight from a run in memory; the columns hold plain `f64` in
//! SI units. Time is `(cycle - first cycle) * period`, not the clock reads of the cycle: the period
//! grid is what setpoints and samples belong to, and jitter of the wake-up is not motion.
//!
//! Invariant: all columns have the same length; a missing cycle is a [`Gap`], never an invented row.

use std::borrow::Borrow;

use thiserror::Error;

use crate::base::axis::AxisId;
use crate::base::input::Inputs;
use crate::base::record::{AxisRecord, CycleRecord, ModeTag};
use crate::base::sample::Freshness;
use crate::rt::door::Records;

/// Cycles that are missing between two rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gap {
    /// First missing cycle.
    pub cycle: u64,
    /// How many are missing in a row.
    pub count: u64,
}

/// Why records do not make a trace.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum TraceError {
    /// A period needs two records.
    #[error("the log holds {records} records, at least 2 are needed to know the period")]
    TooShort {
        /// Records found.
        records: usize,
    },
    /// Records run backwards or stand still.
    #[error("cycle {cycle} follows cycle {previous}: records must be in rising order")]
    OutOfOrder {
        /// The cycle before.
        previous: u64,
        /// The offending one.
        cycle: u64,
    },
    /// Records of different machines.
    #[error("cycle {cycle} has {got} axes, the cycles before have {expected}")]
    AxisCount {
        /// The offending cycle.
        cycle: u64,
        /// Its axes.
        got: usize,
        /// Axes of the first record.
        expected: usize,
    },
    /// The clock did not advance with the cycles.
    #[error("cycles {first} to {last} span {span_s} s, expected a positive span")]
    NoTime {
        /// First cycle.
        first: u64,
        /// Last cycle.
        last: u64,
        /// Time between them, in seconds.
        span_s: f64,
    },
    /// The log has no such motion.
    #[error("motion {motion} is not in the log")]
    NoMotion {
        /// Number asked for.
        motion: u32,
    },
}

/// One axis, column by column.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AxisTrace {
    /// Wanted position, m.
    pub setpoint_position_m: Vec<f64>,
    /// Wanted velocity, m/s.
    pub setpoint_velocity_m_per_s: Vec<f64>,
    /// Motor encoder, m of travel.
    pub motor_position_m: Vec<f64>,
    /// Table scale, m; `None` where the machine has none.
    pub table_position_m: Option<Vec<f64>>,
    /// Velocity of the motor, m/s of travel.
    pub velocity_m_per_s: Vec<f64>,
    /// Motor current, A.
    pub current_a: Vec<f64>,
    /// Current asked of the drive, A.
    pub current_command_a: Vec<f64>,
    /// Output of the position loop, m/s.
    pub velocity_command_m_per_s: Vec<f64>,
    /// Added to it in an excited motion, m/s.
    pub excitation_m_per_s: Vec<f64>,
    /// Proportional term of the velocity loop, N m.
    pub torque_proportional_nm: Vec<f64>,
    /// Integral term of the velocity loop, N m.
    pub torque_integral_nm: Vec<f64>,
    /// Friction feed-forward, N m.
    pub torque_friction_nm: Vec<f64>,
    /// Inertia feed-forward, N m.
    pub torque_inertia_nm: Vec<f64>,
    /// Gain set that acts, by its place in the machine file.
    pub gain_set: Vec<u8>,
    /// State of the axis.
    pub mode: Vec<ModeTag>,
    /// Whether each row's sample was made by its own SYNC.
    pub is_fresh: Vec<bool>,
}

impl AxisTrace {
    fn push(&mut self, record: &AxisRecord) {
        let (setpoint, sample, command) = (&record.setpoint, &record.sample, &record.command);
        self.setpoint_position_m.push(setpoint.position.as_m());
        self.setpoint_velocity_m_per_s.push(setpoint.velocity.as_m_per_s());
        self.motor_position_m.push(sample.position.as_m());
        self.table_position_m.get_or_insert_default().push(sample.table_position.as_m());
        self.velocity_m_per_s.push(sample.velocity.as_m_per_s());
        self.current_a.push(sample.current.as_a());
        self.current_command_a.push(command.current.as_a());
        self.velocity_command_m_per_s.push(command.terms.velocity_command.as_m_per_s());
        self.excitation_m_per_s.push(command.terms.excitation.as_m_per_s());
        self.torque_proportional_nm.push(command.terms.proportional.as_nm());
        self.torque_integral_nm.push(command.terms.integral.as_nm());
        self.torque_friction_nm.push(command.terms.friction.as_nm());
        self.torque_inertia_nm.push(command.terms.inertia.as_nm());
        self.gain_set.push(record.gain_set);
        self.mode.push(record.mode);
        self.is_fresh.push(sample.freshness == Freshness::Fresh);
    }

    /// Rows whose sample was older than their cycle.
    pub fn stale_samples(&self) -> usize {
        self.is_fresh.iter().filter(|fresh| !**fresh).count()
    }

    /// A table position that is not a number somewhere is no table position.
    fn drop_missing_table(&mut self) {
        self.table_position_m =
            self.table_position_m.take().filter(|column| column.iter().all(|m| m.is_finite()));
    }
}

/// A run of cycles as columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Length of one cycle, s.
    pub period_s: f64,
    /// Number of each cycle.
    pub cycle: Vec<u64>,
    /// Time since the first row, s.
    pub time_s: Vec<f64>,
    /// Which motion each row belongs to; 0 before the first.
    pub motion: Vec<u32>,
    /// Whether each row is in the evaluated part of its motion.
    pub is_measured: Vec<bool>,
    /// The axes in order of the machine file.
    pub axes: Vec<AxisTrace>,
    /// Missing cycles, in order.
    pub gaps: Vec<Gap>,
    /// Periods skipped while these rows were made.
    pub overruns: u64,
    /// Records lost while these rows were made.
    pub lost_records: u64,
}

impl Trace {
    /// From records in rising order of their cycles.
    ///
    /// # Errors
    /// When the records are fewer than two, out of order or of different machines.
    pub fn from_records<R: Borrow<CycleRecord>>(
        records: impl IntoIterator<Item = R>,
    ) -> Result<Self, TraceError> {
        let mut tracing = Tracing::default();
        records.into_iter().try_for_each(|record| tracing.see(record.borrow()))?;
        tracing.finish()
    }

    /// The rows of one motion, run-in and run-out included; its time starts at zero again.
    ///
    /// # Errors
    /// When the motion is not in the trace.
    pub fn stretch(&self, motion: u32) -> Result<Self, TraceError> {
        let start = self.motion.iter().position(|number| *number == motion);
        let end = self.motion.iter().rposition(|number| *number == motion);
        let (Some(start), Some(end)) = (start, end) else { return Err(TraceError::NoMotion { motion }) };
        let rows = start..end + 1;
        let cut = |column: &Vec<f64>| column[rows.clone()].to_vec();
        let cycles = self.cycle[start]..=self.cycle[end];
        Ok(Self {
            period_s: self.period_s,
            cycle: self.cycle[rows.clone()].to_vec(),
            time_s: self.time_s[rows.clone()].iter().map(|s| s - self.time_s[start]).collect(),
            motion: self.motion[rows.clone()].to_vec(),
            is_measured: self.is_measured[rows.clone()].to_vec(),
            axes: self
                .axes
                .iter()
                .map(|axis| AxisTrace {
                    setpoint_position_m: cut(&axis.setpoint_position_m),
                    setpoint_velocity_m_per_s: cut(&axis.setpoint_velocity_m_per_s),
                    motor_position_m: cut(&axis.motor_position_m),
                    table_position_m: axis.table_position_m.as_ref().map(cut),
                    velocity_m_per_s: cut(&axis.velocity_m_per_s),
                    current_a: cut(&axis.current_a),
                    current_command_a: cut(&axis.current_command_a),
                    velocity_command_m_per_s: cut(&axis.velocity_command_m_per_s),
                    excitation_m_per_s: cut(&axis.excitation_m_per_s),
                    torque_proportional_nm: cut(&axis.torque_proportional_nm),
                    torque_integral_nm: cut(&axis.torque_integral_nm),
                    torque_friction_nm: cut(&axis.torque_friction_nm),
                    torque_inertia_nm: cut(&axis.torque_inertia_nm),
                    gain_set: axis.gain_set[rows.clone()].to_vec(),
                    mode: axis.mode[rows.clone()].to_vec(),
                    is_fresh: axis.is_fresh[rows.clone()].to_vec(),
                })
                .collect(),
            gaps: self.gaps.iter().filter(|gap| cycles.contains(&gap.cycle)).copied().collect(),
            overruns: self.overruns,
            lost_records: self.lost_records,
        })
    }

    /// The motions in the trace, in order, without 0.
    pub fn motions(&self) -> Vec<u32> {
        let mut motions: Vec<u32> = self.motion.iter().copied().filter(|motion| *motion > 0).collect();
        motions.dedup();
        motions
    }
    /// How many rows.
    pub fn len(&self) -> usize {
        self.cycle.len()
    }
    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.cycle.is_empty()
    }
    /// The columns of one axis; `None` when the machine has no such axis.
    pub fn axis(&self, axis: AxisId) -> Option<&AxisTrace> {
        self.axes.get(axis.index())
    }
    /// Cycles missing between the rows.
    pub fn missing_cycles(&self) -> u64 {
        self.gaps.iter().map(|gap| gap.count).sum()
    }

    fn empty(axes: usize) -> Self {
        Self {
            period_s: 0.0,
            cycle: Vec::new(),
            time_s: Vec::new(),
            motion: Vec::new(),
            is_measured: Vec::new(),
            axes: vec![AxisTrace::default(); axes],
            gaps: Vec::new(),
            overruns: 0,
            lost_records: 0,
        }
    }

    fn push(&mut self, row: &CycleRecord) -> Result<(), TraceError> {
        let (got, expected) = (row.axes.count(), self.axes.len());
        if got != expected {
            return Err(TraceError::AxisCount { cycle: row.cycle, got, expected });
        }
        if let Some(&previous) = self.cycle.last() {
            if row.cycle <= previous {
                return Err(TraceError::OutOfOrder { previous, cycle: row.cycle });
            }
            if row.cycle > previous + 1 {
                self.gaps.push(Gap { cycle: previous + 1, count: row.cycle - previous - 1 });
            }
        }
        self.cycle.push(row.cycle);
        self.motion.push(row.stage.motion);
        self.is_measured.push(row.stage.is_measured);
        for (columns, record) in self.axes.iter_mut().zip(row.axes.as_slice()) {
            columns.push(record);
        }
        Ok(())
    }
}

/// A trace in the making, record by record: from the cycle itself, or as a log is read.
#[derive(Clone, Debug, Default)]
pub struct Tracing {
    made: Option<Made>,
    broken: Option<TraceError>,
}

/// Rows so far, with the records at both ends of them.
#[derive(Clone, Debug)]
struct Made {
    trace: Trace,
    first: CycleRecord,
    last: CycleRecord,
}

impl Tracing {
    /// The next record.
    ///
    /// # Errors
    /// When it does not follow those before.
    pub fn see(&mut self, record: &CycleRecord) -> Result<(), TraceError> {
        let fresh = || Made { trace: Trace::empty(record.axes.count()), first: *record, last: *record };
        let made = self.made.get_or_insert_with(fresh);
        made.last = *record;
        made.trace.push(record)
    }

    /// The trace of all records.
    ///
    /// # Errors
    /// When there are fewer than two, or one did not follow those before.
    pub fn finish(self) -> Result<Trace, TraceError> {
        if let Some(broken) = self.broken {
            return Err(broken);
        }
        let Some(Made { mut trace, first, last }) = self.made else {
            return Err(TraceError::TooShort { records: 0 });
        };
        if trace.len() < 2 {
            return Err(TraceError::TooShort { records: trace.len() });
        }
        let span_s = (last.timing.scheduled - first.timing.scheduled).as_s();
        if span_s <= 0.0 {
            return Err(TraceError::NoTime { first: first.cycle, last: last.cycle, span_s });
        }
        trace.period_s = span_s / (last.cycle - first.cycle) as f64;
        trace.time_s =
            trace.cycle.iter().map(|cycle| (cycle - first.cycle) as f64 * trace.period_s).collect();
        trace.overruns = last.overruns - first.overruns.min(last.overruns);
        trace.lost_records = last.lost_records - first.lost_records.min(last.lost_records);
        trace.axes.iter_mut().for_each(AxisTrace::drop_missing_table);
        Ok(trace)
    }
}

impl Records for Tracing {
    fn put(&mut self, record: &CycleRecord, _inputs: &Inputs) {
        if self.broken.is_none() {
            self.broken = self.see(record).err();
        }
    }
    fn lost(&self) -> u64 {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::record::Stage;
    use crate::base::time::{Moment, Span};
    use crate::base::units::Position;

    fn records(cycles: &[u64]) -> Vec<CycleRecord> {
        let record = |&cycle: &u64| {
            let mut record = CycleRecord::empty(2);
            record.cycle = cycle;
            record.timing.scheduled = Moment::ZERO + Span::us(500) * cycle as i64;
            record.stage = Stage { motion: u32::from(cycle >= 3), is_measured: cycle >= 4 };
            record.axes[AxisId::Y].setpoint.position = Position::mm(cycle as f64);
            record.axes[AxisId::Y].sample.table_position = Position::m(f64::NAN);
            record
        };
        cycles.iter().map(record).collect()
    }

    #[test]
    fn missing_cycles_are_gaps_and_keep_their_time() {
        let trace = Trace::from_records(records(&[1, 2, 3, 6, 7])).unwrap();
        assert!((trace.period_s - 0.0005).abs() < 1e-12, "period {} s", trace.period_s);
        assert_eq!(trace.gaps, [Gap { cycle: 4, count: 2 }]);
        assert!((trace.time_s[3] - 0.0025).abs() < 1e-12, "time of cycle 6 is {} s", trace.time_s[3]);
        assert_eq!(trace.missing_cycles(), 2);
    }

    #[test]
    fn a_stretch_holds_one_motion_with_its_run_in() {
        let trace = Trace::from_records(records(&[1, 2, 3, 4, 5])).unwrap();
        let stretch = trace.stretch(1).unwrap();
        assert_eq!(stretch.cycle, [3, 4, 5]);
        assert_eq!(stretch.is_measured, [false, true, true]);
        assert_eq!(stretch.time_s[0], 0.0);
        assert_eq!(stretch.axes[1].setpoint_position_m, [0.003, 0.004, 0.005]);
        assert_eq!(trace.motions(), [1]);
        assert_eq!(trace.stretch(2), Err(TraceError::NoMotion { motion: 2 }));
    }

    #[test]
    fn a_table_that_is_not_a_number_is_no_table() {
        let trace = Trace::from_records(records(&[1, 2])).unwrap();
        assert!(trace.axes[0].table_position_m.is_some());
        assert_eq!(trace.axes[1].table_position_m, None);
    }

    #[test]
    fn records_that_run_backwards_are_refused() {
        let refused = Trace::from_records(records(&[2, 2]));
        assert_eq!(refused, Err(TraceError::OutOfOrder { previous: 2, cycle: 2 }));
        assert_eq!(Trace::from_records(records(&[5])), Err(TraceError::TooShort { records: 1 }));
    }
}
