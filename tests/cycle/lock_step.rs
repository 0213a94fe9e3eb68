//! Promise: in lock step with a machine behind a bus of its own, a run gives the records of the run in memory
//! to the bit; also when frames are lost, late, repeated or out of order on the way.

use std::collections::VecDeque;

use quadrant::base::input::Inputs;
use quadrant::base::record::CycleRecord;
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Position, Velocity};
use quadrant::config::{self, Machine};
use quadrant::rt::bus::faulty::{Faults, Faulty};
use quadrant::rt::bus::lockstep::Lockstep;
use quadrant::rt::bus::{Bus, Frame, Received, SendError};
use quadrant::rt::cycle::pace::Virtual;
use quadrant::rt::cycle::procedure::Ending;
use quadrant::rt::cycle::{Cycle, conduct};
use quadrant::rt::door::Records;
use quadrant::rt::wire::{Address, command, feedback};
use quadrant::sim::closed_loop::{Wired, commission};
use quadrant::sim::rack::Rack;
use quadrant::sim::session::Session;

use crate::circle_run::{paper_circle, procedure};

const SEED: u64 = 7;

/// Frames on their way to the host.
#[derive(Debug, Default)]
struct Way(VecDeque<Frame>);

impl Bus for Way {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.0.push_back(*frame);
        Ok(())
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        Some(Received { frame: self.0.pop_front()?, at: until })
    }
}

/// A machine that hears each frame at once, as one in another process may.
struct Behind<'a, F> {
    session: &'a mut Session<F>,
    way: Way,
}

impl<F: Fn() -> Rack> Bus for Behind<'_, F> {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.session.hear(frame, &mut self.way);
        Ok(())
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        self.way.receive(until)
    }
}

/// A machine that hears so many frames more.
struct Mortal<B> {
    behind: B,
    lifetime: usize,
}

impl<B: Bus> Bus for Mortal<B> {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        if self.lifetime == 0 {
            return Ok(());
        }
        self.lifetime -= 1;
        self.behind.send(frame)
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        self.behind.receive(until)
    }
}

/// What each cycle was told and what it did, as text.
#[derive(Debug, Default)]
struct Told {
    cycles: Vec<String>,
    stale: u64,
}

impl Records for Told {
    fn put(&mut self, record: &CycleRecord, inputs: &Inputs) {
        assert!(self.cycles.len() < 100_000, "the run does not end");
        let inputs: Vec<_> = inputs.iter().collect();
        self.cycles.push(format!("{record:?} {inputs:?}"));
        self.stale += u64::from(record.axes.as_slice().iter().any(|axis| axis.sample.age_cycles > 0));
    }
    fn lost(&self) -> u64 {
        0
    }
}

/// What a test does on a bus: a small circle, up to its end or a fault.
fn run<B: Bus>(machine: &Machine, mut bus: B, from_the_host: Faults, to_the_host: Faults) -> (Told, Ending) {
    let drives = commission(&mut bus, machine.drives().expect("each axis has its node"))
        .expect("boards like their sheets");
    let mut bus = Faulty::new(bus, SEED, to_the_host, from_the_host);
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let mut circle = paper_circle(1);
    circle.circle.radius = Position::mm(5.0);
    circle.circle.feed = Velocity::mm_per_min(1500.0);
    let mut procedure = procedure(machine, "standard", circle);
    let mut told = Told::default();
    let mut grid = Virtual::new(machine.cycle.period);
    let last = conduct(&mut cycle, &mut bus, &mut grid, &mut procedure, &mut told);
    (told, procedure.ending(&last))
}

fn in_memory(machine: &Machine, from_the_host: Faults, to_the_host: Faults) -> (Told, Ending) {
    run(machine, Wired::new(machine.rack(SEED)), from_the_host, to_the_host)
}

fn in_lock_step<F: Fn() -> Rack>(
    machine: &Machine,
    session: &mut Session<F>,
    from_the_host: Faults,
    to_the_host: Faults,
) -> (Told, Ending) {
    let behind = Behind { session, way: Way::default() };
    let bus = Lockstep::begin_on(behind, Span::s(10.0)).expect("it answers at once");
    run(machine, bus, from_the_host, to_the_host)
}

/// Every number to its last bit, and what is not a number too.
#[track_caller]
fn assert_same(one: &(Told, Ending), other: &(Told, Ending)) {
    for (a, b) in one.0.cycles.iter().zip(&other.0.cycles) {
        assert_eq!(a, b);
    }
    assert_eq!(one.0.cycles.len(), other.0.cycles.len(), "cycles of two runs");
    assert_eq!(one.1, other.1);
}

