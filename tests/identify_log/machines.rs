//! Random machines around the reference machine, and what is believed of them.

use std::f64::consts::SQRT_2;

use quadrant::base::units::{Force, Velocity};
use quadrant::config::Machine;
use quadrant::plant::effects;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use crate::common::machine_with;

/// Half the 95 % interval of the torque constant, %.
pub(crate) const TORQUE_CONSTANT_PERCENT: f64 = 5.0;

/// A machine as it is, and as its file has it.
pub(crate) struct Pair {
    pub(crate) truth: Machine,
    pub(crate) believed: Machine,
}

/// Machine `seed`. Friction, screw, inertia, damping and current loop are its own and the file does not know them;
/// the torque constant is off by what a data sheet allows; the table was weighed. Its encoder counts 0.1 um, or
/// 1 um with every other seed.
pub(crate) fn random(seed: u64) -> Pair {
    let counts = if seed.is_multiple_of(2) { "100000" } else { "10000" };
    let edit = format!("counts-per-rev = {counts}");
    let mut truth = machine_with("reference", &[("counts-per-rev = 1048576", &edit)]);
    let mut believed = truth.clone();
    let mut random = Pcg64Mcg::seed_from_u64(1_000 + seed);
    let ids: Vec<_> = truth.axes.axes().collect();
    for id in ids {
        let mut between = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
        let plant = &mut truth.axes[id].plant;
        let sliding_n = 951.3 * between(0.75, 1.25);
        plant.friction.sliding = Force::n(sliding_n);
        plant.friction.breakaway = Force::n(sliding_n * between(1.1, 1.3));
        let end_mm_per_s = between(0.35, 0.8);
        plant.friction.fall_end = Velocity::mm_per_s(end_mm_per_s);
        plant.friction.fall_start = Velocity::mm_per_s(end_mm_per_s * between(0.15, 0.4));
        plant.friction.viscous_n_s_per_m = 1e3 * between(0.0, 3.0);
        plant.mechanics.stiffness_n_per_m *= between(0.75, 1.4);
        plant.mechanics.damping_n_s_per_m *= between(0.8, 1.2);
        plant.mechanics.inertia_kg_m2 *= between(0.85, 1.15);
        plant.mechanics.mass_kg *= between(0.8, 1.2);
        plant.actuator.current_loop_hz *= between(0.8, 1.3);
        let ripple = effects::entry("screw-ripple").expect("an effect of the catalogue");
        *plant = plant.with_effect(ripple, [2.0 * SQRT_2, 1.0, between(0.0, 360.0)]);
        believed.axes[id].plant.mechanics.mass_kg = plant.mechanics.mass_kg;
        let off: f64 = StandardNormal.sample(&mut random);
        plant.actuator.torque_constant_nm_per_a *= 1.0 + 0.01 * TORQUE_CONSTANT_PERCENT / 1.96 * off;
    }
    Pair { truth, believed }
}
