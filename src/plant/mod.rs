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
//! table runs above `D_v`, is held fast or creeps where its friction does not fall, ten where it stops or tears loose, and where
//! friction falls two, five or ten as fast as it does. The friction force is predicted at the start of a step
//! and corrected by its mean over the step; the table sticks where its velocity changes sign within
//! `F_max` and tears loose where `|K d + C v_m|` exceeds it, both within a step. Against a step 25 times smaller this holds
//! the protrusion of a circle within a nanometre or two (`cargo bench --bench plant`). What real axes have beyond
//! that is in [`effects`].
//! Invariant: pure functions of parameters, state, input and time step; no clock, no randomness.

mod body;
mod drive_filter;
pub mod driven;
pub mod effects;
pub mod encoder;
pub mod friction;
mod maps;
pub mod params;
pub mod response;
pub mod rigid;

pub use params::{Actuator, Mechanics, Parameters};

use std::sync::Arc;

use crate::base::time::Span;
use crate::base::units::{Current, Force, Position, Velocity};
use body::{Body, Part};
use drive_filter::{DriveFilter, PIECES_MAX};
use effects::acting::{Acting, Remembered};
use effects::backlash::Gap;
use effects::step::Bare;
use effects::{Neighbour, Pace};
use friction::Law;
use maps::Motion;

/// Shares of what friction holds: a standing table that is pulled with the second and more leans on a flank; with the first and less it is
/// taken to hang free between both, for that may be the noise of a current.
const LEANS: [f64; 2] = [0.01, 0.02];
/// Share of break-away that a table at rest is taken to stand: at its end any rounding of a current would let it slip. A table that creeps
/// to rest stands within two thousandths of it, and what is cut off there is missing where it moves on.
const STANDS: f64 = 0.999;
/// Steps of a tick in which the table stops or may break away.
pub const FINE_STEPS: u32 = 10;
/// Rounds in which the place is found that an encoder shows: what it shows too much changes by less than a tenth of a way along it.
const SHOWN_ROUNDS: usize = 8;
/// A dead time of the actuator is shorter than so many ticks: that of any machine file with any delay that is tried beside it, in the
/// shortest cycle.
pub const DEAD_TICKS_MAX: usize = 128;
/// Longest dead time of a machine file, in ticks: one that is off by a factor is found before a loop is closed over it.
pub const FILE_DEAD_TICKS_MAX: usize = 20;

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

/// One axis in motion.
#[derive(Clone, Debug)]
pub struct Plant {
    tick: Span,
    fine_steps: u32,
    force_per_current: f64,
    peak_a: f64,
    mass_kg: f64,
    /// Of the table, as the last tick began.
    table_before: Velocity,
    /// Commands on their way through the dead time, newest first, as forces in N.
    pending_n: [f64; DEAD_TICKS_MAX + 1],
    dead_ticks: usize,
    filter: DriveFilter,
    /// The part of the tick that still sees the older command; absent without a fraction of a tick.
    early: Option<Part>,
    late: Part,
    body: Body,
    bare: Bare,
    acting: Option<Arc<Acting>>,
}

impl Plant {
    /// An axis at rest that is stepped at `tick`.
    ///
    /// # Panics
    /// When the dead time reaches [`DEAD_TICKS_MAX`] ticks (`config` allows [`FILE_DEAD_TICKS_MAX`]).
    pub fn new(axis: &Parameters, tick: Span) -> Self {
        Self::with_fine_steps(axis, tick, FINE_STEPS)
    }

    /// An axis that slides steadily, wound up by its friction; its motor is at zero now, at a place of the machine.
    ///
    /// # Panics
    /// As [`Plant::new`].
    pub fn sliding(axis: &Parameters, tick: Span, velocity: Velocity, place: Position) -> Self {
        Self::sliding_in(axis, tick, FINE_STEPS, velocity, place)
    }

    fn sliding_in(
        axis: &Parameters,
        tick: Span,
        fine_steps: u32,
        velocity: Velocity,
        place: Position,
    ) -> Self {
        let drive_n = steady_force(axis, velocity, place).as_n();
        let (speed, side) = (velocity.as_m_per_s(), velocity.as_m_per_s().signum());
        let motion = [0.0, speed, speed, drive_n, 0.0];
        let gap = Gap::new(axis.mechanics.backlash_m);
        let mut plant = Self::from_state(axis, tick, fine_steps, motion, side, gap)
            .wound_up(axis, drive_n, place)
            .leaning(axis, side);
        if let Some(acting) = &plant.acting {
            let friction_n = acting.steady_friction_n(&plant.body.law, velocity, place);
            plant.body.remembered = acting.remembered(speed, friction_n);
        }
        plant
    }

