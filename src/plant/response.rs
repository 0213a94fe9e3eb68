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
    // What the deflection carries along takes from the force of the screw on both.
    let coupling =
        s * mechanics.damping_n_s_per_m + mechanics.stiffness_n_per_m - s * s * mechanics.carried_kg();
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

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::plant::tests::paper_axis;

    /// Inertias of the parts of a screw, of all that the motor turns, and which share of the compliance is between it and them.
    const SCREW: [(f64, f64); 3] = [(0.01, 0.12), (0.01, 0.24), (0.01, 0.36)];

    /// Place of the motor per force on it, of motor, parts of the screw and table on springs and dampers in a row.
    fn of_a_chain(axis: &Parameters, omega_rad_per_s: f64) -> Complex<f64> {
        let s = Complex::new(0.0, omega_rad_per_s);
        let mechanics = &axis.mechanics;
        let turned_kg = mechanics.motor_mass_kg();
        let parts = SCREW.map(|(share, at)| (share * turned_kg, at));
        // The shares of their momentum that two masses carry for them.
        let [of_motor, of_table] = [0, 1].map(|side| {
            parts.iter().map(|(part_kg, at)| part_kg * if side == 0 { 1.0 - at } else { *at }).sum::<f64>()
        });
        let first = (turned_kg - of_motor, 0.0);
        let last = (mechanics.mass_kg - of_table, 1.0);
        let all: Vec<(f64, f64)> = [first].into_iter().chain(parts).chain([last]).collect();
        let mut stiffness = DMatrix::<Complex<f64>>::zeros(all.len(), all.len());
        for (place, (mass_kg, _)) in all.iter().enumerate() {
            stiffness[(place, place)] += s * s * *mass_kg;
        }
        for (place, pair) in all.windows(2).enumerate() {
            let spring =
                (s * mechanics.damping_n_s_per_m + mechanics.stiffness_n_per_m) / (pair[1].1 - pair[0].1);
            for (row, column, side) in [(0, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0), (1, 0, -1.0)] {
                stiffness[(place + row, place + column)] += spring * side;
            }
        }
        let mut force = DVector::zeros(all.len());
        force[0] = Complex::new(1.0, 0.0);
        stiffness.lu().solve(&force).expect("it moves")[0]
    }

    #[test]
    fn a_screw_of_several_inertias_answers_as_two_masses_whose_deflection_carries_some_along() {
        let mut axis = paper_axis();
        let carried = SCREW.iter().map(|(share, at)| share * at * (1.0 - at)).sum::<f64>();
        // About their resonance.
        for hz in [80.0, 110.0, 150.0] {
            let omega_rad_per_s = TAU * hz;
            let off = |axis: &Parameters| {
                let mechanics = &axis.mechanics;
                let travel = mechanics.travel_per_rad_m() / mechanics.force_per_torque();
                let drive = Complex::new(1.0, omega_rad_per_s * axis.actuator.lag_s())
                    / delay(axis.actuator.dead_time.as_s(), omega_rad_per_s);
                let speed = motor_speed_per_torque(axis, omega_rad_per_s) * drive * travel;
                let chain = of_a_chain(axis, omega_rad_per_s) * Complex::new(0.0, omega_rad_per_s);
                (speed / chain - 1.0).norm()
            };
            axis.mechanics.carried_share = 0.0;
            let off_without = off(&axis);
            axis.mechanics.carried_share = carried;
            let off_with = off(&axis);
            assert!(off_without > 4e-3, "{hz} Hz: off by {off_without} without");
            assert!(off_with < 0.15 * off_without, "{hz} Hz: off by {off_with}, {off_without} without");
        }
    }
}
