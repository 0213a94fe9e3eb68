//! One axis with its loops and its plant, period by period: what any analysis runs that asks what an axis would
//! have done. Tuning runs it thousands of times, identification and gap hold it against a log.
//!
//! ```text
//!   setpoint ─► loops ─► counts of current ─► plant ─► latch ─► counts of position ─► velocity estimate ─┐
//!                 ▲───────────────────────────────────────────────────────────────────────────────────────┘
//! ```
//!
//! Loops, plant, latch, estimator and scale are those that ship; encoder counts, rounding of the current and when a
//! command acts are those of the board (`sim/board`). Frames, modes and logs are left out: the cycle over frames
//! gives the same numbers at a hundred times the price.
//!
//! It begins in one of two ways. [`ClosedAxis::sliding`] is for what has time to settle: a friction feed-forward holds
//! the torque of friction for a tick, and the swap to the gains in question gives it to the integral, as a swap of
//! gains does in a real run. [`ClosedAxis::taken_over`] is for what begins where data do: the loops take over the
//! measured current, whatever it is for.
//! Invariant: pure function of settings, start and setpoints; no formula of control or plant is repeated here.

use crate::base::command::Limits as Acted;
use crate::base::fault::Fault;
use crate::base::sample::{Freshness, Sample};
use crate::base::setpoint::Setpoint;
use crate::base::time::Span;
use crate::base::units::{Current, Position, Torque, Velocity};
use crate::config::machine::{Axis, Gains};
use crate::plant::effects::Neighbour;
use crate::plant::effects::control::{Otherwise, Remembered};
use crate::plant::encoder::{Knot, Latch};
use crate::plant::friction::Law;
use crate::plant::{Parameters, Plant, steady_force};
use crate::rt::control::{AxisLoop, Settings};
use crate::rt::drive::sheet::CommandApplies;
use crate::rt::drive::velocity::VelocityEstimator;

/// Gain sets of a run that begins with a swap: that of the beginning, and the one in question.
const BEGIN: u8 = 0;
const ASKED: u8 = 1;
/// Rows before the first that latch and estimator are shown.
const ROWS_BEFORE: u8 = 3;

/// How a measured axis moves at the first row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Where its motor is, as its encoder shows it.
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
    /// What the scale at the table showed, where it is looked at.
    pub table_position: Option<Position>,
    /// Current at the SYNC.
    pub current: Current,
}

/// What the loops do in a row before they act.
#[derive(Clone, Copy, Debug)]
enum Handover {
    /// First row: the integral takes this torque.
    Torque(Torque),
    /// First row: follow the axis, which the feed-forward holds.
    Follow,
    /// Second row: the gains in question take over from the feed-forward.
    Swap,
    /// Nothing but to look for faults.
    Watched,
    /// Nothing: what is held against data has had none.
    Done,
}

/// An axis on its way.
#[derive(Clone, Debug)]
pub struct ClosedAxis<'a> {
    axis: &'a Axis,
    loops: AxisLoop,
    plant: Plant,
    motor: Latch,
    table: Option<Latch>,
    estimator: VelocityEstimator,
    /// What the control does that its settings do not say.
    otherwise: Otherwise,
    remembered: Remembered,
    /// Where the motor was at the first row.
    start: Position,
    handover: Handover,
    /// In force, about to be with the next SYNC, and asked for in the last row.
    acting: Current,
    waiting: Current,
    asked: Current,
    limits: Acted,
    fault: Option<Fault>,
}

impl<'a> ClosedAxis<'a> {
    /// An axis that slides with its motor at `start`, under `gains`. Its `plant` need not be what its control
    /// believes, and is that of [`Plant::sliding`] at this velocity and place.
    pub fn sliding(axis: &'a Axis, plant: Plant, start: Position, velocity: Velocity, gains: &Gains) -> Self {
        let real = steady_force(&axis.plant, velocity, start);
        let mut begin = *gains;
        let believed = Law::new(axis.control.axis.friction).sliding(velocity).as_n();
        begin.compensation.friction = if believed == 0.0 { 0.0 } else { real.as_n() / believed };
        let mut settings = Settings { gain_set_count: 2, ..axis.control };
        settings.gain_sets[usize::from(BEGIN)] = begin;
        settings.gain_sets[usize::from(ASKED)] = *gains;
        let current = axis.plant.actuator.current(axis.plant.mechanics.torque_for_force(real));
        let start = Start { position: start, velocity, current, time: Span::ZERO };
        Self::begin(
            axis,
            settings,
            axis.plant.otherwise(),
            plant.placed(start.position),
            &start,
            Handover::Follow,
        )
    }

