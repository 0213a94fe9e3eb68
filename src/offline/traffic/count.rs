//! Cycles that a host ran, by the count that its commands carry.
//!
//! The numbers of SYNC jump where the host skipped periods, and where a text lacks cycles. Commands count the
//! cycles that were run, from 1 at the beginning of a run and modulo 256, and so tell one from the other.
//! Invariant: periods skipped and cycles missing together are the jumps.

/// Cycles of a run so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Count {
    /// Periods that the host skipped.
    pub(super) skipped: u64,
    /// Cycles that were run and not seen.
    pub(super) missing: u64,
    /// Times that the commands did not count on.
    pub(super) breaks: u64,
    /// Cycles run, with the present one.
    run: u64,
    last: Option<u64>,
    /// How far the commands' count is ahead.
    offset: Option<u8>,
}

impl Count {
    /// The next cycle that was seen, with the count of its commands; how many periods were skipped so far.
    pub(super) fn overruns(&mut self, cycle: u64, sequence: Option<u8>) -> u64 {
        let expected = match self.last.replace(cycle) {
            None => {
                // Where a run is seen from its beginning, the count has not yet come around.
                let counted = sequence.map(u64::from).filter(|_| cycle < 255);
                self.run = counted.filter(|run| (1..=cycle + 1).contains(run)).unwrap_or(cycle + 1);
                self.skipped = cycle + 1 - self.run;
                self.run
            }
            Some(last) => {
                let jump = cycle - last - 1;
                let missing = sequence.map_or(0, |sequence| self.missing_in(jump, sequence));
                self.missing += missing;
                self.skipped += jump - missing;
                self.run += 1 + missing;
                self.run
            }
        };
        if let (Some(sequence), None) = (sequence, self.offset) {
            self.offset = Some(sequence.wrapping_sub(expected as u8));
        }
        self.skipped
    }

    /// How many of a jump's cycles were run.
    fn missing_in(&mut self, jump: u64, sequence: u8) -> u64 {
        let Some(offset) = self.offset else { return 0 };
        let next = (self.run + 1) as u8;
        let ahead = u64::from(sequence.wrapping_sub(offset).wrapping_sub(next));
        if ahead > jump {
            self.breaks += 1;
            self.offset = None;
            return 0;
        }
        // No host skips as many periods as the count takes to come around: it was a text that paused.
        ahead + (jump - ahead) / 256 * 256
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(seen: &[(u64, Option<u8>)]) -> (u64, u64, u64) {
        let mut count = Count::default();
        seen.iter().for_each(|(cycle, sequence)| {
            count.overruns(*cycle, *sequence);
        });
        (count.skipped, count.missing, count.breaks)
    }

    #[test]
    fn what_was_skipped_is_told_from_what_is_missing() {
        assert_eq!(count(&[(0, Some(1)), (1, Some(2)), (2, Some(3))]), (0, 0, 0));
        assert_eq!(count(&[(0, Some(1)), (4, Some(2)), (5, Some(3))]), (3, 0, 0), "skipped");
        assert_eq!(count(&[(0, Some(1)), (4, Some(5)), (5, Some(6))]), (0, 3, 0), "missing");
        assert_eq!(count(&[(0, Some(1)), (4, Some(3)), (5, Some(4))]), (2, 1, 0), "both");
        assert_eq!(count(&[(3, Some(1)), (4, Some(2))]), (3, 0, 0), "skipped before the first");
        assert_eq!(
            count(&[(700, Some(9)), (701, Some(10)), (704, Some(13))]),
            (0, 2, 0),
            "begun within a run"
        );
        assert_eq!(count(&[(0, Some(1)), (1_000, Some(233))]), (0, 999, 0), "a pause");
        assert_eq!(count(&[(0, Some(1)), (1, None), (4, Some(3))]), (2, 0, 0), "a cycle without commands");
    }

    #[test]
    fn a_count_that_does_not_go_on_is_told_once() {
        assert_eq!(count(&[(0, Some(1)), (1, Some(7)), (2, Some(8)), (3, Some(9))]), (0, 0, 1));
        assert_eq!(count(&[(0, Some(1)), (1, Some(1)), (2, Some(2))]), (0, 0, 1), "another run");
    }
}
