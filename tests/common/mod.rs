//! Shared by the closed-loop tests: machines made from the embedded files, a rig that steps the shipped
//! cycle over a simulated rack period by period, and a line between them that can be made to misbehave.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use quadrant::base::axis::{AxisId, PerAxis};
use quadrant::base::input::Inputs;
use quadrant::base::motion::{Circle, Direction};
use quadrant::base::order::{Excitation, ExcitedMotion};
use quadrant::base::record::{AxisRecord, CycleRecord, ModeTag, Timing};
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Acceleration, Position, Velocity};
use quadrant::config::{self, Machine};
use quadrant::rt::bus::{Bus, Frame, Received, SendError};
use quadrant::rt::control::profile::{CircleMotion, LineMotion};
use quadrant::rt::cycle::pace::{Slot, Virtual};
use quadrant::rt::cycle::procedure::{CircleTest, Ending, Procedure};
use quadrant::rt::cycle::{Cycle, conduct};
use quadrant::rt::door::{Order, Orders, Records};
use quadrant::rt::wire::Address;
use quadrant::sim::closed_loop::Wired;
use quadrant::sim::rack::Rack;

pub(crate) const X: AxisId = AxisId::X;
pub(crate) const Y: AxisId = AxisId::Y;

/// An embedded machine with lines of its text replaced; every replacement must find something.
pub(crate) fn machine_with(name: &str, edits: &[(&str, &str)]) -> Machine {
    let embedded = config::EMBEDDED.into_iter().find(|(other, _)| *other == name);
    let (_, text) = embedded.expect("an embedded machine");
    let mut text = text.to_owned();
    for (from, to) in edits {
        assert!(text.contains(from), "the {name} machine has no line '{from}'");
        text = text.replace(from, to);
    }
    config::from_texts(name, &text, &Default::default())
        .unwrap_or_else(|problems| panic!("{}", problems.render(false)))
}

pub(crate) fn machine(name: &str) -> Machine {
    machine_with(name, &[])
}

/// The reference machine with a third axis like the second, at a rate that the bus can carry.
pub(crate) fn three_axes() -> Machine {
    let (_, text) = config::EMBEDDED[0];
    let (_, y) = text.split_once("[axis.y.board]").expect("an axis y");
    let z = format!("[axis.y.board]{y}").replace("axis.y", "axis.z").replace("node = 2", "node = 3");
    let text = format!("{text}\n{z}")
        .replace("period-us = 500 ", "period-us = 1000 ")
        .replace("reply-window-us = 300", "reply-window-us = 600");
    config::from_texts("three axes", &text, &Default::default())
        .unwrap_or_else(|problems| panic!("{}", problems.render(false)))
}

/// The circle of the paper's test: 150 mm around zero, from 45 degrees.
pub(crate) fn circle(feed_mm_per_min: f64, direction: Direction) -> CircleMotion {
    CircleMotion {
        circle: Circle {
            centre_x: Position::ZERO,
            centre_y: Position::ZERO,
            radius: Position::mm(150.0),
            feed: Velocity::mm_per_min(feed_mm_per_min),
            direction,
            start_angle_rad: std::f64::consts::FRAC_PI_4,
            revolutions: 1,
        },
        run_in_s: 1.5,
        run_out_s: 0.3,
        acceleration: Acceleration::m_per_s2(0.5),
    }
}

/// Keeps every record.
#[derive(Debug, Default)]
pub(crate) struct Kept(pub(crate) Vec<CycleRecord>);

impl Records for Kept {
    fn put(&mut self, record: &CycleRecord, _inputs: &Inputs) {
        self.0.push(*record);
    }
    fn lost(&self) -> u64 {
        0
    }
}

/// A whole circular test by the shipped procedure, in virtual time.
pub(crate) fn run_circles(
    machine: &Machine,
    gains: &str,
    circles: &[CircleMotion],
    seed: u64,
) -> Vec<CycleRecord> {
    run_circles_on(machine.rack(seed), machine, gains, circles)
}

