//! Promise: the experiments of `quadrant identify` run to their end on the machine they were planned for, keep
//! its limits all the way, take the time that was said, and their log replays bit for bit.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use quadrant::base::axis::AxisId;
use quadrant::base::command::Limits;
use quadrant::base::input::Inputs;
use quadrant::base::record::{CycleRecord, ModeTag};
use quadrant::base::units::{Position, Velocity};
use quadrant::config::Machine;
use quadrant::log::{Pace, Reader, Writer};
use quadrant::offline::identify::plan::{Plan, Planned, Purpose, Request};
use quadrant::offline::replay::replay;
use quadrant::rt::cycle::pace::Virtual;
use quadrant::rt::cycle::procedure::{Ending, Procedure};
use quadrant::rt::cycle::{Cycle, conduct};
use quadrant::rt::door::{Records, record_ring};
use quadrant::run::{Origin, Place, header};
use quadrant::sim::closed_loop::{Patient, Wired};

use crate::common::{Kept, X, Y, machine, machine_with};

/// A machine so small that its experiments take two minutes.
fn small() -> Machine {
    let edits = [
        ("travel-min-mm = -250.0", "travel-min-mm = -8.0"),
        ("travel-max-mm = 250.0", "travel-max-mm = 60.0"),
        ("travel-margin-mm = 5.0", "travel-margin-mm = 2.0"),
        ("positioning-feed-mm-per-min = 6000.0", "positioning-feed-mm-per-min = 3000.0"),
        ("velocity-mm-per-s = 250.0", "velocity-mm-per-s = 60.0"),
    ];
    machine_with("reference", &edits)
}

fn plan(machine: &Machine, axes: &[AxisId]) -> Plan {
    let request = Request { gains: "standard".to_owned(), axes: axes.to_vec() };
    Plan::of(machine, &request).expect("the gain set is there")
}

fn run(machine: &Machine, orders: &mut Procedure, records: &mut impl Records) -> Ending {
    let mut bus = Wired::new(machine.rack(3));
    let drives = bus.commission(machine.drives().expect("boards")).expect("boards like their sheets");
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let last = conduct(&mut cycle, &mut bus, &mut Virtual::new(machine.cycle.period), orders, records);
    orders.ending(&last)
}

/// What limits acted on an axis while a motion of a purpose ran.
fn acted(rows: &[CycleRecord], motions: &[&Planned], purpose: Purpose, axis: AxisId) -> Limits {
    let is_of = |row: &&CycleRecord| {
        let motion = (row.stage.motion as usize).checked_sub(1).and_then(|place| motions.get(place));
        motion.is_some_and(|planned| planned.purpose == purpose)
    };
    let of_row = |row: &CycleRecord| row.axes[axis].command.limits;
    rows.iter().filter(is_of).map(of_row).fold(Limits::NONE, Limits::with)
}

#[test]
fn the_experiments_of_two_axes_end_as_planned_and_keep_every_limit() {
    let machine = small();
    let plan = plan(&machine, &[]);
    let mut kept = Kept::default();
    let mut orders = Procedure::new(plan.programme(), Arc::default());
    assert_eq!(run(&machine, &mut orders, &mut kept), Ending::Complete);
    let rows = kept.0;
    let motions: Vec<&Planned> = plan.steps.iter().filter(|planned| planned.step.is_motion()).collect();
    assert_eq!(rows[rows.len() - 1].stage.motion as usize, motions.len());

    let (took_s, said_s) = (rows.len() as f64 * machine.cycle.period.as_s(), plan.duration_s());
    assert!((took_s / said_s - 1.0).abs() < 0.1, "took {took_s} s, said were {said_s} s");
    for axis in [X, Y] {
        let (low, high) = plan.reach(axis);
        let off = Position::um(200.0);
        for row in &rows {
            let place = row.axes[axis].sample.position;
            assert!(place > low - off && place < high + off, "axis {axis} at {place} in cycle {}", row.cycle);
        }
        for purpose in [
            Purpose::FrequencyResponse,
            Purpose::SteadyFriction,
            Purpose::BreakAway,
            Purpose::Reversal,
            Purpose::Inertia,
        ] {
            let limits = acted(&rows, &motions, purpose, axis);
            assert_eq!(limits, Limits::NONE, "axis {axis}, {}: {limits:?}", purpose.name());
        }
    }
}