#[test]
fn one_run_after_the_other_gives_the_records_of_the_run_in_memory() {
    for name in ["reference", "paper", "classic"] {
        let machine = config::load(name).expect("an embedded machine");
        let memory = in_memory(&machine, Faults::NONE, Faults::NONE);
        let cycles = memory.0.cycles.len() as u64;
        assert!(memory.1 == Ending::Complete && cycles > 2_000, "{name}: {cycles} cycles, {:?}", memory.1);
        let mut session = Session::new(|| machine.rack(SEED));
        for _ in 0..2 {
            assert_same(&memory, &in_lock_step(&machine, &mut session, Faults::NONE, Faults::NONE));
        }
        let counts = session.counts();
        assert_eq!((counts.sessions, counts.cycles, counts.refused), (2, 2 * cycles, 0));
    }
}

#[test]
fn faults_of_the_line_are_the_same_faults() {
    let machine = config::load("reference").expect("an embedded machine");
    let lossy = Faults { drop: 0.02, repeat: 0.02, reorder: 0.02, ..Faults::NONE };
    let late = Faults { delay: (0.05, Span::us(700)), flip_bit: 0.01, ..lossy };
    // A wire that breaks for good in the middle of the motion.
    let never = Moment::ZERO + Span::s(1e6);
    let cut = Faults { silence: Some((Moment::ZERO + Span::s(1.5), never)), ..Faults::NONE };
    for (from_the_host, to_the_host) in
        [(Faults::NONE, lossy), (lossy, Faults::NONE), (late, late), (Faults::NONE, cut), (cut, Faults::NONE)]
    {
        let memory = in_memory(&machine, from_the_host, to_the_host);
        let mut session = Session::new(|| machine.rack(SEED));
        assert_same(&memory, &in_lock_step(&machine, &mut session, from_the_host, to_the_host));
        assert!(memory.0.stale > 2, "nothing was lost");
    }
}

#[test]
fn a_machine_that_dies_ends_the_run_wherever_it_stood() {
    let machine = config::load("reference").expect("an embedded machine");
    let patience = Span::ms(1);
    // Frames it hears before it dies: marker 0, eight questions with a marker each; then from the first SYNC
    // through enabling into the motion.
    let commissioning = 17;
    for lifetime in (commissioning..200).chain((200..20_000).step_by(990)) {
        let mut session = Session::new(|| machine.rack(SEED));
        let behind = Mortal { behind: Behind { session: &mut session, way: Way::default() }, lifetime };
        let bus = Lockstep::begin_on(behind, patience).expect("it answers at first");
        let (told, ending) = run(&machine, bus, Faults::NONE, Faults::NONE);
        assert!(matches!(ending, Ending::Faulted(..)), "died after {lifetime} frames: {ending:?}");
        // Drives that were never ready are waited for: 250 ticks of the position loop. Those that were are not.
        let wait = if lifetime < commissioning + 20 { 1_000 } else { 0 };
        let cycles_max = lifetime / 4 + 100 + wait;
        assert!(told.cycles.len() < cycles_max, "{} cycles for {lifetime} frames", told.cycles.len());
    }
}

#[test]
fn a_sync_that_is_late_or_broken_leads_the_machine_nowhere() {
    let machine = config::load("reference").expect("an embedded machine");
    let mut session = Session::new(|| machine.rack(SEED));
    let node = machine.axes.as_slice()[0].node;
    let mut latched_us = |cycle: u32| {
        let mut way = Way::default();
        session.hear(&command::encode_sync(cycle), &mut way);
        let mut answers = way.0.iter().filter(|frame| frame.id() == Address::Feedback(node).id());
        feedback::decode(answers.next().expect("an answer")).expect("a whole frame").board_time_us
    };
    let times = [0, 100, 100, 98, 101].map(&mut latched_us);
    assert_eq!(times, [0, 100, 100, 100, 101].map(|cycle| cycle * 500));
    // A flipped bit, up and down; and one that leads less far, so that it is believed.
    let times = [102 + (1 << 30), 103, 104 - 64, 105, 106 + 1_024, 107].map(&mut latched_us);
    assert_eq!(times, [102, 103, 104, 105, 1_130, 1_131].map(|cycle| cycle * 500));
}

#[test]
fn a_host_without_markers_begins_anew_with_the_sync_of_cycle_zero() {
    let machine = config::load("reference").expect("an embedded machine");
    let mut session = Session::new(|| machine.rack(SEED));
    let mut answers = |cycles: std::ops::Range<u32>| {
        let mut way = Way::default();
        cycles.for_each(|cycle| session.hear(&command::encode_sync(cycle), &mut way));
        way.0
    };
    let first = answers(0..300);
    assert!(first.len() > 600, "{} answers: feedback, boot-up and heartbeats", first.len());
    assert_ne!(answers(300..600), first);
    assert_eq!(answers(0..300), first);
    assert_eq!(answers(0..300), first);
    assert_eq!(session.counts().sessions, 3);
}
