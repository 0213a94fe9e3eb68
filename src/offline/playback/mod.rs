//! Playback: what the boards of a recorded run said, said again on a bus, to a live host.
//!
//! ```text
//!   log ─► feedback, heartbeats, emergencies, late and broken frames of cycle k ─► bus ─► host
//!   recorded commands of cycle k ≟ commands of cycle k ◄────────────────────────── bus ◄──┘
//! ```
//!
//! The host asks for identity and parameters first; boards made from the sheets in the log answer, and tell the
//! heartbeats that were heard before the first cycle. How long that takes does not matter: the run begins with
//! the host's first SYNC, which must have the number of the first recorded cycle, and each SYNC calls for what
//! was received in the cycle of its number, in that order. Where the axes stand follows from the recorded
//! counts, whether they are enabled from the recorded status words. A host with the same machine file and the
//! same orders then gives the same commands to the bit: it is told the same.
//!
//! In lock step the host's markers come back behind the frames of its cycle. On the wall clock the frames of a
//! log of the wall clock come as long after SYNC as they came then; frames of virtual time come at once.
//!
//! What happened to the recorded host alone cannot be played: periods it skipped, frames its interface refused,
//! its own controller off the bus. There it ends, and says so.
//! Invariant: no clock is read here; nothing is sent on a bus on which a board is heard.

mod commands;

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::Serialize;

use self::commands::Awaited;
pub use self::commands::Difference;
use super::recorded::{Recorded, RecordedCycle, StartError};
use super::traffic::Frames;
use crate::base::frame::{Format, Frame, Received};
use crate::base::input::What;
use crate::base::record::{BusState, CycleRecord, Refusal};
use crate::base::time::{Moment, Span};
use crate::config::Machine;
use crate::log::LogError;
use crate::rt::bus::Bus;
use crate::rt::bus::lockstep::{BEGIN, number_of};
use crate::rt::wire::scaling::EncoderCounts;
use crate::rt::wire::{Address, Node, command};
use crate::sim::board::Board;

/// When the frames of a cycle are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timing {
    /// All at its SYNC.
    AtOnce,
    /// As long after SYNC as they came in the log.
    AsRecorded,
}

/// Why a playback was given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlaybackError {
    /// There is a machine, or another playback.
    #[error("a board speaks on this bus, {node}: play only where there is none")]
    Board {
        /// Which board.
        node: Node,
    },
}

/// How long a host may be silent within its run.
const SILENCE: Span = Span::ms(5_000);
/// How often a wait for frames looks whether it is to be stopped.
const WAIT: Span = Span::ms(100);

/// Plays on a bus until it is over or `is_stopped`; the `clock` is that of the bus. `progress` is told the
/// number of cycles now and then.
///
/// # Errors
/// See [`PlaybackError`].
pub fn play<I: Iterator<Item = Result<RecordedCycle, LogError>>>(
    playback: &mut Playback<I>,
    bus: &mut impl Bus,
    clock: impl Fn() -> Moment,
    is_stopped: &AtomicBool,
    mut progress: impl FnMut(u64),
) -> Result<(), PlaybackError> {
    let mut heard = clock();
    while !playback.is_over() && !is_stopped.load(Ordering::Relaxed) {
        let now = clock();
        playback.speak(now, bus);
        let until = playback.due().map_or(now + WAIT, |due| due.min(now + WAIT));
        if let Some(received) = bus.receive(until) {
            heard = received.at;
            playback.hear(&received, bus)?;
            if playback.has_begun() && playback.cycles().is_multiple_of(4_096) {
                progress(playback.cycles());
            }
        } else if playback.has_begun() && now - heard > SILENCE {
            playback.fall_silent();
        }
    }
    Ok(())
}

/// What came of a playback.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Played {
    /// Cycles in which every command was the recorded one.
    pub cycles: u64,
    /// Commands in them.
    pub commands: u64,
    /// Time of the machine in them, s.
    pub machine_s: f64,
    /// Frames sent for the boards in the run.
    pub frames: u64,
    /// Reports of the recorded host's own controller: nobody else can send them.
    pub reports_left_out: u64,
    /// The first command that is not the recorded one.
    pub difference: Option<Difference>,
    /// Why it ended before the end of the log.
    pub ended_early: Option<String>,
}

