//! Promise: the simulated machine on the wall clock is the one of virtual time, seen at other moments. At
//! exactly the grid a circle shows the same protrusions; between the steps of the plant encoders are latched
//! where the axis is; a board whose host is silent looks after its axis alone.
#![cfg(feature = "offline")]

mod stall;
mod truth;

use std::sync::Arc;

use quadrant::base::axis::AxisId;
use quadrant::base::motion::Direction;
use quadrant::base::record::CycleRecord;
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Current, Position};
use quadrant::config::Machine;
use quadrant::offline::circle::protrusion::QuadrantHeights;
use quadrant::offline::circle::{Run, analyse};
use quadrant::offline::trace::Trace;
use quadrant::plant::State;
use quadrant::rt::bus::memory::{self, End};
use quadrant::rt::bus::{Bus, Frame, Received, SendError};
use quadrant::rt::control::profile::CircleMotion;
use quadrant::rt::cycle::pace::Virtual;
use quadrant::rt::cycle::procedure::{CircleTest, Ending, Procedure};
use quadrant::rt::cycle::{Cycle, conduct};
use quadrant::rt::drive::commission::CommissionSettings;
use quadrant::rt::drive::sheet::CommandApplies;
use quadrant::rt::drive::state::DriveState;
use quadrant::rt::wire::command::{CYCLIC_SYNCHRONOUS_TORQUE, RawCommand};
use quadrant::rt::wire::scaling::CurrentCounts;
use quadrant::rt::wire::state::{self, Emergency};
use quadrant::rt::wire::{Address, command, feedback};
use quadrant::sim::live_rack::LiveRack;
use truth::Truth;

use crate::common::{Kept, X, Y, circle, machine, machine_with, run_circles};

const PERIOD: Span = Span::us(500);
/// The rack's steps.
const STEP: Span = Span::us(50);
/// When the boards get power; the cycle's moment zero comes later.
const POWER_ON: Moment = Moment::ns(-1_000_000_000);

/// A host's end of a bus with a live rack at the other: the rack sees each frame at a moment of its own.
struct Clocked {
    host: End,
    machine: End,
    rack: LiveRack,
    /// When the SYNC of a cycle comes to the boards, and its commands.
    sync_at: fn(u32) -> Moment,
    command_at: fn(u32) -> Moment,
    now: Moment,
    cycle: u32,
    anchors: Vec<Anchor>,
}

/// What the axes did at the end of the last step before a SYNC.
struct Anchor {
    at: Moment,
    states: [State; 2],
}

impl Clocked {
    fn new(rack: LiveRack, sync_at: fn(u32) -> Moment, command_at: fn(u32) -> Moment) -> Self {
        let (host, machine) = memory::pair(64);
        Self { host, machine, rack, sync_at, command_at, now: POWER_ON, cycle: 0, anchors: Vec::new() }
    }
}

impl Bus for Clocked {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        match Address::of(frame.id()) {
            Some(Address::Sync) => {
                self.cycle = command::decode_sync(frame).expect("the host sends whole frames");
                self.now = (self.sync_at)(self.cycle);
            }
            Some(Address::Command(_)) => self.now = (self.command_at)(self.cycle),
            _ => {}
        }
        self.host.send(frame)?;
        self.rack.serve(&mut self.machine, self.now);
        if Address::of(frame.id()) == Some(Address::Sync) {
            let steps = (self.now - POWER_ON) / STEP;
            let states = [X, Y].map(|axis| self.rack.state(axis));
            self.anchors.push(Anchor { at: POWER_ON + STEP * steps, states });
        }
        Ok(())
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        self.host.receive(until)
    }
}

fn on_grid(cycle: u32) -> Moment {
    Moment::ZERO + PERIOD * i64::from(cycle)
}

/// Up to 100 us early or late, in whole microseconds.
fn jittered(cycle: u32) -> Moment {
    on_grid(cycle) + Span::us(i64::from(cycle.wrapping_mul(2_654_435_761) >> 8) % 201 - 100)
}

