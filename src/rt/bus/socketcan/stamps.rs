//! From the stamp the kernel puts on a frame, which is wall clock, to the monotonic clock.
//!
//! `at = monotonic_now - (wall_now - stamp)`. If the wall clock was set between stamp and now, that is wrong
//! by the step. What is known without a stamp bounds the error: a frame came before it was read, after
//! the frame ahead of it, and after the last moment at which nothing was waiting.
//! Invariant: no moment is in the future, and none is before an earlier frame's.

use crate::base::time::Moment;
use crate::rt::clock::Clocks;

/// Dates frames in the order in which they came.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stamps {
    earliest: Moment,
}

impl Stamps {
    /// Nothing came before this moment of the monotonic clock.
    pub(super) const fn since(earliest: Moment) -> Self {
        Self { earliest }
    }

    /// When a frame with this stamp came, on the monotonic clock; `now` was read after it came.
    pub(super) fn place(&mut self, stamp: Option<Moment>, now: Clocks) -> Moment {
        let stated = stamp.map_or(now.monotonic, |stamp| now.monotonic - (now.wall - stamp));
        self.earliest = stated.max(self.earliest).min(now.monotonic);
        self.earliest
    }

    /// All that had come by then was read.
    pub(super) fn nothing_before(&mut self, moment: Moment) {
        self.earliest = self.earliest.max(moment);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;

    /// The monotonic clock a second after boot, the wall clock in its own century.
    fn clocks(since: Span) -> Clocks {
        let wall = Moment::ns(1_800_000_000_000_000_000) + since;
        Clocks { wall, monotonic: Moment::ZERO + since }
    }

    #[test]
    fn a_stamp_is_as_old_on_both_clocks() {
        let mut stamps = Stamps::since(Moment::ZERO);
        let (now, came) = (clocks(Span::us(900)), clocks(Span::us(700)));
        assert_eq!(stamps.place(Some(came.wall), now), came.monotonic);
    }

    #[test]
    fn a_clock_that_was_set_cannot_move_a_frame_out_of_its_bounds() {
        let now = clocks(Span::ms(5));
        for step in [Span::s(3600.0), Span::s(-3600.0), Span::ms(1)] {
            let mut stamps = Stamps::since(Moment::ZERO);
            stamps.nothing_before(clocks(Span::ms(4)).monotonic);
            let at = stamps.place(Some(clocks(Span::us(4_500)).wall + step), now);
            assert!(at >= clocks(Span::ms(4)).monotonic && at <= now.monotonic, "{at:?} after {step:?}");
        }
    }

    #[test]
    fn frames_stay_in_order_and_without_a_stamp_they_came_now() {
        let mut stamps = Stamps::since(Moment::ZERO);
        let now = clocks(Span::ms(5));
        let first = stamps.place(Some(clocks(Span::us(4_800)).wall), now);
        assert_eq!(stamps.place(Some(clocks(Span::us(4_700)).wall), now), first);
        assert_eq!(stamps.place(None, now), now.monotonic);
        // Less than what is known already.
        stamps.nothing_before(Moment::ZERO);
        assert_eq!(stamps.place(Some(clocks(Span::ZERO).wall), now), now.monotonic);
    }
}
