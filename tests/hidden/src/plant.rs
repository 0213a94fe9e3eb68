//! What an axis is made of, as numbers in SI units, and the friction curve that a machine file can state.
//!
//! The curve, for a speed `a`: `breakaway` up to `fall_start`, a parabola down to `sliding` at `fall_end`, which it
//! meets with no slope, then `sliding + viscous (a - fall_end)`.
//! Invariant: nothing here knows of an effect.

/// Parameters of one axis; a machine file states all of them but one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plant {
    /// Table, kg.
    pub mass: f64,
    /// Between screw and table, N/m.
    pub stiffness: f64,
    /// Between screw and table, N s/m.
    pub damping: f64,
    /// Motor and screw, kg m^2.
    pub inertia: f64,
    /// Of it what sits within the spring, half of the compliance on either side. A machine file states the rest.
    pub screw_share: f64,
    /// Travel per turn, m.
    pub lead: f64,
    /// Of the screw, 0 to 1.
    pub efficiency: f64,
    /// N m/A.
    pub torque_constant: f64,
    /// First order, Hz.
    pub current_loop_hz: f64,
    /// Largest friction, N.
    pub breakaway: f64,
    /// Least friction, N.
    pub sliding: f64,
    /// Speed at which the fall of the friction begins, m/s.
    pub fall_start: f64,
    /// Speed at which it ends, m/s.
    pub fall_end: f64,
    /// Beyond `fall_end`, N s/m.
    pub viscous: f64,
}

impl Plant {
    /// Travel per radian, m.
    pub fn travel_per_rad(&self) -> f64 {
        self.lead / std::f64::consts::TAU
    }

    /// Torque at the motor for a force at the screw, N m per N.
    pub fn torque_per_force(&self) -> f64 {
        self.travel_per_rad() / self.efficiency
    }

    /// Motor, screw and table as one inertia at the motor, kg m^2.
    pub fn inertia_total(&self) -> f64 {
        self.inertia + self.mass * self.travel_per_rad() * self.torque_per_force()
    }

    /// Friction at a speed that is not negative, N, without the part that grows with speed.
    pub fn dry_friction(&self, speed: f64) -> f64 {
        if speed >= self.fall_end {
            return self.sliding;
        }
        let from = speed.max(self.fall_start);
        let share = (self.fall_end - from) / (self.fall_end - self.fall_start);
        self.sliding + (self.breakaway - self.sliding) * share * share
    }

    /// The part that grows with speed, N.
    pub fn viscous_friction(&self, speed: f64) -> f64 {
        self.viscous * (speed - self.fall_end).max(0.0)
    }
}

/// How the axis is controlled; known exactly, as a controller knows its own settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Control {
    /// Position loop, 1/s.
    pub position_gain: f64,
    /// Share of the setpoint's velocity that is fed forward.
    pub velocity_feed_forward: f64,
    /// Velocity loop, proportional, N m s/rad.
    pub proportional: f64,
    /// Velocity loop, integral, N m/rad.
    pub integral: f64,
    /// Most current, A.
    pub current_max: f64,
    /// From the latch of the encoders to the current that follows from it, s.
    pub delay: f64,
    /// Velocity from three positions instead of two.
    pub is_second_order: bool,
}

/// What the axis is measured with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensors {
    /// One count of the motor encoder as travel, m.
    pub motor_count: f64,
    /// One count of the table scale, m.
    pub table_count: f64,
    /// What the table scale adds to the place: mounting, air, vibration; m rms.
    pub table_noise: f64,
    /// Its correlation time, s.
    pub table_noise_time: f64,
    /// Current that is measured but does not flow, A rms.
    pub current_noise: f64,
    /// Its correlation time, s.
    pub current_noise_time: f64,
    /// Torque that nobody asked for, N m rms: bearings, seals, the grid.
    pub torque_noise: f64,
    /// Its correlation time, s.
    pub torque_noise_time: f64,
    /// Error of the instant at which both encoders are latched, s rms.
    pub latch_jitter: f64,
}

/// Sensors without error.
pub const IDEAL: Sensors = Sensors {
    motor_count: 0.0,
    table_count: 0.0,
    table_noise: 0.0,
    table_noise_time: 1e-2,
    current_noise: 0.0,
    current_noise_time: 1e-3,
    torque_noise: 0.0,
    torque_noise_time: 1e-2,
    latch_jitter: 0.0,
};

#[cfg(test)]
mod tests {
    use crate::machine::Machine;

    #[test]
    fn the_curve_has_the_papers_corners() {
        let plant = Machine::paper().axes[0].plant;
        for (speed_mm_per_s, force) in
            [(0.0, 1127.8), (0.1, 1127.8), (0.3, 951.3 + 0.25 * 176.5), (0.5, 951.3), (33.0, 951.3)]
        {
            let curve = plant.dry_friction(speed_mm_per_s * 1e-3);
            assert!((curve - force).abs() < 1e-9, "{curve} N at {speed_mm_per_s} mm/s, should be {force} N");
        }
    }
}
