//! Promise: the boards of a log, played to a live host in lock step, draw the recorded commands from it bit for
//! bit, whatever happened in the run; a host that is set otherwise is told by cycle, axis and field; and what
//! cannot be played ends it, without a difference that is none.

#[path = "../common/mod.rs"]
#[expect(dead_code, reason = "a test uses the part it needs")]
mod common;
mod edges;
#[path = "../common/eventful.rs"]
mod eventful;
mod wall;

use std::collections::VecDeque;
use std::path::Path;

use common::{X, machine, machine_with};
use eventful::{Kept, eventful};
use quadrant::base::input::{Input, Inputs, What};
use quadrant::base::record::{BusState, CycleRecord, ModeTag, Refusal, Timing as Clock};
use quadrant::base::time::{Moment, Span};
use quadrant::config::Machine;
use quadrant::config::scenario::{Scenario, load_scenario};
use quadrant::offline::hil::Course;
use quadrant::offline::playback::{Playback, Played, Timing};
use quadrant::offline::recorded::RecordedCycle;
use quadrant::offline::replay::Replayer;
use quadrant::offline::traffic::export::Export;
use quadrant::offline::traffic::import::{Import, Wanted};
use quadrant::rt::bus::lockstep::Lockstep;
use quadrant::rt::bus::{Bus, Format, Frame, Received, SendError};
use quadrant::rt::cycle::Cycle;
use quadrant::rt::cycle::pace::{Pace, Slot, Virtual};
use quadrant::rt::door::{Order, Orders, Records};
use quadrant::sim::closed_loop::{Wired, commission};
use rstest::rstest;

type Cycles<'a> = Box<dyn Iterator<Item = Result<RecordedCycle, quadrant::log::LogError>> + 'a>;

fn playback<'a>(machine: &Machine, kept: &'a Kept, timing: Timing) -> Playback<Cycles<'a>> {
    let cycles =
        kept.iter().map(|(record, inputs)| RecordedCycle { record: *record, inputs: inputs.clone() });
    Playback::new(machine, Box::new(cycles.map(Ok)) as Cycles<'a>, timing).expect("it begins with its run")
}

/// Frames on their way to the host.
#[derive(Debug, Default)]
struct Way(VecDeque<Frame>);

impl Bus for Way {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        assert_ne!(frame.format(), Format::Report, "no bus carries it");
        self.0.push_back(*frame);
        Ok(())
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        Some(Received { frame: self.0.pop_front()?, at: until })
    }
}

/// The host's end of a bus with a playback at the other.
struct Behind<'a, 'b> {
    playback: &'a mut Playback<Cycles<'b>>,
    way: Way,
}

impl Bus for Behind<'_, '_> {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        let received = Received { frame: *frame, at: Moment::ZERO };
        self.playback.hear(&received, &mut self.way).expect("there is no board");
        Ok(())
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        self.way.receive(until)
    }
}

/// Cycles as an import gives them.
#[derive(Default)]
struct Imported(Kept);

impl Records for Imported {
    fn put(&mut self, record: &CycleRecord, inputs: &Inputs) {
        self.0.push((*record, inputs.iter().copied().collect()));
    }
    fn lost(&self) -> u64 {
        0
    }
}

/// The orders of a run, each in its cycle.
#[derive(Default)]
struct Given(Option<Order>);

impl Orders for Given {
    fn next(&mut self, _last: &CycleRecord) -> Option<Order> {
        self.0.take()
    }
    fn is_done(&self, _last: &CycleRecord) -> bool {
        false
    }
}

