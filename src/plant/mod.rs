//! The physics of one axis, written once: two masses on a ball screw, stick-slip friction at the
//! table, a motor behind its current loop.
//!
//! | who | uses it for |
//! |---|---|
//! | `sim` | the axis behind a simulated board |
//! | `rt/control` | friction and inertia feed-forward, expected torque |
//! | `offline` | loop margins, identification, tuning, gap |
//!
//! [`Plant::step`] advances one servo tick by exact maps (`maps.rs`): one step of the tick while the
//! table runs, ten while it creeps or sticks. The friction force is predicted at the start of a step
//! and corrected by its mean over the step; the table sticks when its velocity changes sign within
//! `F_max` and tears loose when `|K d + C v_m|` exceeds it. Against a step 25 times smaller this holds
//! the protrusion of a circle within a few nanometres (`cargo bench --bench plant`).
//! Invariant: pure functions of parameters, state, input and time step; no clock, no randomness.

pub mod driven;
mod effects;
pub mod encoder;
pub mod friction;
mod maps;
pub mod params;
pub mod response;
pub mod rigid;

pub use params::{Actuator, Mechanics, Parameters};

use crate::base::time::Span;
use crate::base::units::{Current, Position, Velocity};
use effects::backlash::{Gap, Ladder};
pub use effects::ripple::Ripple;
use effects::ripple::Turn;
use friction::Law;
use maps::{Motion, StepMaps};

/// Steps of a tick while the table creeps or sticks.
pub const FINE_STEPS: u32 = 10;
/// Table speed above which one step spans the tick: four times the default `D_v`.
const CREEP: Velocity = Velocity::mm_per_s(2.0);
/// Longest dead time of the actuator, in ticks.
pub const DEAD_TICKS_MAX: usize = 8;

/// What the axis does at this instant, in travel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Of the motor, from where the axis stood at the start.
    pub motor_position: Position,
    /// Of the motor.
    pub motor_velocity: Velocity,
    /// Of the table.
    pub table_position: Position,
    /// Of the table.
    pub table_velocity: Velocity,
    /// Behind the current loop.
    pub current: Current,
    /// Whether friction holds the table.
    pub is_stuck: bool,
}

/// A part of the tick with one held command: its maps in one step and in fine steps.
#[derive(Clone, Debug)]
struct Part {
    whole: StepMaps,
    fine: StepMaps,
    fine_steps: u32,
    /// Instead of the others, for an axis with play.
    with_gap: Option<Ladder>,
}

impl Part {
    fn new(axis: &Parameters, gap: Gap, length_s: f64, fine_steps: u32) -> Self {
        let fine_s = length_s / f64::from(fine_steps);
        Self {
            whole: StepMaps::new(axis, length_s),
            fine: StepMaps::new(axis, fine_s),
            fine_steps,
            with_gap: (!gap.is_none()).then(|| Ladder::new(axis, fine_s)),
        }
    }
}

/// What moves: state and the constants that decide between sticking and sliding.
#[derive(Clone, Debug)]
struct Body {
    law: Law,
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
    motion: Motion,
    /// -1 or +1 while the table slides, 0 while it sticks.
    slide: f64,
    gap: Gap,
    turn: Turn,
}

/// One axis in motion.
#[derive(Clone, Debug)]
pub struct Plant {
    tick: Span,
    fine_steps: u32,
    force_per_current: f64,
    peak_a: f64,
    /// Commands on their way through the dead time, newest first, as forces in N.
    pending_n: [f64; DEAD_TICKS_MAX + 1],
    dead_ticks: usize,
    /// The part of the tick that still sees the older command; absent without a fraction of a tick.
    early: Option<Part>,
    late: Part,
    body: Body,
}

impl Plant {
    /// An axis at rest that is stepped at `tick`.
    ///
    /// # Panics
    /// When the dead time reaches [`DEAD_TICKS_MAX`] ticks (checked by `config`).
    pub fn new(axis: &Parameters, tick: Span) -> Self {
        Self::with_fine_steps(axis, tick, FINE_STEPS)
    }

