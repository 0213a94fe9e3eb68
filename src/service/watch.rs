//! Looks at the cycle from outside, once a second: does it advance, what was lost?
//!
//! Invariant: only reads counters; a stuck cycle is said aloud, never papered over.

use std::sync::atomic::Ordering;
use std::time::Duration;

use tracing::{debug, error, warn};

use super::Shared;
use crate::base::time::Span;

/// How often.
const EVERY: Duration = Duration::from_secs(1);
/// Share of the due cycles below which the cycle counts as slow.
const ENOUGH: f64 = 0.9;

/// Watch until the cycle's thread has ended by itself, which it should not.
pub(super) async fn run(shared: &Shared, period: Span, is_over: impl Fn() -> bool) {
    let due = EVERY.as_secs_f64() / period.as_s();
    let mut ticks = tokio::time::interval(EVERY);
    ticks.tick().await;
    let (mut cycles_seen, mut lost_seen) = (shared.cycles.load(Ordering::Relaxed), 0);
    let mut overruns_seen = 0;
    loop {
        ticks.tick().await;
        if is_over() {
            error!("the cycle has ended by itself");
            return;
        }
        let (cycles, lost) = (shared.cycles.load(Ordering::Relaxed), shared.lost.load(Ordering::Relaxed));
        let advanced = cycles - cycles_seen;
        if advanced == 0 {
            error!(cycle = cycles, "the cycle has not advanced for {} s", EVERY.as_secs());
        } else if (advanced as f64) < ENOUGH * due {
            warn!("{advanced} cycles in {} s, due were {due:.0}", EVERY.as_secs());
        } else {
            debug!(cycle = cycles, "running");
        }
        if lost > lost_seen {
            warn!("{} records lost", lost - lost_seen);
        }
        let overruns = shared.overruns.load(Ordering::Relaxed);
        if overruns > overruns_seen {
            warn!("{} periods skipped", overruns - overruns_seen);
        }
        (cycles_seen, lost_seen, overruns_seen) = (cycles, lost, overruns);
    }
}
