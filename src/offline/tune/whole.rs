//! The check of what was found: the whole circular test, by the shipped cycle over frames with boards and plants
//! at the other end, in virtual time, beside its twin without friction.
//!
//! Invariant: what is stated as the protrusion of a machine was measured as `quadrant circle` measures it.

use std::f64::consts::FRAC_PI_4;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::window::Path;
use crate::base::axis::PerAxis;
use crate::base::fault::Fault;
use crate::base::motion::{Circle, Direction};
use crate::base::units::Position;
use crate::config::Machine;
use crate::config::machine::Gains;
use crate::config::plan::{CircleRequest, PlanError};
use crate::offline::circle::CircularTest;
use crate::offline::circle::motions::{TestError, analyse_test};
use crate::offline::simulated::{self, SimulatedError};
use crate::offline::trace::{Trace, Tracing};
use crate::rt::cycle::procedure::{CircleTest, Ending};

/// Why there is no circular test.
#[derive(Debug, thiserror::Error)]
pub enum WholeError {
    /// It cannot be made on this machine.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The machine cannot be simulated.
    #[error(transparent)]
    Simulated(#[from] SimulatedError),
    /// An axis was stopped.
    #[error("the simulated circle ended early, axis {axis}: {fault}; see {}", fault.page())]
    Faulted {
        /// Which axis.
        axis: String,
        /// By what.
        fault: Fault,
    },
    /// Somebody wished it to stop.
    #[error("interrupted in the check on the whole circle")]
    Interrupted,
    /// What was recorded is no circular test.
    #[error(transparent)]
    Test(#[from] TestError),
}

/// Both ways round.
pub const DIRECTIONS: [Direction; 2] = [Direction::Ccw, Direction::Cw];

/// The circle of a path, around where the axes stand, once.
pub const fn circle(path: &Path) -> Circle {
    Circle {
        centre_x: Position::ZERO,
        centre_y: Position::ZERO,
        radius: path.radius,
        feed: path.feed,
        direction: DIRECTIONS[0],
        start_angle_rad: FRAC_PI_4,
        revolutions: 1,
    }
}

/// The circular test of a machine with these gains on each of its axes, both ways round.
///
/// # Errors
/// When the test does not fit the machine or does not come to its end.
pub fn circular_test(
    machine: &Machine,
    gains: &PerAxis<Gains>,
    path: &Path,
    seed: u64,
    stop: &Arc<AtomicBool>,
) -> Result<CircularTest, WholeError> {
    let mut machine = machine.clone();
    for (id, axis) in machine.axes.iter_mut() {
        axis.control.gain_sets[0] = gains[id];
    }
    let circle = circle(path);
    let request =
        CircleRequest { gains: machine.gain_sets[0].clone(), circle, directions: DIRECTIONS.to_vec() };
    let test = machine.circle_test(&request)?;
    let twin = machine.clone().without_friction();
    let (trace, twin) = rayon::join(|| run(&machine, test, seed, stop), || run(&twin, test, seed, stop));
    Ok(analyse_test(&circle, &DIRECTIONS, &trace?, Some(&twin?))?)
}

fn run(machine: &Machine, test: CircleTest, seed: u64, stop: &Arc<AtomicBool>) -> Result<Trace, WholeError> {
    let mut tracing = Tracing::default();
    match simulated::run(machine, machine, test, seed, stop, &mut tracing)? {
        Ending::Complete => Ok(tracing.finish().map_err(TestError::from)?),
        Ending::Faulted(axis, fault) => {
            Err(WholeError::Faulted { axis: machine.axis_names()[axis.index()].clone(), fault })
        }
        Ending::Interrupted | Ending::Refused => Err(WholeError::Interrupted),
    }
}
