//! All boards of a machine with their plants behind them, on one end of a bus, in virtual time.
//!
//! The rack lives by the SYNC: when the host sends the one of cycle `k`, every plant has moved on by
//! the periods since the last SYNC under the current of its board, and every board latches what its
//! sensors show. Between two SYNCs boards hear commands and parameter requests at the time of the last.
//! [`LiveRack`](super::live_rack::LiveRack) is the same machine on the wall clock.
//! Invariant: its time is the cycle number in the SYNC, so it is the same at any speed of the host.

use super::axis::{self, Axis, Stepping};
use super::board::Board;
use super::script::Script;
use super::script::player::Player;
use super::truth::AxisTruth;
use crate::base::axis::{AxisId, PerAxis};
use crate::base::time::{Moment, Span};
use crate::plant::{self, FINE_STEPS};
use crate::rt::bus::{Bus, Frame};
use crate::rt::wire::{Address, command};

pub use super::axis::AxisSettings;

/// A SYNC is overtaken by so many at most.
const LATE_MIN: i32 = -8;
/// A host is away for so many periods at most: a minute at 2 kHz.
const LEAP_MAX: i32 = 120_000;

/// The boards and plants of a machine.
#[derive(Debug)]
pub struct Rack {
    period: Span,
    now: Moment,
    last_cycle: Option<u32>,
    axes: Vec<Axis>,
    player: Player,
}

impl Rack {
    /// A machine at rest, powered on at moment zero. The seed decides where the encoders' counters
    /// stand and what the noise is.
    pub fn new(period: Span, axes: &PerAxis<AxisSettings>, seed: u64) -> Self {
        let stepping = Stepping { step: period, fine_steps: FINE_STEPS };
        let axis = |(id, settings): (AxisId, &AxisSettings)| {
            Axis::new(settings, stepping, seed.wrapping_add(id.index() as u64), Moment::ZERO)
        };
        let axes = axes.iter().map(axis).collect();
        Self { period, now: Moment::ZERO, last_cycle: None, axes, player: Player::default() }
    }

    /// The same machine, in which something goes wrong.
    pub fn with_script(mut self, script: &Script) -> Self {
        self.player = Player::new(script, self.period, &mut self.axes);
        self
    }

    /// Hear all frames that wait at this end of the bus, and put the answers on it.
    pub fn serve(&mut self, bus: &mut impl Bus) {
        while let Some(received) = bus.receive(self.now) {
            self.hear(&received.frame);
            self.player.speak(&mut self.axes, self.now, bus);
        }
    }

    fn hear(&mut self, frame: &Frame) {
        if Address::of(frame.id()) == Some(Address::Sync)
            && let Ok(cycle) = command::decode_sync(frame)
        {
            self.pass_to(cycle);
        }
        let Self { player, axes, now, .. } = self;
        player.hear(Some(frame), *now, |frame| reach(axes, frame, *now));
    }

    /// The periods up to this cycle are over.
    fn pass_to(&mut self, cycle: u32) {
        let elapsed = self.count(cycle);
        self.player.begin(self.now);
        for _ in 0..elapsed {
            for said in self.player.second_hosts(self.now + self.period, &self.axes) {
                reach(&mut self.axes, &said, self.now);
            }
            self.now = self.now + self.period;
            for axis in &mut self.axes {
                axis.step(axis.current(), self.now);
            }
            self.player.pass(self.now, &mut self.axes);
        }
        self.player.pass(self.now, &mut self.axes);
    }

    /// The periods up to this cycle, since the last SYNC.
    fn count(&mut self, cycle: u32) -> u32 {
        let Some(last) = self.last_cycle else {
            self.last_cycle = Some(cycle);
            return 0;
        };
        let elapsed = match cycle.wrapping_sub(last) as i32 {
            // Repeated or late: no time has passed, neither now nor with the next one.
            LATE_MIN..=0 => 0,
            ahead @ 1..=LEAP_MAX => ahead as u32,
            // A broken number, or somebody who counts anew: boards latch at every SYNC, whatever its number.
            _ => 1,
        };
        self.last_cycle = Some(last.wrapping_add(elapsed));
        elapsed
    }

    /// The board of an axis, to make it fail.
    pub fn board_mut(&mut self, axis: AxisId) -> &mut Board {
        &mut self.axes[axis.index()].board
    }

    /// What an axis really does.
    pub fn state(&self, axis: AxisId) -> plant::State {
        self.axes[axis.index()].state()
    }

    /// Low byte of the cycle of the command that acts on an axis; `None` before the first.
    pub fn acting_command(&self, axis: AxisId) -> Option<u8> {
        self.axes[axis.index()].board.acting_command()
    }

    /// What all axes really do, where a perfect encoder would be latched by a SYNC now.
    pub fn truths(&self) -> PerAxis<AxisTruth> {
        PerAxis::from_fn(self.axes.len(), |axis| self.axes[axis.index()].truth(Span::ZERO))
    }
}

/// A frame comes to all boards.
fn reach(axes: &mut [Axis], frame: &Frame, now: Moment) {
    axis::cross(axes, frame, Span::ZERO);
    for axis in axes {
        axis.hear(frame, now, Span::ZERO);
    }
}
