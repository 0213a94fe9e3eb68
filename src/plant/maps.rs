//! Exact maps of the linear parts of Eq. (6): for a step `h` during which the force command and the
//! friction force are held, the state after the step is a constant matrix times the state before.
//!
//! State `z = [d, v_m, v_t, f]`: screw deflection `x_m - x_t` (m), motor and table velocity in travel
//! (m/s), motor force behind the current loop (N); `x_m` only integrates `v_m` and rides along.
//!
//! ```text
//!   M_m v_m' = f - K d - C (v_m - v_t)         M v_t' = K d + C (v_m - v_t) - F
//!   d'       = v_m - v_t                       f'     = (u - f) / τ        x_m' = v_m
//! ```
//!
//! While the table sticks, `v_t = 0` and its equation falls away. The matrices come from the matrix
//! exponential of the system with its held inputs appended (Van Loan 1978), once per parameter set.
//! Invariant: nothing here knows friction's law; the controller's gains never enter.

use nalgebra::SMatrix;

use super::params::Parameters;

/// Deflection, motor velocity, table velocity, motor force, motor position.
pub(super) type Motion = [f64; 5];

const D: usize = 0;
const V_MOTOR: usize = 1;
const V_TABLE: usize = 2;
const FORCE: usize = 3;
const X_MOTOR: usize = 4;
const COMMAND: usize = 5;
const FRICTION: usize = 6;

/// One exact step. Columns are padded to six so that a step is six fused vector operations.
#[derive(Clone, Debug)]
pub(super) struct Map {
    deflection: [f64; 6],
    motor_velocity: [f64; 6],
    table_velocity: [f64; 6],
    force: [f64; 6],
    command: [f64; 6],
    friction: [f64; 6],
}

/// The maps for one length of step.
#[derive(Clone, Debug)]
pub(super) struct StepMaps {
    pub(super) slip: Map,
    pub(super) stick: Map,
    /// Length of the step.
    pub(super) length_s: f64,
    /// Of the screw in these maps.
    pub(super) stiffness_n_per_m: f64,
    /// Between motor and table in these maps.
    pub(super) damping_n_s_per_m: f64,
}

impl StepMaps {
    /// Both maps of an axis for a step of `step_s` seconds.
    pub(super) fn new(axis: &Parameters, step_s: f64) -> Self {
        Self {
            slip: Map::new(axis, step_s, true),
            stick: Map::new(axis, step_s, false),
            length_s: step_s,
            stiffness_n_per_m: axis.mechanics.stiffness_n_per_m,
            damping_n_s_per_m: axis.mechanics.damping_n_s_per_m,
        }
    }
}

impl Map {
    fn new(axis: &Parameters, step_s: f64, is_slipping: bool) -> Self {
        let (k, c) = (axis.mechanics.stiffness_n_per_m, axis.mechanics.damping_n_s_per_m);
        let (motor_kg, table_kg) = (axis.mechanics.motor_mass_kg(), axis.mechanics.mass_kg);
        let lag_s = axis.actuator.lag_s();
        let mut rate = SMatrix::<f64, 7, 7>::zeros();
        rate[(D, V_MOTOR)] = 1.0;
        rate[(X_MOTOR, V_MOTOR)] = 1.0;
        rate[(V_MOTOR, D)] = -k / motor_kg;
        rate[(V_MOTOR, V_MOTOR)] = -c / motor_kg;
        rate[(V_MOTOR, FORCE)] = 1.0 / motor_kg;
        rate[(FORCE, FORCE)] = -1.0 / lag_s;
        rate[(FORCE, COMMAND)] = 1.0 / lag_s;
        if is_slipping {
            rate[(D, V_TABLE)] = -1.0;
            rate[(V_MOTOR, V_TABLE)] = c / motor_kg;
            rate[(V_TABLE, D)] = k / table_kg;
            rate[(V_TABLE, V_MOTOR)] = c / table_kg;
            rate[(V_TABLE, V_TABLE)] = -c / table_kg;
            rate[(V_TABLE, FRICTION)] = -1.0 / table_kg;
        }
        let map = (rate * step_s).exp();
        let column = |input: usize| std::array::from_fn(|row| if row < 5 { map[(row, input)] } else { 0.0 });
        Self {
            deflection: column(D),
            motor_velocity: column(V_MOTOR),
            table_velocity: column(V_TABLE),
            force: column(FORCE),
            command: column(COMMAND),
            friction: column(FRICTION),
        }
    }

