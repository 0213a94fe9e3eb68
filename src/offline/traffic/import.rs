//! Text of candump as a log: what the traffic of a bus tells of a run, by any host and boards that speak its
//! protocol.
//!
//! A SYNC begins the cycle of its number. What follows goes through `rt/drive` as it would have gone live, so
//! samples, their freshness and all counts are those of a host that was there; commands stand as they were
//! decoded. What a listener cannot know is marked: modes, faults, gain sets and what became of a frame that is
//! missing as such, setpoints and terms of the control as NaN. Nor does a listener know the grid: a cycle is
//! scheduled when its SYNC was seen, so it has no wake-up error.
//!
//! Markers tell that host and machine went in lock step. The times of such a text are those of two programs and
//! not of the machine; cycles then stand on the grid of the machine file, from the moment of the first SYNC on.
//!
//! Commands count the cycles that were run. Where the numbers of SYNC jump, the count tells periods that the
//! host skipped from cycles that the text lacks.
//! Invariant: every frame behind the first SYNC is a sample, a command or an input of a record; what is left
//! out is counted.

use std::collections::VecDeque;
use std::io::Read;

use serde::Serialize;

use super::Frames;
use super::count::Count;
pub use super::source::{LeftOut, Wanted};
use super::source::{Seen, Source};
use super::unknown;
use crate::base::axis::PerAxis;
use crate::base::command::Command;
use crate::base::frame::{Format, Frame, Received};
use crate::base::input::Inputs;
use crate::base::record::{CycleRecord, Refusal, Timing};
use crate::base::time::{Moment, Span};
use crate::candump::TextError;
use crate::config::Machine;
use crate::rt::bus::lockstep::{BEGIN, number_of};
use crate::rt::bus::{Bus, SendError};
use crate::rt::door::Records;
use crate::rt::drive::{Drives, Operational, SettingsError, checksum};
use crate::rt::wire::command::{RawCommand, decode_sync};
use crate::rt::wire::{Address, Malformed};

/// Most periods that SYNC can jump; commands name their cycle by 16 bits.
const JUMP_MAX: u32 = 0x7FFF;

/// Why a text does not become a log.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A line is no text of candump.
    #[error(transparent)]
    Text(#[from] TextError),
    /// Frames of two interfaces.
    #[error("line {line}: interface {second} beside {first}; name the one that is wanted")]
    TwoInterfaces {
        /// Which line.
        line: u64,
        /// The interface of the lines above.
        first: String,
        /// The other.
        second: String,
    },
    /// A SYNC without the number of its cycle.
    #[error("line {line}: {cause}; the SYNC of these boards carries the number of its cycle")]
    Sync {
        /// Which line.
        line: u64,
        /// What is wrong.
        cause: Malformed,
    },
    /// No cycle begins.
    #[error("none of the {frames} frames in the text is a SYNC, so there is no cycle")]
    NoSync {
        /// Frames of the interface.
        frames: usize,
    },
    /// The machine cannot be set up.
    #[error("the machine: {0}")]
    Drives(#[from] SettingsError),
}

/// What was imported.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Imported {
    /// Cycles in the log.
    pub cycles: u64,
    /// Periods that the host skipped.
    pub periods_skipped: u64,
    /// Cycles that were run and are not in the text.
    pub cycles_missing: u64,
    /// Frames in the cycles.
    pub frames: u64,
    /// Frames from before the first SYNC; of these the last heartbeats are kept.
    pub frames_before: u64,
    /// Commands of the host that are not in the text.
    pub commands_missing: u64,
    /// SYNCs that go back or too far ahead, as those of another host. They begin no cycle.
    pub syncs_aside: u64,
    /// Commands of another cycle, or a second one of the same: of another host.
    pub commands_aside: u64,
    /// Times that the commands' count of cycles did not go on.
    pub sequence_breaks: u64,
    /// Where another run begins in the text, if one does: there the import ends.
    pub another_run_at_line: Option<u64>,
    /// What is not in the log.
    #[serde(flatten)]
    pub left_out: LeftOut,
}

impl Imported {
    /// Whether the text told all of a run by one host.
    pub fn is_whole(&self) -> bool {
        let left_out = &self.left_out;
        let lacks = [
            self.cycles_missing,
            self.commands_missing,
            self.syncs_aside,
            self.commands_aside,
            self.sequence_breaks,
            left_out.damaged_lines,
            left_out.dropped,
            left_out.times_back,
        ];
        lacks.iter().all(|count| *count == 0) && self.another_run_at_line.is_none()
    }
}

/// A SYNC that begins a cycle.
#[derive(Clone, Copy, Debug)]
struct Begin {
    cycle: u64,
    at: Moment,
}

impl Begin {
    /// The cycle of a SYNC behind it, if that can be of the same run.
    fn next(self, number: u32) -> Option<u64> {
        let ahead = number.wrapping_sub(self.cycle as u32);
        (1..=JUMP_MAX).contains(&ahead).then(|| self.cycle + u64::from(ahead))
    }
}

