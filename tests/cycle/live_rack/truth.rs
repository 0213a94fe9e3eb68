//! The axis of Eq. (6) by a method of its own: Runge-Kutta of the fourth order in steps of a microsecond.

use quadrant::base::units::{Current, Velocity};
use quadrant::plant::friction::Law;
use quadrant::plant::{Parameters, State};

/// One axis.
pub(crate) struct Truth {
    axis: Parameters,
    law: Law,
    /// Motor and table, place and speed, and the current behind its loop.
    at: [f64; 5],
    is_stuck: bool,
}

impl Truth {
    pub(crate) fn new(axis: &Parameters, from: &State) -> Self {
        let at = [
            from.motor_position.as_m(),
            from.motor_velocity.as_m_per_s(),
            from.table_position.as_m(),
            from.table_velocity.as_m_per_s(),
            from.current.as_a(),
        ];
        Self { axis: *axis, law: Law::new(axis.friction), at, is_stuck: from.is_stuck }
    }

    pub(crate) fn motor_m(&self) -> f64 {
        self.at[0]
    }

    fn pull_n(&self, [motor_m, motor_m_per_s, table_m, table_m_per_s, _]: [f64; 5]) -> f64 {
        let mechanics = &self.axis.mechanics;
        mechanics.stiffness_n_per_m * (motor_m - table_m)
            + mechanics.damping_n_s_per_m * (motor_m_per_s - table_m_per_s)
    }

    fn rate(&self, at: [f64; 5], current: Current) -> [f64; 5] {
        let Parameters { mechanics, actuator, .. } = &self.axis;
        let pull_n = self.pull_n(at);
        let motor_n = actuator.torque(Current::a(at[4])).as_nm() * mechanics.force_per_torque();
        let friction_n = self.law.sliding(Velocity::m_per_s(at[3])).as_n();
        let table = if self.is_stuck { 0.0 } else { (pull_n - friction_n) / mechanics.mass_kg };
        [
            at[1],
            (motor_n - pull_n) / mechanics.motor_mass_kg(),
            if self.is_stuck { 0.0 } else { at[3] },
            table,
            (current.as_a() - at[4]) / actuator.lag_s(),
        ]
    }

    pub(crate) fn step(&mut self, current: Current) {
        let h = 1e-6;
        let moved = |by: [f64; 5], part: f64| std::array::from_fn(|i| self.at[i] + by[i] * part * h);
        let k1 = self.rate(self.at, current);
        let k2 = self.rate(moved(k1, 0.5), current);
        let k3 = self.rate(moved(k2, 0.5), current);
        let k4 = self.rate(moved(k3, 1.0), current);
        let before = self.at[3];
        self.at = std::array::from_fn(|i| self.at[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
        if !self.is_stuck && before * self.at[3] < 0.0 {
            self.is_stuck = true;
            self.at[3] = 0.0;
        }
        let pull_n = self.pull_n(self.at);
        if self.is_stuck && pull_n.abs() > self.law.breakaway().as_n() {
            self.is_stuck = false;
            // The law is a set at rest; from here it is that of the direction in which it slides.
            self.at[3] = f64::MIN_POSITIVE.copysign(pull_n);
        }
    }
}
