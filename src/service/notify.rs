//! What the supervisor, as systemd, is told, by the protocol of `sd_notify(3)`: ready, how it goes, stopping, and
//! a sign of life that it may rely on.
//!
//! Without a supervisor nobody listens, and nothing is sent.
//! Invariant: a sign of life is sent only for a cycle that runs as fast as it is due.

use std::time::Duration;

use sd_notify::NotifyState;
use tracing::warn;

use crate::base::time::Span;

/// Share of the due cycles below which the cycle counts as slow.
const ENOUGH: f64 = 0.9;

/// How the cycle went since it was last looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pulse {
    /// Not one cycle.
    Stopped,
    /// Fewer than enough.
    Slow,
    /// As due.
    Steady,
}

impl Pulse {
    /// Judges the cycles run in a time.
    pub(super) fn of(cycles: u64, elapsed: Duration, period: Span) -> Self {
        if cycles == 0 {
            Self::Stopped
        } else if (cycles as f64) < ENOUGH * due(elapsed, period) {
            Self::Slow
        } else {
            Self::Steady
        }
    }
}

/// Cycles due in a time.
pub(super) fn due(elapsed: Duration, period: Span) -> f64 {
    elapsed.as_secs_f64() / period.as_s()
}

/// The supervisor, if there is one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Supervisor {
    /// Longest silence it bears; `None`: it does not listen for signs of life.
    patience: Option<Duration>,
}

impl Supervisor {
    /// As the environment says.
    pub(super) fn from_environment() -> Self {
        Self { patience: sd_notify::watchdog_enabled().filter(|patience| !patience.is_zero()) }
    }

    /// How often to look at the cycle: at least twice as often as a sign of life is wanted.
    pub(super) fn look_every(&self, at_most: Duration) -> Duration {
        self.patience.map_or(at_most, |patience| at_most.min(patience / 2))
    }

    /// The cycle runs.
    pub(super) fn ready(&self) {
        tell(&[NotifyState::Ready]);
    }

    /// How it goes, for people; and a sign of life, if there is one.
    pub(super) fn beat(&self, pulse: Pulse, status: &str) {
        let status = NotifyState::Status(status);
        match pulse {
            Pulse::Steady if self.patience.is_some() => tell(&[status, NotifyState::Watchdog]),
            Pulse::Steady | Pulse::Slow | Pulse::Stopped => tell(&[status]),
        }
    }

    /// The axes come to rest, and then it ends.
    pub(super) fn stopping(&self) {
        tell(&[NotifyState::Stopping, NotifyState::Status("coming to rest")]);
    }
}

fn tell(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        warn!("the supervisor cannot be told {states:?}: {error}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_cycle_that_keeps_its_rate_is_alive() {
        let second = |cycles| Pulse::of(cycles, Duration::from_secs(1), Span::us(500));
        assert_eq!(second(2_000), Pulse::Steady);
        assert_eq!(second(1_800), Pulse::Steady);
        assert_eq!(second(1_799), Pulse::Slow);
        assert_eq!(second(1), Pulse::Slow);
        assert_eq!(second(0), Pulse::Stopped);
    }

    #[test]
    fn what_is_due_follows_from_the_time_that_passed() {
        let period = Span::us(500);
        assert_eq!(Pulse::of(1_800, Duration::from_millis(1_001), period), Pulse::Slow, "looked late");
        assert_eq!(Pulse::of(180, Duration::from_millis(100), period), Pulse::Steady, "looked often");
        assert_eq!(Pulse::of(0, Duration::ZERO, period), Pulse::Stopped, "no time is no excuse");
    }

    #[test]
    fn the_cycle_is_looked_at_twice_in_the_time_of_silence() {
        let second = Duration::from_secs(1);
        let every = |patience| Supervisor { patience }.look_every(second);
        assert_eq!(every(None), second);
        assert_eq!(every(Some(5 * second)), second);
        assert_eq!(every(Some(second)), second / 2);
    }
}