fn late_command(cycle: u32) -> Moment {
    jittered(cycle) + Span::us(217)
}

/// A cycle over boards that are commissioned from the power-on of the rack.
fn cycle_on(machine: &Machine, bus: &mut impl Bus) -> Cycle {
    let mut now = POWER_ON;
    let clock = || {
        now = now + Span::ms(10);
        now
    };
    let drives = machine.drives().expect("each axis has its board");
    let drives = drives.commission(bus, CommissionSettings::default(), clock);
    let drives = drives.expect("boards like their sheets");
    Cycle::new(machine.cycle_settings(), drives, &machine.control_settings())
}

/// A circle in both axes over a live rack.
fn run(
    machine: &Machine,
    motion: CircleMotion,
    sync_at: fn(u32) -> Moment,
    command_at: fn(u32) -> Moment,
) -> (Vec<CycleRecord>, Vec<Anchor>) {
    let mut bus = Clocked::new(machine.live_rack(7, POWER_ON), sync_at, command_at);
    let mut cycle = cycle_on(machine, &mut bus);
    let test = CircleTest {
        gain_set: 0,
        circles: [Some(motion), None],
        positioning_feed: machine.motion.positioning_feed,
    };
    let mut procedure = Procedure::new(test, Arc::default());
    let mut kept = Kept::default();
    let last = conduct(&mut cycle, &mut bus, &mut Virtual::new(PERIOD), &mut procedure, &mut kept);
    assert_eq!(procedure.ending(&last), Ending::Complete);
    (kept.0, bus.anchors)
}

fn heights(motion: &CircleMotion, [with, without]: [&[CycleRecord]; 2]) -> QuadrantHeights {
    let trace = |records: &[CycleRecord]| {
        let whole = Trace::from_records(records).expect("records in order");
        whole.stretch(2).expect("the circle is the second motion")
    };
    let (with, without) = (trace(with), trace(without));
    let run = Run { nominal: motion.circle, trace: &with, friction_free: Some(&without) };
    analyse(&[run]).expect("a whole circle").motor.protrusion_um
}

#[test]
fn at_exactly_the_grid_a_circle_shows_the_same_protrusions() {
    for name in ["reference", "paper"] {
        let machine = machine(name);
        let smooth = machine.clone().without_friction();
        let motion = circle(2000.0, Direction::Ccw);
        let [virtual_um, live_um] = [
            heights(
                &motion,
                [
                    &run_circles(&machine, "standard", &[motion], 7),
                    &run_circles(&smooth, "standard", &[motion], 7),
                ],
            ),
            heights(
                &motion,
                [&run(&machine, motion, on_grid, on_grid).0, &run(&smooth, motion, on_grid, on_grid).0],
            ),
        ];
        println!("{name}: {virtual_um:?} in virtual time, {live_um:?} on the clock");
        let each =
            |heights: QuadrantHeights| [heights.x_plus, heights.y_plus, heights.x_minus, heights.y_minus];
        for (one, other) in each(virtual_um).into_iter().zip(each(live_um)) {
            let off_um = (one - other).abs();
            assert!(
                off_um < 0.01,
                "{name}: {one:.4} um and {other:.4} um, {off_um:.4} um apart, bound 0.01 um"
            );
        }
    }
}