/// The same on a given rack.
pub(crate) fn run_circles_on(
    rack: Rack,
    machine: &Machine,
    gains: &str,
    circles: &[CircleMotion],
) -> Vec<CycleRecord> {
    let mut bus = Wired::new(rack);
    let drives =
        bus.commission(machine.drives().expect("each axis has its board")).expect("boards like their sheets");
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let test = CircleTest {
        gain_set: machine.gain_set(gains).expect("a gain set of the machine"),
        circles: std::array::from_fn(|index| circles.get(index).copied()),
        positioning_feed: machine.motion.positioning_feed,
    };
    let mut procedure = Procedure::new(test, Arc::new(AtomicBool::new(false)));
    let mut kept = Kept::default();
    let mut grid = Virtual::new(machine.cycle.period);
    let last = conduct(&mut cycle, &mut bus, &mut grid, &mut procedure, &mut kept);
    assert_eq!(procedure.ending(&last), Ending::Complete);
    kept.0
}

/// What becomes of a frame on its way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fate {
    Pass,
    Lost,
    /// Received twice.
    Twice,
    /// Received behind the next one.
    Overtaken,
    /// Received so many SYNCs later.
    Later(u64),
    /// Refused by a bus that has no room.
    Refused,
    /// Refused by a bus that is down.
    Down,
}

type Hook = Box<dyn FnMut(&mut Frame) -> Fate>;

/// The bus between host and rack, with somebody sitting on it.
pub(crate) struct Line {
    pub(crate) wired: Wired,
    /// Sees each frame of the host and may change it.
    pub(crate) outgoing: Hook,
    /// Sees each frame of the boards and may change it.
    pub(crate) incoming: Hook,
    syncs: u64,
    /// Frames held back, with the SYNC behind which they come.
    held: Vec<(u64, Received)>,
    overtaken: Option<Received>,
    /// How long after the end of the reply window frames come.
    pub(crate) behind: Span,
    /// What the host sent and received, if somebody asks: SYNC, received, commands, and so on.
    pub(crate) crossed: Option<Vec<Frame>>,
}

impl Bus for Line {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        let outcome = self.carry(frame);
        self.crossed.iter_mut().filter(|_| outcome.is_ok()).for_each(|crossed| crossed.push(*frame));
        outcome
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        let mut received = self.bring(until)?;
        received.at = received.at + self.behind;
        self.crossed.iter_mut().for_each(|crossed| crossed.push(received.frame));
        Some(received)
    }
}

impl Line {
    fn carry(&mut self, frame: &Frame) -> Result<(), SendError> {
        let mut frame = *frame;
        self.syncs += u64::from(Address::of(frame.id()) == Some(Address::Sync));
        match (self.outgoing)(&mut frame) {
            Fate::Pass => self.wired.send(&frame),
            Fate::Lost => Ok(()),
            fate @ (Fate::Twice | Fate::Overtaken | Fate::Later(_)) => panic!("no way to be {fate:?}"),
            Fate::Refused => Err(SendError::Full),
            Fate::Down => Err(SendError::Down),
        }
    }
    fn bring(&mut self, until: Moment) -> Option<Received> {
        if let Some(place) = self.held.iter().position(|(due, _)| *due <= self.syncs) {
            return Some(Received { at: until, ..self.held.remove(place).1 });
        }
        while let Some(mut received) = self.wired.receive(until) {
            match (self.incoming)(&mut received.frame) {
                Fate::Lost => continue,
                Fate::Twice => self.held.push((self.syncs, received)),
                Fate::Overtaken => {
                    self.held.extend(self.overtaken.replace(received).map(|earlier| (self.syncs, earlier)));
                    continue;
                }
                Fate::Later(syncs) => {
                    self.held.push((self.syncs + syncs, received));
                    continue;
                }
                Fate::Pass => {}
                fate @ (Fate::Refused | Fate::Down) => panic!("nobody can be told of {fate:?}"),
            }
            self.held.extend(self.overtaken.take().map(|earlier| (self.syncs, earlier)));
            return Some(received);
        }
        self.overtaken.take()
    }
}

/// Orders in the sequence in which they were given.
#[derive(Debug, Default)]
struct Queue(VecDeque<Order>);

impl Orders for Queue {
    fn next(&mut self, _last: &CycleRecord) -> Option<Order> {
        self.0.pop_front()
    }
    fn is_done(&self, _last: &CycleRecord) -> bool {
        false
    }
}

/// The shipped cycle over a rack, one period at a time.
pub(crate) struct Rig {
    pub(crate) machine: Machine,
    pub(crate) line: Line,
    cycle: Cycle,
    queue: Queue,
    next: u64,
    overruns: u64,
    pub(crate) last: CycleRecord,
    pub(crate) inputs: Inputs,
}

impl Rig {
    pub(crate) fn new(machine: Machine, seed: u64) -> Self {
        let control = machine.control_settings();
        Self::with_control(machine, &control, seed)
    }