#[test]
fn an_axis_that_was_not_chosen_stays() {
    let machine = small();
    let mut kept = Kept::default();
    let mut orders = Procedure::new(plan(&machine, &[Y]).programme(), Arc::default());
    assert_eq!(run(&machine, &mut orders, &mut kept), Ending::Complete);
    let moved_um = kept.0.iter().map(|row| row.axes[X].sample.position.as_um().abs()).fold(0.0, f64::max);
    assert!(moved_um < 0.1, "x moved by {moved_um} um");
}

/// Sets the wish to stop in a cycle.
struct StopIn<'a> {
    kept: Kept,
    wish: &'a AtomicBool,
    /// Whether it is time.
    is_time: fn(&CycleRecord) -> bool,
}

impl Records for StopIn<'_> {
    fn put(&mut self, record: &CycleRecord, inputs: &Inputs) {
        self.kept.put(record, inputs);
        if (self.is_time)(record) {
            self.wish.store(true, Ordering::Relaxed);
        }
    }
    fn lost(&self) -> u64 {
        0
    }
}

#[test]
fn a_stop_wish_in_an_excited_motion_ends_them_at_rest_and_without_current() {
    let machine = machine("reference");
    let wish = Arc::new(AtomicBool::new(false));
    let mut orders = Procedure::new(plan(&machine, &[X]).programme(), Arc::clone(&wish));
    let is_time = |record: &CycleRecord| record.stage.is_measured;
    let mut records = StopIn { kept: Kept::default(), wish: &wish, is_time };
    assert_eq!(run(&machine, &mut orders, &mut records), Ending::Interrupted);
    let rows = records.kept.0;
    let measured = rows.iter().position(|row| row.stage.is_measured).expect("it was measured");
    let [before, last] = [&rows[measured], &rows[rows.len() - 1]];
    assert!(before.axes[X].command.terms.excitation != Velocity::ZERO);
    assert_eq!(last.axes[X].mode, ModeTag::Off);
    assert!(last.axes[X].sample.velocity.abs() < Velocity::mm_per_s(0.5));
    // 20 mm/s are braked within a millimetre or two, and the lag of the position loop comes after.
    let way_mm = (last.axes[X].sample.position - before.axes[X].sample.position).as_mm();
    assert!((0.5..5.0).contains(&way_mm), "{way_mm} mm to rest");
}

#[test]
fn the_log_of_experiments_replays_bit_for_bit_and_names_its_motions() {
    let machine = small();
    let plan = plan(&machine, &[X]);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let place = Place { pace: Pace::Virtual, interface: None, seed: 3 };
    let origin = Origin { monotonic: Default::default(), wall_ns: 1_800_000_000_000_000_000 };
    let mut header = header(&machine, &place, &origin, "a test");
    header.motions = plan.motions();
    let (ring, drain) = record_ring(4_096);
    let writer = Writer::start(&path, header, drain.ring, drain.inputs, drain.lost).expect("a new log");
    let mut orders = Procedure::new(plan.programme(), Arc::default());
    assert_eq!(run(&machine, &mut orders, &mut Patient(ring)), Ending::Complete);
    let outcome = writer.join();
    assert_eq!(outcome.lost, 0);

    let mut log = Reader::open(&path).expect("its header is whole");
    let replayed = replay(&mut log, |_| ()).expect("it begins with its run");
    assert_eq!((replayed.difference, replayed.ended_early), (None, None));
    assert_eq!(replayed.cycles, outcome.written);
    assert_excited_motions_are_named(&path);
}

/// The motions in which something was excited are those that the header says.
fn assert_excited_motions_are_named(path: &Path) {
    let log = Reader::open(path).expect("its header is whole");
    let named: Vec<u32> = log
        .header()
        .motions
        .iter()
        .filter(|(_, motion)| motion["kind"] == "excited")
        .map(|(n, _)| *n)
        .collect();
    let is_excited = |row: &CycleRecord| row.axes[X].command.terms.excitation != Velocity::ZERO;
    let mut excited: Vec<u32> =
        log.map(|row| row.expect("a whole record")).filter(is_excited).map(|row| row.stage.motion).collect();
    excited.dedup();
    assert_eq!(named, excited);
    assert_eq!(named.len(), 2, "there and back");
}
