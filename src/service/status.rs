//! How it goes, for whoever looks: a JSON file that is replaced once a second, with the state of every axis,
//! what was lost, and the timing of every cycle since start. `quadrant latency --live` draws it.
//!
//! Invariant: made from records, beside the cycle; a reader never sees half a file.

use std::io;
use std::path::PathBuf;

use serde::Serialize;
use tracing::{error, warn};

use crate::base::record::CycleRecord;
use crate::config::Machine;
use crate::log::timing::{Share, Timings};
use crate::rt::door::RecordDrain;

/// The file's name in the runtime folder of the service.
pub(super) const FILE: &str = "status.json";

/// What the file says.
#[derive(Debug, Serialize)]
struct Status<'a> {
    machine: &'a str,
    log: &'a str,
    period_us: f64,
    cycle: u64,
    overruns: u64,
    lost_records: u64,
    bus_state: u8,
    axes: Vec<AxisStatus>,
    shares: Vec<Share>,
}

/// One axis.
#[derive(Debug, Serialize)]
struct AxisStatus {
    name: String,
    mode: &'static str,
    fault: Option<&'static str>,
    position_mm: f64,
    following_error_um: f64,
    current_a: f64,
    missed_frames: u32,
}

/// Keeps the file.
pub(super) struct StatusFile {
    records: RecordDrain,
    machine: String,
    axes: Vec<String>,
    period_us: f64,
    log: String,
    path: Option<PathBuf>,
    timings: Timings,
    last: Option<CycleRecord>,
    is_refused: bool,
}

impl StatusFile {
    /// Of a run of `machine` whose records come from `records`; without a path nothing is written.
    pub(super) fn new(machine: &Machine, records: RecordDrain, log: String, path: Option<PathBuf>) -> Self {
        Self {
            records,
            machine: machine.name.clone(),
            axes: machine.axis_names(),
            period_us: machine.cycle.period.as_us(),
            log,
            path,
            timings: Timings::default(),
            last: None,
            is_refused: false,
        }
    }

    /// Takes the records that came, tells the faults that are new in them, and replaces the file.
    pub(super) fn update(&mut self) {
        while self.records.inputs.pop().is_ok() {}
        while let Ok(record) = self.records.ring.pop() {
            self.timings.add(&record);
            self.tell_faults(&record);
            self.last = Some(record);
        }
        let outcome = self.write();
        if let Err(error) = &outcome
            && !self.is_refused
        {
            warn!("the status file cannot be written: {error}");
        }
        self.is_refused = outcome.is_err();
    }

    fn tell_faults(&self, record: &CycleRecord) {
        for ((axis, row), name) in record.axes.iter().zip(&self.axes) {
            let before = self.last.as_ref().and_then(|last| last.axes[axis].fault);
            if let Some(fault) = row.fault.filter(|fault| before != Some(*fault)) {
                error!(cycle = record.cycle, "axis {name}: {fault}; see {}", fault.page());
            }
        }
    }

    /// The axes with a fault, as words; nothing if there is none.
    pub(super) fn faults(&self) -> String {
        let rows = self.last.iter().flat_map(|last| last.axes.as_slice()).zip(&self.axes);
        rows.filter_map(|(row, name)| Some(format!("axis {name}: {}, ", row.fault?))).collect()
    }

    fn write(&self) -> io::Result<()> {
        let (Some(path), Some(last)) = (&self.path, &self.last) else { return Ok(()) };
        let axes = last.axes.as_slice().iter().zip(&self.axes).map(|(row, name)| AxisStatus {
            name: name.clone(),
            mode: row.mode.name(),
            fault: row.fault.map(crate::base::fault::Fault::name),
            position_mm: row.sample.position.as_mm(),
            following_error_um: row.command.terms.following_error.as_um(),
            current_a: row.sample.current.as_a(),
            missed_frames: row.link.missed,
        });
        let status = Status {
            machine: &self.machine,
            log: &self.log,
            period_us: self.period_us,
            cycle: last.cycle,
            overruns: last.overruns,
            lost_records: last.lost_records,
            bus_state: last.bus.state as u8,
            axes: axes.collect(),
            shares: self.timings.shares(),
        };
        let half = path.with_extension("part");
        std::fs::write(&half, serde_json::to_vec(&status)?)?;
        std::fs::rename(&half, path)
    }
}