    /// The state after the step.
    #[inline]
    pub(super) fn apply(&self, z: &Motion, command_n: f64, friction_n: f64) -> Motion {
        let mut next = [0.0; 6];
        // Summed from the inputs to the state, smallest first; the order is part of "bit for bit".
        for (row, value) in next.iter_mut().enumerate() {
            let inputs = self.friction[row] * friction_n + self.command[row] * command_n;
            let drive = self.force[row] * z[FORCE] + self.deflection[row] * z[D];
            let speeds = self.motor_velocity[row] * z[V_MOTOR] + self.table_velocity[row] * z[V_TABLE];
            *value = (inputs + drive) + speeds;
        }
        [next[0], next[1], next[2], next[3], z[X_MOTOR] + next[4]]
    }

    /// What a change of the held friction force changes in the state after the step.
    #[inline]
    pub(super) fn correct(&self, z: &mut Motion, friction_change_n: f64) {
        for (value, per_n) in z.iter_mut().zip(self.friction) {
            *value += per_n * friction_change_n;
        }
    }

    /// The state after the step with a held force on the motor that does not pass the current loop.
    ///
    /// Shifted by it, motor force and command obey the equation of the current loop as they are.
    pub(super) fn apply_loaded(&self, z: &Motion, command_n: f64, motor_n: f64, table_n: f64) -> Motion {
        let mut shifted = *z;
        shifted[FORCE] += motor_n;
        let mut next = self.apply(&shifted, command_n + motor_n, table_n);
        next[FORCE] -= motor_n;
        next
    }

    /// What changes of the held forces on motor and table change in the state after the step.
    pub(super) fn correct_loaded(&self, z: &mut Motion, motor_change_n: f64, table_change_n: f64) {
        for (row, value) in z.iter_mut().enumerate() {
            let by_motor = if row == FORCE { 0.0 } else { self.force[row] + self.command[row] };
            *value += self.friction[row] * table_change_n + by_motor * motor_change_n;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::tests::paper_axis;

    #[test]
    fn two_half_steps_are_one_step() {
        let whole = Map::new(&paper_axis(), 5e-4, true);
        let half = Map::new(&paper_axis(), 2.5e-4, true);
        let start = [5e-6, 0.01, -0.02, 300.0, 0.1];
        let once = whole.apply(&start, 500.0, -951.3);
        let twice = half.apply(&half.apply(&start, 500.0, -951.3), 500.0, -951.3);
        for (a, b) in once.iter().zip(twice) {
            assert!((a - b).abs() <= 1e-12 * (1.0 + a.abs()), "{once:?} {twice:?}");
        }
    }

    #[test]
    fn a_force_on_the_motor_acts_at_once_and_a_command_through_its_lag() {
        let axis = paper_axis();
        let map = Map::new(&axis, 1e-3, true);
        let start = [5e-6, 0.01, -0.02, 300.0, 0.1];
        let by_lag_n = 100.0 * (1.0 - (-1e-3 / axis.actuator.lag_s()).exp());
        let (idle, pushed) =
            (map.apply(&start, 500.0, -951.3), map.apply_loaded(&start, 500.0, 100.0, -951.3));
        assert_eq!(idle[FORCE].to_bits(), map.apply_loaded(&start, 500.0, 0.0, -951.3)[FORCE].to_bits());
        assert!((pushed[FORCE] - idle[FORCE]).abs() < 1e-9, "{pushed:?}");
        assert!((map.apply(&start, 600.0, -951.3)[FORCE] - idle[FORCE] - by_lag_n).abs() < 1e-9);
        // The momentum of both masses grows by force times time.
        let gained = |motion: &Motion| {
            axis.mechanics.motor_mass_kg() * motion[V_MOTOR] + axis.mechanics.mass_kg * motion[V_TABLE]
        };
        assert!((gained(&pushed) - gained(&idle) - 0.1).abs() < 1e-12);
        let mut corrected = idle;
        map.correct_loaded(&mut corrected, 100.0, 0.0);
        for (a, b) in corrected.iter().zip(pushed) {
            assert!((a - b).abs() <= 1e-12 * (1.0 + a.abs()), "{corrected:?} {pushed:?}");
        }
    }

    #[test]
    fn momentum_of_a_free_axis_is_force_times_time() {
        let axis = paper_axis();
        let map = Map::new(&axis, 1e-3, true);
        let end = map.apply(&[0.0, 0.0, 0.0, 100.0, 0.0], 100.0, 0.0);
        let momentum = axis.mechanics.motor_mass_kg() * end[V_MOTOR] + axis.mechanics.mass_kg * end[V_TABLE];
        assert!((momentum - 0.1).abs() < 1e-12, "{momentum} N s, expected 0.1 N s");
    }
}