/// How far the encoders of an axis were off at each SYNC, nm: against an axis that starts where the rack's was
/// one SYNC before, under the currents that the board applied since.
fn off_nm(machine: &Machine, axis: AxisId, records: &[CycleRecord], anchors: &[Anchor]) -> Vec<f64> {
    let settings = &machine.axes[axis];
    let dead_time = settings.plant.actuator.dead_time;
    // Each current from when it acts.
    let acts_at = |cycle: u32| match settings.sheet.command_applies {
        CommandApplies::OnReceipt => late_command(cycle) + dead_time,
        CommandApplies::OnNextSync => jittered(cycle + 1) + dead_time,
    };
    let current_at = |moment: Moment, near: usize| {
        let is_acting = |record: &&CycleRecord| acts_at(record.cycle as u32) <= moment;
        records[..=near].iter().rev().find(is_acting).map_or(Current::ZERO, |record| {
            let counts = settings.scale.current_counts(record.axes[axis].command.current);
            settings.scale.current(counts)
        })
    };
    (1..records.len())
        .map(|k| {
            let (mut now, state) = (anchors[k - 1].at, anchors[k - 1].states[axis.index()]);
            let mut truth = Truth::new(&settings.plant, &state);
            while now < jittered(records[k].cycle as u32) {
                truth.step(current_at(now, k));
                now = now + Span::us(1);
            }
            (records[k].axes[axis].sample.position.as_m() - truth.motor_m()) * 1e9
        })
        .collect()
}

/// An encoder so fine that what is off is the rack's.
const FINE_ENCODER: (&str, &str) = ("counts-per-rev = 1048576", "counts-per-rev = 268435456");

#[test]
fn syncs_that_jitter_find_the_axis_where_it_is() {
    for (name, edits) in [
        ("reference", &[FINE_ENCODER][..]),
        ("paper", &[]),
        ("reference", &[FINE_ENCODER, ("dead-time-us = 0", "dead-time-us = 730")]),
    ] {
        let machine = machine_with(name, edits);
        let mut motion = circle(3000.0, Direction::Ccw);
        motion.circle.radius = Position::mm(5.0);
        motion.run_in_s = 0.2;
        let (records, anchors) = run(&machine, motion, jittered, late_command);
        for axis in [X, Y] {
            let way_mm = records.iter().map(|record| record.axes[axis].sample.position.abs().as_mm());
            assert!(way_mm.fold(0.0, f64::max) > 3.0, "{name}: axis {axis} does not move");
            let mut off_nm = off_nm(&machine, axis, &records, &anchors);
            off_nm.iter_mut().for_each(|nm| *nm = nm.abs());
            off_nm.sort_by(f64::total_cmp);
            let (median_nm, largest_nm) = (off_nm[off_nm.len() / 2], off_nm[off_nm.len() - 1]);
            println!("{name} {edits:?} {axis}: {median_nm:.3} nm off, {largest_nm:.2} nm at most");
            assert!(largest_nm < 5.0, "{name}, axis {axis}: {largest_nm} nm off, bound 5 nm");
        }
    }
}

fn at(us: i64) -> Moment {
    Moment::ZERO + Span::us(us)
}

/// A rack of the reference machine without a host, and frames brought to it by hand.
struct ByHand {
    rack: LiveRack,
    host: End,
    machine: End,
    sequence: u8,
}

impl ByHand {
    fn new() -> Self {
        let (host, machine_end) = memory::pair(256);
        let rack = machine("reference").live_rack(7, Moment::ZERO);
        Self { rack, host, machine: machine_end, sequence: 0 }
    }
    fn bring(&mut self, frame: &Frame, moment: Moment) -> Vec<Frame> {
        self.host.send(frame).expect("room on the bus");
        self.pass(moment)
    }
    fn pass(&mut self, moment: Moment) -> Vec<Frame> {
        self.rack.serve(&mut self.machine, moment);
        std::iter::from_fn(|| self.host.receive(moment)).map(|received| received.frame).collect()
    }
    fn command(&mut self, current_a: f64, control_word: u16, moment: Moment) {
        self.sequence = self.sequence.wrapping_add(1);
        let raw = RawCommand {
            current: CurrentCounts::ua((current_a * 1e6) as i32),
            control_word,
            sequence: self.sequence,
            mode_of_operation: CYCLIC_SYNCHRONOUS_TORQUE,
            ..RawCommand::default()
        };
        let node = machine("reference").axes[X].node;
        self.bring(&command::encode(node, &raw), moment);
    }
    /// Periods with SYNC and a command of 4 A each, until the axis moves; the moment of the last command.
    fn set_moving(&mut self) -> Moment {
        for cycle in 0..400 {
            let start = PERIOD * cycle;
            self.bring(&command::encode_sync(cycle as u32), Moment::ZERO + start);
            let control_word = [0x06, 0x07, 0x0F][usize::try_from(cycle).map_or(2, |cycle| cycle.min(2))];
            self.command(4.0, control_word, Moment::ZERO + start + Span::us(300));
        }
        assert_eq!(self.rack.board_mut(X).drive(), DriveState::OperationEnabled);
        let speed_mm_per_s = self.rack.state(X).motor_velocity.as_mm_per_s();
        assert!(speed_mm_per_s > 50.0, "{speed_mm_per_s} mm/s");
        Moment::ZERO + PERIOD * 399 + Span::us(300)
    }
}

