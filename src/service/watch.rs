//! Looks at the cycle from outside: does it advance, what was lost? Tells people and the supervisor.
//!
//! Invariant: only reads counters; a stuck cycle is said aloud, never papered over.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tokio::time::{Instant, MissedTickBehavior};
use tracing::{debug, error, warn};

use super::Shared;
use super::notify::{Pulse, Supervisor, due};
use super::status::StatusFile;
use crate::base::time::Span;

/// How often, unless the supervisor wants a sign of life more often.
const EVERY: Duration = Duration::from_secs(1);
/// How often it is asked whether the first cycle has run.
const FIRST_EVERY: Duration = Duration::from_millis(5);
/// How often it is asked whether somebody wishes to stop: the cycle hears of it by itself.
const STOP_EVERY: Duration = Duration::from_millis(50);

/// What was seen at one look.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    cycles: u64,
    lost: u64,
    overruns: u64,
}

impl Seen {
    fn now(shared: &Shared) -> Self {
        Self {
            cycles: shared.cycles.load(Ordering::Relaxed),
            lost: shared.lost.load(Ordering::Relaxed),
            overruns: shared.overruns.load(Ordering::Relaxed),
        }
    }
}

/// Until somebody wishes to stop.
pub(super) async fn until(stop_wish: &AtomicBool) {
    while !stop_wish.load(Ordering::Relaxed) {
        tokio::time::sleep(STOP_EVERY).await;
    }
}

/// Watch until the cycle's thread has ended by itself, which it should not.
pub(super) async fn run(
    shared: &Shared,
    period: Span,
    supervisor: &Supervisor,
    file: &mut StatusFile,
    is_over: impl Fn() -> bool,
) {
    while shared.cycles.load(Ordering::Relaxed) == 0 {
        if is_over() {
            error!("the cycle has ended before it ran");
            return;
        }
        tokio::time::sleep(FIRST_EVERY).await;
    }
    supervisor.ready();
    let mut ticks = tokio::time::interval(supervisor.look_every(EVERY));
    // A look that comes late is no reason for the next to come early.
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    ticks.tick().await;
    let (mut before, mut looked) = (Seen::now(shared), Instant::now());
    loop {
        ticks.tick().await;
        file.update();
        if is_over() {
            error!("the cycle has ended by itself");
            return;
        }
        let (seen, elapsed) = (Seen::now(shared), looked.elapsed());
        looked = Instant::now();
        let advanced = seen.cycles - before.cycles;
        let pulse = Pulse::of(advanced, elapsed, period);
        let line = file.faults() + &status(advanced, elapsed, &seen, shared);
        supervisor.beat(pulse, &line);
        match pulse {
            Pulse::Stopped => {
                error!(cycle = seen.cycles, "the cycle has not advanced for {:.1} s", elapsed.as_secs_f64());
            }
            Pulse::Slow => warn!(
                "{advanced} cycles in {:.1} s, due were {:.0}",
                elapsed.as_secs_f64(),
                due(elapsed, period)
            ),
            Pulse::Steady => debug!(cycle = seen.cycles, "running"),
        }
        if seen.lost > before.lost {
            warn!("{} records lost", seen.lost - before.lost);
        }
        if seen.overruns > before.overruns {
            warn!("{} periods skipped", seen.overruns - before.overruns);
        }
        before = seen;
    }
}

/// One line for people, as `systemctl status` shows it.
fn status(advanced: u64, elapsed: Duration, seen: &Seen, shared: &Shared) -> String {
    let latest_us = shared.wake_error_ns_max.load(Ordering::Relaxed) as f64 * 1e-3;
    format!(
        "{:.0} cycles/s, latest wake-up {latest_us:.0} us, {} periods skipped, {} records lost",
        advanced as f64 / elapsed.as_secs_f64(),
        seen.overruns,
        seen.lost
    )
}
