//! A host that stalls between waking and its SYNC: it loses a cycle, and nothing that looks worse.

use std::sync::Arc;

use quadrant::base::record::{ModeTag, Timing};
use quadrant::base::sample::Freshness;
use quadrant::base::time::{Moment, Span};
use quadrant::rt::bus::{Bus, Frame, Received, SendError};
use quadrant::rt::cycle::pace::Slot;
use quadrant::rt::cycle::standby::Standby;

use super::{Clocked, PERIOD, POWER_ON, cycle_on, on_grid};
use crate::common::machine;

/// The cycle whose SYNC is late, and by how much.
const STALLED: u32 = 1_000;
const STALL: Span = Span::us(1_350);

fn stalled(cycle: u32) -> Moment {
    if cycle == STALLED { on_grid(cycle) + STALL } else { on_grid(cycle) }
}

fn stalled_command(cycle: u32) -> Moment {
    stalled(cycle) + Span::us(100)
}

/// The same bus, on which answers are dated when they came, as on an interface.
struct Dated(Clocked);

impl Bus for Dated {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.0.send(frame)
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        let at = self.0.now;
        self.0.receive(until).map(|received| Received { at, ..received })
    }
}

#[test]
fn a_stall_of_more_than_two_periods_before_a_sync_is_no_reset_of_a_board() {
    let machine = machine("reference");
    let mut bus = Dated(Clocked::new(machine.live_rack(7, POWER_ON), stalled, stalled_command));
    let mut cycle = cycle_on(&machine, &mut bus);
    let mut orders = Standby::new(true, Arc::default());
    let (mut number, mut overruns) = (0, 0);
    while number < 1_500 {
        let scheduled = Moment::ZERO + PERIOD * number as i64;
        let slot = Slot { number, timing: Timing::at(scheduled), overruns };
        let (record, _) = cycle.run(&mut bus, &mut orders, &slot, &mut || scheduled);
        for (axis, row) in record.axes.iter() {
            assert_eq!(row.fault, None, "axis {axis}, cycle {number}");
            let is_fresh = row.sample.freshness == Freshness::Fresh;
            assert_eq!(is_fresh, number != u64::from(STALLED), "axis {axis}, cycle {number}");
            assert!(
                number < 200 || row.mode == ModeTag::Ready,
                "axis {axis}, cycle {number}: {:?}",
                row.mode
            );
        }
        // Slots that were over when the host came to its SYNC are skipped.
        let missed = if number == u64::from(STALLED) { (STALL / PERIOD) as u64 } else { 0 };
        (number, overruns) = (number + 1 + missed, overruns + missed);
    }
    assert_eq!(overruns, 2);
}
