//! The conductor: one period of the machine, from frames in to frames out and record.
//!
//! ```text
//!   orders ─► collect ─► mode ─► control ─► dispatch ─► record
//! ```
//!
//! [`Cycle::run`] is the same on the machine, in simulation and in replay: the bus, the orders and the
//! slot on the grid are arguments. The period ends well before the next: feedback that is not there by
//! the end of the reply window is stale, and an axis that stays without is stopped.
//! Invariant: record and inputs hold everything that the cycle read and decided.

mod at_rest;
pub mod bucket;
pub mod mode;
pub mod pace;
pub mod procedure;
mod reset;
mod seen;
pub mod standby;
mod verdict;

use crate::base::axis::PerAxis;
use crate::base::command::{Command, Limits as Acted};
use crate::base::fault::Fault;
use crate::base::input::{Input, Inputs, What};
use crate::base::order::ExcitedMotion;
use crate::base::record::{CycleRecord, LinkCounts, Refusal, Stage, Timing};
use crate::base::sample::Freshness;
use crate::base::time::{Moment, Span};
use crate::base::units::Acceleration;
use crate::rt::bus::Bus;
use crate::rt::control::{self, Answer, AxisLoop, profile::Profile};
use crate::rt::door::{Order, Orders, Records};
use crate::rt::drive::state::{self, Target};
use crate::rt::drive::{Drives, Observation, Operational};

use at_rest::AtRest;
use bucket::{Bucket, BucketLimit};
use mode::{Mode, Patience, Sight, Wish};
use pace::{Pace, Slot};
use reset::Resets;

/// What sets a cycle, beside the settings of its axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The position loop acts, and orders are taken, in each so many cycles.
    pub position_every: u32,
    /// From the SYNC to the last moment at which feedback counts as fresh.
    pub reply_window: Span,
    /// Cycles without fresh feedback that are borne.
    pub stale_cycles_max: u32,
    /// Longest silence between heartbeats.
    pub heartbeat_timeout: Span,
    /// How long enabling and stopping may take.
    pub patience: Patience,
    /// Periods skipped at once that are borne: for so long the last current flows and nobody watches.
    pub pause_cycles_max: u32,
    /// How many missed periods are borne.
    pub overruns: BucketLimit,
    /// How much missed feedback and how many unusable frames of a board are borne.
    pub losses: BucketLimit,
    /// Along the path when a motion is stopped.
    pub stop_acceleration: Acceleration,
}

/// The machine's cycle.
#[derive(Debug)]
pub struct Cycle {
    settings: Settings,
    drives: Drives<Operational>,
    loops: PerAxis<AxisLoop>,
    modes: PerAxis<Mode>,
    answers: PerAxis<Answer>,
    commands: PerAxis<Command>,
    profile: Profile,
    overruns: Bucket,
    /// Before the first cycle none is missed: the grid may begin before the threads are there.
    overruns_seen: Option<u64>,
    losses: PerAxis<Bucket>,
    resets: PerAxis<Resets>,
    at_rest: AtRest,
    next_order_slot: u64,
    record: CycleRecord,
    inputs: Inputs,
}

impl Cycle {
    /// A cycle over commissioned drives; every axis off.
    pub fn new(settings: Settings, drives: Drives<Operational>, axes: &PerAxis<control::Settings>) -> Self {
        let count = axes.count();
        Self {
            settings,
            drives,
            loops: axes.map(|_, axis| AxisLoop::new(axis)),
            modes: PerAxis::filled(count, Mode::Off),
            answers: PerAxis::filled(count, Answer::default()),
            commands: PerAxis::filled(count, Command::default()),
            profile: Profile::new(count),
            overruns: Bucket::new(settings.overruns),
            overruns_seen: None,
            losses: PerAxis::filled(count, Bucket::new(settings.losses)),
            resets: PerAxis::filled(count, Resets::default()),
            at_rest: AtRest::default(),
            next_order_slot: 0,
            record: CycleRecord::empty(count),
            inputs: Inputs::default(),
        }
    }

    /// One period: its record and what it was told. The `clock` is asked where a part of the period
    /// ends, for the record alone; nothing is decided by it.
    pub fn run<B: Bus>(
        &mut self,
        bus: &mut B,
        orders: &mut impl Orders,
        slot: &Slot,
        clock: &mut impl FnMut() -> Moment,
    ) -> (&mut CycleRecord, &Inputs) {
        let now = slot.timing.scheduled;
        self.inputs.clear();
        let is_position_tick = self.is_position_tick(slot);
        let order = if is_position_tick { orders.next(&self.record) } else { None };
        if let Some(order) = order {
            self.inputs.push(Input { cycle: slot.number, what: What::Order(order) });
        }
        let until = now + self.settings.reply_window;
        self.drives.collect(bus, slot.number, until, &mut self.inputs);
        let collected = clock();
        let wish = self.take(order, now);
        self.pass(slot);
        self.decide(wish, slot);
        self.profile.advance(now);
        self.control(is_position_tick);
        let decided = clock();
        // A refusal stands in the record, and the next cycle judges it there.
        let refusals = self.drives.dispatch(bus, &self.commands, slot.number);
        self.write_record(&refusals, slot, Timing { collected, decided, ..slot.timing });
        (&mut self.record, &self.inputs)
    }

