//! Whether a board is heard, and whether what it says is new: judges each feedback frame against
//! the cycle that waits for it, follows the heartbeat, and counts what was wrong.
//!
//! A frame is fresh if it answers this cycle's SYNC and its sequence is not that of the last fresh
//! one. Ages are in cycles of the grid: skipped periods age a sample like lost frames do. When an
//! age becomes a fault is for `rt/cycle` to say.
//! Invariant: of all frames of one board at most one is fresh in a cycle, and never the same twice.

use crate::base::record::LinkCounts;
use crate::base::sample::RawFeedback;
use crate::base::time::{Moment, Span};
use crate::rt::wire::state::Heartbeat;

/// What a feedback frame is to the cycle that received it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Judgement {
    /// New; the last fresh one was so many periods ago (1: none lost), or this is the first.
    Fresh { periods: Option<u32> },
    /// Not to be used.
    Unusable,
}

/// Life signs of one board.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Liveness {
    pub(super) counts: LinkCounts,
    /// Cycle and sequence of the last fresh feedback.
    last: Option<(u64, u8)>,
    /// First cycle that waited for this board.
    waits_since: Option<u64>,
    heard: Option<Moment>,
    /// What the last heartbeat said.
    beat: Option<Heartbeat>,
}

impl Liveness {
    /// A cycle begins to wait for this board.
    pub(super) fn begin(&mut self, cycle: u64, until: Moment) {
        self.waits_since.get_or_insert(cycle);
        self.heard.get_or_insert(until);
    }

    /// Judges a feedback frame that came during `cycle`.
    pub(super) fn judge(&mut self, raw: &RawFeedback, cycle: u64) -> Judgement {
        // After exactly 256 lost frames the sequence is the old one again: that costs one more
        // cycle, and silence of that length is a fault anyway.
        if self.last.is_some_and(|(_, sequence)| sequence == raw.sequence) {
            count(&mut self.counts.repeated, true);
            return Judgement::Unusable;
        }
        let is_fresh_already = self.last.is_some_and(|(fresh, _)| fresh == cycle);
        if raw.answers_cycle != cycle as u16 || is_fresh_already {
            count(&mut self.counts.late, true);
            return Judgement::Unusable;
        }
        Judgement::Fresh { periods: self.accept(raw, cycle) }
    }

    /// Takes a feedback that is known to be new; the last one was so many periods ago.
    pub(super) fn accept(&mut self, raw: &RawFeedback, cycle: u64) -> Option<u32> {
        count(&mut self.counts.fresh, true);
        let before = self.last.replace((cycle, raw.sequence));
        before.map(|(fresh, _)| periods_between(fresh, cycle))
    }

    /// The last cycle with fresh feedback.
    pub(super) fn last_fresh(&self) -> Option<u64> {
        self.last.map(|(fresh, _)| fresh)
    }

    /// Cycles since the last fresh feedback, or since the first one that waited for it.
    pub(super) fn age_cycles(&self, cycle: u64) -> u32 {
        let since = self.last.map(|(fresh, _)| fresh).or(self.waits_since);
        since.map_or(0, |since| periods_between(since, cycle))
    }

    /// Takes a heartbeat; whether it shows that the board restarted.
    pub(super) fn heartbeat(&mut self, heartbeat: Heartbeat, at: Moment) -> bool {
        count(&mut self.counts.heartbeats, true);
        self.heard = Some(at);
        // The boot-up message may be lost: the next heartbeat still tells by its count. The count starts
        // again with the power; then the seconds since boot have gone back.
        let is_changed = self.beat.replace(heartbeat).is_some_and(|before| {
            heartbeat.reset_count != before.reset_count || heartbeat.uptime_s < before.uptime_s
        });
        let is_reset = heartbeat.state == Heartbeat::BOOT_UP || is_changed;
        count(&mut self.counts.resets, is_reset);
        is_reset
    }

    /// The board restarted, as its clock shows: what its next heartbeat counts is no second event.
    pub(super) fn restarted(&mut self) {
        count(&mut self.counts.resets, true);
        self.beat = None;
    }

    /// Time since the last heartbeat, or since the first cycle.
    pub(super) fn heartbeat_age(&self, now: Moment) -> Span {
        self.heard.map_or(Span::ZERO, |heard| now - heard)
    }

    /// What was heard before the cycle started is no news in it.
    pub(super) fn start(&mut self) {
        *self = Self { beat: self.beat, ..Self::default() };
    }
}

