//! An axis as far as it is known before its falling part, and likely ones to be drawn from it.
//!
//! What was found before comes with its interval, so what is drawn differs by as much; the intervals of what is
//! found next hold all of it. Damping is not told by constant speeds and reversals: it is drawn within a factor of
//! what the machine file says. Invariant: the same seed draws the same axis.

use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

use crate::base::units::Force;
use crate::config::machine::Axis;

/// Standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Uncertainty {
    /// `F_max`, N.
    pub breakaway_n: f64,
    /// `F_low`, N.
    pub sliding_n: f64,
    /// `m`, N s/m.
    pub viscous_n_s_per_m: f64,
    /// N/m.
    pub stiffness_n_per_m: f64,
    /// All that moves, kg.
    pub moving_kg: f64,
    /// Of friction from place to place, as a share of it: what is left of its ripple.
    pub place: f64,
    /// Of the logarithm.
    pub current_loop: f64,
    /// Of the logarithm of the torque constant: all forces are wrong by it alike, and the weighed table is not.
    pub torque_constant: f64,
}

/// Damping differs from that of the machine file by at most this factor.
const DAMPING: f64 = 1.5;

/// What is known.
#[derive(Clone, Debug)]
pub struct Known {
    /// The axis of the log, its plant as it was found.
    pub axis: Axis,
    /// How surely.
    pub uncertainty: Uncertainty,
}

impl Known {
    /// A likely axis.
    pub fn drawn(&self, random: &mut impl Rng) -> Axis {
        let mut off = |deviation: f64| -> f64 {
            let normal: f64 = StandardNormal.sample(random);
            deviation * normal
        };
        let std = &self.uncertainty;
        let mut axis = self.axis;
        let friction = &mut axis.plant.friction;
        let sliding_n = friction.sliding.as_n() + off(std.sliding_n);
        friction.breakaway =
            Force::n((friction.breakaway.as_n() + off(std.breakaway_n)).max(1.001 * sliding_n));
        friction.sliding = Force::n(sliding_n);
        friction.viscous_n_s_per_m = (friction.viscous_n_s_per_m + off(std.viscous_n_s_per_m)).max(0.0);
        let mechanics = &mut axis.plant.mechanics;
        let moving_kg = mechanics.motor_mass_kg() + mechanics.mass_kg + off(std.moving_kg);
        mechanics.mass_kg *= off(std.torque_constant).exp();
        mechanics.stiffness_n_per_m += off(std.stiffness_n_per_m);
        let per_kg = mechanics.travel_per_rad_m() / mechanics.force_per_torque();
        mechanics.inertia_kg_m2 = (moving_kg - mechanics.mass_kg).max(0.1 * moving_kg) * per_kg;
        axis.plant.actuator.current_loop_hz *= off(std.current_loop).exp();
        let factor = random.random_range(-1.0..1.0) * DAMPING.ln();
        axis.plant.mechanics.damping_n_s_per_m *= f64::exp(factor);
        axis
    }
}