    /// The axis of a machine with the gains of a set, taken over as it was measured. Its `plant` need not be what its
    /// control believes. One at rest has no more current than its friction holds: otherwise the model would slip where the machine
    /// stood.
    pub fn taken_over(axis: &'a Axis, gain_set: u8, plant: &Parameters, start: &Start) -> Self {
        let tick = axis.control.tick;
        let mut settings = Settings { gain_set_count: 1, ..axis.control };
        settings.gain_sets[0] = axis.control.gain_sets[usize::from(gain_set)];
        let mut torque = plant.actuator.torque(start.current);
        let mut start = *start;
        let moving = if start.velocity == Velocity::ZERO {
            let force = plant.mechanics.force_of_torque(torque);
            let standing = Plant::standing(plant, tick, force, start.position);
            if standing.drive_force() != force {
                torque = plant.mechanics.torque_for_force(standing.drive_force());
                start.current = plant.actuator.current(torque);
            }
            standing
        } else {
            Plant::sliding(plant, tick, start.velocity, start.position)
        };
        let handover = Handover::Torque(torque);
        // An encoder that shows something else would move the axis in its first rows.
        let (moving, motor) = moving.after(start.time).showing(start.position);
        start.position = motor;
        Self::begin(axis, settings, plant.otherwise(), moving, &start, handover)
    }

    fn begin(
        axis: &'a Axis,
        mut settings: Settings,
        otherwise: Otherwise,
        plant: Plant,
        start: &Start,
        handover: Handover,
    ) -> Self {
        let tick = axis.control.tick;
        settings.gain_sets = settings.gain_sets.map(|gains| gains_of(&otherwise, gains));
        let mut estimator = VelocityEstimator::new(axis.velocity_estimate, tick);
        let mut motor = Latch::new(axis.feedback_latency, tick);
        for back in (0..=ROWS_BEFORE).rev() {
            let position = way_back(start.velocity, tick, back);
            motor.feed(Knot { position, velocity: start.velocity });
            if back > 0 {
                let [shown, _] = plant.shown(position, position);
                estimator.advance(start.position + shown, 1);
            }
        }
        Self {
            axis,
            loops: AxisLoop::new(&settings),
            plant,
            motor,
            table: None,
            estimator,
            otherwise,
            remembered: Remembered::default(),
            start: start.position,
            handover,
            acting: start.current,
            waiting: start.current,
            asked: start.current,
            limits: Acted::NONE,
            fault: None,
        }
    }

    /// The same with a scale at the table that is looked at, before its first row.
    #[must_use]
    pub fn with_table(mut self) -> Self {
        let tick = self.axis.control.tick;
        let state = self.plant.state();
        let mut table = Latch::new(self.axis.feedback_latency, tick);
        for back in (0..=ROWS_BEFORE).rev() {
            let position = state.table_position + way_back(state.table_velocity, tick, back);
            table.feed(Knot { position, velocity: state.table_velocity });
        }
        self.table = Some(table);
        self
    }