    /// Every so many slots; a skipped tick of the position loop is made up for in the next slot.
    fn is_position_tick(&mut self, slot: &Slot) -> bool {
        let is_due = slot.number >= self.next_order_slot;
        if is_due {
            let every = u64::from(self.settings.position_every);
            self.next_order_slot = (slot.number / every + 1) * every;
        }
        is_due
    }

    /// The periods since the last cycle are over, run or skipped.
    fn pass(&mut self, slot: &Slot) {
        let periods = slot.number.saturating_sub(self.record.cycle);
        self.loops.as_mut_slice().iter_mut().for_each(|axis| axis.pass(periods));
    }

    /// Carry out what concerns the motion; return what concerns the modes.
    fn take(&mut self, order: Option<Order>, now: Moment) -> Wish {
        let all_ready = self.modes.as_slice().iter().all(|mode| *mode == Mode::Ready);
        match order {
            None => return Wish::Nothing,
            Some(Order::Enable) => return Wish::Enable,
            Some(Order::Disable) => return Wish::Disable,
            Some(Order::Stop) => return Wish::Stop,
            Some(Order::ClearFaults) => return Wish::ClearFault,
            Some(Order::UseGains(set)) => self.use_gains(set),
            Some(Order::Line(line)) if all_ready => {
                if self.profile.start_line(&line, now) {
                    self.record.stage.motion += 1;
                }
            }
            Some(Order::Circle(circle)) if all_ready => {
                if self.profile.start_circle(&circle, now) {
                    self.record.stage.motion += 1;
                }
            }
            Some(Order::Excited(motion)) if all_ready && self.admits(&motion) => {
                if self.profile.start_excited(&motion, now) {
                    self.record.stage.motion += 1;
                }
            }
            // A motion is not begun while another runs or an axis is not ready.
            Some(Order::Line(_) | Order::Circle(_) | Order::Excited(_)) => {}
        }
        Wish::Nothing
    }

    /// Whether the machine has the axis to be excited, and its limits allow it.
    fn admits(&self, motion: &ExcitedMotion) -> bool {
        let excited = self.loops.iter().find(|(axis, _)| *axis == motion.excitation.axis);
        excited.is_some_and(|(_, axis_loop)| axis_loop.admits(motion))
    }

    fn use_gains(&mut self, set: u8) {
        for (axis, axis_loop) in self.loops.iter_mut() {
            let sample = &self.record.axes[axis].sample;
            axis_loop.use_gains(set, &self.profile.setpoints()[axis], sample);
        }
    }

    /// What is wrong, what was wished, and so the mode of each axis.
    fn decide(&mut self, wish: Wish, slot: &Slot) {
        let now = slot.timing.scheduled;
        let (observed, counts) = (self.drives.observations(), self.drives.link_counts());
        let seen = self.overruns_seen.replace(slot.overruns).unwrap_or(slot.overruns);
        let skipped = slot.overruns.saturating_sub(seen);
        let is_overrun = self.overruns.cycle(skipped) || skipped > u64::from(self.settings.pause_cycles_max);
        let any_fault = self.modes.as_slice().iter().any(|mode| mode.fault().is_some());
        for (axis, mode) in self.modes.iter_mut() {
            let observation = observed[axis];
            let limits = self.loops[axis].limits();
            let expected = self.loops[axis].expected();
            let is_lossy =
                self.losses[axis].cycle(losses(observation, counts[axis], &self.record.axes[axis].link));
            let commands = self.record.commands();
            let of_link = verdict::of_link(observation, *mode, commands, is_lossy, &self.settings);
            let violation = self.loops[axis].violation(&observation.sample);
            let is_jump = self.loops[axis].is_jump(&observation.sample, observation.acceleration);
            let of_axis = verdict::of_axis(*mode, is_jump, &self.answers[axis], violation);
            let own = verdict::worst(of_link, of_axis);
            let shared = is_overrun.then_some(Fault::Overrun).or(any_fault.then_some(Fault::OtherAxis));
            let sight = Sight {
                now,
                wish,
                fault: own.or(shared.filter(|_| mode.wants_drive())),
                drive_is_enabled: observation.sample.freshness == Freshness::Fresh
                    && observation.drive == Some(state::DriveState::OperationEnabled),
                motion_is_running: self.profile.is_running(),
                // A stale velocity says nothing about now.
                is_standing: observation.sample.freshness == Freshness::Fresh
                    && limits.is_standing(observation.sample.velocity)
                    && limits.is_standing(expected.expected_velocity()),
            };
            let next = mode.next(&sight, &self.settings.patience);
            if wish == Wish::ClearFault || (next == Mode::Off && *mode != Mode::Off) {
                self.resets[axis] = Resets::default();
            }
            *mode = next;
        }
        if self.modes.as_slice().iter().any(|mode| !matches!(mode, Mode::Ready | Mode::Moving { .. })) {
            self.profile.stop(self.settings.stop_acceleration, now);
        }
        if !self.modes.as_slice().iter().any(|mode| mode.is_energised()) {
            // Nobody is on the path any more; an axis that is enabled again starts from where it stands.
            self.profile.abandon();
        }
        let wants_drive = self.modes.as_slice().iter().any(|mode| mode.wants_drive());
        let settled = self.loops.iter().map(|(axis, axis_loop)| {
            at_rest::has_settled(observed[axis], axis_loop.limits(), self.settings.stale_cycles_max)
        });
        self.at_rest.see(wants_drive, settled, now, self.settings.patience.stopping);
    }

