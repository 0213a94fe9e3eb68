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
use crate::base::input::Inputs;
use crate::base::motion::{Circle, Direction};
use crate::base::record::CycleRecord;
use crate::base::units::Position;
use crate::config::Machine;
use crate::config::machine::Gains;
use crate::config::plan::{CircleRequest, PlanError};
use crate::offline::circle::{self, CircleError, CircularTest, Run};
use crate::offline::trace::{Trace, TraceError};
use crate::rt::cycle::pace::Virtual;
use crate::rt::cycle::procedure::{CircleTest, Ending, Procedure};
use crate::rt::cycle::{Cycle, conduct};
use crate::rt::door::Records;
use crate::rt::drive::SettingsError;
use crate::rt::drive::commission::CommissionError;
use crate::sim::closed_loop::Wired;

/// Why there is no circular test.
#[derive(Debug, thiserror::Error)]
pub enum WholeError {
    /// It cannot be made on this machine.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The drives cannot be set up.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The boards are not what their sheet says.
    #[error(transparent)]
    Commission(#[from] CommissionError),
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
    /// The records are no trace.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// The trace is no circle.
    #[error(transparent)]
    Circle(#[from] CircleError),
}

/// Number of each circle among the motions: a straight move leads to it.
const MOTIONS: [u32; 2] = [2, 4];
const DIRECTIONS: [Direction; 2] = [Direction::Ccw, Direction::Cw];

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
    let circle = Circle {
        centre_x: Position::ZERO,
        centre_y: Position::ZERO,
        radius: path.radius,
        feed: path.feed,
        direction: DIRECTIONS[0],
        start_angle_rad: FRAC_PI_4,
        revolutions: 1,
    };
    let request =
        CircleRequest { gains: machine.gain_sets[0].clone(), circle, directions: DIRECTIONS.to_vec() };
    let test = machine.circle_test(&request)?;
    let twin = machine.clone().without_friction();
    let (paths, twins) = rayon::join(|| run(&machine, test, seed, stop), || run(&twin, test, seed, stop));
    let (paths, twins) = (paths?, twins?);
    let runs: Vec<Run<'_>> = (DIRECTIONS.iter().zip(paths.iter().zip(&twins)))
        .map(|(direction, (trace, twin))| Run {
            nominal: Circle { direction: *direction, ..circle },
            trace,
            friction_free: Some(twin),
        })
        .collect();
    Ok(circle::analyse(&runs)?)
}

fn run(
    machine: &Machine,
    test: CircleTest,
    seed: u64,
    stop: &Arc<AtomicBool>,
) -> Result<[Trace; 2], WholeError> {
    let mut bus = Wired::new(machine.rack(seed));
    let drives = bus.commission(machine.drives()?)?;
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let mut orders = Procedure::new(test, Arc::clone(stop));
    let mut kept = Kept::default();
    let last = conduct(&mut cycle, &mut bus, &mut Virtual::new(machine.cycle.period), &mut orders, &mut kept);
    match orders.ending(&last) {
        Ending::Complete => {}
        Ending::Faulted(axis, fault) => {
            return Err(WholeError::Faulted { axis: machine.axis_names()[axis.index()].clone(), fault });
        }
        Ending::Interrupted | Ending::Refused => return Err(WholeError::Interrupted),
    }
    let whole = Trace::from_records(&kept.0)?;
    Ok([whole.stretch(MOTIONS[0])?, whole.stretch(MOTIONS[1])?])
}

/// Every record of a run.
#[derive(Default)]
struct Kept(Vec<CycleRecord>);

impl Records for Kept {
    fn put(&mut self, record: &CycleRecord, _inputs: &Inputs) {
        self.0.push(*record);
    }
    fn lost(&self) -> u64 {
        0
    }
}