    /// One row: what is latched with its SYNC, and what the loops ask for then. The position loop acts in the first. What
    /// the scale at the table shows of the next axis is in it, where that is known.
    pub fn row(&mut self, setpoint: &Setpoint, is_position_tick: bool, next: Option<&Neighbour>) -> Row {
        if self.axis.sheet.command_applies == CommandApplies::OnNextSync {
            self.acting = self.waiting;
        }
        let (sample, table_position) = self.latched(next);
        let tick = self.axis.control.tick;
        let pushed = self.otherwise.current(&mut self.remembered, setpoint, tick);
        let late = self.otherwise.late(&mut self.remembered, setpoint, tick);
        let setpoint = late.as_ref().unwrap_or(setpoint);
        match self.handover {
            Handover::Torque(torque) => {
                self.loops.take_over(setpoint, &sample, torque);
                self.handover = Handover::Done;
            }
            Handover::Follow => {
                self.loops.follow(&sample);
                self.handover = Handover::Swap;
            }
            Handover::Swap => {
                self.loops.use_gains(ASKED, setpoint, &sample);
                self.handover = Handover::Watched;
            }
            Handover::Watched => self.fault = self.loops.violation(&sample),
            Handover::Done => {}
        }
        let answer = self.loops.step(setpoint, &sample, is_position_tick);
        let asked = if pushed == Current::ZERO { answer.current } else { answer.current + pushed };
        self.asked = self.axis.scale.current(self.axis.scale.current_counts(asked));
        self.limits = answer.limits;
        if answer.is_not_a_number {
            self.fault = Some(Fault::NotANumber);
        }
        match self.axis.sheet.command_applies {
            CommandApplies::OnReceipt => self.acting = self.asked,
            CommandApplies::OnNextSync => self.waiting = self.asked,
        }
        Row { position: sample.position, table_position, current: sample.current }
    }

    /// The period to the next row passes.
    pub fn pass(&mut self) {
        self.pass_shaken(Current::ZERO);
    }

    /// The same where the torque is that of so much more current, of which the loops know nothing.
    pub fn pass_shaken(&mut self, by: Current) {
        self.plant.step(self.acting + by);
        let state = self.plant.state();
        self.motor.feed(Knot { position: state.motor_position, velocity: state.motor_velocity });
        if let Some(table) = &mut self.table {
            table.feed(Knot { position: state.table_position, velocity: state.table_velocity });
        }
        self.loops.pass(1);
    }

    /// Current asked of the drive in the last row.
    pub const fn asked(&self) -> Current {
        self.asked
    }

    /// Limits that acted in it.
    pub const fn limits(&self) -> Acted {
        self.limits
    }

    /// Why the cycle would have stopped the axis in it; nothing is looked for where it was taken over.
    pub const fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// What the encoders show with the SYNC.
    fn latched(&mut self, next: Option<&Neighbour>) -> (Sample, Option<Position>) {
        let scale = &self.axis.scale;
        let motor = self.motor.position(Span::ZERO);
        let table = self.table.as_ref().map(|table| table.position(Span::ZERO));
        let [motor, table_shown] = self.plant.shown(motor, table.unwrap_or(motor));
        let position = scale.motor_position(scale.motor_counts(self.start + motor));
        let crossing = next.map_or(Position::ZERO, |next| self.plant.crossed(next));
        let table_position =
            table.map(|_| scale.table_position(scale.table_counts(self.start + table_shown + crossing)));
        let sample = Sample {
            freshness: Freshness::Fresh,
            position,
            velocity: self.estimator.advance(position, 1),
            current: scale.current(scale.current_counts(self.plant.state().current)),
            ..Sample::default()
        };
        (sample, table_position)
    }
}

/// The gains of a control that does something otherwise.
pub fn gains_of(otherwise: &Otherwise, gains: Gains) -> Gains {
    let mut gains = gains;
    gains.position.gain_per_s *= otherwise.position_gain;
    gains.velocity = gains.velocity.scaled(otherwise.velocity_gain);
    gains
}

