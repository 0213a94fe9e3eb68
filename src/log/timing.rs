//! Where the time of the periods went: histograms of the clock reads that stand in every record.
//!
//! | share | from | to |
//! |---|---|---|
//! | wake-up error | the place on the grid | the thread runs |
//! | collect | the thread runs | all replies are in, or the reply window is over |
//! | control | all replies are in | the commands stand |
//! | total | the thread runs | commands sent, record handed over |
//!
//! In nanoseconds, three significant digits. The histograms are made beside the cycle, from its records: a
//! log gives them for any run, and a daemon for the one that runs.
//! Invariant: one record, one count; memory does not grow.

use hdrhistogram::Histogram;
use serde::Serialize;

use crate::base::record::CycleRecord;
use crate::base::time::{Moment, Span};

/// Longest time told apart, in nanoseconds: what takes longer counts as this long.
const LONGEST_NS: u64 = 10_000_000_000;
/// Digits kept of each value.
const DIGITS: u8 = 3;

/// Histograms of one run, each in nanoseconds.
#[derive(Clone, Debug)]
pub struct Timings {
    /// From the place on the grid to the wake-up.
    pub wake: Histogram<u64>,
    /// Until all replies are in.
    pub collect: Histogram<u64>,
    /// Until the commands stand.
    pub control: Histogram<u64>,
    /// Until the cycle is done.
    pub total: Histogram<u64>,
    /// The wake-up of the last record: its end stands in the next.
    last: Option<(u64, Moment)>,
}

impl Default for Timings {
    fn default() -> Self {
        let [wake, collect, control, total] = [(); 4].map(|()| {
            Histogram::new_with_max(LONGEST_NS, DIGITS).expect("a range and digits that the crate allows")
        });
        Self { wake, collect, control, total, last: None }
    }
}

/// What is told of a histogram, in microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Percentiles {
    /// Values.
    pub count: u64,
    /// Half of the values do not exceed it.
    pub p50_us: f64,
    /// 99 % do not.
    pub p99_us: f64,
    /// 99.9 % do not.
    pub p99_9_us: f64,
    /// 99.99 % do not.
    pub p99_99_us: f64,
    /// The longest.
    pub max_us: f64,
}

impl Timings {
    /// Counts one more cycle.
    pub fn add(&mut self, record: &CycleRecord) {
        let timing = &record.timing;
        count(&mut self.wake, timing.woke - timing.scheduled);
        count(&mut self.collect, timing.collected - timing.woke);
        count(&mut self.control, timing.decided - timing.collected);
        // The end of a cycle that was followed by a lost record is not known.
        if let Some((_, woke)) = self.last.filter(|(cycle, _)| is_next(*cycle, record)) {
            count(&mut self.total, timing.previous_finished - woke);
        }
        self.last = Some((record.cycle, timing.woke));
    }

    /// The histograms with their names, in order of the period.
    pub fn named(&self) -> [(&'static str, &Histogram<u64>); 4] {
        [
            ("wake-up error", &self.wake),
            ("collect", &self.collect),
            ("control", &self.control),
            ("total", &self.total),
        ]
    }
}

/// Whether `record` is of the next period: with a skipped one between, the end still stands in it, but so
/// it does with a lost one, and they are not told apart here.
fn is_next(cycle: u64, record: &CycleRecord) -> bool {
    record.cycle == cycle + 1
}

fn count(histogram: &mut Histogram<u64>, span: Span) {
    histogram.saturating_record(span.as_ns().max(0).unsigned_abs());
}

impl Percentiles {
    /// Of a histogram in nanoseconds.
    pub fn of(histogram: &Histogram<u64>) -> Self {
        let us = |quantile| histogram.value_at_quantile(quantile) as f64 * 1e-3;
        Self {
            count: histogram.len(),
            p50_us: us(0.5),
            p99_us: us(0.99),
            p99_9_us: us(0.999),
            p99_99_us: us(0.9999),
            max_us: histogram.max() as f64 * 1e-3,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::record::Timing;

    fn record(cycle: u64, late_us: i64, took_us: [i64; 2], previous_took_us: i64) -> CycleRecord {
        let period = Span::us(500);
        let scheduled = Moment::ZERO + period * cycle as i64;
        let woke = scheduled + Span::us(late_us);
        let collected = woke + Span::us(took_us[0]);
        let timing = Timing {
            scheduled,
            woke,
            collected,
            decided: collected + Span::us(took_us[1]),
            previous_finished: scheduled - period + Span::us(previous_took_us),
        };
        CycleRecord { cycle, timing, ..CycleRecord::empty(1) }
    }

    #[test]
    fn each_share_is_counted_where_it_ends() {
        let mut timings = Timings::default();
        // The wake-up of each cycle is 10 us late, so its total is 10 us less than its end on the grid.
        timings.add(&record(0, 10, [100, 3], 0));
        timings.add(&record(1, 10, [120, 4], 140));
        timings.add(&record(2, 10, [900, 5], 160));
        timings.add(&record(4, 10, [100, 3], 0));
        let told = timings.named().map(|(name, histogram)| (name, histogram.len(), histogram.max() / 1_000));
        assert_eq!(
            told,
            [("wake-up error", 4, 10), ("collect", 4, 900), ("control", 4, 5), ("total", 2, 150)]
        );
    }

    #[test]
    fn percentiles_are_in_microseconds() {
        let mut histogram = Timings::default().wake;
        (1..=10_000_u64).for_each(|us| histogram.saturating_record(us * 1_000));
        let told = Percentiles::of(&histogram);
        for (got, wanted) in [
            (told.p50_us, 5_000.0),
            (told.p99_us, 9_900.0),
            (told.p99_9_us, 9_990.0),
            (told.p99_99_us, 9_999.0),
            (told.max_us, 10_000.0),
        ] {
            assert!((got / wanted - 1.0).abs() < 2e-3, "{got} us, wanted {wanted} us");
        }
    }
}
