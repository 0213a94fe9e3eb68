//! Why data are no runs.
//!
//! Invariant: what is refused names its run, axis and column, and what to do where that is known.

use thiserror::Error;

/// Shortest run that is looked at, s.
pub(super) const SHORTEST_S: f64 = 1.0;
/// Share of rows that may be filled in or dropped.
pub(super) const REPAIRED_SHARE_MAX: f64 = 0.05;

/// Why a run cannot be used.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RunError {
    /// Data of another machine.
    #[error("{run}: axis {axis} is none of the machine's ({known})")]
    Axis {
        /// Which run.
        run: String,
        /// What it calls the axis.
        axis: String,
        /// What the machine has.
        known: String,
    },
    /// Nothing says where the axis should have been.
    #[error("{run}, axis {axis}: no setpoint; the model is driven by it")]
    NoSetpoint {
        /// Which run.
        run: String,
        /// Which axis.
        axis: String,
    },
    /// Another rate than that of the cycle.
    #[error(
        "{run}: rows are {found_us:.1} us apart, the machine's cycle takes {wanted_us:.1} us; log every cycle, or one in two, three or four"
    )]
    Period {
        /// Which run.
        run: String,
        /// Distance of its rows.
        found_us: f64,
        /// Period of the machine.
        wanted_us: f64,
    },
    /// Too much is missing or repeated.
    #[error("{run}: {count} of {rows} rows are {what}; more than {} % is not repaired", 100.0 * REPAIRED_SHARE_MAX)]
    Broken {
        /// Which run.
        run: String,
        /// How many rows.
        count: usize,
        /// Of how many.
        rows: usize,
        /// What is wrong with them.
        what: &'static str,
    },
    /// It ends before it tells anything.
    #[error("{run}: {length_s:.2} s in one piece, at least {SHORTEST_S} s are needed")]
    TooShort {
        /// Which run.
        run: String,
        /// Its longest piece.
        length_s: f64,
    },
    /// Nothing was asked to move.
    #[error("{run}: no axis was asked to move")]
    Standing {
        /// Which run.
        run: String,
    },
    /// A channel that shows nothing.
    #[error(
        "{run}, axis {axis}: {channel} stands still from {from_s:.3} s to {to_s:.3} s while the setpoint goes {way_mm:.1} mm: frozen"
    )]
    Frozen {
        /// Which run.
        run: String,
        /// Which axis.
        axis: String,
        /// Which column.
        channel: &'static str,
        /// From when.
        from_s: f64,
        /// To when.
        to_s: f64,
        /// How far the setpoint went.
        way_mm: f64,
    },
    /// A unit or a sense that cannot be.
    #[error("{run}, axis {axis}: {channel} moves {slope:.4} times as far as the setpoint; {hint}")]
    Unit {
        /// Which run.
        run: String,
        /// Which axis.
        axis: String,
        /// Which column.
        channel: &'static str,
        /// Its slope over the setpoint.
        slope: f64,
        /// What it may be.
        hint: &'static str,
    },
}
