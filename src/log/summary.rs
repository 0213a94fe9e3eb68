//! A log in a few numbers: how long, how whole, how well each axis followed, how late the cycle woke.
//!
//! Invariant: one pass over the records, memory independent of their number (but for the faults).

use std::collections::BTreeMap;

use serde::Serialize;

use crate::base::axis::PerAxis;
use crate::base::fault::Fault;
use crate::base::record::CycleRecord;
use crate::base::time::{Moment, Span};

use super::error::LogError;
use super::header::Header;
use super::timing::{Percentiles, Timings};

/// What a log holds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// From the first cycle to the end of the last, in seconds.
    pub duration_s: f64,
    /// Records.
    pub cycles: u64,
    /// Places where the numbers of the cycles jump.
    pub gaps: u64,
    /// Cycles missing in those places: skipped or lost.
    pub cycles_missing: u64,
    /// Records lost until the last one was made, by its own account.
    pub lost_records: u64,
    /// Periods skipped because a cycle came late, by the last record's account.
    pub overruns: u64,
    /// Wake-up behind the grid, the latest, in microseconds, to 0.1 %.
    pub wake_error_us_max: f64,
    /// Wake-up behind the grid that 99 % of the cycles kept, in microseconds, to 0.1 %.
    pub wake_error_us_p99: f64,
    /// Each axis.
    pub axes: Vec<AxisSummary>,
    /// Every fault as it came up.
    pub faults: Vec<FaultSeen>,
}

/// What one axis did.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct AxisSummary {
    /// Its name.
    pub name: String,
    /// Largest distance from the setpoint, in micrometres; NaN where no setpoint is known.
    pub following_error_um_max: f64,
    /// Largest measured current, in amperes.
    pub current_a_max: f64,
    /// How many cycles it was in which mode, by name.
    pub cycles_by_mode: BTreeMap<&'static str, u64>,
}

/// A fault that was not there in the cycle before.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultSeen {
    /// Name of the axis.
    pub axis: String,
    /// Number of the fault.
    pub number: u8,
    /// Its name.
    pub name: &'static str,
    /// In which cycle.
    pub cycle: u64,
    /// When, in seconds since the first record.
    pub at_s: f64,
}

impl Summary {
    /// Of a log with this header and these records, as a [`super::Reader`] gives them.
    ///
    /// # Errors
    /// The first that the records hold.
    pub fn of(
        header: &Header,
        records: impl Iterator<Item = Result<CycleRecord, LogError>>,
    ) -> Result<Self, LogError> {
        let mut tally = Tally::new(header);
        for record in records {
            tally.add(&record?);
        }
        Ok(tally.finish())
    }
}

/// The numbers on their way.
struct Tally {
    period: Span,
    summary: Summary,
    first: Moment,
    last: Option<CycleRecord>,
    timings: Timings,
}

impl Tally {
    fn new(header: &Header) -> Self {
        let axes = header.axes.iter().map(|name| AxisSummary {
            name: name.clone(),
            following_error_um_max: f64::NAN,
            ..AxisSummary::default()
        });
        let summary = Summary {
            duration_s: 0.0,
            cycles: 0,
            gaps: 0,
            cycles_missing: 0,
            lost_records: 0,
            overruns: 0,
            wake_error_us_max: 0.0,
            wake_error_us_p99: 0.0,
            axes: axes.collect(),
            faults: Vec::new(),
        };
        let first = Moment::ZERO;
        Self { period: header.period, summary, first, last: None, timings: Timings::default() }
    }

    fn add(&mut self, record: &CycleRecord) {
        let summary = &mut self.summary;
        match &self.last {
            None => self.first = record.timing.scheduled,
            Some(last) => {
                let missing = record.cycle.saturating_sub(last.cycle).saturating_sub(1);
                summary.gaps += u64::from(missing > 0);
                summary.cycles_missing += missing;
            }
        }
        summary.cycles += 1;
        self.timings.add(record);
        for (axis, now) in record.axes.iter() {
            let Some(of_axis) = summary.axes.get_mut(axis.index()) else { continue };
            let error_um = now.command.terms.following_error.abs().as_um();
            of_axis.following_error_um_max = of_axis.following_error_um_max.max(error_um);
            of_axis.current_a_max = of_axis.current_a_max.max(now.sample.current.abs().as_a());
            *of_axis.cycles_by_mode.entry(now.mode.name()).or_default() += 1;
        }
        self.add_faults(record);
        self.last = Some(*record);
    }