/// A text on its way into a log.
#[derive(Debug)]
pub struct Import<R> {
    source: Source<R>,
    frames: Frames,
    drives: Drives<Operational>,
    period: Span,
    reply_window: Span,
    is_lock_step: bool,
    wall_at_zero_ns: i64,
    next: Option<Begin>,
    waiting: VecDeque<Received>,
    record: CycleRecord,
    count: Count,
    /// When the last command of the cycle before was seen.
    finished: Option<Moment>,
    imported: Imported,
}

impl<R: Read> Import<R> {
    /// Reads a text up to its first cycle.
    ///
    /// # Errors
    /// See [`ImportError`].
    pub fn begin(machine: &Machine, text: R, wanted: &Wanted) -> Result<Self, ImportError> {
        let mut source = Source::new(text, wanted);
        let mut before = Vec::new();
        let sync = loop {
            match source.next()? {
                Some(seen) if is_sync(&seen.frame) => break seen,
                Some(seen) => before.push(seen),
                None => return Err(ImportError::NoSync { frames: before.len() }),
            }
        };
        // Up to the next SYNC: whether there are markers decides on the time of the first cycle.
        source.peek(is_sync)?;
        let is_lock_step = before.iter().any(|seen| is_marker(&seen.frame)) || source.has_ahead(is_marker);
        let (period, axes) = (machine.cycle.period, machine.axes.count());
        let cycle = u64::from(number(&sync)?);
        let since_zero = period * cycle as i64;
        let wall_at_zero_ns = sync.wall_ns.saturating_sub(since_zero.as_ns());
        let heard = before.iter().map(|seen| Received {
            frame: seen.frame,
            at: Moment::ns(seen.wall_ns.saturating_sub(wall_at_zero_ns)),
        });
        let is_heartbeat = |received: &Received| {
            received.frame.format() != Format::Report
                && matches!(Address::of(received.frame.id()), Some(Address::Heartbeat(_)))
        };
        let drives = machine.drives()?.resume(heard.filter(is_heartbeat));
        let frames_before = before.len() as u64;
        Ok(Self {
            source,
            frames: Frames::of(machine),
            drives,
            period,
            reply_window: machine.cycle.reply_window,
            is_lock_step,
            wall_at_zero_ns,
            next: Some(Begin { cycle, at: Moment::ZERO + since_zero }),
            waiting: VecDeque::new(),
            record: CycleRecord { axes: PerAxis::filled(axes, unknown::axis()), ..CycleRecord::empty(axes) },
            count: Count::default(),
            finished: None,
            imported: Imported { frames: 1, frames_before, ..Imported::default() },
        })
    }

    /// Whether host and machine went in lock step.
    pub const fn is_lock_step(&self) -> bool {
        self.is_lock_step
    }

    /// Wall clock at moment zero, nanoseconds since 1970.
    pub const fn wall_at_zero_ns(&self) -> i64 {
        self.wall_at_zero_ns
    }

    /// Name of the interface.
    pub fn interface(&self) -> &str {
        self.source.interface()
    }

    /// Gives every cycle of the text to `records`.
    ///
    /// # Errors
    /// See [`ImportError`]; the cycles before it have been given.
    pub fn run(mut self, records: &mut impl Records) -> Result<Imported, ImportError> {
        let mut inputs = Inputs::default();
        while let Some(begin) = self.next.take() {
            let commands = self.gather(begin)?;
            inputs.clear();
            self.cycle(begin, &commands, &mut inputs);
            self.record.lost_records = records.lost() + inputs.lost();
            records.put(&self.record, &inputs);
            self.imported.cycles += 1;
        }
        self.imported.periods_skipped = self.count.skipped;
        self.imported.cycles_missing = self.count.missing;
        self.imported.sequence_breaks = self.count.breaks;
        self.imported.left_out = self.source.left_out();
        Ok(self.imported)
    }

    /// Reads up to the SYNC of the next cycle. The commands of this one come back; the rest waits to be
    /// received.
    fn gather(&mut self, begin: Begin) -> Result<PerAxis<Option<Spoken>>, ImportError> {
        let mut commands = PerAxis::filled(self.record.axes.count(), None);
        while let Some(seen) = self.source.next()? {
            let Seen { frame, .. } = seen;
            let at = self.moment(&seen, begin);
            if self.is_another_run(&seen, begin)? {
                self.imported.another_run_at_line = Some(seen.line);
                break;
            }
            if self.is_lock_step && is_marker(&frame) {
                continue;
            }
            self.imported.frames += 1;
            if is_sync(&frame) {
                if let Some(cycle) = begin.next(number(&seen)?) {
                    let at = if self.is_lock_step { Moment::ZERO + self.period * cycle as i64 } else { at };
                    self.next = Some(Begin { cycle, at });
                    break;
                }
                self.imported.syncs_aside += 1;
            } else if let Some(axis) = self.frames.axis_commanded(&frame) {
                match self.frames.decode_command(&frame) {
                    Ok(raw) if commands[axis].is_none() && self.frames.is_of_cycle(&raw, begin.cycle) => {
                        commands[axis] = Some(Spoken { raw, frame, at });
                        continue;
                    }
                    Ok(_) | Err(_) => self.imported.commands_aside += 1,
                }
            }
            self.waiting.push_back(Received { frame, at });
        }
        Ok(commands)
    }