    /// With control settings that are not those of the machine.
    pub(crate) fn with_control(
        machine: Machine,
        control: &PerAxis<quadrant::rt::control::Settings>,
        seed: u64,
    ) -> Self {
        let mut wired = Wired::new(machine.rack(seed));
        let drives = machine.drives().expect("each axis has its board");
        let drives = wired.commission(drives).expect("boards like their sheets");
        let cycle = Cycle::new(machine.cycle_settings(), drives, control);
        let axes = machine.axes.count();
        let line = Line {
            wired,
            outgoing: Box::new(|_| Fate::Pass),
            incoming: Box::new(|_| Fate::Pass),
            syncs: 0,
            held: Vec::new(),
            overtaken: None,
            behind: Span::ZERO,
            crossed: None,
        };
        let last = CycleRecord::empty(axes);
        Self {
            machine,
            line,
            cycle,
            queue: Queue::default(),
            next: 0,
            overruns: 0,
            last,
            inputs: Inputs::default(),
        }
    }

    /// To be given at the next tick of the position loop that finds it first in the queue.
    pub(crate) fn order(&mut self, order: Order) {
        self.queue.0.push_back(order);
    }

    /// One period.
    pub(crate) fn step(&mut self) -> &CycleRecord {
        let scheduled = Moment::ZERO + self.machine.cycle.period * self.next as i64;
        let timing = Timing::at(scheduled);
        let slot = Slot { number: self.next, timing, overruns: self.overruns };
        self.next += 1;
        let (record, inputs) = self.cycle.run(&mut self.line, &mut self.queue, &slot, &mut || scheduled);
        self.last = *record;
        self.inputs.clone_from(inputs);
        &self.last
    }

    /// The host is busy elsewhere for so many periods.
    pub(crate) fn skip(&mut self, periods: u64) {
        self.next += periods;
        self.overruns += periods;
    }

    /// Periods until all axes are in a mode.
    pub(crate) fn run_until(&mut self, mode: ModeTag, cycles_max: u64) -> u64 {
        for cycles in 1..=cycles_max {
            self.step();
            if self.last.axes.as_slice().iter().all(|axis| axis.mode == mode) {
                return cycles;
            }
        }
        panic!("not all axes are {} after {cycles_max} cycles: {:?}", mode.name(), self.modes());
    }

    pub(crate) fn run(&mut self, cycles: u64) {
        for _ in 0..cycles {
            self.step();
        }
    }

    /// Until the motion just ordered has begun and ended.
    pub(crate) fn run_until_moved(&mut self) {
        self.run_until(ModeTag::Moving, 8);
        self.run_until(ModeTag::Ready, 40_000);
    }

    pub(crate) fn enable(&mut self) {
        self.order(Order::Enable);
        self.run_until(ModeTag::Ready, 200);
    }

    /// A straight move of all axes to one coordinate.
    pub(crate) fn line_to(&self, place_mm: f64, feed_mm_per_s: f64) -> Order {
        Order::Line(LineMotion {
            target: PerAxis::filled(self.machine.axes.count(), Position::mm(place_mm)),
            feed: Velocity::mm_per_s(feed_mm_per_s),
            acceleration: Acceleration::m_per_s2(0.5),
        })
    }

    /// The same with the first axis excited from 8 to 200 Hz for a second at full strength.
    pub(crate) fn excited_to(&self, place_mm: f64, feed_mm_per_s: f64) -> ExcitedMotion {
        let Order::Line(line) = self.line_to(place_mm, feed_mm_per_s) else { panic!("a line is a line") };
        let excitation = Excitation {
            axis: X,
            amplitude: Velocity::mm_per_s(0.4),
            period: Span::ms(500),
            harmonic_min: 4,
            harmonic_max: 100,
            lines: 16,
            repeats: 2,
        };
        ExcitedMotion { line, excitation }
    }

    pub(crate) fn axis(&self, axis: AxisId) -> &AxisRecord {
        &self.last.axes[axis]
    }

    pub(crate) fn modes(&self) -> Vec<(ModeTag, Option<quadrant::base::fault::Fault>)> {
        self.last.axes.as_slice().iter().map(|axis| (axis.mode, axis.fault)).collect()
    }

    pub(crate) fn state(&self, axis: AxisId) -> quadrant::plant::State {
        self.line.wired.rack().state(axis)
    }
}
