//! A repeat: rows that were commanded like others.
//!
//! Invariant: what was measured takes no part.

use std::ops::Range;

use super::{Run, span};
use crate::base::axis::AxisId;

/// Two passes of a command are the same within this share of its span.
pub(super) const SAME_SHARE: f64 = 2e-4;
/// What was different before a repeat fades for so long, and it must then go on for so long to tell the noise, s.
pub(super) const FADE_S: f64 = 1.0;
pub(super) const REPEAT_MIN_S: f64 = 0.5;
/// Where a run goes on for more than this share of it after its last repeat, that is no run-out.
const RUN_OUT_SHARE: f64 = 0.2;

/// Rows of a run that were commanded like rows of it, or of another run, before: `later = earlier + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repeat {
    /// What comes again.
    pub what: What,
    /// Index of the run of the earlier pass, and of the later.
    pub runs: [usize; 2],
    /// Distance in rows; not whole for most laps.
    pub shift: f64,
    /// First and last row of the earlier pass that has a later one.
    pub rows: [usize; 2],
}

/// What comes again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// A run, or its laps or motions.
    Run,
    /// A motion of a run in another.
    Motion,
    /// What one axis does, as circles the other way around are the same for one of two, whatever the others do.
    Axis(AxisId),
    /// The opposite of it: what is the same both ways counts as noise then.
    Opposite(AxisId),
}

impl Repeat {
    /// Whether it says anything of an axis.
    pub(in crate::offline::gap) fn is_of(&self, id: AxisId) -> bool {
        match self.what {
            What::Run | What::Motion => true,
            What::Axis(of) | What::Opposite(of) => of == id,
        }
    }

    /// What the later pass is multiplied with to be as the earlier.
    pub(in crate::offline::gap) fn sign(&self) -> f64 {
        if matches!(self.what, What::Opposite(_)) { -1.0 } else { 1.0 }
    }
}

/// How many rows a run has until its command only repeats: its first lap with the start of the second; none where it is that of a
/// run before it.
pub fn first_pass(run: usize, rows: usize, repeats: &[Repeat]) -> usize {
    let of = |repeat: &Repeat| match repeat.runs {
        [first, second] if first < run && second == run => Some(0),
        [first, second] if first == run && second == run => {
            let shift = repeat.shift.ceil() as usize;
            let is_over = repeat.rows[1] + shift >= ((1.0 - RUN_OUT_SHARE) * rows as f64) as usize;
            is_over.then_some(repeat.rows[0] + shift)
        }
        _ => None,
    };
    repeats.iter().filter(|repeat| repeat.what == What::Run).filter_map(of).min().unwrap_or(rows).min(rows)
}

/// The longest way of an axis in some rows, m.
pub(super) fn span_of(run: &Run, rows: Range<usize>) -> f64 {
    run.axes.values().map(|axis| span(&axis.setpoint_m[rows.clone()])).fold(0.0, f64::max)
}