    /// An axis at rest, wound up by as much of this force of its motor as friction holds; its motor is at zero now, at a place of
    /// the machine. Play is taken up on the side of the force, less of it where the force is little, and none where it is as good as none.
    ///
    /// # Panics
    /// As [`Plant::new`].
    pub fn standing(axis: &Parameters, tick: Span, force: Force, place: Position) -> Self {
        let gap = Gap::new(axis.mechanics.backlash_m);
        let still = Self::from_state(axis, tick, FINE_STEPS, [0.0; 5], 0.0, gap);
        let force_n = still.held_n(force.as_n(), place);
        let [free_n, leans_n] = LEANS.map(|share| share * still.body.law.breakaway().as_n());
        let leant = (force_n.abs() - free_n) / (leans_n - free_n).max(f64::MIN_POSITIVE);
        let side = leant.clamp(0.0, 1.0).copysign(force_n);
        let mut plant = still.wound_up(axis, force_n, place).leaning(axis, side);
        if let Some(acting) = &plant.acting {
            plant.body.remembered = acting.remembered_at_rest(force_n, place);
        }
        plant
    }

    /// As much of a force of the motor as friction holds at a place, with whatever else pulls at the table there, N.
    fn held_n(&self, force_n: f64, place: Position) -> f64 {
        let breakaway_n = STANDS * self.body.law.breakaway().as_n();
        match &self.acting {
            Some(acting) => acting.held_n(breakaway_n, force_n, place),
            None => held_beside(self.bare.push_n, breakaway_n, force_n),
        }
    }

    /// The same at a place of the machine, its screw, drive and dead time at a force.
    fn wound_up(mut self, axis: &Parameters, force_n: f64, place: Position) -> Self {
        self.body.motion[3] = force_n;
        let stiffness_n_per_m = axis.mechanics.stiffness_n_per_m;
        self.body.motion[0] = match &self.acting {
            Some(acting) => acting.wound_up_m(stiffness_n_per_m, force_n, place),
            None => force_n / stiffness_n_per_m,
        };
        self.pending_n = [force_n; DEAD_TICKS_MAX + 1];
        self.filter = self.filter.at(force_n);
        self.body.origin_m = place.as_m();
        self
    }

    /// The same with its play taken up on a side, by as much of it.
    fn leaning(mut self, axis: &Parameters, side: f64) -> Self {
        self.body.motion[0] += 0.5 * side * axis.mechanics.backlash_m;
        self
    }

    /// The same so long after the start of the machine, for effects that go with time.
    #[must_use]
    pub fn after(mut self, time: Span) -> Self {
        self.body.remembered.time_s = time.as_s();
        self
    }

    /// The same with its zero at another place of the machine.
    #[must_use]
    pub fn placed(mut self, place: Position) -> Self {
        self.body.origin_m = place.as_m();
        self
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
        let acting = Acting::new(axis);
        let axis = &acting.as_ref().map_or(*axis, |acting| acting.prepared(axis));
        let filter = DriveFilter::new(&axis.actuator, late_by_s, tick);
        let further_n_s_per_m = acting.as_ref().map_or(0.0, Acting::steepest_fall_n_s_per_m);
        let of_fall = |n_s_per_m: f64| Pace::of_growth(n_s_per_m / axis.mechanics.mass_kg);
        let falling = of_fall(axis.friction.steepest_fall_n_s_per_m() + further_n_s_per_m);
        let has_shares = acting.is_some() || matches!(falling, Pace::Even | Pace::Brisk);
        let part = |length_s: f64| {
            let pieces = filter.pieces() as u32;
            Part::new(axis, gap, length_s / f64::from(pieces), fine_steps.div_ceil(pieces), has_shares)
        };
        Self {
            tick,
            fine_steps,
            force_per_current: axis.actuator.torque_constant_nm_per_a * axis.mechanics.force_per_torque(),
            peak_a: axis.actuator.peak_current.as_a(),
            mass_kg: axis.mechanics.mass_kg,
            table_before: Velocity::m_per_s(motion[2]),
            pending_n: [0.0; DEAD_TICKS_MAX + 1],
            dead_ticks,
            filter,
            early: (late_by_s > 0.0).then(|| part(late_by_s)),
            late: part(tick.as_s() - late_by_s),
            body: Body {
                law: Law::new(axis.friction),
                stiffness_n_per_m: axis.mechanics.stiffness_n_per_m,
                damping_n_s_per_m: axis.mechanics.damping_n_s_per_m,
                paces: [of_fall(further_n_s_per_m), falling, Pace::Slow],
                push_back: maps::push_back(&axis.mechanics),
                motion,
                slide,
                gap,
                origin_m: 0.0,
                remembered: acting.as_ref().map_or(Remembered::REST, |acting| acting.remembered(0.0, 0.0)),
            },
            bare: Bare { push_n: axis.effects.push_n() },
            acting: acting.map(Arc::new),
        }
    }