    /// An axis that slides steadily, wound up by its friction; its motor is at zero now.
    ///
    /// # Panics
    /// As [`Plant::new`].
    pub fn sliding(axis: &Parameters, tick: Span, velocity: Velocity) -> Self {
        let friction_n = Law::new(axis.friction).sliding(velocity).as_n();
        let (speed, side) = (velocity.as_m_per_s(), velocity.as_m_per_s().signum());
        let mechanics = &axis.mechanics;
        let deflection_m = friction_n / mechanics.stiffness_n_per_m + 0.5 * side * mechanics.backlash_m;
        let motion = [deflection_m, speed, speed, friction_n, 0.0];
        let mut plant =
            Self::from_state(axis, tick, FINE_STEPS, motion, side, Gap::new(mechanics.backlash_m));
        plant.pending_n = [friction_n; DEAD_TICKS_MAX + 1];
        plant
    }

    /// An axis at rest with another number of fine steps in a tick: the convergence benchmark and tests.
    pub fn with_fine_steps(axis: &Parameters, tick: Span, fine_steps: u32) -> Self {
        Self::from_state(axis, tick, fine_steps, [0.0; 5], 0.0, Gap::new(axis.mechanics.backlash_m))
    }

    fn from_state(
        axis: &Parameters,
        tick: Span,
        fine_steps: u32,
        motion: Motion,
        slide: f64,
        gap: Gap,
    ) -> Self {
        let dead_ticks = (axis.actuator.dead_time / tick) as usize;
        assert!(dead_ticks < DEAD_TICKS_MAX, "dead time of more than {DEAD_TICKS_MAX} ticks");
        let late_by_s = (axis.actuator.dead_time - tick * dead_ticks as i64).as_s();
        Self {
            tick,
            fine_steps,
            force_per_current: axis.actuator.torque_constant_nm_per_a * axis.mechanics.force_per_torque(),
            peak_a: axis.actuator.peak_current.as_a(),
            pending_n: [0.0; DEAD_TICKS_MAX + 1],
            dead_ticks,
            early: (late_by_s > 0.0).then(|| Part::new(axis, gap, late_by_s, fine_steps)),
            late: Part::new(axis, gap, tick.as_s() - late_by_s, fine_steps),
            body: Body {
                law: Law::new(axis.friction),
                stiffness_n_per_m: axis.mechanics.stiffness_n_per_m,
                damping_n_s_per_m: axis.mechanics.damping_n_s_per_m,
                motion,
                slide,
                gap,
                turn: Turn::new(axis.ripple, axis.mechanics.lead_m),
            },
        }
    }

    /// Become another axis in the middle of its motion: positions, velocities, motor force and the
    /// deflection of the screw stay as they are, and so do the commands in the dead time.
    ///
    /// # Panics
    /// When the dead time is not that of this axis.
    pub fn change(&mut self, axis: &Parameters) {
        let Body { motion, slide, gap, .. } = self.body;
        let gap = gap.resized(axis.mechanics.backlash_m, motion[0]);
        let changed = Self::from_state(axis, self.tick, self.fine_steps, motion, slide, gap);
        assert_eq!(
            changed.dead_ticks, self.dead_ticks,
            "a dead time does not change while commands are in it"
        );
        *self = Self { pending_n: self.pending_n, ..changed };
    }

    /// What it does now.
    pub fn state(&self) -> State {
        let [deflection, motor_velocity, table_velocity, force, motor_position] = self.body.motion;
        State {
            motor_position: Position::m(motor_position),
            motor_velocity: Velocity::m_per_s(motor_velocity),
            table_position: Position::m(motor_position - deflection),
            table_velocity: Velocity::m_per_s(table_velocity),
            current: Current::a(force / self.force_per_current),
            is_stuck: self.body.slide == 0.0,
        }
    }