/// Where an axis of constant velocity was so many rows ago, from where it is.
fn way_back(velocity: Velocity, tick: Span, rows: u8) -> Position {
    Position::m(-velocity.as_m_per_s() * tick.as_s() * f64::from(rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;
    use crate::base::units::Acceleration;
    use crate::config;
    use crate::plant::effects::{Values, entry};

    #[test]
    fn an_axis_at_rest_stays_where_its_encoder_shows_it() {
        let machine = config::load("paper").unwrap();
        let axis = &machine.axes[AxisId::X];
        for (name, values) in
            [("encoder-eccentricity", [20.0, 70.0, 0.0]), ("encoder-interpolation", [0.1, 5.0, 10.0])]
        {
            let plant = axis.plant.with_effect(entry(name).unwrap(), values);
            let start = Start {
                position: Position::mm(3.217),
                velocity: Velocity::ZERO,
                current: Current::ZERO,
                time: Span::ZERO,
            };
            let mut closed = ClosedAxis::taken_over(axis, 0, &plant, &start);
            let setpoint = Setpoint::at_rest(start.position);
            for row in 0..400 {
                let shown = closed.row(&setpoint, row % 4 == 0, None);
                let off_um = (shown.position - start.position).as_um();
                assert!(off_um.abs() < 2e-3, "{name}, row {row}: {off_um} um");
                assert!(shown.current.as_a().abs() < 0.01, "{name}, row {row}: {:?}", shown.current);
                closed.pass();
            }
        }
    }

    /// Following error, mm, and mean current, A, of the paper's axis at 20 mm/s under a control with an effect, after a
    /// second; and the largest current before.
    fn steady(effect: Option<(&str, Values)>) -> [f64; 3] {
        const MM_PER_S: f64 = 20.0;
        let machine = config::load("paper").unwrap();
        let axis = &machine.axes[AxisId::X];
        let plant =
            effect.map_or(axis.plant, |(name, values)| axis.plant.with_effect(entry(name).unwrap(), values));
        let start = Start {
            position: Position::ZERO,
            velocity: Velocity::mm_per_s(MM_PER_S),
            current: Current::ZERO,
            time: Span::ZERO,
        };
        let mut closed = ClosedAxis::taken_over(axis, 0, &plant, &start);
        let tick_s = axis.control.tick.as_s();
        let mut error_mm = 0.0;
        let mut mean_a = 0.0;
        let mut most_a = 0.0_f64;
        for row in 0..4_000_u32 {
            let setpoint = Setpoint {
                position: Position::mm(MM_PER_S * f64::from(row) * tick_s),
                velocity: start.velocity,
                acceleration: Acceleration::ZERO,
            };
            let logged = closed.row(&setpoint, row.is_multiple_of(axis.control.position_every), None);
            if row >= 2_000 {
                error_mm += (setpoint.position - logged.position).as_mm() / 2_000.0;
                mean_a += logged.current.as_a() / 2_000.0;
            }
            most_a = most_a.max(logged.current.as_a());
            closed.pass();
        }
        [error_mm, mean_a, most_a]
    }

    #[test]
    fn what_a_control_does_otherwise_shows_in_the_following_error() {
        let [as_said_mm, as_said_a, most_a] = steady(None);
        // v / K_p, and v T later.
        let expected_mm = 20.0 / 8.55;
        assert!((as_said_mm / expected_mm - 1.0).abs() < 5e-3, "{as_said_mm} mm, expected {expected_mm} mm");
        for (name, values, factor, more_mm) in [
            ("servo-gain-mismatch", [25.0, 0.0, 0.0], 0.8, 0.0),
            ("servo-gain-mismatch", [0.0, 30.0, 0.0], 1.0, 0.0),
            ("command-filter", [10.0, 0.0, 0.0], 1.0, 0.2),
            ("reversal-compensation", [5.0, 20.0, 1.0], 1.0, 0.0),
        ] {
            let [error_mm, current_a, _] = steady(Some((name, values)));
            let expected_mm = factor * as_said_mm + more_mm;
            assert!(
                (error_mm / expected_mm - 1.0).abs() < 2e-3,
                "{name}: {error_mm} mm, expected {expected_mm} mm"
            );
            assert!(
                (current_a / as_said_a - 1.0).abs() < 1e-3,
                "{name}: {current_a} A, without {as_said_a} A"
            );
        }
        let [.., stiffer_a] = steady(Some(("servo-gain-mismatch", [0.0, 30.0, 0.0])));
        assert!((stiffer_a / most_a - 1.0).abs() > 0.01, "{stiffer_a} A at the start, without {most_a} A");
    }
}
