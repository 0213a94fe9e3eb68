//! All boards of a machine with their plants behind them, on one end of a bus, on the wall clock.
//!
//! Time is the moment at which a frame came, and the moment that the caller says it is now. The plants
//! move on in steps of a tenth of the period or less, up to the last whole step before that moment; the
//! encoders are latched at the moment itself. A current acts from the moment at which its board applies
//! it: a step in which it changes gets the mean, which leaves the momentum right. Boards' clocks,
//! watchdogs and heartbeats go on while the host is silent.
//!
//! ```text
//!   SYNC, stamped by the kernel ─┐                          ┌─ command, stamped
//!   ──┼────────┼────────┼────────▼──┼────────┼────────┼─────▼──┼───► steps of the plant
//!                                └ latched: end of the last step and velocity times the rest
//! ```
//!
//! SYNCs that jitter by 100 us find the axis within 1 nm of where an independent integration has it
//! (`tests/cycle/live_rack`); the rest below one step leaves out `a t² / 2`, 10 nm at 8 m/s^2.
//! Invariant: no clock is read here, and time never goes back: a frame that is looked at late is answered
//! from what the sensors showed when it came.

use std::collections::VecDeque;

use super::axis::{self, Axis, AxisSettings, Stepping};
use super::board::Board;
use super::script::Script;
use super::script::player::Player;
use super::truth::AxisTruth;
use crate::base::axis::{AxisId, PerAxis};
use crate::base::time::{Moment, Span};
use crate::base::units::Current;
use crate::plant;
use crate::rt::bus::{Bus, Frame, Received};
use crate::rt::wire::Address;

/// Longest step.
const STEP_MAX: Span = Span::us(50);
/// Fewest steps in a period.
const STEPS_MIN: i64 = 10;

/// The boards and plants of a machine, following a clock.
#[derive(Debug)]
pub struct LiveRack {
    step: Span,
    /// End of the last step.
    stepped: Moment,
    axes: Vec<Axis>,
    /// Of each axis.
    currents: Vec<CurrentLine>,
    period: Span,
    player: Player,
}

impl LiveRack {
    /// A machine at rest that gets power at a moment. The seed decides where the encoders' counters stand
    /// and what the noise is.
    pub fn new(period: Span, axes: &PerAxis<AxisSettings>, seed: u64, power_on: Moment) -> Self {
        let steps = ((period + STEP_MAX - Span::ns(1)) / STEP_MAX).max(STEPS_MIN);
        let step = Span::ns(period.as_ns() / steps);
        let axis = |(id, settings): (AxisId, &AxisSettings)| {
            // The dead time is kept here: it may be many steps long.
            let mut prompt = *settings;
            prompt.plant.actuator.dead_time = Span::ZERO;
            let stepping = Stepping { step, fine_steps: 1 };
            Axis::new(&prompt, stepping, seed.wrapping_add(id.index() as u64), power_on)
        };
        let current = |axis: &AxisSettings| CurrentLine::new(axis.plant.actuator.dead_time);
        Self {
            step,
            stepped: power_on,
            axes: axes.iter().map(axis).collect(),
            currents: axes.as_slice().iter().map(current).collect(),
            period,
            player: Player::default(),
        }
    }

    /// The same machine, in which something goes wrong.
    pub fn with_script(mut self, script: &Script) -> Self {
        self.player = Player::new(script, self.period, &mut self.axes);
        self
    }

    /// Serve the bus until a moment: each frame that comes is answered at once, as of when it came.
    pub fn serve(&mut self, bus: &mut impl Bus, until: Moment) {
        while let Some(received) = bus.receive(until) {
            self.answer(&received, bus);
        }
        self.speak(until, bus);
    }

    /// A frame came: the answers go to the bus.
    pub fn answer(&mut self, received: &Received, bus: &mut impl Bus) {
        self.hear(received);
        self.player.speak(&mut self.axes, received.at, bus);
    }

    /// It is now: what the boards say by themselves goes to the bus.
    pub fn speak(&mut self, now: Moment, bus: &mut impl Bus) {
        self.advance_to(now);
        self.player.speak(&mut self.axes, now, bus);
    }

    /// A frame came.
    pub fn hear(&mut self, received: &Received) {
        let Received { frame, at } = received;
        self.advance_to(*at);
        if Address::of(frame.id()) == Some(Address::Sync) {
            self.player.begin(*at);
        }
        self.player.pass(*at, &mut self.axes);
        let after = *at - self.stepped;
        let Self { player, axes, currents, .. } = self;
        player.hear(Some(frame), *at, |frame| reach(axes, currents, frame, *at, after));
    }

