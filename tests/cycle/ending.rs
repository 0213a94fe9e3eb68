//! Promise: a run begins with axes that are ready and ends with axes at rest: the last record shows no drive
//! that gives current and, where the board is heard, no axis that moves, however the run ended.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use quadrant::base::axis::AxisId;
use quadrant::base::fault::Fault;
use quadrant::base::motion::Direction;
use quadrant::base::record::{CycleRecord, ModeTag};
use quadrant::base::sample::Freshness;
use quadrant::base::time::Span;
use quadrant::rt::cycle::pace::Virtual;
use quadrant::rt::cycle::procedure::{CircleTest, Ending, Procedure};
use quadrant::rt::cycle::standby::Standby;
use quadrant::rt::cycle::{Cycle, conduct};
use quadrant::rt::door::{Order, Orders};
use quadrant::rt::drive::state::DriveState;
use quadrant::rt::wire::Address;
use quadrant::sim::closed_loop::Wired;
use quadrant::sim::rack::Rack;
use quadrant::sim::script::{Effect, Script, ScriptedFault};
use rstest::rstest;

use crate::common::{Fate, Kept, Rig, X, Y, circle, machine};

/// Wishes to stop in a cycle.
struct StopAt<O> {
    orders: O,
    cycle: u64,
    wish: Arc<AtomicBool>,
}

impl<O: Orders> Orders for StopAt<O> {
    fn next(&mut self, last: &CycleRecord) -> Option<Order> {
        self.wish.fetch_or(last.cycle >= self.cycle, Ordering::Relaxed);
        self.orders.next(last)
    }
    fn is_done(&self, last: &CycleRecord) -> bool {
        self.orders.is_done(last)
    }
}

/// A run of the machine with its boards as they are in `rack`; every record.
fn conducted(name: &str, rack: Rack, orders: &mut impl Orders) -> Vec<CycleRecord> {
    let machine = machine(name);
    let mut bus = Wired::new(rack);
    let drives = bus.commission(machine.drives().expect("own boards")).expect("boards like their sheets");
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let mut kept = Kept::default();
    conduct(&mut cycle, &mut bus, &mut Virtual::new(machine.cycle.period), orders, &mut kept);
    kept.0
}

/// Faster than a tenth of a second can brake.
fn fast_circle(name: &str, wish: &Arc<AtomicBool>) -> Procedure {
    let test = CircleTest {
        gain_set: 0,
        circles: [Some(circle(8_000.0, Direction::Ccw)), None],
        positioning_feed: machine(name).motion.positioning_feed,
    };
    Procedure::new(test, Arc::clone(wish))
}

fn assert_at_rest(name: &str, records: &[CycleRecord]) {
    let machine = machine(name);
    for (axis, row) in records.last().expect("a run").axes.iter() {
        assert!(matches!(row.mode, ModeTag::Off | ModeTag::Faulted), "axis {axis}: {row:?}");
        if row.sample.freshness == Freshness::Fresh {
            let drive = DriveState::decode(row.sample.raw.status_word);
            assert_ne!(drive, Some(DriveState::OperationEnabled), "axis {axis}: {row:?}");
            let standstill = machine.axes[axis].control.limits.standstill;
            assert!(row.sample.velocity.abs() <= standstill, "axis {axis} still moves: {row:?}");
        }
    }
}

fn fault_at(at_s: f64, axis: AxisId, effect: Effect) -> Script {
    let fault = ScriptedFault { at: Span::s(at_s), lasts: Span::ZERO, axis: Some(axis), effect };
    Script { seed: 1, faults: vec![fault] }
}