/// Counts on where it is so; counters wrap, at 2 kHz after 24 days.
pub(super) const fn count(counter: &mut u32, is_so: bool) {
    *counter = counter.wrapping_add(is_so as u32);
}

/// Periods of the grid from one cycle to another.
pub(super) fn periods_between(earlier: u64, later: u64) -> u32 {
    u32::try_from(later.saturating_sub(earlier)).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feedback(answers_cycle: u16, sequence: u8) -> RawFeedback {
        RawFeedback { answers_cycle, sequence, ..RawFeedback::default() }
    }

    #[test]
    fn only_a_new_answer_to_this_cycle_is_fresh() {
        let mut liveness = Liveness::default();
        assert_eq!(liveness.judge(&feedback(10, 1), 10), Judgement::Fresh { periods: None });
        assert_eq!(liveness.judge(&feedback(10, 1), 10), Judgement::Unusable, "the same frame again");
        assert_eq!(liveness.judge(&feedback(10, 2), 10), Judgement::Unusable, "a second answer");
        assert_eq!(
            liveness.judge(&feedback(10, 2), 11),
            Judgement::Unusable,
            "an answer to the cycle before"
        );
        assert_eq!(liveness.judge(&feedback(11, 1), 11), Judgement::Unusable, "a frozen sequence");
        assert_eq!(liveness.judge(&feedback(13, 3), 13), Judgement::Fresh { periods: Some(3) });
        let LinkCounts { fresh, late, repeated, .. } = liveness.counts;
        assert_eq!((fresh, late, repeated), (2, 2, 2));
    }

    #[test]
    fn the_answer_holds_the_low_half_of_the_cycle() {
        let mut liveness = Liveness::default();
        assert_eq!(liveness.judge(&feedback(0x2345, 0), 0xF_2345), Judgement::Fresh { periods: None });
    }

    #[test]
    fn ages_count_periods_of_the_grid() {
        let mut liveness = Liveness::default();
        liveness.begin(100, Moment::ZERO);
        assert_eq!(liveness.age_cycles(107), 7, "never heard: since the first wait");
        liveness.judge(&feedback(110, 0), 110);
        assert_eq!((liveness.age_cycles(110), liveness.age_cycles(150)), (0, 40));
    }

    #[test]
    fn a_restart_is_seen_once_with_or_without_its_boot_up_message() {
        let beat = |state, reset_count| Heartbeat { state, reset_count, uptime_s: 0 };
        let mut liveness = Liveness::default();
        let mut restarted = |beat| liveness.heartbeat(beat, Moment::ZERO);
        assert!(!restarted(beat(Heartbeat::OPERATIONAL, 4)));
        assert!(restarted(beat(Heartbeat::BOOT_UP, 5)));
        assert!(!restarted(beat(Heartbeat::OPERATIONAL, 5)));
        assert!(restarted(beat(Heartbeat::OPERATIONAL, 6)), "the boot-up message was lost");
    }

    #[test]
    fn a_board_that_counts_from_zero_again_has_restarted() {
        let beat = |state, uptime_s| Heartbeat { state, reset_count: 0, uptime_s };
        let mut liveness = Liveness::default();
        let mut restarted = |beat| liveness.heartbeat(beat, Moment::ZERO);
        assert!(!restarted(beat(Heartbeat::OPERATIONAL, 0)));
        assert!(restarted(beat(Heartbeat::BOOT_UP, 0)), "in the same second of its life");
        assert!(!restarted(beat(Heartbeat::OPERATIONAL, 0)));
        assert!(!restarted(beat(Heartbeat::OPERATIONAL, u16::MAX)));
        assert!(!restarted(beat(Heartbeat::OPERATIONAL, u16::MAX)), "the seconds stay at their maximum");
        assert!(restarted(beat(Heartbeat::OPERATIONAL, 0)), "the boot-up message was lost");
    }

    #[test]
    fn a_heartbeat_ages_from_when_it_came() {
        let mut liveness = Liveness::default();
        liveness.begin(0, Moment::ns(100));
        assert_eq!(
            liveness.heartbeat_age(Moment::ns(150)),
            Span::ns(50),
            "never heard: since the first wait"
        );
        liveness.heartbeat(Heartbeat::default(), Moment::ns(200));
        assert_eq!(liveness.heartbeat_age(Moment::ns(250)), Span::ns(50));
    }
}
