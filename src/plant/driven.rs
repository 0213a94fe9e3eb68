//! Screw, table and friction behind a motor whose motion is given: the half of Eq. (6) that a motor encoder
//! does not see, and what it makes the motor feel.
//!
//! ```text
//!   d' = v_m - v_t        M v_t' = K d + C (v_m - v_t) - F_f(v_t)        F = K d + C (v_m - v_t)
//! ```
//!
//! Identification drives it with the measured motion of the motor and compares `F` with the force behind the
//! measured current: the controller then plays no part in the comparison, and neither does the motor's inertia
//! beyond its own acceleration. Between two ends of a tick the motor's position is the cubic through both;
//! in each fine step its speed is held, and the step is exact for it. Play between screw and table and what the
//! deflection of the screw carries along are left out. Invariant: sticks, breaks away and slides by the law of [`super::friction`], as [`super::Plant`] does.

use nalgebra::SMatrix;

use super::FINE_STEPS;
use super::encoder::{Knot, between};
use super::friction::{self, Law};
use super::params::Mechanics;
use crate::base::time::Span;
use crate::base::units::{Force, Velocity};

const D: usize = 0;
const V_TABLE: usize = 1;
const V_MOTOR: usize = 2;
const FRICTION: usize = 3;

/// Rows of deflection and table velocity after a fine step of sliding.
type Slip = [[f64; 4]; 2];

/// The table behind a motor.
#[derive(Clone, Debug)]
pub struct Driven {
    law: Law,
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
    fine_s: f64,
    slip: Slip,
    deflection_m: f64,
    table_m_per_s: f64,
    /// -1 or +1 while the table slides, 0 while it sticks.
    slide: f64,
}

impl Driven {
    /// A table that stands, with the screw relaxed.
    pub fn new(mechanics: &Mechanics, friction: friction::Parameters, tick: Span) -> Self {
        let (k, c, m) = (mechanics.stiffness_n_per_m, mechanics.damping_n_s_per_m, mechanics.mass_kg);
        let fine_s = tick.as_s() / f64::from(FINE_STEPS);
        let mut rate = SMatrix::<f64, 4, 4>::zeros();
        rate[(D, V_MOTOR)] = 1.0;
        rate[(D, V_TABLE)] = -1.0;
        rate[(V_TABLE, D)] = k / m;
        rate[(V_TABLE, V_MOTOR)] = c / m;
        rate[(V_TABLE, V_TABLE)] = -c / m;
        rate[(V_TABLE, FRICTION)] = -1.0 / m;
        let map = (rate * fine_s).exp();
        let row = |row: usize| std::array::from_fn(|input| map[(row, input)]);
        Self {
            law: Law::new(friction),
            stiffness_n_per_m: k,
            damping_n_s_per_m: c,
            fine_s,
            slip: [row(D), row(V_TABLE)],
            deflection_m: 0.0,
            table_m_per_s: 0.0,
            slide: 0.0,
        }
    }

    /// The table in steady sliding with the motor.
    #[must_use]
    pub fn sliding(mut self, velocity: Velocity) -> Self {
        self.deflection_m = self.law.sliding(velocity).as_n() / self.stiffness_n_per_m;
        self.table_m_per_s = velocity.as_m_per_s();
        self.slide = velocity.as_m_per_s().signum();
        self
    }

    /// The table at rest under a force of the screw, at most the break-away force.
    #[must_use]
    pub fn standing(mut self, force: Force) -> Self {
        self.deflection_m = force.clamp_abs(self.law.breakaway()).as_n() / self.stiffness_n_per_m;
        self.table_m_per_s = 0.0;
        self.slide = 0.0;
        self
    }

    /// The motor moves from one end of a tick to the other; the force it feels of the screw at the end.
    pub fn step(&mut self, from: &Knot, to: &Knot) -> Force {
        let tick = Span::s(self.fine_s * f64::from(FINE_STEPS));
        let mut last = from.position;
        let mut speed = 0.0;
        for part in 1..=FINE_STEPS {
            let place = between(from, to, f64::from(part) / f64::from(FINE_STEPS), tick);
            speed = (place - last).as_m() / self.fine_s;
            last = place;
            self.fine_step(speed);
        }
        self.force(speed)
    }

    /// Of a table that stands, the deflection is known from the force that the motor feels of the screw: go a share
    /// of the way to it. Whether the table sticks once more in its chatter hangs by a hair, and a branch that was
    /// not taken would be missed for good without this; one that slides goes its own way.
    pub fn follow(&mut self, force: Force, share: f64) {
        if self.slide == 0.0 {
            let aim_m = force.clamp_abs(self.law.breakaway()).as_n() / self.stiffness_n_per_m;
            self.deflection_m += share * (aim_m - self.deflection_m);
        }
    }

