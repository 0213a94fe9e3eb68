//! What real axes have and the two-mass model lacks: one file for each effect, with its equation, its
//! parameters, where it acts and how far it may be believed.
//!
//! ```text
//!   machine file ──► Effects ──► Acting ──► forces, friction (step.rs)   ──► Plant
//!   [axis.*.effects.<name>]      │     └──► what the sensors show        ──► sim, tuning
//!                                └──────► what a control does otherwise ──► data of another control
//! ```
//!
//! An [`Entry`] says what the file may hold, what a search may take for granted, and how the effect takes part:
//! as another value of a parameter of the base model, as friction, as a force, or in what a sensor shows. A new
//! effect is a file with its `ENTRY`, and its name in the list below; what several share is beside them (`swing`).
//! Invariant: an effect whose first value is zero is absent: it costs nothing and changes no bit.

pub(in crate::plant) mod acting;
mod catalogue;
pub mod control;
mod hooks;
mod parameter;
pub(in crate::plant) mod step;
mod swing;

mod viscous_friction;
mod quadratic_drag;
mod stribeck;
mod presliding;
mod direction_asymmetry;
mod constant_force;
mod spring_load;
mod position_dependent_friction;
mod load_dependent_friction;
mod friction_warm_up;
mod screw_ripple;
mod motor_cogging;
mod torque_ripple;
mod ball_pass_ripple;
mod torque_saturation;
mod torque_disturbance;
mod actuator_delay;
mod current_loop_lag;
pub(in crate::plant) mod backlash;
mod soft_zone;
mod position_dependent_stiffness;
mod resonance;
mod encoder_eccentricity;
mod encoder_interpolation;
mod pitch_error;
mod scale_error;
mod thermal_growth;
mod squareness;
mod cross_coupling;
mod servo_gain_mismatch;
mod command_filter;
mod reversal_compensation;

pub use catalogue::{Coordinate, Effects, Entry, Experiment, VALUES_MAX, Values, entry};
pub use friction_warm_up::warmed_share;
pub use hooks::Neighbour;
pub(in crate::plant) use hooks::{Action, Pace};
pub use parameter::Parameter;
pub use spring_load::neutral_with_force_mm;

/// Every effect there is.
pub const CATALOGUE: &[Entry] = &[
    viscous_friction::ENTRY,
    quadratic_drag::ENTRY,
    stribeck::ENTRY,
    presliding::ENTRY,
    presliding::WITH_MEMORY,
    direction_asymmetry::ENTRY,
    constant_force::ENTRY,
    spring_load::ENTRY,
    position_dependent_friction::ENTRY,
    position_dependent_friction::WAVE,
    position_dependent_friction::TIGHT_SPOT,
    load_dependent_friction::ENTRY,
    friction_warm_up::ENTRY,
    screw_ripple::ENTRY,
    screw_ripple::HARMONIC,
    motor_cogging::ENTRY,
    motor_cogging::HARMONIC,
    torque_ripple::ENTRY,
    torque_ripple::HARMONIC,
    ball_pass_ripple::ENTRY,
    torque_saturation::ENTRY,
    torque_disturbance::ENTRY,
    torque_disturbance::PUSH,
    actuator_delay::ENTRY,
    current_loop_lag::ENTRY,
    current_loop_lag::FILTER,
    backlash::ENTRY,
    soft_zone::ENTRY,
    position_dependent_stiffness::ENTRY,
    resonance::ENTRY,
    encoder_eccentricity::ENTRY,
    encoder_interpolation::ENTRY,
    encoder_interpolation::HARMONIC,
    encoder_interpolation::SCALE,
    encoder_interpolation::SCALE_HARMONIC,
    pitch_error::ENTRY,
    pitch_error::HARMONIC,
    scale_error::ENTRY,
    thermal_growth::ENTRY,
    squareness::ENTRY,
    cross_coupling::ENTRY,
    cross_coupling::OF_INERTIA,
    cross_coupling::PUSH,
    cross_coupling::PUSH_OF_INERTIA,
    servo_gain_mismatch::ENTRY,
    command_filter::ENTRY,
    command_filter::BY_ROWS,
    reversal_compensation::ENTRY,
];

#[cfg(test)]
mod tests;
