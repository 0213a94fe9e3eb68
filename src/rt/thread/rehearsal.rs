//! A rehearsal of the pace: so many periods with nothing to do, to see how late the thread is woken and
//! whether it meets a page that is not there. For the self-check before an axis may move.
//!
//! Invariant: runs on the grid of the cycle, in its thread, with its settings; touches no bus.

use nix::errno::Errno;

use super::PageFaults;
use crate::base::time::Span;
use crate::rt::cycle::pace::Pace;

/// What was seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rehearsal {
    /// Periods run.
    pub periods: u64,
    /// Periods that were over before the thread was woken.
    pub overruns: u64,
    /// The latest wake-up, from its place on the grid.
    pub wake_error_max: Span,
    /// Page faults of the thread meanwhile.
    pub page_faults: Result<PageFaults, Errno>,
}

/// Runs so many periods of a pace.
pub fn rehearse(pace: &mut impl Pace, periods: u64) -> Rehearsal {
    let before = PageFaults::of_this_thread();
    let (mut overruns, mut wake_error_max) = (0, Span::ZERO);
    for _ in 0..periods {
        let slot = pace.wait();
        wake_error_max = wake_error_max.max(slot.timing.wake_error());
        overruns = slot.overruns;
        pace.finish();
    }
    let since = |before| PageFaults::of_this_thread().map(|after| after.since(before));
    Rehearsal { periods, overruns, wake_error_max, page_faults: before.and_then(since) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::record::Timing;
    use crate::base::time::Moment;
    use crate::rt::cycle::pace::Slot;

    const PERIOD: Span = Span::us(500);

    /// Wakes by a list of errors; touches fresh memory in each period if it is told to.
    struct Listed {
        late_us: std::vec::IntoIter<i64>,
        slot: Slot,
        fresh_bytes: usize,
    }

    impl Pace for Listed {
        fn wait(&mut self) -> Slot {
            let late = Span::us(self.late_us.next().expect("as many as periods"));
            let scheduled = Moment::ZERO + PERIOD * self.slot.number as i64;
            self.slot.timing = Timing { woke: scheduled + late, ..Timing::at(scheduled) };
            self.slot.number += 1;
            self.slot.overruns += u64::from(late > Span::us(400));
            self.slot
        }
        fn now(&self) -> Moment {
            self.slot.timing.woke
        }
        fn finish(&mut self) {
            std::hint::black_box(vec![1_u8; self.fresh_bytes].as_mut_slice());
        }
    }

    fn rehearsed(fresh_bytes: usize) -> Rehearsal {
        let late_us = vec![3, 410, 7, 420, 2].into_iter();
        rehearse(&mut Listed { late_us, slot: Slot::default(), fresh_bytes }, 5)
    }

    #[test]
    fn the_latest_wake_up_is_kept_with_what_was_missed() {
        let seen = rehearsed(0);
        assert_eq!((seen.periods, seen.overruns, seen.wake_error_max), (5, 2, Span::us(420)));
    }

    #[test]
    fn pages_that_are_not_there_are_counted() {
        // Larger than what malloc keeps, so that each period maps it anew: at least a fault each.
        let faults = rehearsed(16 << 20).page_faults.expect("any thread may ask");
        assert!(faults.minor >= 5, "{faults:?}");
    }
}
