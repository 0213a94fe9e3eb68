//! Axes around the paper's, drawn at random: what the plant's step has to bear beside the two gain sets.

use quadrant::config::Machine;
use quadrant::rt::control::velocity_pi::Memory;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::ideal_loop::Axis;

/// How many axes.
pub(crate) const SETS: usize = 60;
const SEED: u64 = 1;
/// Loops that ring more than this are drawn again: no machine is run with them, and in their long
/// trains of slips one slip more or less is a matter of nanometres anywhere.
const DAMPING_MIN: f64 = 0.3;

/// Gains within a factor of 2 (proportional) and 2.5 (integral) of the machine's, stiffness within 1.5,
/// the speeds of the friction law within 2, and 70 to 98 % of the break-away force while sliding.
pub(crate) fn axes(machine: &Machine) -> Vec<Axis> {
    let mut random = Pcg64Mcg::seed_from_u64(SEED);
    let mut axes = Vec::with_capacity(SETS);
    while axes.len() < SETS {
        let gains = if axes.len() % 2 == 0 { "standard" } else { "optimal" };
        let (axis, damping) = draw(Axis::of(machine, gains), &mut random);
        if damping >= DAMPING_MIN {
            axes.push(axis);
        }
    }
    axes
}

/// The axis with its numbers moved, and the damping `K_vp / (2 sqrt(J K_vi))` of its velocity loop.
fn draw(mut axis: Axis, random: &mut Pcg64Mcg) -> (Axis, f64) {
    let mut within = |factor: f64| factor.powf(random.random_range(-1.0..1.0));
    let [proportional, integral, stiffness, speeds] = [2.0, 2.5, 1.5, 2.0].map(&mut within);
    let ratio = random.random_range(0.7..0.98);

    let velocity = &mut axis.control.gain_sets[0].velocity;
    velocity.proportional_nm_s_per_rad *= proportional;
    let Memory::Integrator { gain_nm_per_rad } = &mut velocity.memory else {
        unreachable!("the paper's machine has true integrators")
    };
    *gain_nm_per_rad *= integral;
    let undamped = (axis.plant.mechanics.total_inertia_kg_m2() * *gain_nm_per_rad).sqrt();
    let damping = velocity.proportional_nm_s_per_rad / (2.0 * undamped);

    axis.plant.mechanics.stiffness_n_per_m *= stiffness;
    let friction = &mut axis.plant.friction;
    friction.fall_start = friction.fall_start * speeds;
    friction.fall_end = friction.fall_end * speeds;
    friction.sliding = friction.breakaway * ratio;
    (axis, damping)
}