    /// Time passes, whether or not the host is heard.
    pub fn advance_to(&mut self, now: Moment) {
        while self.stepped + self.step <= now {
            let end = self.stepped + self.step;
            for (axis, current) in self.axes.iter_mut().zip(&mut self.currents) {
                axis.step(current.mean(self.stepped, end), end);
                current.note(axis.current(), end);
            }
            self.stepped = end;
            let Self { player, axes, currents, .. } = self;
            player.pass(end, axes);
            for said in player.second_hosts(end, axes) {
                reach(axes, currents, &said, end, Span::ZERO);
            }
            player.hear(None, end, |frame| reach(axes, currents, frame, end, Span::ZERO));
        }
    }

    /// The board of an axis, to make it fail.
    pub fn board_mut(&mut self, axis: AxisId) -> &mut Board {
        &mut self.axes[axis.index()].board
    }

    /// What all axes really do at a moment, up to a step after the last.
    pub fn truths(&self, now: Moment) -> PerAxis<AxisTruth> {
        let after = now - self.stepped;
        PerAxis::from_fn(self.axes.len(), |axis| self.axes[axis.index()].truth(after))
    }

    /// What an axis really did at the end of the last step.
    pub fn state(&self, axis: AxisId) -> plant::State {
        self.axes[axis.index()].state()
    }
}

/// A frame comes to all boards, so long after the end of the last step.
fn reach(axes: &mut [Axis], currents: &mut [CurrentLine], frame: &Frame, at: Moment, after: Span) {
    axis::cross(axes, frame, after);
    for (axis, current) in axes.iter_mut().zip(currents) {
        axis.hear(frame, at, after);
        current.note(axis.current(), at);
    }
}

/// The current of an axis over time, behind the dead time.
#[derive(Debug)]
struct CurrentLine {
    dead_time: Span,
    /// What acts.
    acting: Current,
    /// What the board gives, and what acted before it, with the moments from which each acts.
    coming: VecDeque<(Moment, Current)>,
}

impl CurrentLine {
    const fn new(dead_time: Span) -> Self {
        Self { dead_time, acting: Current::ZERO, coming: VecDeque::new() }
    }

    /// The board gives this current from a moment on.
    fn note(&mut self, current: Current, at: Moment) {
        let last = self.coming.back().map_or(self.acting, |(_, last)| *last);
        if current != last {
            self.coming.push_back((at + self.dead_time, current));
        }
    }

    /// The mean from one moment to another, which is the start of the next.
    fn mean(&mut self, start: Moment, end: Moment) -> Current {
        let (mut since, mut sum) = (start, Current::ZERO);
        let mut is_steady = true;
        while let Some(&(at, next)) = self.coming.front()
            && at < end
        {
            self.coming.pop_front();
            if at > since {
                sum += self.acting * (at - since).as_s();
                since = at;
                is_steady = false;
            }
            self.acting = next;
        }
        if is_steady {
            self.acting
        } else {
            (sum + self.acting * (end - since).as_s()) / (end - start).as_s()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(us: i64) -> Moment {
        Moment::ZERO + Span::us(us)
    }

    #[test]
    fn a_step_gets_the_mean_of_its_currents() {
        let mut line = CurrentLine::new(Span::ZERO);
        line.note(Current::a(3.0), at(0));
        line.note(Current::a(3.0), at(20));
        assert_eq!(line.mean(at(0), at(50)), Current::a(3.0), "to the bit where it is steady");
        line.note(Current::a(5.0), at(60));
        line.note(Current::a(-1.0), at(90));
        let mean_a = line.mean(at(50), at(100)).as_a();
        assert!((mean_a - (3.0 * 10.0 + 5.0 * 30.0 - 10.0) / 50.0).abs() < 1e-12, "{mean_a} A");
        assert_eq!(line.mean(at(100), at(150)), Current::a(-1.0));
        line.note(Current::a(7.0), at(140));
        assert_eq!(line.mean(at(150), at(200)), Current::a(7.0), "one that is told late acts late");
    }

    #[test]
    fn a_dead_time_longer_than_many_steps_only_shifts() {
        let mut line = CurrentLine::new(Span::us(1_010));
        line.note(Current::a(2.0), at(0));
        let means: Vec<f64> = (0..25).map(|n| line.mean(at(50 * n), at(50 * n + 50)).as_a()).collect();
        assert_eq!(&means[..20], [0.0; 20]);
        assert!((means[20] - 1.6).abs() < 1e-12, "{} A in the step where it begins", means[20]);
        assert_eq!(&means[21..], [2.0; 4]);
    }
}