    /// Become another axis in the middle of its motion: positions, velocities, motor force and the
    /// deflection of the screw stay as they are, and so do the commands in the dead time.
    ///
    /// # Panics
    /// When the dead time is not that of this axis.
    pub fn change(&mut self, axis: &Parameters) {
        let Body { motion, slide, gap, origin_m, .. } = self.body;
        let gap = gap.resized(axis.mechanics.backlash_m, motion[0]);
        let mut changed = Self::from_state(axis, self.tick, self.fine_steps, motion, slide, gap);
        changed.body.origin_m = origin_m;
        if let Some(acting) = &changed.acting {
            changed.body.remembered = acting.taken_over(self.acting.as_deref(), &self.body.remembered);
        }
        assert_eq!(
            changed.dead_ticks, self.dead_ticks,
            "a dead time does not change while commands are in it"
        );
        changed.filter = changed.filter.taken_over(&self.filter);
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
        self.table_before = Velocity::m_per_s(self.body.motion[2]);
        let new_n = held_a * self.force_per_current;
        let Self { early, late, body, acting, bare, tick, pending_n, dead_ticks, filter, .. } = self;
        // Read before they move on: what was written a moment ago would have to be waited for.
        let early_n = pending_n[*dead_ticks];
        let late_n = dead_ticks.checked_sub(1).map_or(new_n, |before| pending_n[before]);
        // A loop, not a call of memmove: most machines have one entry to move.
        for age in (0..=*dead_ticks).rev() {
            pending_n[age + 1] = pending_n[age];
        }
        pending_n[0] = new_n;
        let mut commands_n = [[early_n; PIECES_MAX], [late_n; PIECES_MAX]];
        filter.pass(&mut commands_n);
        let (parts, pieces) = ((early.as_ref(), &*late), filter.pieces());
        match acting {
            Some(acting) if acting.moves(&body.remembered) => {
                body.tick_with_effects(parts, &commands_n, pieces, acting);
            }
            // What only shows too much goes on with the time.
            _ => {
                body.tick(parts, &commands_n, pieces, bare);
                body.remembered.time_s += tick.as_s();
            }
        }
        held_a != command.as_a()
    }

    /// What the drive pushes with, on the table's side.
    pub fn drive_force(&self) -> Force {
        Force::n(self.body.motion[3])
    }

    /// What motor encoder and table scale show where they are at these places.
    pub fn shown(&self, motor: Position, table: Position) -> [Position; 2] {
        let Some(acting) = &self.acting else { return [motor, table] };
        let places_m = [motor, table].map(|place| self.body.origin_m + place.as_m());
        let [motor_m, table_m] = acting.reading_errors_m(places_m, &self.body.remembered);
        [motor + Position::m(motor_m), table + Position::m(table_m)]
    }

    /// The same with its motor where its encoder shows a place, and that place of the motor.
    #[must_use]
    pub fn showing(self, place: Position) -> (Self, Position) {
        let (mut plant, mut motor) = (self.placed(place), place);
        for _ in 0..SHOWN_ROUNDS {
            motor = place - plant.shown(Position::ZERO, Position::ZERO)[0];
            plant = plant.placed(motor);
        }
        (plant, motor)
    }

    /// What it does to the axis before it, with its table at a place.
    pub fn neighbour(&self, table: Position) -> Neighbour {
        let gained_m_per_s = self.body.motion[2] - self.table_before.as_m_per_s();
        Neighbour {
            table: table + Position::m(self.body.origin_m),
            force: Force::n(self.body.screw_n()),
            accelerating: Force::n(self.mass_kg * gained_m_per_s / self.tick.as_s()),
        }
    }

    /// Whether the next axis does something to it.
    pub fn is_crossed(&self) -> bool {
        self.acting.as_ref().is_some_and(|acting| acting.is_crossed())
    }

    /// The next axis pushes it as it does now; what its table scale shows too much of it.
    pub fn crossed(&mut self, next: &Neighbour) -> Position {
        let Self { acting, body, .. } = self;
        let shown_m = acting.as_ref().map(|acting| acting.crossing_m(next, &mut body.remembered));
        Position::m(shown_m.unwrap_or(0.0))
    }
}

/// As much of a force as holds a table still together with another, where friction holds so much, N.
fn held_beside(other_n: f64, breakaway_n: f64, force_n: f64) -> f64 {
    (force_n + other_n).clamp(-breakaway_n, breakaway_n) - other_n
}

/// Force of the drive, on the table's side, that keeps an axis at a velocity at a place of the machine.
pub fn steady_force(axis: &Parameters, velocity: Velocity, place: Position) -> Force {
    let law = Law::new(axis.friction);
    match Acting::new(axis) {
        None => law.sliding(velocity) - Force::n(axis.effects.push_n()),
        Some(acting) => acting.steady_force(&law, velocity, place),
    }
}

#[cfg(test)]
pub(crate) mod tests;
