//! When the next cycle runs: an absolute grid of periods from the start of the run.
//!
//! [`Virtual`] steps from slot to slot as fast as it is called. [`Wall`] sleeps until each slot on the
//! monotonic clock; slots that have passed by then, before or during the sleep, are skipped and counted,
//! never run in a burst: a cycle starts within its own slot.
//! Invariant: the grid never moves.

use nix::errno::Errno;
use nix::sys::time::TimeSpec;
use nix::time::{ClockId, ClockNanosleepFlags, clock_nanosleep};

use crate::base::record::Timing;
use crate::base::time::{Moment, Span};
pub use crate::rt::clock::monotonic_now;

/// A place on the grid, and what the clock said around it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slot {
    /// Number of the period since start.
    pub number: u64,
    /// Clock reads.
    pub timing: Timing,
    /// Periods skipped since start.
    pub overruns: u64,
}

/// Something that says when.
pub trait Pace {
    /// Wait for the next slot.
    fn wait(&mut self) -> Slot;
    /// What the clock says within the present slot, in time of the run.
    fn now(&self) -> Moment;
    /// The cycle of the present slot is done.
    fn finish(&mut self);
}

/// Virtual time: every cycle starts on its slot and takes no time.
#[derive(Clone, Debug)]
pub struct Virtual {
    period: Span,
    next: u64,
}

impl Virtual {
    /// A grid of `period` from moment zero.
    pub const fn new(period: Span) -> Self {
        Self { period, next: 0 }
    }
}

impl Pace for Virtual {
    fn wait(&mut self) -> Slot {
        let number = self.next;
        self.next += 1;
        let scheduled = Moment::ZERO + self.period * number as i64;
        Slot { number, timing: Timing::at(scheduled), overruns: 0 }
    }
    fn now(&self) -> Moment {
        Moment::ZERO + self.period * (self.next as i64 - 1)
    }
    fn finish(&mut self) {}
}

/// Wall-clock time.
#[derive(Clone, Debug)]
pub struct Wall {
    period: Span,
    origin: Moment,
    next: u64,
    overruns: u64,
    finished: Moment,
}

impl Wall {
    /// A grid of `period` whose first slot is at `origin` on the monotonic clock: moment zero of the run.
    pub const fn starting_at(origin: Moment, period: Span) -> Self {
        Self { period, origin, next: 0, overruns: 0, finished: origin }
    }

    /// Move past the slots that are already over, at `now`; returns where the next one stands.
    fn skip(&mut self, now: Moment) -> Moment {
        let scheduled = self.origin + self.period * self.next as i64;
        let missed = ((now - scheduled) / self.period).max(0);
        self.next += missed as u64;
        self.overruns += missed as u64;
        scheduled + self.period * missed
    }
}

/// Sleep again for as long as signals wake us early: the absolute time makes waiting again exact.
#[cfg_attr(
    not(test),
    expect(clippy::panic, reason = "no cycle without a clock; the board takes the current away")
)]
fn sleep_through<T>(mut sleep: impl FnMut() -> Result<T, Errno>) {
    loop {
        match sleep() {
            Ok(_) => return,
            Err(Errno::EINTR) => {}
            // Linux refuses this sleep to nobody; without it the cycle would spin off its grid.
            Err(errno) => panic!("CLOCK_MONOTONIC cannot be slept on: {errno}"),
        }
    }
}

impl Pace for Wall {
    fn wait(&mut self) -> Slot {
        let awaited = self.skip(monotonic_now());
        let until = TimeSpec::new(awaited.as_ns() / 1_000_000_000, awaited.as_ns() % 1_000_000_000);
        let sleep = || clock_nanosleep(ClockId::CLOCK_MONOTONIC, ClockNanosleepFlags::TIMER_ABSTIME, &until);
        sleep_through(sleep);
        let woke = monotonic_now();
        // Overslept by whole periods: this is the slot that has begun by now, not the one waited for.
        let scheduled = self.skip(woke);
        let since_origin = |moment: Moment| Moment::ZERO + (moment - self.origin);
        let timing = Timing {
            scheduled: since_origin(scheduled),
            awaited: since_origin(awaited),
            woke: since_origin(woke),
            collected: since_origin(woke),
            decided: since_origin(woke),
            previous_finished: since_origin(self.finished),
        };
        let number = self.next;
        self.next += 1;
        Slot { number, timing, overruns: self.overruns }
    }

    fn now(&self) -> Moment {
        Moment::ZERO + (monotonic_now() - self.origin)
    }

    fn finish(&mut self) {
        self.finished = monotonic_now();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Span = Span::us(500);

    #[test]
    fn late_slots_are_skipped_and_counted() {
        let mut pace = Wall { next: 4, ..Wall::starting_at(Moment::ns(1_000), PERIOD) };
        let due = pace.origin + PERIOD * 4;
        assert_eq!(pace.skip(due - Span::us(3)), due, "early");
        assert_eq!(pace.skip(due + Span::us(499)), due, "late within the slot: it still runs");
        assert_eq!(pace.overruns, 0);
        assert_eq!(pace.skip(due + Span::us(1_700)), due + PERIOD * 3);
        assert_eq!((pace.next, pace.overruns), (7, 3));
    }

    #[test]
    fn a_signal_does_not_end_the_sleep() {
        let mut answers = [Err(Errno::EINTR), Err(Errno::EINTR), Ok(()), Err(Errno::EINVAL)].into_iter();
        sleep_through(|| answers.next().expect("four answers"));
        assert_eq!(answers.len(), 1, "it sleeps until it has slept");
    }

    #[test]
    #[should_panic(expected = "cannot be slept on")]
    fn a_clock_that_cannot_be_slept_on_does_not_spin() {
        let mut answers = [Err::<(), _>(Errno::EINTR), Err(Errno::EINVAL)].into_iter();
        sleep_through(|| answers.next().expect("no third try"));
    }

    #[test]
    fn the_wall_grid_is_absolute() {
        let mut pace = Wall::starting_at(monotonic_now() + PERIOD, PERIOD);
        for _ in 0..20 {
            let slot = pace.wait();
            assert_eq!(slot.timing.scheduled, Moment::ZERO + PERIOD * slot.number as i64);
            assert!(slot.timing.woke >= slot.timing.scheduled, "woke before its slot: {slot:?}");
            pace.finish();
        }
    }
}
