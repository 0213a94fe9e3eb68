//! All boards of a machine with their plants behind them, on one end of a bus, in virtual time.
//!
//! The rack lives by the SYNC: when the host sends the one of cycle `k`, every plant has moved on by
//! the periods since the last SYNC under the current of its board, and every board latches what its
//! sensors show. Between two SYNCs boards hear commands and parameter requests at the time of the last.
//! [`LiveRack`](super::live_rack::LiveRack) is the same machine on the wall clock.
//! Invariant: its time is the cycle number in the SYNC, so it is the same at any speed of the host.

use super::axis::{Axis, Stepping};
use super::board::Board;
use super::script::Script;
use super::script::player::Player;
use crate::base::axis::{AxisId, PerAxis};
use crate::base::time::{Moment, Span};
use crate::base::units::{Current, Position};
use crate::plant::{self, FINE_STEPS};
use crate::rt::bus::{Bus, Frame};
use crate::rt::wire::{Address, command};

pub use super::axis::AxisSettings;

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
        // A counter that has stood still or gone back is a repeated or late SYNC: no time has passed.
        let elapsed = self.last_cycle.map_or(0, |last| cycle.wrapping_sub(last) as i32).max(0);
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
        self.last_cycle = Some(cycle);
    }

    /// The board of an axis, to make it fail.
    pub fn board_mut(&mut self, axis: AxisId) -> &mut Board {
        &mut self.axes[axis.index()].board
    }

    /// What an axis really does.
    pub fn state(&self, axis: AxisId) -> plant::State {
        self.axes[axis.index()].state()
    }

    /// Where the motor of an axis is, as a perfect encoder would be latched by a SYNC now.
    pub fn sensed(&self, axis: AxisId) -> Position {
        self.axes[axis.index()].sensed()
    }

    /// Low byte of the cycle of the command that acts on an axis; `None` before the first.
    pub fn acting_command(&self, axis: AxisId) -> Option<u8> {
        self.axes[axis.index()].board.acting_command()
    }

    /// Current that the drive of an axis gives now.
    pub fn current(&self, axis: AxisId) -> Current {
        self.axes[axis.index()].current()
    }
}

/// A frame comes to all boards.
fn reach(axes: &mut [Axis], frame: &Frame, now: Moment) {
    for axis in axes {
        axis.hear(frame, now, Span::ZERO);
    }
}
