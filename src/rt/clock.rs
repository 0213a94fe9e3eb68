//! The clocks of the system, on behalf of the two who must ask: the pace, which sleeps until a slot, and a
//! bus on a real interface, which waits until a deadline and dates what it receives.
//!
//! Reading them is no system call on a usual kernel. The monotonic clock never steps and is the one that
//! paces; the wall clock is only read to translate stamps of the kernel.
//! Invariant: the only reader of a clock in `rt`.

use nix::time::{ClockId, clock_gettime};

use crate::base::time::Moment;

/// Both clocks, read one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clocks {
    /// Wall clock: since 1970. May step.
    pub wall: Moment,
    /// Monotonic clock, read last: nothing stamped before is later than this.
    pub monotonic: Moment,
}

impl Clocks {
    /// What they say now.
    pub fn now() -> Self {
        let wall = read(ClockId::CLOCK_REALTIME);
        Self { wall, monotonic: monotonic_now() }
    }
}

/// Now, on the monotonic clock.
pub fn monotonic_now() -> Moment {
    read(ClockId::CLOCK_MONOTONIC)
}

#[cfg_attr(
    not(test),
    expect(clippy::panic, reason = "no cycle without a clock; the board takes the current away")
)]
fn read(clock: ClockId) -> Moment {
    match clock_gettime(clock) {
        Ok(time) => Moment::ns(time.tv_sec() * 1_000_000_000 + time.tv_nsec()),
        // Linux refuses these clocks to nobody; a grid without a clock would be worse than a stop.
        Err(errno) => panic!("clock {clock} cannot be read: {errno}"),
    }
}