    /// Whether no axis has current or moves, as far as it is heard, or one would not come to rest in time.
    pub const fn is_at_rest(&self) -> bool {
        self.at_rest.is_over()
    }

    /// A command for each axis: the loops where current may flow, zero where not.
    fn control(&mut self, is_position_tick: bool) {
        let observed = self.drives.observations();
        for (axis, command) in self.commands.iter_mut() {
            let (mode, observation) = (self.modes[axis], observed[axis]);
            let answer = &mut self.answers[axis];
            if !mode.is_energised() {
                self.loops[axis].follow(&observation.sample);
                self.profile.stand(axis, observation.sample.position);
                *answer = Answer::default();
            } else if observation.sample.freshness == Freshness::Fresh {
                let setpoint = &self.profile.setpoints()[axis];
                self.loops[axis].excite(self.profile.excitation(axis));
                *answer = self.loops[axis].step(setpoint, &observation.sample, is_position_tick);
            } else {
                // The last answer stands until fresh feedback comes or the fault takes it away.
                self.loops[axis].miss(is_position_tick);
            }
            let target = match mode {
                Mode::Off => self.resets[axis].target(observation.drive),
                Mode::Faulted { .. } => Target::Disabled,
                Mode::Enabling { .. } | Mode::Ready | Mode::Moving { .. } | Mode::Stopping { .. } => {
                    Target::Enabled
                }
            };
            let is_saturated = verdict::is_saturated(observation);
            *command = Command {
                current: answer.current,
                control_word: state::control_word(observation.drive, target, command.control_word),
                terms: answer.terms,
                limits: answer.limits.with(Acted::when(is_saturated, Acted::DRIVE)),
            };
        }
    }

    fn write_record(&mut self, refusals: &PerAxis<Refusal>, slot: &Slot, timing: Timing) {
        let (observed, counts) = (self.drives.observations(), self.drives.link_counts());
        let record = &mut self.record;
        record.cycle = slot.number;
        record.timing = timing;
        record.overruns = slot.overruns;
        record.bus = *self.drives.bus();
        record.stage = Stage { is_measured: self.profile.is_measured(slot.timing.scheduled), ..record.stage };
        for (axis, row) in record.axes.iter_mut() {
            row.mode = self.modes[axis].tag();
            row.fault = self.modes[axis].fault();
            row.gain_set = self.loops[axis].gain_set();
            row.setpoint = self.profile.setpoints()[axis];
            row.sample = observed[axis].sample;
            row.arrivals = observed[axis].arrivals;
            row.link = *counts[axis];
            row.command = self.commands[axis];
            row.refusal = refusals[axis];
        }
    }
}

/// What a cycle lost of one board: its fresh feedback, and frames that came and could not be used.
fn losses(observation: &Observation, now: &LinkCounts, before: &LinkCounts) -> u64 {
    let unusable =
        |counts: &LinkCounts| counts.late.wrapping_add(counts.repeated).wrapping_add(counts.malformed);
    u64::from(observation.sample.freshness != Freshness::Fresh)
        + u64::from(unusable(now).wrapping_sub(unusable(before)))
}

/// Run cycles until the orders say that it is done and the axes are at rest; the last record.
pub fn conduct<B: Bus>(
    cycle: &mut Cycle,
    bus: &mut B,
    pace: &mut impl Pace,
    orders: &mut impl Orders,
    records: &mut impl Records,
) -> CycleRecord {
    loop {
        let slot = pace.wait();
        let (record, inputs) = cycle.run(bus, orders, &slot, &mut || pace.now());
        record.lost_records = records.lost() + inputs.lost();
        records.put(record, inputs);
        let is_done = orders.is_done(record);
        pace.finish();
        if is_done && cycle.is_at_rest() {
            return cycle.record;
        }
    }
}
