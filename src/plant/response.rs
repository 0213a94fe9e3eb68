//! Frequency response of the axis from the drive's current command, as torque, to the motor's speed:
//! the linear part of Eq. (6) with both masses, the current loop and the actuator's dead time.
//!
//! Used for loop margins (`offline/margins`) and frequency-response identification.
//! Invariant: the same parameters as [`super::Plant`]; friction, which has no transfer function, is left out, but for
//! its viscous part where the table is known to slide.

use nalgebra::Complex;

use super::params::Parameters;

/// Motor speed per torque command, (rad/s)/(N m), at `omega_rad_per_s`, of an axis without friction.
pub fn motor_speed_per_torque(axis: &Parameters, omega_rad_per_s: f64) -> Complex<f64> {
    speed_per_torque(axis, 0.0, omega_rad_per_s)
}

/// The same of a table that slides one way: of its friction the viscous part answers to the speed.
pub fn sliding_speed_per_torque(axis: &Parameters, omega_rad_per_s: f64) -> Complex<f64> {
    speed_per_torque(axis, axis.friction.viscous_n_s_per_m, omega_rad_per_s)
}

fn speed_per_torque(axis: &Parameters, viscous_n_s_per_m: f64, omega_rad_per_s: f64) -> Complex<f64> {
    let s = Complex::new(0.0, omega_rad_per_s);
    let mechanics = &axis.mechanics;
    let (motor_kg, table_kg) = (mechanics.motor_mass_kg(), mechanics.mass_kg);
    // Of the table by itself, force per place.
    let table = s * (s * table_kg + viscous_n_s_per_m);
    let coupling = s * mechanics.damping_n_s_per_m + mechanics.stiffness_n_per_m;
    let velocity_per_force =
        s * (table + coupling) / (s * s * motor_kg * (table + coupling) + coupling * table);
    let speed_per_torque = velocity_per_force * (mechanics.force_per_torque() / mechanics.travel_per_rad_m());
    let current_loop = Complex::new(1.0, 0.0) / (s * axis.actuator.lag_s() + 1.0);
    let filter = Complex::new(1.0, 0.0) / (s * axis.actuator.filter_s + 1.0);
    speed_per_torque * filter * current_loop * delay(axis.actuator.dead_time.as_s(), omega_rad_per_s)
}

/// A pure delay, `exp(-s T)`.
pub fn delay(delay_s: f64, omega_rad_per_s: f64) -> Complex<f64> {
    Complex::from_polar(1.0, -delay_s * omega_rad_per_s)
}
