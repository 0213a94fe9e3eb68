//! A board's own clock, as its feedback tells it: how long it really was between two latches, and whether
//! the clock still runs on.
//!
//! The host's SYNC comes late when the host does, and the encoders are latched when it comes. A velocity from
//! the grid would be wrong by the share of a period that the SYNC was late; the board's clock knows.
//! A SYNC is sent within its own period, so two latches are never further from the grid than one period each.
//! Invariant: at exactly the grid the step is exactly the grid's, so nothing is rounded there.

use crate::base::time::Span;

/// A board's clock runs at most so much faster or slower than the host's: 1000 ppm, ten times a bad quartz.
const DRIFT: i64 = 1_000;

/// The clock of one board.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoardClock {
    period_us: i64,
    last_us: Option<u32>,
}

/// From one latch to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// The first latch.
    First,
    /// So many periods of the grid, exactly.
    Periods(u32),
    /// Not quite.
    Time(Span),
    /// No clock that ran on does this.
    Jump,
}

impl BoardClock {
    pub(super) const fn new(period: Span) -> Self {
        Self { period_us: period.as_ns() / 1_000, last_us: None }
    }

    /// The board restarted: its next time is a first one.
    pub(super) const fn restart(&mut self) {
        self.last_us = None;
    }

    /// A new latch, `periods` of the grid after the last.
    pub(super) fn latch(&mut self, time_us: u32, periods: u32) -> Step {
        let Some(last_us) = self.last_us.replace(time_us) else { return Step::First };
        let expected_us = self.expected_us(periods);
        let off_us = i64::from(time_us.wrapping_sub(last_us).wrapping_sub(expected_us as u32) as i32);
        if off_us == 0 {
            Step::Periods(periods)
        } else if off_us.abs() > self.slack_us(periods) || off_us <= -expected_us {
            Step::Jump
        } else {
            Step::Time(Span::us(expected_us + off_us))
        }
    }

    /// The time of which only the low half came, `periods` of the grid after the last latch. `None`: no
    /// clock that ran on shows this.
    pub(super) fn completed_us(&self, low_half: u16, periods: u32) -> Option<u32> {
        let Some(last_us) = self.last_us else { return Some(u32::from(low_half)) };
        let expected_us = last_us.wrapping_add(self.expected_us(periods) as u32);
        let off_us = low_half.wrapping_sub(expected_us as u16) as i16;
        let has_run_on = i64::from(off_us).abs() <= self.slack_us(periods);
        has_run_on.then_some(expected_us.wrapping_add_signed(i32::from(off_us)))
    }

    fn expected_us(&self, periods: u32) -> i64 {
        self.period_us * i64::from(periods)
    }

    fn slack_us(&self, periods: u32) -> i64 {
        2 * self.period_us + self.expected_us(periods) / DRIFT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(last_us: u32) -> BoardClock {
        BoardClock { last_us: Some(last_us), ..BoardClock::new(Span::us(500)) }
    }

    #[test]
    fn the_grid_is_exact_and_what_is_off_it_is_told() {
        assert_eq!(BoardClock::new(Span::us(500)).latch(7, 1), Step::First);
        assert_eq!(clock(1_000).latch(1_500, 1), Step::Periods(1));
        assert_eq!(clock(u32::MAX - 99).latch(1_400, 3), Step::Periods(3), "across the wrap");
        assert_eq!(clock(1_000).latch(1_530, 1), Step::Time(Span::us(530)));
        assert_eq!(clock(1_000).latch(1_020, 1), Step::Time(Span::us(20)), "the first SYNC was late");
        assert_eq!(clock(1_000).latch(2_501, 1), Step::Jump);
        assert_eq!(clock(1_000).latch(12, 1), Step::Jump, "the board began again");
        for time_us in [1_000, 999, 501] {
            assert_eq!(clock(1_000).latch(time_us, 1), Step::Jump, "no clock stands or runs backwards");
        }
        assert_eq!(clock(0).latch(500_000_400, 1_000_000), Step::Time(Span::us(500_000_400)), "drift");
    }

    #[test]
    fn a_time_that_came_short_is_completed_to_the_nearest() {
        assert_eq!(BoardClock::new(Span::us(500)).completed_us(9, 1), Some(9));
        for time_us in [70_500_u32, 70_490, 131_072, 65_535, 65_536] {
            let before = clock(time_us.wrapping_sub(500));
            assert_eq!(before.completed_us(time_us as u16, 1), Some(time_us));
        }
        assert_eq!(clock(u32::MAX).completed_us(499, 1), Some(499));
    }

    #[test]
    fn a_time_that_came_short_and_is_256_periods_old_does_not_fit() {
        for period_us in [250, 500, 1_000, 2_000] {
            let now_us = 300_000_u32;
            let clock = BoardClock {
                last_us: Some(now_us - period_us),
                ..BoardClock::new(Span::us(i64::from(period_us)))
            };
            for off_us in [-999, 0, 999].map(|thousandths| thousandths * period_us as i32 / 1_000) {
                let time_us = now_us.wrapping_add_signed(off_us);
                assert_eq!(
                    clock.completed_us(time_us as u16, 1),
                    Some(time_us),
                    "{period_us} us, {off_us} us"
                );
                let old_us = time_us.wrapping_sub(256 * period_us);
                assert_eq!(clock.completed_us(old_us as u16, 1), None, "{period_us} us, {off_us} us");
            }
        }
    }
}
