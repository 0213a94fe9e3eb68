//! One axis with its loops and its plant, period by period: what any analysis runs that asks what an axis would
//! have done.
//!
//! ```text
//!   setpoint ─► loops ─► counts of current ─► plant ─► latch ─► counts of position ─► velocity estimate ─┐
//!                 ▲───────────────────────────────────────────────────────────────────────────────────────┘
//! ```
//!
//! Loops, plant, latch, estimator and scale are those that ship; encoder counts, rounding of the current and when a
//! command acts are those of the board (`sim/board`). Frames, modes and logs are left out: the cycle over frames
//! gives the same numbers at a hundred times the price.
//! Invariant: pure function of settings, start and setpoints; no formula of control or plant is repeated here.

use crate::base::command::Terms;
use crate::base::sample::{Freshness, Sample};
use crate::base::setpoint::Setpoint;
use crate::base::time::Span;
use crate::base::units::{Current, Position, Torque, Velocity};
use crate::config::machine::Axis;
use crate::plant::effects::Neighbour;
use crate::plant::encoder::{Knot, Latch};
use crate::plant::{Parameters, Plant};
use crate::rt::control::{AxisLoop, Settings};
use crate::rt::drive::sheet::CommandApplies;
use crate::rt::drive::velocity::VelocityEstimator;

/// How an axis moves at the first row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Where its motor is.
    pub position: Position,
    /// How fast it goes; at rest, friction holds it.
    pub velocity: Velocity,
    /// Current of its motor.
    pub current: Current,
    /// Since the start of the machine.
    pub time: Span,
}

/// What a row of a log would hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// What the encoder showed at the SYNC.
    pub position: Position,
    /// What the scale at the table showed.
    pub table_position: Position,
    /// Current at the SYNC.
    pub current: Current,
    /// Current asked of the drive.
    pub asked: Current,
    /// How it came about.
    pub terms: Terms,
}

/// An axis on its way.
#[derive(Clone, Debug)]
pub struct ClosedAxis {
    axis: Axis,
    loops: AxisLoop,
    plant: Plant,
    motor: Latch,
    table: Latch,
    estimator: VelocityEstimator,
    /// Where the motor was at the first row.
    start: Position,
    /// Current of the first row, until the loops have taken it over.
    begins_with: Option<Torque>,
    /// In force, and about to be with the next SYNC.
    acting: Current,
    waiting: Current,
}

impl ClosedAxis {
    /// The axis of a machine with the gains of a set, whose plant need not be what its control believes.
    pub fn begin(axis: &Axis, gain_set: u8, plant: &Parameters, start: Start) -> Self {
        let tick = axis.control.tick;
        let mut settings = Settings { gain_set_count: 1, ..axis.control };
        settings.gain_sets[0] = axis.control.gain_sets[usize::from(gain_set)];
        let torque = plant.actuator.torque(start.current);
        let moving = if start.velocity == Velocity::ZERO {
            Plant::standing(plant, tick, plant.mechanics.force_of_torque(torque)).placed(start.position)
        } else {
            Plant::sliding(plant, tick, start.velocity, start.position)
        };
        let moving = moving.after(start.time);
        let mut estimator = VelocityEstimator::new(axis.velocity_estimate, tick);
        let state = moving.state();
        let mut motor = Latch::new(axis.feedback_latency, tick);
        let mut table = Latch::new(axis.feedback_latency, tick);
        for back in (0..=3).rev() {
            let way = Position::m(-start.velocity.as_m_per_s() * tick.as_s() * f64::from(back));
            motor.feed(Knot { position: way, velocity: start.velocity });
            table.feed(Knot { position: state.table_position + way, velocity: start.velocity });
            if back > 0 {
                estimator.advance(start.position + way, 1);
            }
        }
        Self {
            axis: *axis,
            loops: AxisLoop::new(&settings),
            plant: moving,
            motor,
            table,
            estimator,
            start: start.position,
            begins_with: Some(torque),
            acting: start.current,
            waiting: start.current,
        }
    }

    /// One row: what is latched with its SYNC, and what the loops ask for then. What its scale shows of the next axis is
    /// in it, where that is known.
    pub fn row(&mut self, setpoint: &Setpoint, is_position_tick: bool, next: Option<&Neighbour>) -> Row {
        let scale = &self.axis.scale;
        if self.axis.sheet.command_applies == CommandApplies::OnNextSync {
            self.acting = self.waiting;
        }
        let [motor, table] =
            self.plant.shown(self.motor.position(Span::ZERO), self.table.position(Span::ZERO));
        let crossing = next.map_or(Position::ZERO, |next| self.plant.crossing(next));
        let position = scale.motor_position(scale.motor_counts(self.start + motor));
        let table = scale.table_counts(self.start + table + crossing);
        let current = scale.current(scale.current_counts(self.plant.state().current));
        let velocity = self.estimator.advance(position, 1);
        let sample = Sample { freshness: Freshness::Fresh, position, velocity, current, ..Sample::default() };
        if let Some(torque) = self.begins_with.take() {
            self.loops.take_over(setpoint, &sample, torque);
        }
        let answer = self.loops.step(setpoint, &sample, is_position_tick);
        let asked = scale.current(scale.current_counts(answer.current));
        match self.axis.sheet.command_applies {
            CommandApplies::OnReceipt => self.acting = asked,
            CommandApplies::OnNextSync => self.waiting = asked,
        }
        let table_position = scale.table_position(table);
        Row { position, table_position, current, asked, terms: answer.terms }
    }

    /// The period to the next row passes.
    pub fn pass(&mut self) {
        self.plant.step(self.acting);
        let state = self.plant.state();
        self.motor.feed(Knot { position: state.motor_position, velocity: state.motor_velocity });
        self.table.feed(Knot { position: state.table_position, velocity: state.table_velocity });
        self.loops.pass(1);
    }
}
