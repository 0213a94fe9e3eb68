//! Is this machine fit for real time? A list of checks, each held or missing with what mends it, and the
//! verdict over it: may an axis be armed?
//!
//! ```text
//!   rt/thread: what was obtained ─┐
//!   /proc, /sys (system.rs) ──────┴─► checks.rs ─► Vec<Check> ─► verdict ─► arm | refuse
//! ```
//!
//! Run at each start and by `quadrantd --check`. On a bus with a machine at its end a required check
//! that is missing refuses to arm; on a simulated one it is only said.
//! Invariant: nothing is taken for held that was not read back from the system.

mod checks;
mod system;

use std::fmt;

use serde::Serialize;

pub use checks::{Obtained, Wanted, checks};
pub use system::System;

/// One thing that real time needs or likes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Check {
    /// What it is about.
    pub name: &'static str,
    /// Whether an axis of a real machine is not armed without it.
    pub is_required: bool,
    /// What was found.
    pub found: String,
    /// Whether that is enough.
    #[serde(flatten)]
    pub state: State,
}

/// Whether what was found is enough.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "state", rename_all = "kebab-case")]
pub enum State {
    /// It is.
    Held,
    /// It is not.
    Missing {
        /// What to do.
        mend: String,
    },
}

impl Check {
    /// Whether it stands in the way of arming a real machine.
    pub fn is_missing(&self) -> bool {
        self.is_required && self.state != State::Held
    }
}

/// One line, with a second one for what to do.
impl fmt::Display for Check {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, found, .. } = self;
        match &self.state {
            State::Held => write!(out, "held     {name:<14} {found}"),
            State::Missing { mend } => {
                let word = if self.is_required { "MISSING" } else { "absent" };
                write!(out, "{word:<8} {name:<14} {found}\n{:24}to mend: {mend}", "")
            }
        }
    }
}

/// What follows from the checks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict<'c> {
    /// Axes may be armed, although these checks are missing: nothing real moves, or a person wants it so.
    Arm {
        /// Missing, and borne.
        despite: Vec<&'c Check>,
    },
    /// A real machine must not be moved like this.
    Refuse {
        /// What is in the way.
        missing: Vec<&'c Check>,
    },
}

/// Whether axes may be armed. `bus_is_real`: at the other end of the bus may be a machine.
/// `allow_jitter`: a person at a desk bears what is missing.
pub fn verdict(checks: &[Check], bus_is_real: bool, allow_jitter: bool) -> Verdict<'_> {
    let missing: Vec<&Check> = checks.iter().filter(|check| check.is_missing()).collect();
    if missing.is_empty() || !bus_is_real || allow_jitter {
        Verdict::Arm { despite: missing }
    } else {
        Verdict::Refuse { missing }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(is_required: bool, is_held: bool) -> Check {
        let state = if is_held { State::Held } else { State::Missing { mend: "lock it".to_owned() } };
        Check { name: "memory", is_required, found: "0 kB locked".to_owned(), state }
    }

    #[test]
    fn a_real_machine_is_armed_only_with_all_that_is_required() {
        let [held, missing, absent] = [check(true, true), check(true, false), check(false, false)];
        let good = [held.clone(), absent.clone()];
        let bad = [held, missing.clone(), absent, missing.clone()];
        let armed = Verdict::Arm { despite: vec![] };
        for (bus_is_real, allow_jitter) in [(true, false), (true, true), (false, false), (false, true)] {
            assert_eq!(verdict(&good, bus_is_real, allow_jitter), armed);
        }
        let missing = vec![&missing, &missing];
        assert_eq!(verdict(&bad, true, false), Verdict::Refuse { missing: missing.clone() });
        for (bus_is_real, allow_jitter) in [(true, true), (false, false), (false, true)] {
            assert_eq!(verdict(&bad, bus_is_real, allow_jitter), Verdict::Arm { despite: missing.clone() });
        }
    }

    #[test]
    fn a_check_is_read_by_people_and_programs() {
        let missing = check(true, false);
        assert_eq!(
            missing.to_string(),
            "MISSING  memory         0 kB locked\n                        to mend: lock it"
        );
        let json = r#"{"name":"memory","is_required":true,"found":"0 kB locked","state":"missing","mend":"lock it"}"#;
        assert_eq!(serde_json::to_string(&missing).unwrap(), json);
        assert!(check(false, false).to_string().starts_with("absent   "));
        assert!(check(true, true).to_string().starts_with("held     "));
    }
}