    /// A session begins with marker 0; a run with the SYNC of cycle 0, unless the one at hand goes on behind it:
    /// then that was another host's.
    fn is_another_run(&mut self, seen: &Seen, begin: Begin) -> Result<bool, ImportError> {
        if self.is_lock_step && number_of(&seen.frame) == Some(BEGIN) {
            return Ok(true);
        }
        if !is_sync(&seen.frame) || number(seen)? != 0 {
            return Ok(false);
        }
        let behind = self.source.peek(is_sync)?.map(|next| number(&next)).transpose()?;
        Ok(behind.is_none_or(|number| begin.next(number).is_none()))
    }

    fn moment(&self, seen: &Seen, begin: Begin) -> Moment {
        if self.is_lock_step {
            begin.at + self.reply_window
        } else {
            Moment::ns(seen.wall_ns.saturating_sub(self.wall_at_zero_ns))
        }
    }

    /// What `rt/drive` makes of the frames, as a record.
    fn cycle(&mut self, begin: Begin, commands: &PerAxis<Option<Spoken>>, inputs: &mut Inputs) {
        let until = begin.at + self.reply_window;
        let dropped = self.source.dropped();
        let mut bus = Waiting { frames: &mut self.waiting, last: begin.at, is_dry: false, dropped };
        self.drives.collect(&mut bus, begin.cycle, until, inputs);
        let collected = if bus.is_dry { until } else { bus.last };

        let mut spoken = commands.as_slice().iter().flatten();
        let sequence = spoken.clone().next().map(|command| command.raw.sequence);
        let decided = spoken.clone().next().map_or(collected, |command| command.at);
        let finished = spoken.next_back().map_or(decided, |command| command.at);
        let previous_finished = self.finished.replace(finished).unwrap_or(begin.at);
        let record = &mut self.record;
        record.timing = if self.is_lock_step {
            Timing::at(begin.at)
        } else {
            Timing { collected, decided, previous_finished, ..Timing::at(begin.at) }
        };
        record.cycle = begin.cycle;
        record.overruns = self.count.overruns(begin.cycle, sequence);
        record.bus = *self.drives.bus();
        let told = commands.as_slice().iter().flatten().map(|command| &command.frame);
        record.bus.sent_crc = checksum(begin.cycle, told);
        let (observed, counts) = (self.drives.observations(), self.drives.link_counts());
        for (axis, row) in record.axes.iter_mut() {
            row.sample = observed[axis].sample;
            row.arrivals = observed[axis].arrivals;
            row.link = *counts[axis];
            (row.command, row.refusal) = match &commands[axis] {
                Some(Spoken { raw, .. }) => {
                    let current = self.frames.scales[axis].current(raw.current);
                    (Command { current, control_word: raw.control_word, ..unknown::command() }, Refusal::None)
                }
                None => (unknown::command(), Refusal::Unknown),
            };
            self.imported.commands_missing += u64::from(row.refusal == Refusal::Unknown);
        }
    }
}

/// Whether a frame is a SYNC; a report of the controller has no identifier.
fn is_sync(frame: &Frame) -> bool {
    frame.format() != Format::Report && Address::of(frame.id()) == Some(Address::Sync)
}

fn is_marker(frame: &Frame) -> bool {
    number_of(frame).is_some()
}

fn number(seen: &Seen) -> Result<u32, ImportError> {
    decode_sync(&seen.frame).map_err(|cause| ImportError::Sync { line: seen.line, cause })
}

/// A command as it was seen.
#[derive(Clone, Copy, Debug)]
struct Spoken {
    raw: RawCommand,
    frame: Frame,
    at: Moment,
}

/// Frames that wait to be received.
struct Waiting<'a> {
    frames: &'a mut VecDeque<Received>,
    /// When the last one came that was received.
    last: Moment,
    /// More was asked for than there was.
    is_dry: bool,
    dropped: u64,
}

impl Bus for Waiting<'_> {
    fn send(&mut self, _sync: &Frame) -> Result<(), SendError> {
        Ok(())
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        let received = self.frames.front().copied().filter(|received| received.at <= until);
        match &received {
            Some(received) => {
                self.frames.pop_front();
                self.last = self.last.max(received.at);
            }
            None => self.is_dry = true,
        }
        received
    }
    fn dropped(&self) -> u64 {
        self.dropped
    }
}
