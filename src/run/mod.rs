//! What a run needs before its first cycle, whoever runs it: a computer that is fit for real time, the thread
//! of the cycle, the CAN interface, moment zero, and what the log says of it all.
//!
//! ```text
//!   machine ─► Prepared (process, thread, checks) ─► judge ─► commission ─► cycle
//!                open (interface) ─────────────────────────┘
//! ```
//!
//! Invariant: a real axis is armed only with real time, or by a person who said otherwise.

mod cycle_thread;
mod preparation;
pub mod readiness;

use std::collections::BTreeMap;
use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::SystemTime;

use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use signal_hook::flag;

pub use cycle_thread::CycleThread;
pub use preparation::Prepared;

use crate::base::time::{Moment, Span};
use crate::config::Machine;
use crate::log::{Header, Pace};
use crate::rt::bus::Id;
use crate::rt::bus::socketcan::{OpenError, Settings, SocketCan};
use crate::rt::clock::monotonic_now;
use crate::rt::drive::commission::{CommissionError, CommissionSettings};
use crate::rt::drive::{Configuring, Drives, Operational};

/// From here to the first slot of a run on the wall clock: time to start the threads.
const LEAD: Span = Span::ms(200);
/// Version and commit, as in logs and reports.
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("QUADRANT_COMMIT"), ")");

/// Moment zero of a run, on both clocks.
#[derive(Clone, Copy, Debug)]
pub struct Origin {
    /// On the clock that paces.
    pub monotonic: Moment,
    /// Nanoseconds since 1970.
    pub wall_ns: i64,
}

impl Origin {
    /// A little ahead, so that the threads are there by then.
    pub fn soon() -> Self {
        Self { monotonic: monotonic_now() + LEAD, wall_ns: wall_now_ns() + LEAD.as_ns() }
    }
}

/// Nanoseconds since 1970.
pub fn wall_now_ns() -> i64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_nanos() as i64
}

/// A wish to stop, set by the signals that ask for the end: Ctrl-C, `kill`, a terminal that is closed. The
/// handler sets it, so it is heard whatever the program's threads are waiting for. Where `second_ends`, a
/// second one ends the program at once: for runs that move nothing real.
///
/// # Errors
/// What the system says of a handler that it refuses.
pub fn stop_wish(second_ends: bool) -> io::Result<Arc<AtomicBool>> {
    let stop_wish = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP, SIGQUIT] {
        if second_ends {
            flag::register_conditional_shutdown(signal, 130, Arc::clone(&stop_wish))?;
        }
        flag::register(signal, Arc::clone(&stop_wish))?;
    }
    Ok(stop_wish)
}

/// Where the machine of a run is.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    /// What paces the run.
    pub pace: Pace,
    /// CAN interface; `None`: the machine is simulated in this process.
    pub interface: Option<&'a str>,
    /// Seed of the machine in this process.
    pub seed: u64,
}

/// What the log of a run says of it; the program is named with its version. Motions and whatever else there is
/// to say are the caller's.
pub fn header(machine: &Machine, place: &Place<'_>, origin: &Origin, program: &str) -> Header {
    Header {
        project_version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: env!("QUADRANT_COMMIT").to_owned(),
        machine_name: machine.name.clone(),
        machine_text: machine.text.clone(),
        sheets: machine.sheets.clone(),
        seed: place.seed,
        pace: place.pace,
        wall_at_zero_ns: origin.wall_ns,
        axes: machine.axis_names(),
        period: machine.cycle.period,
        gain_sets: machine.gain_sets.clone(),
        motions: BTreeMap::new(),
        extra: BTreeMap::from([
            ("program".to_owned(), format!("{program} {VERSION}")),
            ("bus".to_owned(), place.interface.unwrap_or("memory").to_owned()),
        ]),
    }
}

/// The CAN interface of a machine, its frames and these others.
///
/// # Errors
/// See [`OpenError`].
pub fn open(machine: &Machine, interface: &str, others: &[Id]) -> Result<SocketCan, OpenError> {
    let identifiers = [machine.identifiers().as_slice(), others].concat();
    let settings = Settings { interface, identifiers: &identifiers, is_fd: machine.is_fd() };
    SocketCan::open(&settings, monotonic_now())
}

/// Commission drives over an interface that was just opened, on the wall clock.
///
/// # Errors
/// See [`CommissionError`].
pub fn commission(
    bus: &mut SocketCan,
    drives: Drives<Configuring>,
) -> Result<Drives<Operational>, CommissionError> {
    let began = monotonic_now();
    bus.set_origin(began);
    drives.commission(bus, CommissionSettings::default(), || Moment::ZERO + (monotonic_now() - began))
}
