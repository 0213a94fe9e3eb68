//! Exact maps of the linear parts of Eq. (6): for a step `h` during which the force command and the
//! friction force are held, the state after the step is a constant matrix times the state before.
//!
//! State `z = [d, v_m, v_t, f]`: screw deflection `x_m - x_t` (m), motor and table velocity in travel
//! (m/s), motor force behind the current loop (N); `x_m` only integrates `v_m` and rides along.
//!
//! ```text
//!   M_m v_m' = f - S + m_d d''                 M v_t' = S - F - m_d d''
//!   d'       = v_m - v_t                       f'     = (u - f) / τ        x_m' = v_m
//!   S        = K d + C d'
//! ```
//!
//! `m_d` is what the deflection carries along of the screw, whose parts move with neither end: their energy is
//! `m_d d'^2 / 2` less than with those shares of them in both masses that carry their momentum.
//!
//! While the table sticks, `v_t = 0` and its equation falls away. The matrices come from the matrix
//! exponential of the system with its held inputs appended (Van Loan 1978), once per parameter set.
//! Invariant: nothing here knows friction's law; the controller's gains never enter.

use nalgebra::SMatrix;

use super::params::{Mechanics, Parameters};

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

/// What each mass is to a force on it, and the shares of forces on the other that it takes with the other sign.
#[derive(Clone, Copy, Debug)]
struct Masses {
    motor_kg: f64,
    table_kg: f64,
    /// To the motor of what acts on the table, and to the table of what acts on the motor.
    shares: [f64; 2],
    /// The motor's while the table is held.
    held_kg: f64,
}

impl Masses {
    /// Of `[M_m - m_d, m_d; m_d, M - m_d] [v_m', v_t'] = forces`, solved for each.
    fn of(mechanics: &Mechanics) -> Self {
        let carried_kg = mechanics.carried_kg();
        let [motor_kg, table_kg] =
            [mechanics.motor_mass_kg(), mechanics.mass_kg].map(|mass_kg| mass_kg - carried_kg);
        let shares = [carried_kg / table_kg, carried_kg / motor_kg];
        Self {
            motor_kg: motor_kg - carried_kg * shares[0],
            table_kg: table_kg - carried_kg * shares[1],
            shares,
            held_kg: motor_kg,
        }
    }
}

/// Share of what accelerates a motor before a table that is held, by which the table is pushed back.
pub(super) fn push_back(mechanics: &Mechanics) -> f64 {
    Masses::of(mechanics).shares[1]
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
    /// Stiffness and damping of the screw in them.
    pub(super) const fn screw(&self) -> [f64; 2] {
        [self.stiffness_n_per_m, self.damping_n_s_per_m]
    }

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
        let Masses { motor_kg, table_kg, shares: [of_table, of_motor], held_kg } =
            Masses::of(&axis.mechanics);
        let lag_s = axis.actuator.lag_s();
        // Of one mass by the force on the other.
        let (k_motor, c_motor) = (k * (1.0 + of_table), c * (1.0 + of_table));
        let (k_table, c_table) = (k * (1.0 + of_motor), c * (1.0 + of_motor));
        let mut rate = SMatrix::<f64, 7, 7>::zeros();
        rate[(D, V_MOTOR)] = 1.0;
        rate[(X_MOTOR, V_MOTOR)] = 1.0;
        rate[(FORCE, FORCE)] = -1.0 / lag_s;
        rate[(FORCE, COMMAND)] = 1.0 / lag_s;
        if is_slipping {
            rate[(D, V_TABLE)] = -1.0;
            rate[(V_MOTOR, D)] = -k_motor / motor_kg;
            rate[(V_MOTOR, V_MOTOR)] = -c_motor / motor_kg;
            rate[(V_MOTOR, V_TABLE)] = c_motor / motor_kg;
            rate[(V_MOTOR, FORCE)] = 1.0 / motor_kg;
            rate[(V_MOTOR, FRICTION)] = of_table / motor_kg;
            rate[(V_TABLE, D)] = k_table / table_kg;
            rate[(V_TABLE, V_MOTOR)] = c_table / table_kg;
            rate[(V_TABLE, V_TABLE)] = -c_table / table_kg;
            rate[(V_TABLE, FORCE)] = 0.0 - of_motor / table_kg;
            rate[(V_TABLE, FRICTION)] = -1.0 / table_kg;
        } else {
            rate[(V_MOTOR, D)] = -k / held_kg;
            rate[(V_MOTOR, V_MOTOR)] = -c / held_kg;
            rate[(V_MOTOR, FORCE)] = 1.0 / held_kg;
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

    /// Speed that a force on the table gains in the step, m/s.
    pub(super) fn gained(&self, table_n: f64) -> f64 {
        -self.friction[V_TABLE] * table_n
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
        for carried_share in [0.0, 0.05] {
            let mut axis = paper_axis();
            axis.mechanics.carried_share = carried_share;
            let map = Map::new(&axis, 1e-3, true);
            let end = map.apply(&[0.0, 0.0, 0.0, 100.0, 0.0], 100.0, 0.0);
            let momentum =
                axis.mechanics.motor_mass_kg() * end[V_MOTOR] + axis.mechanics.mass_kg * end[V_TABLE];
            assert!((momentum - 0.1).abs() < 1e-12, "{momentum} N s, expected 0.1 N s");
        }
    }

    #[test]
    fn two_masses_swing_at_their_resonance_whatever_their_deflection_carries_along() {
        for carried_share in [0.0, 0.05] {
            let mut axis = paper_axis();
            axis.mechanics.damping_n_s_per_m = 0.0;
            axis.mechanics.carried_share = carried_share;
            let period_s = 1.0 / axis.mechanics.resonance_hz();
            let start = [5e-6, 0.01, -0.02, 0.0, 0.0];
            let end = Map::new(&axis, period_s, true).apply(&start, 0.0, 0.0);
            for (place, off) in [(D, 1e-15), (V_MOTOR, 1e-12), (V_TABLE, 1e-12)] {
                assert!((end[place] - start[place]).abs() < off, "{carried_share}: {start:?} {end:?}");
            }
        }
    }

    #[test]
    fn a_held_table_is_pushed_by_as_much_as_would_just_not_move_it() {
        let mut axis = paper_axis();
        axis.mechanics.carried_share = 0.05;
        let (motor_n, screw_n) = (2_000.0, 151e6 * 2e-6);
        let held_n = screw_n - push_back(&axis.mechanics) * (motor_n - screw_n);
        assert!(held_n < 0.95 * screw_n, "{held_n} N of {screw_n} N");
        let step_s = 1e-7;
        let start = [2e-6, 0.0, 0.0, motor_n, 0.0];
        let slips = Map::new(&axis, step_s, true).apply(&start, motor_n, held_n);
        let holds = Map::new(&axis, step_s, false).apply(&start, motor_n, 0.0);
        let [gained, all] = [slips[V_TABLE], slips[V_MOTOR]].map(f64::abs);
        assert!(gained < 1e-4 * all, "{gained} m/s of {all} m/s");
        assert!((holds[V_MOTOR] - slips[V_MOTOR]).abs() < 1e-4 * all, "{holds:?} {slips:?}");
    }
}