/// Plays a log to a live host with this machine file, that is ordered what the recorded one was and skips the
/// periods it skipped; what the host made of it.
fn played(host: &Machine, log_of: &Machine, kept: &Kept) -> (Played, Kept) {
    let mut playback = playback(log_of, kept, Timing::AtOnce);
    let behind = Behind { playback: &mut playback, way: Way::default() };
    let mut bus = Lockstep::begin_on(behind, Span::ms(20)).expect("it answers at once");
    let drives = commission(&mut bus, host.drives().expect("each axis has its board"));
    let mut cycle = Cycle::new(
        host.cycle_settings(),
        drives.expect("boards like their sheets"),
        &host.control_settings(),
    );
    let mut lived = Kept::new();
    for (record, inputs) in kept {
        let mut orders = Given(inputs.iter().find_map(|input| match input.what {
            What::Order(order) => Some(order),
            What::Frame { .. } | What::Before(_) => None,
        }));
        let timing = Clock::at(record.timing.scheduled);
        let slot = Slot { number: record.cycle, timing, overruns: record.overruns };
        let (live, told) = cycle.run(&mut bus, &mut orders, &slot, &mut || timing.scheduled);
        if bus.is_peer_lost() {
            break;
        }
        lived.push((*live, told.iter().copied().collect()));
    }
    drop(bus);
    (playback.into_played(), lived)
}

/// The heartbeats that a run was begun with.
fn before(kept: &Kept) -> Vec<Frame> {
    let frame = |input: &Input| match input.what {
        What::Before(received) => Some(received.frame),
        What::Order(_) | What::Frame { .. } => None,
    };
    kept[0].1.iter().filter_map(frame).collect()
}

/// The cycle in which something happens that nobody else can do to a host.
fn unplayable(kept: &Kept) -> Option<usize> {
    let is = |record: &CycleRecord| {
        record.bus.state == BusState::BusOff
            || record.bus.sync != Refusal::None
            || record.commands() != Refusal::None
    };
    kept.iter().position(|(record, _)| is(record))
}

#[rstest]
fn whatever_happened_draws_the_recorded_commands(#[values("reference", "classic")] name: &str) {
    let machine = machine(name);
    let (mut moved, mut unusable, mut whole, mut reports) = (0, 0, 0, 0);
    for seed in 0..18 {
        let (kept, _) = eventful(name, seed);
        let (played, live) = played(&machine, &machine, &kept);
        assert_eq!(played.difference, None, "seed {seed}");
        let cycles = match unplayable(&kept) {
            Some(at) => {
                let why = played.ended_early.unwrap_or_default();
                assert!(why.contains("the recorded bus refused a command"), "seed {seed}: {why}");
                at + 1
            }
            None => {
                assert_eq!(played.ended_early, None, "seed {seed}");
                whole += 1;
                kept.len()
            }
        };
        assert_eq!((played.cycles, played.commands), (cycles as u64, 2 * cycles as u64), "seed {seed}");
        assert_eq!((before(&live).len(), before(&live)), (2, before(&kept)), "seed {seed}");
        for ((live, _), (recorded, _)) in live.iter().zip(&kept[..cycles - 1]) {
            // All of it, and not the commands alone.
            for (axis, row) in recorded.axes.iter() {
                let live = &live.axes[axis];
                assert_eq!(live.sample.raw, row.sample.raw, "seed {seed}, cycle {}", recorded.cycle);
                assert_eq!((live.mode, live.fault), (row.mode, row.fault), "cycle {}", recorded.cycle);
                assert_eq!(live.link, row.link, "seed {seed}, cycle {}", recorded.cycle);
            }
        }
        let last = &kept[cycles - 1].0;
        moved += kept.iter().filter(|(record, _)| record.axes[X].mode == ModeTag::Moving).count();
        unusable += last.axes.as_slice().iter().map(|axis| axis.link.late + axis.link.malformed).sum::<u32>();
        reports += played.reports_left_out;
    }
    assert!(whole >= 4 && moved > 2_000, "{whole} logs to their end, {moved} cycles in motion");
    assert!(unusable > 100 && reports > 10, "{unusable} frames late or malformed, {reports} reports");
}

/// What a listener wrote of a run knows its boards and commands, and that is what a playback needs.
#[test]
fn an_imported_text_can_be_played_too() {
    let machine = machine("reference");
    let (mut kept, _) = eventful("reference", 0);
    let mut text = Vec::new();
    let mut export = Export::new(&machine, 1_800_000_000_000_000_000, "can0", &mut text);
    kept.iter().for_each(|(record, inputs)| export.cycle(record, inputs).expect("memory takes it"));
    let mut imported = Imported::default();
    let import =
        Import::begin(&machine, text.as_slice(), &Wanted::default()).expect("it is a text of candump");
    import.run(&mut imported).expect("it is a text of candump");
    for ((record, inputs), (told, again)) in kept.iter_mut().zip(imported.0) {
        *record = told;
        inputs.retain(|input| matches!(input.what, What::Order(_)));
        inputs.extend(again);
    }
    let (played, _) = played(&machine, &machine, &kept);
    assert_eq!((played.cycles, played.difference, played.ended_early), (kept.len() as u64, None, None));
}

