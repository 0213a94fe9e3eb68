//! One axis' end of the link to its board: takes its frames, keeps its observation.
//!
//! Wrap-around, scale, velocity and freshness of one axis meet here.
//! Invariant: an unusable frame changes counters and nothing else.

use super::bend::Bend;
use super::board_clock::{BoardClock, Step};
use super::halves::{Doubt, Halves, Piece};
use super::liveness::{Judgement, Liveness, count, periods_between};
use super::state::DriveState;
use super::velocity::VelocityEstimator;
use super::{DriveSettings, Events, Observation, Taken};
use crate::base::command::Command;
use crate::base::input::Inputs;
use crate::base::record::{Arrival, Arrivals, LinkCounts};
use crate::base::sample::{Freshness, RawFeedback, Sample};
use crate::base::time::{Moment, Span};
use crate::base::units::Acceleration;
use crate::rt::bus::{Frame, Received};
use crate::rt::wire::command::{CYCLIC_SYNCHRONOUS_TORQUE, RawCommand};
use crate::rt::wire::feedback::BoardFlags;
use crate::rt::wire::scaling::{AxisScale, CurrentCounts, EncoderCounts, Odometer};
use crate::rt::wire::state::Emergency;
use crate::rt::wire::{Address, Layout, Malformed, Node, classic, feedback, state};

/// The host's end of the link to one board.
#[derive(Clone, Copy, Debug)]
pub(super) struct Link {
    node: Node,
    layout: Layout,
    halves: Halves,
    scale: AxisScale,
    motor: Odometer,
    table: Odometer,
    velocity: VelocityEstimator,
    bend: Bend,
    clock: BoardClock,
    period_s: f64,
    liveness: Liveness,
    /// End of this cycle's reply window.
    until: Moment,
    command_sequence: u8,
    pub(super) observation: Observation,
}

impl Link {
    pub(super) fn new(settings: &DriveSettings, period: Span) -> Self {
        Self {
            node: settings.node,
            layout: settings.layout,
            halves: Halves::default(),
            scale: settings.scale,
            motor: Odometer::default(),
            table: Odometer::default(),
            velocity: VelocityEstimator::new(settings.velocity_estimate, period),
            bend: Bend::new(settings.scale.motor_resolution()),
            clock: BoardClock::new(period),
            period_s: period.as_s(),
            liveness: Liveness::default(),
            until: Moment::ZERO,
            command_sequence: 0,
            observation: Observation::default(),
        }
    }
    pub(super) const fn node(&self) -> Node {
        self.node
    }
    pub(super) const fn counts(&self) -> &LinkCounts {
        &self.liveness.counts
    }

    /// What was heard while commissioning is no news for the cycle.
    pub(super) fn start(&mut self) {
        self.liveness.start();
        self.observation = Observation::default();
    }

    /// A cycle begins: nothing of it is fresh yet, nothing has happened in it.
    pub(super) fn begin(&mut self, cycle: u64, until: Moment) {
        self.until = until;
        self.liveness.begin(cycle, until);
        let sample = &mut self.observation.sample;
        sample.freshness = match sample.freshness {
            Freshness::Never => Freshness::Never,
            Freshness::Fresh | Freshness::Stale => Freshness::Stale,
        };
        self.observation.acceleration = Acceleration::ZERO;
        self.observation.events =
            Events { board_flags: self.observation.events.board_flags, ..Events::default() };
    }

    /// A cycle has received all it will; pieces without their rest go to the inputs.
    pub(super) fn end(&mut self, cycle: u64, until: Moment, inputs: &mut Inputs) {
        match self.halves.end(cycle, inputs) {
            Doubt::None => {}
            Doubt::Late => count(&mut self.liveness.counts.late, true),
            // A boot-up message tells it too.
            Doubt::Restart if self.observation.events.is_board_reset => {}
            Doubt::Restart => {
                self.clock.restart();
                self.restarted();
            }
        }
        let sample = &mut self.observation.sample;
        sample.age_cycles = self.liveness.age_cycles(cycle);
        count(&mut self.liveness.counts.missed, sample.freshness != Freshness::Fresh);
        self.observation.events.heartbeat_age = self.liveness.heartbeat_age(until);
    }

    /// Takes a feedback frame; whether it is the answer this cycle waits for.
    pub(super) fn take_feedback(&mut self, received: &Received, place: u8, cycle: u64) -> Taken {
        if received.at > self.until {
            // The window was over; it is met here because the host was late as well.
            count(&mut self.liveness.counts.late, true);
            return Taken::Aside;
        }
        match self.whole(received, place, cycle) {
            Ok(Whole::Feedback { raw, arrivals }) => self.use_feedback(raw, arrivals, cycle),
            Ok(Whole::Not(taken)) => taken,
            Err(_unreadable) => {
                count(&mut self.liveness.counts.malformed, true);
                Taken::Aside
            }
        }
    }

