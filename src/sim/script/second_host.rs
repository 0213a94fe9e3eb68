//! Another host on the same bus: somebody has started a second controller.
//!
//! It counts its SYNCs from zero and orders every drive to take its current away, once in each period,
//! between the SYNCs of the first host. Like every frame on the bus, the first host hears them too.
//! Invariant: it listens to nobody.

use super::Sends;
use crate::base::time::{Moment, Span};
use crate::rt::bus::Frame;
use crate::rt::wire::command::{self, CYCLIC_SYNCHRONOUS_TORQUE, RawCommand};
use crate::rt::wire::{Layout, Node};

/// Where in the period of the first host it talks, in hundredths.
const PHASE_PERCENT: i64 = 60;

/// A host that talks.
#[derive(Clone, Debug)]
pub(super) struct SecondHost {
    sends: Sends,
    period: Span,
    next: Moment,
    cycle: u32,
}

impl SecondHost {
    /// One that starts in the period that begins now.
    pub(super) fn new(sends: Sends, period: Span, now: Moment) -> Self {
        let phase = Span::ns(period.as_ns() * PHASE_PERCENT / 100);
        Self { sends, period, next: now + phase, cycle: 0 }
    }

    /// What it says up to a moment.
    pub(super) fn speak(
        &mut self,
        until: Moment,
        boards: impl Iterator<Item = (Node, Layout)> + Clone,
        mut say: impl FnMut(Frame),
    ) {
        while self.next <= until {
            if self.sends != Sends::Commands {
                say(command::encode_sync(self.cycle));
            }
            if self.sends != Sends::Sync {
                let raw = RawCommand {
                    cycle: self.cycle as u16,
                    sequence: self.cycle as u8,
                    mode_of_operation: CYCLIC_SYNCHRONOUS_TORQUE,
                    ..RawCommand::default()
                };
                boards.clone().for_each(|(node, layout)| say(layout.command(node, &raw)));
            }
            self.cycle = self.cycle.wrapping_add(1);
            self.next = self.next + self.period;
        }
    }
}
