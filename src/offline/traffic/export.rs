//! A log as text of candump: what a listener on the bus of the run would have written.
//!
//! Times are those of the log: SYNC when its cycle woke, received frames when they came, commands when they
//! stood. A frame that came between two cycles stands between them. In virtual time a cycle takes none, so the
//! text lets no time go back: a line is never earlier than the one before it.
//! Invariant: the frames of each cycle in the order SYNC, received, commands; nothing that was not on the bus.

use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::Frames;
use crate::base::frame::Frame;
use crate::base::input::{Input, What};
use crate::base::record::CycleRecord;
use crate::base::time::Moment;
use crate::candump;
use crate::config::{self, Machine};
use crate::log::{LogError, Reader};

/// Why a log cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// It cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// Its machine file, as it carries it, is not right any more.
    #[error("the machine file in the log: {0}")]
    Machine(#[from] Box<config::problem::FileProblems>),
    /// The text cannot be written.
    #[error("cannot write {}: {cause}", file.display())]
    Unwritable {
        /// Which text.
        file: PathBuf,
        /// What the system says.
        cause: io::Error,
    },
}

/// What was exported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Exported {
    /// Cycles in the log.
    pub cycles: u64,
    /// Frames in the text.
    pub frames: u64,
    /// Cycles that were run and whose records the log lacks.
    pub cycles_missing: u64,
    /// Records and inputs that were lost while the run was logged, by its own account.
    pub lost: u64,
}

/// Writes the traffic of a log to `text`. `file` names the text in messages.
///
/// # Errors
/// What the reader meets, after everything before it was written; a text that cannot be written.
pub fn export<R: Read + Seek>(
    log: &mut Reader<R>,
    interface: &str,
    text: impl Write,
    file: &Path,
) -> Result<Exported, ExportError> {
    let unwritable = |cause| ExportError::Unwritable { file: file.to_owned(), cause };
    let header = log.header();
    let machine = config::from_texts("machine.toml", &header.machine_text, &header.sheets)?;
    let mut export = Export::new(&machine, header.wall_at_zero_ns, interface, text);
    let mut cycles_run = None;
    let mut outcome = Exported::default();
    while let Some(record) = log.next() {
        let record = record.inspect_err(|_| drop(export.text.flush()))?;
        export.cycle(&record, log.inputs_until(&record)).map_err(unwritable)?;
        let expected = cycles_run.map_or(record.cycles_run(), |before| before + 1);
        outcome.cycles_missing += record.cycles_run().saturating_sub(expected);
        cycles_run = Some(record.cycles_run());
        outcome.cycles += 1;
        outcome.lost = record.lost_records;
    }
    export.text.flush().map_err(unwritable)?;
    outcome.frames = export.lines;
    Ok(outcome)
}

/// Writes cycle by cycle.
#[derive(Debug)]
pub struct Export<W> {
    frames: Frames,
    wall_at_zero_ns: i64,
    interface: String,
    text: W,
    /// Of the line before.
    wall_ns: i64,
    lines: u64,
}

impl<W: Write> Export<W> {
    /// Of a run of `machine` that began at `wall_at_zero_ns` nanoseconds since 1970.
    pub fn new(machine: &Machine, wall_at_zero_ns: i64, interface: &str, text: W) -> Self {
        let interface = interface.to_owned();
        Self { frames: Frames::of(machine), wall_at_zero_ns, interface, text, wall_ns: 0, lines: 0 }
    }

    /// The next cycle of the run.
    pub fn cycle(&mut self, record: &CycleRecord, inputs: &[Input]) -> io::Result<()> {
        let woke = record.timing.woke;
        for input in inputs {
            if let What::Before(received) = input.what {
                // Its moment may be on the clock of the commissioning.
                self.write(&received.frame, received.at.min(woke))?;
            }
        }
        let received = self.frames.received(record, inputs);
        let behind = received.iter().position(|frame| frame.at >= woke).unwrap_or(received.len());
        let (before, within) = received.split_at(behind);
        for frame in before {
            self.write(&frame.frame, frame.at)?;
        }
        if let Some(sync) = self.frames.sync(record) {
            self.write(&sync, woke)?;
        }
        for frame in within {
            self.write(&frame.frame, frame.at)?;
        }
        for command in self.frames.commands(record) {
            self.write(&command, record.timing.decided)?;
        }
        Ok(())
    }