    fn add_faults(&mut self, record: &CycleRecord) {
        let faults = |axes: &PerAxis<_>| axes.map(|_, axis: &crate::base::record::AxisRecord| axis.fault);
        let before = self.last.as_ref().map(|last| faults(&last.axes));
        for (axis, now) in record.axes.iter() {
            let is_new = before.as_ref().is_none_or(|before| before[axis] != now.fault);
            if let (Some(fault), true) = (now.fault, is_new) {
                let axis =
                    self.summary.axes.get(axis.index()).map_or(String::new(), |axis| axis.name.clone());
                let at_s = (record.timing.scheduled - self.first).as_s();
                let (number, name, cycle) = (Fault::number(fault), fault.name(), record.cycle);
                self.summary.faults.push(FaultSeen { axis, number, name, cycle, at_s });
            }
        }
    }

    fn finish(mut self) -> Summary {
        if let Some(last) = self.last {
            self.summary.duration_s = (last.timing.scheduled - self.first + self.period).as_s();
            self.summary.lost_records = last.lost_records;
            self.summary.overruns = last.overruns;
        }
        let wake_error = Percentiles::of(&self.timings.wake);
        self.summary.wake_error_us_max = wake_error.max_us;
        self.summary.wake_error_us_p99 = wake_error.p99_us;
        self.summary
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;
    use crate::base::record::ModeTag;
    use crate::base::units::{Current, Position};
    use crate::log::header::tests::example;

    #[test]
    fn a_run_of_known_shape() {
        let mut records = Vec::new();
        for cycle in (0..100).chain(103..203) {
            let mut record = CycleRecord::empty(2);
            record.cycle = cycle;
            record.overruns = if cycle < 100 { 0 } else { 3 };
            record.timing.scheduled = Moment::ns(7_000_000) + Span::us(500) * cycle as i64;
            record.timing.woke = record.timing.awaited + Span::us(if cycle == 50 { 900 } else { 10 });
            record.axes[AxisId::X].mode = if cycle < 10 { ModeTag::Ready } else { ModeTag::Moving };
            record.axes[AxisId::X].command.terms.following_error = Position::um(-(cycle as f64));
            record.axes[AxisId::X].sample.table_position = Position::m(f64::NAN);
            record.axes[AxisId::Y].sample.current = Current::a(if cycle == 60 { -4.5 } else { 1.0 });
            record.axes[AxisId::Y].fault = (120..130).contains(&cycle).then_some(Fault::Overcurrent);
            records.push(Ok(record));
        }
        let summary = Summary::of(&example(&["x", "y"]), records.into_iter()).unwrap();
        assert!((summary.duration_s - 203.0 * 500e-6).abs() < 1e-12, "{} s", summary.duration_s);
        assert_eq!((summary.cycles, summary.gaps, summary.cycles_missing, summary.overruns), (200, 1, 3, 3));
        assert!((summary.wake_error_us_max - 900.0).abs() < 0.9, "{} us", summary.wake_error_us_max);
        let p99_us = summary.wake_error_us_p99;
        assert!((10.0..10.01).contains(&p99_us), "{p99_us} us");
        assert!((summary.axes[0].following_error_um_max - 202.0).abs() < 1e-9);
        assert!((summary.axes[1].current_a_max - 4.5).abs() < 1e-12);
        assert_eq!(summary.axes[0].cycles_by_mode, BTreeMap::from([("ready", 10), ("moving", 190)]));
        let at_s = 120.0 * 500e-6;
        let [fault] = &summary.faults[..] else { panic!("{:?}", summary.faults) };
        assert_eq!(
            (fault.axis.as_str(), fault.number, fault.name, fault.cycle),
            ("y", 6, "overcurrent", 120)
        );
        assert!((fault.at_s - at_s).abs() < 1e-12, "{} s", fault.at_s);
    }
}
