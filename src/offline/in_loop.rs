//! One axis in the shipped loops, in memory: what tuning runs thousands of times, and identification holds against
//! a log.
//!
//! ```text
//!   setpoint ──► AxisLoop ──► current, as the board rounds and applies it ──► Plant ──► encoder ──┐
//!                   ▲                                                                             │
//!                   └── velocity estimate ◄── counts ◄────────────────────────────────────────────┘
//! ```
//!
//! It begins sliding, wound up, with the torque of friction already in the integral: a friction feed-forward holds
//! it for a tick, and the swap to the gains in question gives it to the integral, as a swap of gains does in a
//! real run. What is left of the beginning fades while the axis settles. Encoder counts, rounding of the
//! current, and when a command acts are those of the board (`sim/board`); frames, logs and other axes are left out.
//! Invariant: no formula of control or plant is repeated here; nothing is random.

use crate::base::command::Limits as Acted;
use crate::base::fault::Fault;
use crate::base::sample::{Freshness, Sample};
use crate::base::setpoint::Setpoint;
use crate::base::time::Span;
use crate::base::units::{Current, Position, Velocity};
use crate::config::machine::{Axis, Gains};
use crate::plant::encoder::{Knot, Latch};
use crate::plant::friction::Law;
use crate::plant::{Plant, steady_force};
use crate::rt::control::{AxisLoop, Settings};
use crate::rt::drive::sheet::CommandApplies;
use crate::rt::drive::velocity::VelocityEstimator;

/// Gain sets of a run: that of the beginning, and the one in question.
const BEGIN: u8 = 0;
const ASKED: u8 = 1;

/// The axis on its way.
#[derive(Debug)]
pub struct InLoop<'a> {
    axis: &'a Axis,
    loops: AxisLoop,
    plant: Plant,
    encoder: Latch,
    estimator: VelocityEstimator,
    /// Where the motor was at the first tick.
    start: Position,
    ticks: u64,
    /// In force, and about to be with the next SYNC.
    acting: Current,
    waiting: Current,
    asked: Current,
    limits: Acted,
    fault: Option<Fault>,
}

impl<'a> InLoop<'a> {
    /// An axis that slides with its motor at `start`, under `gains`. Its `plant` need not be what its control
    /// believes, and is that of [`Plant::sliding`] at this velocity and place.
    pub fn sliding(axis: &'a Axis, plant: Plant, start: Position, velocity: Velocity, gains: &Gains) -> Self {
        let period = axis.control.tick;
        let real = steady_force(&axis.plant, velocity, start);
        let mut begin = *gains;
        let believed = Law::new(axis.control.axis.friction).sliding(velocity).as_n();
        begin.compensation.friction = if believed == 0.0 { 0.0 } else { real.as_n() / believed };
        let mut settings = Settings { gain_set_count: 2, ..axis.control };
        settings.gain_sets[usize::from(BEGIN)] = begin;
        settings.gain_sets[usize::from(ASKED)] = *gains;

        let mut estimator = VelocityEstimator::new(axis.velocity_estimate, period);
        let mut encoder = Latch::new(axis.feedback_latency, period);
        for back in (1..=3).rev() {
            let position = Position::m(velocity.as_m_per_s() * period.as_s() * -f64::from(back));
            encoder.feed(Knot { position, velocity });
            estimator.advance(start + position, 1);
        }
        encoder.feed(Knot { position: Position::ZERO, velocity });
        let current = axis.plant.actuator.current(axis.plant.mechanics.torque_for_force(real));
        Self {
            axis,
            loops: AxisLoop::new(&settings),
            plant: plant.placed(start),
            encoder,
            estimator,
            start,
            ticks: 0,
            acting: current,
            waiting: current,
            asked: current,
            limits: Acted::NONE,
            fault: None,
        }
    }

    /// One period; where the motor is at its SYNC. The position loop acts in the first.
    pub fn tick(&mut self, setpoint: &Setpoint, is_position_tick: bool) -> Position {
        if self.ticks > 0 {
            self.plant.step(self.acting);
            let state = self.plant.state();
            self.encoder.feed(Knot { position: state.motor_position, velocity: state.motor_velocity });
            self.loops.pass(1);
        }
        if self.axis.sheet.command_applies == CommandApplies::OnNextSync {
            self.acting = self.waiting;
        }
        let sample = self.sample();
        match self.ticks {
            // The loops take over an axis that is on its way.
            0 => self.loops.follow(&sample),
            1 => self.loops.use_gains(ASKED, setpoint, &sample),
            _ => self.fault = self.loops.violation(&sample),
        }
        self.ticks += 1;
        let answer = self.loops.step(setpoint, &sample, is_position_tick);
        let counts = self.axis.scale.current_counts(answer.current);
        self.asked = self.axis.scale.current(counts);
        self.limits = answer.limits;
        if answer.is_not_a_number {
            self.fault = Some(Fault::NotANumber);
        }
        match self.axis.sheet.command_applies {
            CommandApplies::OnReceipt => self.acting = self.asked,
            CommandApplies::OnNextSync => self.waiting = self.asked,
        }
        sample.position
    }

    /// Current asked of the drive in the last period.
    pub const fn asked(&self) -> Current {
        self.asked
    }

    /// Limits that acted in it.
    pub const fn limits(&self) -> Acted {
        self.limits
    }

    /// Why the cycle would have stopped the axis in it.
    pub const fn fault(&self) -> Option<Fault> {
        self.fault
    }

    fn sample(&mut self) -> Sample {
        let scale = &self.axis.scale;
        let place = self.encoder.position(Span::ZERO);
        let [shown, _] = self.plant.shown(place, place);
        let latched = scale.motor_counts(self.start + shown);
        let position = scale.motor_position(latched);
        Sample {
            freshness: Freshness::Fresh,
            position,
            velocity: self.estimator.advance(position, 1),
            current: scale.current(scale.current_counts(self.plant.state().current)),
            ..Sample::default()
        }
    }
}
