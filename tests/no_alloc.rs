//! Promise: after start the control thread does not touch the heap. A counting allocator watches the
//! whole loop in memory: cycle, record ring, and the simulated machine that answers in the same thread.

#[expect(dead_code, reason = "a test uses the part it needs")]
mod common;
#[path = "common/heap.rs"]
mod heap;

use common::{Fate, Rig, circle};
use heap::touched;
use quadrant::base::motion::Direction;
use quadrant::base::record::ModeTag;
use quadrant::base::units::Velocity;
use quadrant::rt::control::profile::LineMotion;
use quadrant::rt::cycle::pace::{Pace, Virtual};
use quadrant::rt::door::{Order, Records, record_ring};
use rstest::rstest;

/// Cycles under guard.
const CYCLES: u64 = 100_000;

#[test]
fn an_excited_motion_touches_no_heap() {
    let mut rig = Rig::new(common::machine("reference"), 9);
    rig.enable();
    rig.order(Order::Excited(rig.excited_to(120.0, 20.0)));
    rig.run_until(ModeTag::Moving, 8);
    let (mut measured, mut excited) = (0, 0);
    let before = touched();
    while rig.step().axes[common::X].mode == ModeTag::Moving {
        measured += u64::from(rig.last.stage.is_measured);
        excited += u64::from(rig.axis(common::X).command.terms.excitation != Velocity::ZERO);
    }
    assert_eq!(touched() - before, 0, "allocations and frees in an excited motion");
    assert!(measured == 2_000 && excited > 4_000, "{measured} cycles measured, {excited} excited");
}

#[rstest]
fn a_hundred_thousand_cycles_of_a_circle_touch_no_heap(#[values("reference", "classic")] machine: &str) {
    let mut rig = Rig::new(common::machine(machine), 9);
    rig.enable();
    let mut motion = circle(2000.0, Direction::Ccw);
    motion.circle.revolutions = 6;
    let (x, y) = motion.start();
    let mut target = rig.last.axes.map(|_, axis| axis.setpoint.position);
    (target[common::X], target[common::Y]) = (x, y);
    let feed = Velocity::mm_per_s(100.0);
    rig.order(Order::Line(LineMotion { target, feed, acceleration: motion.acceleration }));
    rig.run_until_moved();
    rig.order(Order::Circle(motion));
    rig.order(Order::UseGains(1));
    rig.order(Order::UseGains(0));

    // As often as is borne: what a cycle missed goes through other code.
    let mut frames = 0_u32;
    rig.line.incoming = Box::new(move |_| {
        frames += 1;
        if frames.is_multiple_of(997) { Fate::Lost } else { Fate::Pass }
    });

    // Smaller than the run: a ring that runs full must not touch the heap either.
    let (mut near, mut far) = record_ring(1 << 10);
    let mut pace = Virtual::new(rig.machine.cycle.period);
    let (mut measured, mut drained, mut told) = (0, 0, 0);
    let before = touched();
    for cycle in 0..CYCLES {
        pace.wait();
        let record = rig.step();
        measured += u64::from(record.stage.is_measured);
        let record = *record;
        near.put(&record, &rig.inputs);
        pace.finish();
        if cycle < CYCLES / 2 {
            drained += u64::from(far.ring.pop().is_ok());
            told += u64::from(far.inputs.pop().is_ok());
        }
    }
    let after = touched();
    assert_eq!(after - before, 0, "allocations and frees in {CYCLES} cycles");
    assert!(told > 100, "{told} heartbeats on their way to the log");
    assert!(measured > 90_000, "{measured} cycles of a circle");
    let missed: u32 = rig.last.axes.as_slice().iter().map(|axis| axis.link.missed).sum();
    assert!(missed > 150, "{missed} cycles without fresh feedback");
    assert!(drained > 49_000 && near.lost() > 48_000, "the ring was drained and then ran full");
    assert!(rig.last.axes.as_slice().iter().all(|axis| axis.mode == ModeTag::Moving), "{:?}", rig.modes());
}