#[rstest]
fn a_stop_by_the_operator_ends_with_drives_that_let_go(#[values("reference", "classic")] name: &str) {
    let wish = Arc::new(AtomicBool::new(false));
    let orders = fast_circle(name, &wish);
    let per_s = 1.0 / machine(name).cycle.period.as_s();
    let mut orders = StopAt { orders, cycle: (5.0 * per_s) as u64, wish };
    let records = conducted(name, machine(name).rack(1), &mut orders);
    assert_at_rest(name, &records);
    assert_eq!(orders.orders.ending(&records[records.len() - 1]), Ending::Interrupted);
    let stopping = records.iter().filter(|record| record.axes[X].mode == ModeTag::Stopping).count();
    assert!(stopping as f64 > 0.15 * per_s, "{stopping} cycles of braking");
}

#[rstest]
fn a_fault_that_takes_the_current_is_seen_to_its_end(#[values("reference", "classic")] name: &str) {
    let mut orders = fast_circle(name, &Arc::default());
    let script = fault_at(5.0, Y, Effect::DriveFault(0x2310));
    let records = conducted(name, machine(name).rack(1).with_script(&script), &mut orders);
    assert_at_rest(name, &records);
    let last = &records[records.len() - 1];
    assert_eq!((last.axes[Y].mode, last.axes[Y].fault), (ModeTag::Faulted, Some(Fault::DriveFault)));
    let coasting = |record: &&CycleRecord| {
        record.axes[Y].mode == ModeTag::Faulted && record.axes[Y].sample.velocity.as_mm_per_s().abs() > 10.0
    };
    assert!(records.iter().filter(coasting).count() > 20, "it was not moving when its current went");
}

#[rstest]
fn a_board_that_is_not_heard_is_not_waited_for(#[values("reference", "classic")] name: &str) {
    let mut orders = fast_circle(name, &Arc::default());
    let mut script = fault_at(5.0, X, Effect::SilentBoard);
    script.faults[0].lasts = Span::s(100.0);
    let records = conducted(name, machine(name).rack(1).with_script(&script), &mut orders);
    assert_at_rest(name, &records);
    let period_s = machine(name).cycle.period.as_s();
    let ended_s = records[records.len() - 1].cycle as f64 * period_s;
    assert!(ended_s < 8.0, "{ended_s} s, 3 s after the board fell silent");
}

#[rstest]
fn what_the_last_run_left_behind_is_reset_before_axes_are_enabled(
    #[values("reference", "classic")] name: &str,
) {
    let mut rack = machine(name).rack(1);
    rack.board_mut(Y).trip_drive(0x2310, 0);
    let wish = Arc::new(AtomicBool::new(false));
    let mut orders = StopAt { orders: Standby::new(true, Arc::clone(&wish)), cycle: 1_000, wish };
    let records = conducted(name, rack, &mut orders);
    assert_at_rest(name, &records);
    assert!(records.iter().any(|record| record.axes[Y].mode == ModeTag::Ready), "y was never enabled");
    assert!(records.iter().all(|record| record.axes[Y].fault.is_none()));
}

#[test]
fn a_drive_fault_that_stays_is_reset_three_times_for_an_order_and_then_left() {
    let mut rig = Rig::new(machine("reference"), 1);
    rig.line.wired.rack_mut().board_mut(Y).trip_drive(0x2310, 0);
    // The drive never hears of a reset.
    rig.line.outgoing = Box::new(|frame| match Address::of(frame.id()) {
        Some(Address::Command(node)) if node.number() == 2 => Fate::Lost,
        _ => Fate::Pass,
    });
    let resets =
        |rig: &mut Rig| (0..1_000).filter(|_| rig.step().axes[Y].command.control_word & 0x80 != 0).count();
    assert_eq!(resets(&mut rig), 3, "at the start");
    assert_eq!(resets(&mut rig), 0, "unasked");
    rig.order(Order::ClearFaults);
    assert_eq!(resets(&mut rig), 3, "asked");
    rig.order(Order::Enable);
    assert_eq!(resets(&mut rig), 0);
    assert_eq!(rig.axis(Y).fault, Some(Fault::DriveFault), "what an axis cannot have it is told");
}