    fn force(&self, motor_m_per_s: f64) -> Force {
        let stretch_m_per_s = motor_m_per_s - self.table_m_per_s;
        Force::n(self.stiffness_n_per_m * self.deflection_m + self.damping_n_s_per_m * stretch_m_per_s)
    }

    fn fine_step(&mut self, motor_m_per_s: f64) {
        if self.slide == 0.0 {
            self.deflection_m += motor_m_per_s * self.fine_s;
        } else {
            self.slid(motor_m_per_s);
            if self.table_m_per_s * self.slide > 0.0 {
                return;
            }
            self.slide = 0.0;
            self.table_m_per_s = 0.0;
        }
        let pull_n = self.force(motor_m_per_s).as_n();
        if pull_n.abs() > self.law.breakaway().as_n() {
            self.slide = pull_n.signum();
        }
    }

    /// Friction predicted at the start of the step, corrected by its mean over the step.
    fn slid(&mut self, motor_m_per_s: f64) {
        let start_n = self.law.magnitude_n(self.table_m_per_s.abs());
        let inputs = [self.deflection_m, self.table_m_per_s, motor_m_per_s, start_n * self.slide];
        let [mut deflection_m, mut table_m_per_s] =
            self.slip.map(|row| row.iter().zip(inputs).map(|(share, input)| share * input).sum::<f64>());
        let end_speed = table_m_per_s * self.slide;
        let slower = end_speed.min(self.table_m_per_s.abs());
        if !self.law.is_flat_above(slower) {
            let change_n = 0.5 * (self.law.magnitude_n(end_speed.max(0.0)) - start_n) * self.slide;
            deflection_m += self.slip[0][FRICTION] * change_n;
            table_m_per_s += self.slip[1][FRICTION] * change_n;
        }
        self.deflection_m = deflection_m;
        self.table_m_per_s = table_m_per_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::units::{Current, Position};
    use crate::plant::Plant;
    use crate::plant::tests::paper_axis;

    /// The motor of a plant under a current that rises and falls, and the force that its screw took: current less
    /// what accelerates the motor.
    #[test]
    fn behind_the_motor_of_a_plant_it_does_what_the_plant_does() {
        let axis = paper_axis();
        let tick = Span::us(500);
        let mut plant = Plant::new(&axis, tick);
        let mut driven = Driven::new(&axis.mechanics, axis.friction, tick);
        let knot = |plant: &Plant| Knot {
            position: plant.state().motor_position,
            velocity: plant.state().motor_velocity,
        };
        let (mut reversals, mut worst_n, mut sticks) = (0, 0.0_f64, 0);
        let mut last = knot(&plant);
        for tick_number in 0..8_000 {
            let phase = f64::from(tick_number) * 0.0005 * std::f64::consts::TAU / 1.3;
            plant.step(Current::a(2.4 * phase.sin()));
            let (now, state) = (knot(&plant), plant.state());
            let felt = driven.step(&last, &now).as_n();
            let stretch = state.motor_velocity - state.table_velocity;
            let truth = axis.mechanics.stiffness_n_per_m
                * (state.motor_position - state.table_position).as_m()
                + axis.mechanics.damping_n_s_per_m * stretch.as_m_per_s();
            reversals += u32::from(last.velocity.as_m_per_s() * now.velocity.as_m_per_s() < 0.0);
            sticks += u32::from(state.is_stuck);
            worst_n = worst_n.max((felt - truth).abs());
            last = now;
        }
        assert!(reversals >= 4 && sticks > 100, "{reversals} reversals, {sticks} ticks of rest");
        assert!(worst_n < 15.0, "{worst_n} N apart");
    }

    #[test]
    fn a_standing_table_resists_up_to_the_break_away_force() {
        let axis = paper_axis();
        let mut driven =
            Driven::new(&axis.mechanics, axis.friction, Span::us(500)).standing(Force::n(-500.0));
        let creep = Velocity::mm_per_s(0.05);
        let mut place = Position::ZERO;
        let mut most_n = f64::MIN;
        for _ in 0..2_000 {
            let from = Knot { position: place, velocity: creep };
            place += Position::m(creep.as_m_per_s() * 0.0005);
            most_n = most_n.max(driven.step(&from, &Knot { position: place, velocity: creep }).as_n());
        }
        let breakaway_n = axis.friction.breakaway.as_n();
        assert!((most_n / breakaway_n - 1.0).abs() < 0.01, "{most_n} N, break-away at {breakaway_n} N");
    }
}
