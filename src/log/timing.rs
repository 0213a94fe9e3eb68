//! Where the time of the periods went: histograms of the clock reads that stand in every record.
//!
//! | share | from | to |
//! |---|---|---|
//! | wake-up error | the place on the grid that it slept for | the thread runs |
//! | collect | the thread runs | all replies are in, or the reply window is over |
//! | control | all replies are in | the commands stand |
//! | total | the thread runs | commands sent, record handed over |
//!
//! In nanoseconds, three significant digits. The histograms are made beside the cycle, from its records: a
//! log gives them for any run, and a daemon for the one that runs.
//! Invariant: one record, one count; memory does not grow.

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

use crate::base::record::CycleRecord;
use crate::base::time::{Moment, Span};

/// Longest time told apart, in nanoseconds: what takes longer counts as this long.
const LONGEST_NS: u64 = 10_000_000_000;
/// Digits kept of each value.
const DIGITS: u8 = 3;
/// Bins of a picture per factor of ten in time.
const BINS_PER_DECADE: i32 = 10;
/// Shortest time of a picture, as a power of ten in seconds: 100 ns; all below is in the first bin.
const FIRST_DECADE: i32 = -7;
/// Longest time of a picture: 1 s; all above is in the last bin.
const LAST_DECADE: i32 = 0;
/// Bins of a picture: the same for every share and run, so that pictures can be laid side by side.
pub const BINS: usize = ((LAST_DECADE - FIRST_DECADE) * BINS_PER_DECADE) as usize;

/// Where a bin starts, in microseconds.
pub fn bin_start_us(bin: usize) -> f64 {
    10_f64.powf(f64::from(FIRST_DECADE) + bin as f64 / f64::from(BINS_PER_DECADE)) * 1e6
}

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

/// One share of the period, told and ready to be drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Its name.
    pub name: String,
    /// What is told of it.
    #[serde(flatten)]
    pub percentiles: Percentiles,
    /// Cycles in each bin, from the shortest time: see [`bin_start_us`].
    pub bins: Vec<u64>,
}

impl Share {
    /// Of a histogram in nanoseconds.
    pub fn of(name: &str, histogram: &Histogram<u64>) -> Self {
        let mut bins = vec![0; BINS];
        for step in histogram.iter_recorded() {
            let decades = (step.value_iterated_to().max(1) as f64 * 1e-9).log10() - f64::from(FIRST_DECADE);
            let bin = (decades * f64::from(BINS_PER_DECADE)).max(0.0) as usize;
            bins[bin.min(BINS - 1)] += step.count_at_value();
        }
        Self { name: name.to_owned(), percentiles: Percentiles::of(histogram), bins }
    }

    /// The bins from the first to the last that has cycles.
    pub fn used(&self) -> Option<std::ops::RangeInclusive<usize>> {
        let first = self.bins.iter().position(|count| *count > 0)?;
        let last = self.bins.iter().rposition(|count| *count > 0)?;
        Some(first..=last)
    }
}

/// What is told of a histogram, in microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
        count(&mut self.wake, timing.wake_error());
        count(&mut self.collect, timing.collected - timing.woke);
        count(&mut self.control, timing.decided - timing.collected);
        // The end of a cycle that was followed by a lost record is not known.
        if let Some((_, woke)) = self.last.filter(|(cycle, _)| is_next(*cycle, record)) {
            count(&mut self.total, timing.previous_finished - woke);
        }
        self.last = Some((record.cycle, timing.woke));
    }

    /// All shares, in order of the period.
    pub fn shares(&self) -> Vec<Share> {
        self.named().into_iter().map(|(name, histogram)| Share::of(name, histogram)).collect()
    }

    /// Every time that was seen with its count, as CSV: to be put together with those of other runs.
    pub fn table(&self) -> String {
        let mut text = String::from("share,us,cycles\n");
        for (name, histogram) in self.named() {
            for step in histogram.iter_recorded() {
                let us = step.value_iterated_to() as f64 * 1e-3;
                text += &format!("{name},{us},{}\n", step.count_at_value());
            }
        }
        text
    }

    fn named(&self) -> [(&'static str, &Histogram<u64>); 4] {
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
            awaited: scheduled,
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
        // Overslept by two periods and a bit: 1.02 ms late, not 20 us.
        let mut late = record(7, 20, [100, 3], 0);
        late.timing.awaited = Moment::ZERO + Span::us(500) * 5;
        timings.add(&late);
        assert!((Percentiles::of(&timings.wake).max_us / 1_020.0 - 1.0).abs() < 2e-3);

        let mut timings = Timings::default();
        // The wake-up of each cycle is 10 us late, so its total is 10 us less than its end on the grid.
        timings.add(&record(0, 10, [100, 3], 0));
        timings.add(&record(1, 10, [120, 4], 140));
        timings.add(&record(2, 10, [900, 5], 160));
        timings.add(&record(4, 10, [100, 3], 0));
        let shares = timings.shares();
        let told = shares
            .iter()
            .map(|share| (share.name.as_str(), share.percentiles.count, share.percentiles.max_us.round()));
        assert_eq!(
            told.collect::<Vec<_>>(),
            [("wake-up error", 4, 10.0), ("collect", 4, 900.0), ("control", 4, 5.0), ("total", 2, 150.0)]
        );
    }

    #[test]
    fn every_cycle_is_in_one_bin_and_the_ends_take_the_rest() {
        let mut histogram = Timings::default().wake;
        for (ns, count) in [(0, 1), (99, 2), (101, 4), (1_001, 8), (u64::MAX, 16)] {
            (0..count).for_each(|_| histogram.saturating_record(ns));
        }
        let share = Share::of("total", &histogram);
        assert_eq!(share.bins.iter().sum::<u64>(), 31);
        assert_eq!((share.bins[0], share.bins[10], share.bins.last()), (7, 8, Some(&16)));
        assert_eq!(share.used(), Some(0..=BINS - 1));
        assert!((bin_start_us(10) - 1.0).abs() < 1e-9, "the tenth bin starts at a microsecond");
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
