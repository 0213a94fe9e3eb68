//! The end of a run. The order to let go of the current acts at a later SYNC, and an axis whose current was
//! taken away coasts: a run that ended with the order would leave both to nobody.
//!
//! Invariant: waits for every board that is heard, and for none longer than a stop may take.

use crate::base::sample::Freshness;
use crate::base::time::{Moment, Span};
use crate::rt::control::limits::Limits;
use crate::rt::drive::Observation;
use crate::rt::drive::state::DriveState;

/// Cycles in a row in which nothing moves: a motor that swings on its screw passes zero in fewer.
const STILL_CYCLES: u32 = 50;

/// Axes on their way to rest.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AtRest {
    /// Since when no axis wants its drive.
    without_current_since: Option<Moment>,
    still_for: u32,
    is_over: bool,
}

impl AtRest {
    /// A cycle: whether an axis wants its drive, and whether each has settled, as far as it is known. While one
    /// wants its drive nobody asks for the second.
    pub(super) fn see(
        &mut self,
        wants_drive: bool,
        settled: impl Iterator<Item = Option<bool>>,
        now: Moment,
        patience: Span,
    ) {
        if wants_drive {
            *self = Self::default();
            return;
        }
        let since = *self.without_current_since.get_or_insert(now);
        let (mut is_moving, mut is_unknown) = (false, false);
        settled.for_each(|settled| {
            is_moving |= settled == Some(false);
            is_unknown |= settled.is_none();
        });
        if is_moving {
            self.still_for = 0;
        } else if !is_unknown {
            self.still_for = self.still_for.saturating_add(1);
        }
        self.is_over = self.still_for >= STILL_CYCLES || now - since > patience;
    }

    /// Whether no axis has current or moves, or one would not settle in time.
    pub(super) const fn is_over(&self) -> bool {
        self.is_over
    }
}

/// Whether an axis has let go of its current and stands; `None` where its sample is lost. One that is not
/// heard any more is left to the watchdog of its board.
pub(super) fn has_settled(observation: &Observation, limits: &Limits, stale_cycles_max: u32) -> Option<bool> {
    let sample = &observation.sample;
    if sample.freshness == Freshness::Fresh {
        let has_let_go = observation.drive != Some(DriveState::OperationEnabled);
        return Some(has_let_go && limits.is_standing(sample.velocity));
    }
    (sample.age_cycles > stale_cycles_max).then_some(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE: Span = Span::ms(1_000);

    /// Cycles of a millisecond until it is over.
    fn cycles(wants_drive: impl Fn(i64) -> bool, has_settled: impl Fn(i64) -> Option<bool>) -> i64 {
        let mut at_rest = AtRest::default();
        let see = |at_rest: &mut AtRest, cycle: i64| {
            // The other axis stands all the while.
            let settled = [Some(true), has_settled(cycle)].into_iter();
            at_rest.see(wants_drive(cycle), settled, Moment::ZERO + Span::ms(cycle), PATIENCE);
            at_rest.is_over()
        };
        (0..10_000).find(|cycle| see(&mut at_rest, *cycle)).expect("it ends")
    }

    #[test]
    fn a_long_stop_is_waited_for_and_so_is_the_coasting_after_it() {
        assert_eq!(cycles(|cycle| cycle < 3_000, |_| Some(true)), 3_049);
        assert_eq!(cycles(|cycle| cycle < 3_000, |cycle| Some(cycle >= 3_500)), 3_549);
    }

    #[test]
    fn passing_zero_is_no_rest() {
        assert_eq!(cycles(|_| false, |cycle| Some(cycle % 40 > 0 || cycle > 200)), 250);
    }

    #[test]
    fn what_was_lost_tells_nothing() {
        assert_eq!(cycles(|_| false, |cycle| (cycle % 2 > 0).then_some(true)), 99);
    }

    #[test]
    fn who_would_not_settle_is_not_waited_for_for_ever() {
        assert_eq!(cycles(|cycle| cycle < 3_000, |_| Some(false)), 4_001);
    }
}
