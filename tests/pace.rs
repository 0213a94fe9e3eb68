//! Promise: on the wall clock the grid is absolute. A cycle that comes late is counted, the periods it
//! missed are skipped and never caught up in a burst, and the records show the gaps by their numbers.

#[expect(dead_code, reason = "a test uses the part it needs")]
mod common;

use std::time::Duration;

use common::{Kept, machine};
use quadrant::base::fault::Fault;
use quadrant::base::record::{CycleRecord, ModeTag};
use quadrant::base::time::{Moment, Span};
use quadrant::rt::bus::{Bus, Frame, Received, SendError};
use quadrant::rt::cycle::pace::{Pace, Virtual, Wall, monotonic_now};
use quadrant::rt::cycle::{Cycle, conduct};
use quadrant::rt::door::{Order, Orders};
use quadrant::rt::wire::Address;
use quadrant::sim::closed_loop::Wired;

/// A bus that keeps the host waiting in some cycles.
struct Slow {
    wired: Wired,
    syncs: u64,
    every: u64,
    pause: Duration,
}

impl Bus for Slow {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        if Address::of(frame.id()) == Some(Address::Sync) {
            self.syncs += 1;
            if self.syncs.is_multiple_of(self.every) {
                std::thread::sleep(self.pause);
            }
        }
        self.wired.send(frame)
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        self.wired.receive(until)
    }
}

/// Enables at the start and disables after so many periods of the grid.
struct Until {
    cycle: u64,
    is_given: bool,
}

impl Orders for Until {
    fn next(&mut self, last: &CycleRecord) -> Option<Order> {
        if last.cycle >= self.cycle {
            return Some(Order::Disable);
        }
        (!std::mem::replace(&mut self.is_given, true)).then_some(Order::Enable)
    }
    fn is_done(&self, last: &CycleRecord) -> bool {
        last.cycle >= self.cycle
    }
}

fn run(pace: &mut impl Pace, every: u64, pause: Duration, cycles: u64) -> Vec<CycleRecord> {
    let machine = machine("reference");
    let mut wired = Wired::new(machine.rack(3));
    let drives = wired.commission(machine.drives().expect("own boards")).expect("boards like their sheets");
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let mut bus = Slow { wired, syncs: 0, every, pause };
    let mut kept = Kept::default();
    conduct(&mut cycle, &mut bus, pace, &mut Until { cycle: cycles, is_given: false }, &mut kept);
    kept.0
}

#[test]
fn late_cycles_are_counted_and_never_caught_up_in_a_burst() {
    const PERIOD: Span = Span::us(500);
    // Every 200th cycle takes five periods and a bit, so the slot that has begun then is the fifth.
    let pause = Duration::from_micros(2_600);
    let records = run(&mut Wall::starting_at(monotonic_now() + PERIOD, PERIOD), 200, pause, 2_000);
    let mut skipped = 0;
    for pair in records.windows(2) {
        let [before, after] = [&pair[0], &pair[1]];
        for record in [before, after] {
            let grid = Moment::ZERO + PERIOD * record.cycle as i64;
            assert_eq!(record.timing.scheduled, grid, "cycle {} left the grid", record.cycle);
            let late = record.timing.woke - grid;
            assert!(late >= Span::ZERO, "cycle {} ran before its slot", record.cycle);
            let whole = (record.timing.wake_error() - late).as_ns();
            assert!(whole >= 0 && whole % PERIOD.as_ns() == 0, "cycle {}: {:?}", record.cycle, record.timing);
            assert!(
                late < PERIOD,
                "cycle {} ran {} us late, in the slot of another",
                record.cycle,
                late.as_us()
            );
        }
        assert!(after.cycle > before.cycle, "cycle {} after {}", after.cycle, before.cycle);
        let gap = after.cycle - before.cycle - 1;
        skipped += gap;
        assert_eq!(
            after.overruns - before.overruns,
            gap,
            "cycle {}: each skipped period counts",
            after.cycle
        );
    }
    let first = &records[0];
    assert_eq!(records[records.len() - 1].overruns, first.overruns + skipped);
    // 2000 periods less those skipped; a busy machine adds pauses of its own.
    let pauses = records.len() as u64 / 200;
    assert!(pauses >= 4 && skipped >= 4 * pauses, "{skipped} periods skipped in {pauses} pauses");
    // A burst would run cycles without waiting: of any three in a row, one whole slot lies between.
    for trio in records.windows(3) {
        let span = trio[2].timing.woke - trio[0].timing.woke;
        assert!(span > PERIOD, "three cycles within {} us", span.as_us());
    }
    println!("{} cycles, {skipped} skipped in {pauses} pauses", records.len());
}

#[test]
fn axes_at_rest_stand_occasional_misses() {
    let records = run(
        &mut Wall::starting_at(monotonic_now() + Span::us(500), Span::us(500)),
        400,
        Duration::from_micros(1_600),
        1_500,
    );
    // What follows is the way to rest.
    let held = records.partition_point(|record| record.cycle < 1_500);
    let (records, last) = (&records[..held], &records[held - 1]);
    // A pause of more than three periods runs the slot that has begun and skips at least two.
    assert!(last.overruns >= 6, "{} periods missed in 3 pauses of 2 or more", last.overruns);
    let longest = records.windows(2).map(|pair| pair[1].overruns - pair[0].overruns).max().unwrap_or(0);
    for (axis, row) in last.axes.iter() {
        // 60 misses are borne, 8 at once; only a machine that adds its own can make more of them here.
        let is_right = match row.fault {
            None => row.mode == ModeTag::Ready,
            Some(fault) => {
                (last.overruns > 60 || longest > 8) && matches!(fault, Fault::Overrun | Fault::OtherAxis)
            }
        };
        assert!(is_right, "axis {axis}, {} overruns: {:?}, {:?}", last.overruns, row.mode, row.fault);
        let moved_um = row.sample.position.as_um();
        assert!(moved_um.abs() < 20.0, "axis {axis} moved by {moved_um} um at rest");
    }
}

#[test]
fn virtual_time_has_every_slot_and_no_overrun() {
    let records = run(&mut Virtual::new(Span::us(500)), 1_000_000, Duration::ZERO, 500);
    assert!(records.len() > 501, "{} cycles", records.len());
    for (number, record) in records.iter().enumerate() {
        assert_eq!((record.cycle, record.overruns), (number as u64, 0));
        assert_eq!(record.timing.woke, record.timing.scheduled);
    }
}