#[test]
fn a_board_whose_host_is_silent_takes_the_current_away_and_beats_on() {
    let mut by_hand = ByHand::new();
    by_hand.set_moving();
    // What the board applied last came into force at the last SYNC.
    let fed = Moment::ZERO + PERIOD * 399;
    let watchdog = machine("reference").axes[X].sheet.watchdog();
    let mut tripped = None;
    let mut beats = 0;
    for us in (0..3_000_000).step_by(1_000) {
        let now = fed + Span::us(1_000 + us);
        for frame in by_hand.pass(now) {
            let code = state::decode_emergency(&frame).map_or(0, |emergency| emergency.code);
            let is_emergency = matches!(Address::of(frame.id()), Some(Address::Emergency(_)));
            if is_emergency && code == Emergency::CODE_WATCHDOG {
                tripped.get_or_insert(now);
            }
            let is_beat = matches!(Address::of(frame.id()), Some(Address::Heartbeat(_)));
            beats += i32::from(is_beat);
        }
    }
    let late = tripped.expect("the watchdog trips without a frame") - (fed + watchdog);
    assert!(late >= Span::ZERO && late <= Span::us(1_050), "tripped {} us after its time", late.as_us());
    let state = by_hand.rack.state(X);
    assert!(state.is_stuck && state.current.as_a().abs() < 1e-9, "friction brakes it: {state:?}");
    // Two boards, one beat each 100 ms.
    assert!((58..=60).contains(&beats), "{beats} heartbeats in 3 s of silence");
}

#[test]
fn a_frame_that_is_looked_at_late_is_answered_as_of_when_it_came() {
    let feedback_of = |frames: Vec<Frame>| {
        let of_x = |frame: &Frame| frame.id() == Address::Feedback(machine("reference").axes[X].node).id();
        let frame = frames.into_iter().find(of_x).expect("X answers");
        feedback::decode(&frame).expect("a whole frame")
    };
    let answer = |looked_at_later: Span| {
        let mut by_hand = ByHand::new();
        let last = by_hand.set_moving();
        let came = last + Span::us(213);
        by_hand.rack.advance_to(came + looked_at_later);
        by_hand.rack.hear(&Received { frame: command::encode_sync(400), at: came });
        feedback_of(by_hand.pass(came + looked_at_later))
    };
    let (prompt, late) = (answer(Span::ZERO), answer(Span::us(1_500)));
    assert_eq!(prompt.board_time_us, 199_500 + 300 + 213, "the moment of the latch, in microseconds");
    assert_eq!(late.board_time_us, prompt.board_time_us);
    let apart = late.motor_counts.wrapping_sub(prompt.motor_counts) as i32;
    assert!(apart.abs() <= 1, "{apart} counts apart; 1.5 ms at 100 mm/s are 16,000");
}

#[test]
fn time_does_not_go_back() {
    let mut rack = machine("reference").live_rack(7, Moment::ZERO);
    rack.advance_to(at(10_000));
    let before = rack.state(Y);
    rack.advance_to(at(3_000));
    assert_eq!(rack.state(Y), before);
}