    fn write(&mut self, frame: &Frame, at: Moment) -> io::Result<()> {
        self.wall_ns = self.wall_ns.max(self.wall_at_zero_ns.saturating_add(at.as_ns()));
        self.lines += 1;
        candump::write(&mut self.text, self.wall_ns, &self.interface, frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;
    use crate::base::frame::Received;
    use crate::base::record::{Arrival, Arrivals, Refusal};
    use crate::base::sample::Freshness;
    use crate::base::time::Span;
    use crate::rt::wire::state::{Heartbeat, encode_heartbeat};

    fn at(us: i64) -> Moment {
        Moment::ZERO + Span::us(us)
    }

    /// Cycle 5 of the classic machine: a heartbeat came before it woke, X answered, Y did not; of the
    /// commands the bus took that of Y.
    fn cycle() -> (Machine, CycleRecord, Vec<Input>) {
        let machine = config::load("classic").unwrap();
        let mut record = CycleRecord::empty(2);
        (record.cycle, record.overruns) = (5, 2);
        (record.timing.woke, record.timing.decided) = (at(5_020), at(5_300));
        record.axes[AxisId::X].sample.freshness = Freshness::Fresh;
        record.axes[AxisId::X].sample.raw.answers_cycle = 5;
        record.axes[AxisId::X].arrivals = Arrivals {
            motor: Arrival { place: 2, at: at(5_140) },
            table: Arrival { place: 1, at: at(5_130) },
        };
        record.axes[AxisId::X].refusal = Refusal::Full;
        let heartbeat = encode_heartbeat(machine.axes[AxisId::Y].node, &Heartbeat::default());
        let received = Received { frame: heartbeat, at: at(4_900) };
        (machine, record, vec![Input { cycle: 5, what: What::Frame { place: 0, received } }])
    }

    fn text(machine: &Machine, record: &CycleRecord, inputs: &[Input]) -> String {
        let mut text = Vec::new();
        Export::new(machine, 1_000_000_000_000, "can0", &mut text).cycle(record, inputs).unwrap();
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn each_frame_stands_at_its_time_and_what_was_refused_nowhere() {
        let (machine, record, inputs) = cycle();
        let expected = "(0000001000.004900) can0 702#00000000\n\
                        (0000001000.005020) can0 080#05000000\n\
                        (0000001000.005130) can0 281#0000000000000500\n\
                        (0000001000.005140) can0 181#0000000000000500\n\
                        (0000001000.005300) can0 202#00000000000504\n";
        assert_eq!(text(&machine, &record, &inputs), expected);
    }

    #[test]
    fn a_refused_sync_is_not_told() {
        let (machine, mut record, inputs) = cycle();
        record.bus.sync = Refusal::Down;
        assert!(!text(&machine, &record, &inputs).contains("080#"));
    }

    #[test]
    fn no_time_goes_back() {
        let (machine, mut record, mut inputs) = cycle();
        record.timing.decided = at(5_000);
        let before = Received { frame: Frame::classic(crate::base::frame::Id::MAX, []), at: at(90_000) };
        inputs.insert(0, Input { cycle: 5, what: What::Before(before) });
        let text = text(&machine, &record, &inputs);
        let times: Vec<&str> = text.lines().filter_map(|line| line.split(' ').next()).collect();
        let expected = [5_020, 5_020, 5_020, 5_130, 5_140, 5_140];
        assert_eq!(times, expected.map(|us| format!("(0000001000.{us:06})")));
    }
}
