//! Replay: the recorded inputs of a run through today's cycle. The same commands and state must come out,
//! bit for bit; where they do not, the first cycle and field that differ are named.
//!
//! ```text
//!   log ─► record + inputs of cycle k ─► frames, order, clock reads ─► Cycle::run ─► record ≟ recorded
//! ```
//!
//! It does not matter where the log comes from: memory, a virtual bus or a machine.
//! Invariant: nothing of the recorded decisions reaches the cycle; only what it was told.

use std::collections::VecDeque;
use std::io::{Read, Seek};

use serde::Serialize;

use crate::base::axis::PerAxis;
use crate::base::input::{Input, What};
use crate::base::record::{CycleRecord, Refusal};
use crate::base::time::Moment;
use crate::config::{self, Machine};
use crate::log::{LogError, Reader, schema};
use crate::offline::recorded::{CyclesOf, Recorded, RecordedCycle, StartError};
use crate::offline::traffic::Frames;
use crate::rt::bus::{Bus, Frame, Received, SendError};
use crate::rt::cycle::Cycle;
use crate::rt::cycle::pace::Slot;
use crate::rt::door::{Order, Orders};

/// Why a log cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// There is nothing to go by.
    #[error(transparent)]
    Start(#[from] StartError),
    /// Its machine file, as it carries it, is not right any more.
    #[error("the machine file in the log: {0}")]
    Machine(#[from] Box<config::problem::FileProblems>),
    /// Its machine cannot be set up.
    #[error("the machine file in the log: {0}")]
    Drives(#[from] crate::rt::drive::SettingsError),
}

/// What came of a replay.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Replay {
    /// Cycles that came out as recorded.
    pub cycles: u64,
    /// Time of the machine in them, s.
    pub machine_s: f64,
    /// The first thing that differs.
    pub difference: Option<Difference>,
    /// Why it ended before the end of the log.
    pub ended_early: Option<String>,
}

/// A field that came out differently.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// In which cycle.
    pub cycle: u64,
    /// Name of the field, as in a CSV export.
    pub field: String,
    /// What the log says.
    pub recorded: String,
    /// What came out.
    pub replayed: String,
}

/// Replays `log` until its end, the first difference, or where something is missing. `progress` is told the
/// number of cycles now and then.
pub fn replay<R: Read + Seek>(log: &mut Reader<R>, progress: impl FnMut(u64)) -> Result<Replay, ReplayError> {
    let header = log.header().clone();
    let machine = config::from_texts("machine.toml", &header.machine_text, &header.sheets)?;
    replay_cycles(&machine, CyclesOf(log), progress)
}

/// Replays the cycles of a run of `machine`.
pub fn replay_cycles(
    machine: &Machine,
    cycles: impl Iterator<Item = Result<RecordedCycle, LogError>>,
    mut progress: impl FnMut(u64),
) -> Result<Replay, ReplayError> {
    let (period_s, axes) = (machine.cycle.period.as_s(), machine.axis_names());
    let mut recorded = Recorded::new(cycles)?;
    let mut replayer = Replayer::new(machine, recorded.ahead().map_or(&[], |first| &first.inputs))?;
    let mut outcome = Replay { cycles: 0, machine_s: 0.0, difference: None, ended_early: None };
    for RecordedCycle { record, inputs } in recorded.by_ref() {
        let replayed = replayer.run(&record, &inputs);
        if let Some((field, recorded, replayed)) = schema::difference(&record, &replayed, &axes) {
            outcome.difference = Some(Difference { cycle: record.cycle, field, recorded, replayed });
            return Ok(outcome);
        }
        outcome.cycles += 1;
        outcome.machine_s = outcome.cycles as f64 * period_s;
        if outcome.cycles.is_multiple_of(4_096) {
            progress(outcome.cycles);
        }
    }
    outcome.ended_early = recorded.ended_early().map(str::to_owned);
    Ok(outcome)
}

/// The cycle of today between a recorded bus and recorded orders.
#[derive(Debug)]
pub struct Replayer {
    cycle: Cycle,
    bus: RecordedBus,
}

impl Replayer {
    /// As the run began whose first cycle had these `inputs`.
    pub fn new(machine: &Machine, inputs: &[Input]) -> Result<Self, crate::rt::drive::SettingsError> {
        let heard = inputs.iter().filter_map(|input| match input.what {
            What::Before(received) => Some(received),
            What::Order(_) | What::Frame { .. } => None,
        });
        let drives = machine.drives()?.resume(heard);
        let cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
        Ok(Self { cycle, bus: RecordedBus::new(machine) })
    }

    /// The cycle of `recorded`, told what it was told then.
    pub fn run(&mut self, recorded: &CycleRecord, inputs: &[Input]) -> CycleRecord {
        self.bus.load(recorded, inputs);
        let mut orders = RecordedOrder(inputs.iter().find_map(|input| match input.what {
            What::Order(order) => Some(order),
            What::Frame { .. } | What::Before(_) => None,
        }));
        let slot = Slot { number: recorded.cycle, timing: recorded.timing, overruns: recorded.overruns };
        let mut reads = [recorded.timing.collected, recorded.timing.decided].into_iter();
        let mut clock = || reads.next().unwrap_or(recorded.timing.decided);
        let (record, _inputs) = self.cycle.run(&mut self.bus, &mut orders, &slot, &mut clock);
        record.lost_records = recorded.lost_records;
        *record
    }
}

/// The order of one cycle.
struct RecordedOrder(Option<Order>);

impl Orders for RecordedOrder {
    fn next(&mut self, _last: &CycleRecord) -> Option<Order> {
        self.0.take()
    }
    fn is_done(&self, _last: &CycleRecord) -> bool {
        false
    }
}

/// A bus on which everything goes as it went then.
#[derive(Debug)]
struct RecordedBus {
    frames: Frames,
    received: VecDeque<Received>,
    sync: Refusal,
    commands: PerAxis<Refusal>,
    dropped: u32,
}

impl RecordedBus {
    fn new(machine: &Machine) -> Self {
        Self {
            frames: Frames::of(machine),
            received: VecDeque::new(),
            sync: Refusal::None,
            commands: PerAxis::filled(machine.axes.count(), Refusal::None),
            dropped: 0,
        }
    }

    fn load(&mut self, record: &CycleRecord, inputs: &[Input]) {
        self.received = self.frames.received(record, inputs).into();
        (self.sync, self.dropped) = (record.bus.sync, record.bus.dropped);
        self.commands = record.axes.map(|_, axis| axis.refusal);
    }
}

const fn outcome(refusal: Refusal) -> Result<(), SendError> {
    match refusal {
        Refusal::None => Ok(()),
        Refusal::Full => Err(SendError::Full),
        Refusal::Down => Err(SendError::Down),
    }
}

impl Bus for RecordedBus {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        let axis = self.frames.axis_commanded(frame);
        outcome(axis.map_or(self.sync, |axis| self.commands[axis]))
    }
    fn receive(&mut self, _until: Moment) -> Option<Received> {
        self.received.pop_front()
    }
    fn dropped(&self) -> u64 {
        u64::from(self.dropped)
    }
}
