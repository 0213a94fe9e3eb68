//! The circles of a whole test: cut from its trace by the numbers of their motions, and judged together.
//!
//! Invariant: a straight move leads to each circle, so the circles are the motions 2, 4, ...

use thiserror::Error;

use super::{CircleError, CircularTest, Run, analyse};
use crate::base::motion::{Circle, Direction};
use crate::offline::trace::{Trace, TraceError};

/// Why a test cannot be judged.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum TestError {
    /// A circle of it is missing.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// A circle of it is none.
    #[error(transparent)]
    Circle(#[from] CircleError),
}

/// Number of a circle among the motions, by its place among the circles.
pub const fn number(place: usize) -> u32 {
    2 * (place as u32 + 1)
}

/// Judges the circles of a test, beside the same test without friction where there is one.
///
/// # Errors
/// When a circle is missing in a trace or cannot be judged.
pub fn analyse_test(
    circle: &Circle,
    directions: &[Direction],
    trace: &Trace,
    friction_free: Option<&Trace>,
) -> Result<CircularTest, TestError> {
    let stretches = |trace: &Trace| -> Result<Vec<Trace>, TraceError> {
        (0..directions.len()).map(|place| trace.stretch(number(place))).collect()
    };
    let paths = stretches(trace)?;
    let twins = friction_free.map(stretches).transpose()?;
    let runs: Vec<Run<'_>> = directions
        .iter()
        .enumerate()
        .map(|(place, direction)| Run {
            nominal: Circle { direction: *direction, ..*circle },
            trace: &paths[place],
            friction_free: twins.as_ref().map(|twins| &twins[place]),
        })
        .collect();
    Ok(analyse(&runs)?)
}
