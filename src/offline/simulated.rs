//! A programme on the simulated machine, in this process and in virtual time: the shipped cycle over frames, with
//! boards and plants at the other end.
//!
//! What plants are behind the boards is said apart from the machine that is controlled: they are the same unless
//! somebody wants to see what happens when they are not.
//! Invariant: the same machines, programme and seed give the same records, to the bit.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::config::Machine;
use crate::rt::cycle::pace::Virtual;
use crate::rt::cycle::procedure::{Ending, Procedure, Programme};
use crate::rt::cycle::{Cycle, conduct};
use crate::rt::door::Records;
use crate::rt::drive::SettingsError;
use crate::rt::drive::commission::CommissionError;
use crate::sim::closed_loop::Wired;

/// Why nothing was run.
#[derive(Debug, thiserror::Error)]
pub enum SimulatedError {
    /// The drives cannot be set up.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The boards are not what their sheet says.
    #[error(transparent)]
    Commission(#[from] CommissionError),
}

/// Runs a programme on a machine that has the plants of another behind its boards; setting `stop` ends it early.
///
/// # Errors
/// When the boards of the two do not fit.
pub fn run(
    machine: &Machine,
    plant: &Machine,
    programme: impl Into<Programme>,
    seed: u64,
    stop: &Arc<AtomicBool>,
    records: &mut impl Records,
) -> Result<Ending, SimulatedError> {
    let mut bus = Wired::new(plant.rack(seed));
    let drives = bus.commission(machine.drives()?)?;
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let mut orders = Procedure::new(programme, Arc::clone(stop));
    let mut grid = Virtual::new(machine.cycle.period);
    let last = conduct(&mut cycle, &mut bus, &mut grid, &mut orders, records);
    Ok(orders.ending(&last))
}
