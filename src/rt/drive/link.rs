//! One axis' end of the link to its board: takes its frames, keeps its observation.
//!
//! Wrap-around, scale, velocity and freshness of one axis meet here.
//! Invariant: an unusable frame changes counters and nothing else.

use super::liveness::{Judgement, Liveness};
use super::state::DriveState;
use super::velocity::VelocityEstimator;
use super::{DriveSettings, Events, Observation, Taken};
use crate::base::command::Command;
use crate::base::record::Arrival;
use crate::base::sample::{Freshness, RawFeedback, Sample};
use crate::base::time::{Moment, Span};
use crate::rt::bus::{Frame, Received};
use crate::rt::wire::command::{CYCLIC_SYNCHRONOUS_TORQUE, RawCommand};
use crate::rt::wire::feedback::BoardFlags;
use crate::rt::wire::scaling::{AxisScale, CurrentCounts, EncoderCounts, Odometer};
use crate::rt::wire::state::Emergency;
use crate::rt::wire::{Node, command, feedback, state};

/// The host's end of the link to one board.
#[derive(Clone, Copy, Debug)]
pub(super) struct Link {
    node: Node,
    scale: AxisScale,
    motor: Odometer,
    table: Odometer,
    velocity: VelocityEstimator,
    liveness: Liveness,
    command_sequence: u8,
    pub(super) observation: Observation,
}

impl Link {
    pub(super) fn new(settings: &DriveSettings, period: Span) -> Self {
        Self {
            node: settings.node,
            scale: settings.scale,
            motor: Odometer::default(),
            table: Odometer::default(),
            velocity: VelocityEstimator::new(settings.velocity_estimate, period),
            liveness: Liveness::default(),
            command_sequence: 0,
            observation: Observation::default(),
        }
    }
    pub(super) const fn node(&self) -> Node {
        self.node
    }

    /// What was heard while commissioning is no news for the cycle.
    pub(super) fn start(&mut self) {
        self.liveness.start();
        self.observation = Observation::default();
    }

    /// A cycle begins: nothing of it is fresh yet, nothing has happened in it.
    pub(super) fn begin(&mut self, cycle: u64, until: Moment) {
        self.liveness.begin(cycle, until);
        let sample = &mut self.observation.sample;
        sample.freshness = match sample.freshness {
            Freshness::Never => Freshness::Never,
            Freshness::Fresh | Freshness::Stale => Freshness::Stale,
        };
        self.observation.events =
            Events { board_flags: self.observation.events.board_flags, ..Events::default() };
    }

    /// A cycle has received all it will.
    pub(super) fn end(&mut self, cycle: u64, until: Moment) {
        let sample = &mut self.observation.sample;
        sample.age_cycles = self.liveness.age_cycles(cycle);
        self.liveness.counts.missed += u32::from(sample.freshness != Freshness::Fresh);
        self.observation.link = self.liveness.counts;
        self.observation.events.heartbeat_age = self.liveness.heartbeat_age(until);
    }

    /// Takes a feedback frame; whether it is the answer this cycle waits for.
    pub(super) fn take_feedback(&mut self, received: &Received, place: u8, cycle: u64) -> Taken {
        let Ok(raw) = feedback::decode(&received.frame) else {
            self.liveness.counts.malformed += 1;
            return Taken::Aside;
        };
        match self.liveness.judge(&raw, cycle) {
            Judgement::Unusable => Taken::Aside,
            Judgement::Fresh { periods } => {
                self.observation.sample = self.sample(raw, periods.unwrap_or(1));
                self.observation.arrival = Arrival { place, at: received.at };
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
        Sample {
            raw,
            freshness: Freshness::Fresh,
            age_cycles: 0,
            position,
            velocity: self.velocity.advance(position, periods),
            table_position: self.scale.table_position(table),
            current: self.scale.current(CurrentCounts::ua(raw.current_ua)),
        }
    }

    pub(super) fn take_heartbeat(&mut self, received: &Received) {
        match state::decode_heartbeat(&received.frame) {
            Ok(heartbeat) => {
                let is_reset = self.liveness.heartbeat(heartbeat, received.at);
                self.observation.events.is_board_reset |= is_reset;
            }
            Err(_unreadable) => self.liveness.counts.malformed += 1,
        }
    }

    pub(super) fn take_emergency(&mut self, frame: &Frame) {
        match state::decode_emergency(frame) {
            Ok(emergency) => {
                self.liveness.counts.emergencies += 1;
                if emergency.code != Emergency::CODE_NONE {
                    // The first is the cause, the others tend to follow from it.
                    self.observation.events.emergency.get_or_insert(emergency);
                }
            }
            Err(_unreadable) => self.liveness.counts.malformed += 1,
        }
    }

    /// The next command frame; its sequence is new whether or not the bus takes it.
    pub(super) fn command_frame(&mut self, wanted: &Command, cycle: u64) -> Frame {
        self.command_sequence = self.command_sequence.wrapping_add(1);
        let raw = RawCommand {
            current: self.scale.current_counts(wanted.current),
            control_word: wanted.control_word,
            cycle: cycle as u16,
            sequence: self.command_sequence,
            mode_of_operation: CYCLIC_SYNCHRONOUS_TORQUE,
        };
        command::encode(self.node, &raw)
    }
}