/// A scenario as a log, until its orders are done and a little longer.
fn recorded(scenario: &Scenario) -> Option<Kept> {
    let machine = &scenario.machine;
    let mut bus = Wired::new(machine.rack(scenario.script.seed).with_script(&scenario.script));
    let drives = bus.commission(machine.drives().expect("each axis has its board")).ok()?;
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let (mut course, mut pace) = (Course::new(&scenario.motion), Virtual::new(machine.cycle.period));
    let (mut kept, mut after) = (Kept::new(), 200);
    for _ in 0..course.cycles_max(machine.cycle.period) {
        let slot = pace.wait();
        let (record, inputs) = cycle.run(&mut bus, &mut course, &slot, &mut || pace.now());
        kept.push((*record, inputs.iter().copied().collect()));
        after -= u32::from(course.is_done(record));
        if after == 0 {
            break;
        }
    }
    Some(kept)
}

#[test]
fn every_scenario_draws_the_recorded_commands() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenarios");
    let (mut faulted, mut whole, mut bus_off) = (0, 0, 0);
    for entry in folder.read_dir().expect("the folder is part of the project") {
        let path = entry.expect("it can be read").path();
        let scenario = load_scenario(&path).unwrap_or_else(|error| panic!("{error}"));
        // Boards that were refused leave no log.
        let Some(kept) = recorded(&scenario) else { continue };
        let (played, _) = played(&scenario.machine, &scenario.machine, &kept);
        assert_eq!(played.difference, None, "{}", scenario.name);
        match unplayable(&kept) {
            None => {
                assert_eq!(
                    (played.cycles, played.ended_early),
                    (kept.len() as u64, None),
                    "{}",
                    scenario.name
                );
                whole += 1;
            }
            Some(at) => {
                assert_eq!(played.cycles, at as u64, "{}", scenario.name);
                let why = played.ended_early.unwrap_or_default();
                assert!(why.contains("own controller left the bus"), "{}: {why}", scenario.name);
                bus_off += 1;
            }
        }
        let is_faulted = |(record, _): &(CycleRecord, _)| record.axes[X].fault.is_some();
        faulted += u32::from(kept.iter().any(is_faulted));
    }
    assert!(whole > 25 && faulted > 15 && bus_off > 0, "{whole} whole, {faulted} faulted, {bus_off} bus-off");
}

#[rstest]
fn one_gain_changed_is_found_where_it_first_acts(#[values("reference", "classic")] name: &str) {
    let (kept, _) = eventful(name, 0);
    let log_of = machine(name);
    let other = machine_with(name, &[("kp-per-s = 8.55", "kp-per-s = 8.56")]);
    let (played, _) = played(&other, &log_of, &kept);
    let difference = played.difference.expect("another gain");
    // The same inputs through the cycle in memory: the first in which other bytes leave the host.
    let mut replayer = Replayer::new(&other, &kept[0].1).expect("two boards");
    let is_other = |(recorded, inputs): &&(CycleRecord, Vec<_>)| {
        replayer.run(recorded, inputs).bus.sent_crc != recorded.bus.sent_crc
    };
    let (recorded, _) = kept.iter().find(is_other).expect("another gain");
    assert_eq!((difference.cycle, difference.field), (recorded.cycle, "current_ua"));
    assert_eq!((played.cycles, played.ended_early), (recorded.cycle - recorded.overruns, None));
    let ua = (recorded.axes[X].command.current.as_a() * 1e6).abs().round().to_string();
    assert_eq!((difference.axis.as_str(), difference.recorded.trim_start_matches('-')), ("x", ua.as_str()));
    assert_ne!(difference.live, difference.recorded);
}