/// The boards of a log, for one host.
#[derive(Debug)]
pub struct Playback<I> {
    recorded: Recorded<I>,
    frames: Frames,
    timing: Timing,
    period_s: f64,
    boards: Vec<Board>,
    /// Heartbeats from before the first cycle, until the host asks.
    before: Vec<Frame>,
    /// Of the last SYNC.
    awaited: Option<Awaited>,
    /// The recorded bus refused a command of that cycle.
    was_refused: bool,
    /// Frames that wait for their moment.
    due: VecDeque<(Moment, Frame)>,
    played: Played,
    is_over: bool,
}

impl<I: Iterator<Item = Result<RecordedCycle, LogError>>> Playback<I> {
    /// The boards of the run that is in these cycles.
    pub fn new(machine: &Machine, cycles: I, timing: Timing) -> Result<Self, StartError> {
        let recorded = Recorded::new(cycles)?;
        let boards = machine.axes.as_slice().iter().map(|axis| {
            // Only asked for parameters: clock and encoders are the log's.
            let counts = EncoderCounts::counts(0);
            Board::new(axis.node, machine.bus.layout, axis.sheet, 0, counts, counts, Moment::ZERO)
        });
        Ok(Self {
            frames: Frames::of(machine),
            timing,
            period_s: machine.cycle.period.as_s(),
            boards: boards.collect(),
            before: heartbeats_before(recorded.ahead()),
            recorded,
            awaited: None,
            was_refused: false,
            due: VecDeque::new(),
            played: Played::default(),
            is_over: false,
        })
    }

    /// Whether there is nothing more to play or to compare.
    pub const fn is_over(&self) -> bool {
        self.is_over
    }

    /// Cycles so far.
    pub const fn cycles(&self) -> u64 {
        self.played.cycles
    }

    /// Whether the run has begun.
    pub const fn has_begun(&self) -> bool {
        self.awaited.is_some()
    }

    /// When the next frame is to be sent.
    pub fn due(&self) -> Option<Moment> {
        self.due.front().map(|(at, _)| *at)
    }

    /// What came of it.
    pub fn into_played(self) -> Played {
        self.played
    }

    /// The host, or whoever is on the bus, sent this.
    pub fn hear(&mut self, received: &Received, bus: &mut impl Bus) -> Result<(), PlaybackError> {
        let frame = &received.frame;
        if self.is_over {
            return Ok(());
        }
        if let Some(number) = number_of(frame) {
            if number == BEGIN && self.has_begun() {
                self.end_early("the host began a new session");
            } else {
                self.send(frame, bus);
            }
            return Ok(());
        }
        match Address::of(frame.id()) {
            Some(Address::Sync) => {
                if let Ok(cycle) = command::decode_sync(frame) {
                    self.begin_cycle(cycle, received.at, bus);
                }
            }
            Some(Address::Command(_)) => self.take_command(frame),
            Some(Address::ParameterRequest(_)) => self.answer(frame, bus),
            Some(address) => {
                if let Some(node) = address.sender() {
                    return Err(PlaybackError::Board { node });
                }
            }
            None => {}
        }
        Ok(())
    }

    /// Sends what is due.
    pub fn speak(&mut self, now: Moment, bus: &mut impl Bus) {
        while let Some((_, frame)) = self.due.front().copied().filter(|(at, _)| *at <= now) {
            self.due.pop_front();
            if frame.format() == Format::Report {
                self.played.reports_left_out += 1;
            } else {
                self.played.frames += 1;
                self.send(&frame, bus);
            }
        }
    }

    /// The host says nothing more.
    pub fn fall_silent(&mut self) {
        if !self.is_over {
            self.end_early("the host fell silent, and the log goes on");
        }
    }

    fn send(&mut self, frame: &Frame, bus: &mut impl Bus) {
        if let Err(error) = bus.send(frame) {
            self.end_early(&format!("a frame to the host could not be sent: {error}"));
        }
    }

    /// Only the boards know parameters, and only the host asks.
    fn answer(&mut self, request: &Frame, bus: &mut impl Bus) {
        for frame in std::mem::take(&mut self.before) {
            self.send(&frame, bus);
        }
        let mut replies = Vec::new();
        for board in &mut self.boards {
            board.hear(request, Moment::ZERO);
            // A board tells its boot-up too, which belongs to its own run.
            let said = std::iter::from_fn(|| board.speak());
            replies.extend(
                said.filter(|frame| matches!(Address::of(frame.id()), Some(Address::ParameterReply(_)))),
            );
        }
        replies.iter().for_each(|reply| self.send(reply, bus));
    }

