//! What stands before the first cycle: process and thread made ready for real time, and the checks over
//! what was obtained.
//!
//! Invariant: nothing here touches a bus; what was obtained is kept until the [`Prepared`] is dropped.

use std::path::Path;

use anyhow::Context;
use tracing::{error, info, warn};

use super::cycle_thread::CycleThread;
use super::readiness::{Check, Obtained, State, System, Verdict, Wanted, checks, verdict};
use crate::base::time::Span;
use crate::config::Machine;
use crate::config::bus_load::BusLoad;
use crate::rt::thread::{Hold, Process};

/// Ready for a cycle, as far as this machine lets it.
pub struct Prepared<T> {
    /// Waits for the cycle.
    pub thread: CycleThread<T>,
    /// What holds and what is missing.
    pub checks: Vec<Check>,
    /// Whether a machine may be at the other end of the bus.
    pub bus_is_real: bool,
    /// Processors sleep again when this is dropped.
    _process: Process,
}

impl<T: Send + 'static> Prepared<T> {
    /// Prepares process and thread; `interface` is the CAN interface, if frames leave this computer.
    /// Call it before there is a second thread.
    pub fn new(machine: &Machine, interface: Option<&str>) -> anyhow::Result<Self> {
        let process = Process::prepare();
        let (thread, prepared, rehearsal) = CycleThread::start(machine.real_time, machine.cycle.period)
            .context("cannot start the thread of the cycle")?;
        let system = System::read(Path::new("/"), interface);
        let obtained = Obtained {
            memory: process.memory,
            awake: process.awake.as_ref().map(Hold::effective_us).map_err(|errno| *errno),
            thread: &prepared,
            rehearsal: &rehearsal,
            system: &system,
        };
        let wanted = Wanted { settings: machine.real_time, wake_error_max: wake_error_max(machine) };
        let checks = checks(&obtained, &wanted);
        let bus_is_real = system.interface.is_some_and(|interface| !interface.is_virtual);
        Ok(Self { thread, checks, bus_is_real, _process: process })
    }

    /// Says what holds and what does not.
    ///
    /// # Errors
    /// On a real bus what is missing refuses to arm, unless `allow_jitter`.
    pub fn judge(&self, allow_jitter: bool) -> anyhow::Result<()> {
        for check in &self.checks {
            let Check { name, found, state, .. } = check;
            match state {
                State::Held => info!("{name}: {found}"),
                State::Missing { mend } if check.is_required => warn!("{name}: {found}; to mend: {mend}"),
                State::Missing { mend } => info!("{name}: {found}; not required: {mend}"),
            }
        }
        match verdict(&self.checks, self.bus_is_real, allow_jitter) {
            Verdict::Arm { despite } if despite.is_empty() => info!("ready for real time"),
            Verdict::Arm { despite } if self.bus_is_real => error!(
                "--allow-jitter: the axes are driven WITHOUT real time, missing {}: expect overruns and stops",
                names(&despite)
            ),
            Verdict::Arm { despite } => {
                warn!("no real time, missing {}; borne, because nothing real moves", names(&despite));
            }
            Verdict::Refuse { missing } => anyhow::bail!(
                "refused to arm: missing {}; how to mend it stands above, and --allow-jitter drives the axes \
                 all the same",
                names(&missing)
            ),
        }
        Ok(())
    }
}

fn names(checks: &[&Check]) -> String {
    checks.iter().map(|check| check.name).collect::<Vec<_>>().join(", ")
}

/// What the frames of a cycle leave of its period: after a later wake-up they run into the next one.
fn wake_error_max(machine: &Machine) -> Span {
    let load = BusLoad::of(machine);
    machine.cycle.period - Span::s(load.replies_s + load.commands_s)
}