    /// A feedback from its frame, or from this frame and one that was here before.
    fn whole(&mut self, received: &Received, place: u8, cycle: u64) -> Result<Whole, Malformed> {
        let frame = &received.frame;
        let is_first = Address::of(frame.id()) == Some(Address::Feedback(self.node));
        let piece = match self.layout {
            Layout::Fd if is_first => {
                let arrival = Arrival { place, at: received.at };
                let arrivals = Arrivals { motor: arrival, table: arrival };
                return feedback::decode(frame).map(|raw| Whole::Feedback { raw, arrivals });
            }
            // On FD nobody has a second frame to send.
            Layout::Fd => {
                count(&mut self.liveness.counts.malformed, true);
                return Ok(Whole::Not(Taken::Aside));
            }
            Layout::Classic if is_first => {
                self.halves.take_motor(classic::decode_motor(frame)?, received, place, cycle)
            }
            Layout::Classic => {
                let half = classic::decode_table(frame)?;
                let periods = self.liveness.last_fresh().map_or(1, |fresh| periods_between(fresh, cycle));
                let board_time_us = self.clock.completed_us(half.board_time_us, periods);
                self.halves.take_table(half, board_time_us, received, place, cycle)
            }
        };
        Ok(match piece {
            Piece::Whole { motor, table, board_time_us, arrivals } => {
                Whole::Feedback { raw: classic::join(motor, table, board_time_us), arrivals }
            }
            Piece::Held => Whole::Not(Taken::Held),
            Piece::Late => {
                count(&mut self.liveness.counts.late, true);
                Whole::Not(Taken::Aside)
            }
            Piece::Repeated => {
                count(&mut self.liveness.counts.repeated, true);
                Whole::Not(Taken::Aside)
            }
        })
    }

    fn use_feedback(&mut self, raw: RawFeedback, arrivals: Arrivals, cycle: u64) -> Taken {
        let judgement = match self.layout {
            Layout::Fd => self.liveness.judge(&raw, cycle),
            // What was joined answers this cycle, for the first time.
            Layout::Classic => Judgement::Fresh { periods: self.liveness.accept(&raw, cycle) },
        };
        match judgement {
            Judgement::Unusable => Taken::Aside,
            Judgement::Fresh { periods } => {
                self.halves.clear();
                self.observation.sample = self.sample(raw, periods.unwrap_or(1));
                self.observation.arrivals = arrivals;
                self.observation.drive = DriveState::decode(raw.status_word);
                self.observation.events.board_flags = BoardFlags::from_bits(raw.board_flags);
                Taken::Fresh
            }
        }
    }

    fn sample(&mut self, raw: RawFeedback, periods: u32) -> Sample {
        let motor = self.motor.advance(EncoderCounts::counts(raw.motor_counts));
        let table = self.table.advance(EncoderCounts::counts(raw.table_counts));
        let position = self.scale.motor_position(motor);
        let step = self.clock.latch(raw.board_time_us, periods);
        if step == Step::Jump {
            self.restarted();
        }
        let since_s = match step {
            Step::First | Step::Jump => {
                self.bend.reset();
                self.period_s
            }
            Step::Periods(periods) => self.period_s * f64::from(periods),
            Step::Time(span) => span.as_s(),
        };
        self.observation.acceleration = self.bend.advance(position, since_s);
        Sample {
            raw,
            freshness: Freshness::Fresh,
            age_cycles: 0,
            position,
            velocity: match step {
                Step::First | Step::Jump => self.velocity.advance(position, periods),
                Step::Periods(periods) => self.velocity.advance(position, periods),
                Step::Time(span) => self.velocity.advance_by(position, span),
            },
            table_position: self.scale.table_position(table),
            current: self.scale.current(CurrentCounts::ua(raw.current_ua)),
        }
    }

    /// The clock of the board began again.
    fn restarted(&mut self) {
        self.liveness.restarted();
        self.observation.events.is_board_reset = true;
    }

    pub(super) fn take_heartbeat(&mut self, received: &Received) {
        match state::decode_heartbeat(&received.frame) {
            Ok(heartbeat) => {
                let is_reset = self.liveness.heartbeat(heartbeat, received.at);
                if is_reset {
                    // Its clock begins again, which is no second event.
                    self.clock.restart();
                    self.observation.events.is_board_reset = true;
                }
            }
            Err(_unreadable) => count(&mut self.liveness.counts.malformed, true),
        }
    }

    pub(super) fn take_emergency(&mut self, frame: &Frame) {
        match state::decode_emergency(frame) {
            Ok(emergency) => {
                count(&mut self.liveness.counts.emergencies, true);
                if emergency.code != Emergency::CODE_NONE {
                    // The first is the cause, the others tend to follow from it.
                    self.observation.events.emergency.get_or_insert(emergency);
                }
            }
            Err(_unreadable) => count(&mut self.liveness.counts.malformed, true),
        }
    }

    /// The next command frame; its sequence is new whether or not the bus takes it.
    pub(super) fn command_frame(&mut self, wanted: &Command, cycle: u64) -> Frame {
        self.command_sequence = self.command_sequence.wrapping_add(1);
        let raw = raw_command(&self.scale, wanted, cycle, self.command_sequence);
        self.layout.command(self.node, &raw)
    }
}

/// A command of `cycle` as it travels. Its sequence counts the cycles that were run, from 1.
pub fn raw_command(scale: &AxisScale, wanted: &Command, cycle: u64, sequence: u8) -> RawCommand {
    RawCommand {
        current: scale.current_counts(wanted.current),
        control_word: wanted.control_word,
        cycle: cycle as u16,
        sequence,
        mode_of_operation: CYCLIC_SYNCHRONOUS_TORQUE,
    }
}

/// A feedback frame, seen for what it completes.
enum Whole {
    /// Everything is there.
    Feedback { raw: RawFeedback, arrivals: Arrivals },
    /// Nothing to use.
    Not(Taken),
}