    fn begin_cycle(&mut self, number: u32, at: Moment, bus: &mut impl Bus) {
        self.end_cycle();
        if self.is_over {
            return;
        }
        let Some(recorded) = self.recorded.ahead().map(|cycle| cycle.record.cycle) else { return };
        if recorded as u32 != number {
            self.end_early(&format!(
                "the host sent the SYNC of cycle {number}, in the log that of cycle {recorded} is next"
            ));
            return;
        }
        // None: what the cycle was told is not whole.
        let Some(cycle) = self.recorded.next() else {
            self.end_where_the_log_does();
            return;
        };
        if let Some(why) = unplayable(&cycle.record) {
            self.end_early(why);
            return;
        }
        self.awaited = Some(Awaited::of(&self.frames, &cycle.record));
        self.was_refused = cycle.record.commands() != Refusal::None;
        self.schedule(&cycle, at);
        self.speak(at, bus);
    }

    /// Every command of the cycle must have come.
    fn end_cycle(&mut self) {
        let Some(awaited) = self.awaited else { return };
        self.played.difference = awaited.missing();
        if self.played.difference.is_some() {
            self.is_over = true;
            return;
        }
        self.played.cycles += 1;
        self.played.commands += awaited.heard() as u64;
        self.played.machine_s = self.played.cycles as f64 * self.period_s;
        if self.was_refused {
            self.end_early("the recorded bus refused a command, of which the host here is not told");
        }
    }

    fn take_command(&mut self, frame: &Frame) {
        let (Some(axis), Some(awaited)) = (self.frames.axis_commanded(frame), &mut self.awaited) else {
            return;
        };
        self.played.difference = awaited.hear(&self.frames, axis, frame);
        self.is_over = self.played.difference.is_some();
        let is_last = awaited.missing().is_none() && self.recorded.ahead().is_none();
        if !self.is_over && is_last {
            self.end_cycle();
            self.end_where_the_log_does();
        }
    }

    /// Frames of a cycle, and those that came before the next one woke: these are read in the next, and sent
    /// when they came.
    fn schedule(&mut self, cycle: &RecordedCycle, sync: Moment) {
        let RecordedCycle { record, inputs } = cycle;
        let woke = record.timing.woke;
        let moment = |received: &Received| sync + (received.at - woke);
        let own = self.frames.received(record, inputs);
        if self.timing == Timing::AtOnce {
            self.due.extend(own.iter().map(|received| (sync, received.frame)));
            return;
        }
        // Those from before the first SYNC come at it; of a later cycle they are sent already.
        let is_first = self.played.cycles == 0;
        let within = own.iter().filter(|received| received.at >= woke || is_first);
        self.due.extend(within.map(|received| (moment(received), received.frame)));
        if let Some(RecordedCycle { record, inputs }) = self.recorded.ahead() {
            let early = self.frames.received(record, inputs);
            let early = early.iter().filter(|received| received.at < record.timing.woke);
            self.due.extend(early.map(|received| (moment(received), received.frame)));
        }
    }

    fn end_where_the_log_does(&mut self) {
        self.is_over = true;
        let why = self.recorded.ended_early();
        self.played.ended_early = self.played.ended_early.take().or(why.map(str::to_owned));
    }

    fn end_early(&mut self, why: &str) {
        self.is_over = true;
        let cycle = self.played.cycles;
        self.played.ended_early.get_or_insert(format!("behind {cycle} cycles: {why}"));
    }
}

fn heartbeats_before(first: Option<&RecordedCycle>) -> Vec<Frame> {
    let inputs = first.map_or(&[][..], |first| &first.inputs);
    let before = inputs.iter().filter_map(|input| match input.what {
        What::Before(received) => Some(received.frame),
        What::Order(_) | What::Frame { .. } => None,
    });
    before.collect()
}

/// What nobody at the other end of a bus can do to a host.
fn unplayable(record: &CycleRecord) -> Option<&'static str> {
    if record.bus.sync != Refusal::None {
        return Some("the recorded bus refused a SYNC, of which the host here is not told");
    }
    (record.bus.state == BusState::BusOff)
        .then_some("the recorded host's own controller left the bus, and that of the host here did not")
}