    /// One tick with a current command, held over the tick. The drive makes at most its peak current;
    /// returns whether it had to hold the command back.
    pub fn step(&mut self, command: Current) -> bool {
        let held_a = command.as_a().clamp(-self.peak_a, self.peak_a);
        // A loop, not a call of memmove: most machines have one entry to move.
        for age in (0..=self.dead_ticks).rev() {
            self.pending_n[age + 1] = self.pending_n[age];
        }
        self.pending_n[0] = held_a * self.force_per_current;
        if let Some(early) = &self.early {
            self.body.advance(early, self.pending_n[self.dead_ticks + 1]);
        }
        self.body.advance(&self.late, self.pending_n[self.dead_ticks]);
        held_a != command.as_a()
    }
}

impl Body {
    fn advance(&mut self, part: &Part, command_n: f64) {
        if let Some(ladder) = &part.with_gap {
            return self.advance_with_gap(part, ladder, command_n);
        }
        if self.is_running() {
            let end = self.slid(&part.whole.slip, command_n);
            if end[2] * self.slide > 0.0 {
                self.motion = end;
                return;
            }
            // It would reverse within the tick: take it again in fine steps.
        }
        for _ in 0..part.fine_steps {
            self.fine_step(&part.fine, command_n);
        }
    }

    /// Whether the table slides fast enough for a step of the whole tick.
    fn is_running(&self) -> bool {
        self.slide != 0.0 && self.table_speed() > CREEP.as_m_per_s()
    }

    fn fine_step(&mut self, maps: &StepMaps, command_n: f64) {
        if self.moved(maps, command_n) {
            self.break_away(self.pull_n());
        }
    }

    /// Move on by one step; whether the table stands at its end.
    #[inline(always)]
    fn moved(&mut self, maps: &StepMaps, command_n: f64) -> bool {
        if self.slide == 0.0 {
            self.motion = maps.stick.apply(&self.motion, command_n, 0.0);
        } else {
            self.motion = self.slid(&maps.slip, command_n);
            if self.motion[2] * self.slide > 0.0 {
                return false;
            }
            self.slide = 0.0;
            self.motion[2] = 0.0;
        }
        true
    }

    /// A standing table tears loose when the screw pulls harder than friction can hold.
    fn break_away(&mut self, pull_n: f64) {
        let even_n = self.law.breakaway().as_n();
        let held_n = if self.turn.is_none() { even_n } else { even_n * self.turn.factor(&self.motion) };
        if pull_n.abs() > held_n {
            self.slide = pull_n.signum();
        }
    }

    /// The state after sliding for one step: friction predicted at its start, corrected by its mean.
    // Always: as a call, whose answer goes through memory, a tick takes 25.5 ns instead of 19.5 ns.
    #[inline(always)]
    fn slid(&self, map: &maps::Map, command_n: f64) -> Motion {
        let start_n = self.friction_n(self.table_speed(), &self.motion);
        let mut end = map.apply(&self.motion, command_n, start_n * self.slide);
        let end_speed = end[2] * self.slide;
        let slower = end_speed.min(self.table_speed());
        if !(self.law.is_flat_above(slower) && self.turn.is_none()) {
            let end_n = self.friction_n(end_speed.max(0.0), &end);
            map.correct(&mut end, 0.5 * (end_n - start_n) * self.slide);
        }
        end
    }

    /// Friction against the table at a speed and where it is, N.
    #[inline(always)]
    fn friction_n(&self, speed_m_per_s: f64, motion: &Motion) -> f64 {
        let even_n = self.law.magnitude_n(speed_m_per_s);
        if self.turn.is_none() { even_n } else { even_n * self.turn.factor(motion) }
    }

    fn table_speed(&self) -> f64 {
        self.motion[2].abs()
    }

    /// Force of the screw on the table at rest, N.
    fn pull_n(&self) -> f64 {
        self.stiffness_n_per_m * self.motion[0] + self.damping_n_s_per_m * self.motion[1]
    }
}

#[cfg(test)]
pub(crate) mod tests;
