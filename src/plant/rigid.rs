//! An axis without elasticity: one mass, Coulomb and viscous friction that may differ by direction, and a
//! constant force. What is left of [`super::Plant`] below its resonance, and the model of linear regression:
//!
//! ```text
//!   F  =  M a  +  F_c± sign(v)  +  m± v  +  F_0
//! ```
//!
//! Used by identification from data that tell no more. Invariant: linear in its parameters; a step is exact for
//! a force held over it, the moment of a reversal included.

/// Friction in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Branch {
    /// Coulomb friction, N; not negative.
    pub coulomb_n: f64,
    /// Viscous friction, N s/m.
    pub viscous_n_s_per_m: f64,
}

/// Parameters of the axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rigid {
    /// All that moves, kg.
    pub mass_kg: f64,
    /// While the velocity is positive.
    pub forwards: Branch,
    /// While it is negative.
    pub backwards: Branch,
    /// Constant force against the drive, N: gravity, or the zero of the force measurement.
    pub offset_n: f64,
}

/// Where it is and how fast it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Position, m.
    pub position_m: f64,
    /// Velocity, m/s.
    pub velocity_m_per_s: f64,
}

/// A time constant above this, s, is no friction to speak of: the velocity is a ramp.
const ENDLESS_S: f64 = 1e6;

impl Rigid {
    /// Force that makes a motion, N.
    pub fn force_n(&self, velocity_m_per_s: f64, acceleration_m_per_s2: f64) -> f64 {
        let branch = self.branch(velocity_m_per_s);
        let friction_n = if velocity_m_per_s == 0.0 {
            0.0
        } else {
            branch.coulomb_n.copysign(velocity_m_per_s) + branch.viscous_n_s_per_m * velocity_m_per_s
        };
        self.mass_kg * acceleration_m_per_s2 + friction_n + self.offset_n
    }

    fn branch(&self, direction: f64) -> &Branch {
        if direction < 0.0 { &self.backwards } else { &self.forwards }
    }

    /// The motion after `time_s` under a force.
    #[must_use]
    pub fn step(&self, from: Motion, force_n: f64, time_s: f64) -> Motion {
        let drive_n = force_n - self.offset_n;
        let mut motion = from;
        let mut left_s = time_s;
        // A reversal splits the step; after the second the axis sticks or goes on one way.
        for _ in 0..3 {
            let direction = if motion.velocity_m_per_s == 0.0 { drive_n } else { motion.velocity_m_per_s };
            let branch = self.branch(direction);
            if motion.velocity_m_per_s == 0.0 && drive_n.abs() <= branch.coulomb_n {
                return motion;
            }
            let free_n = drive_n - branch.coulomb_n.copysign(direction);
            let slide = Slide {
                end_m_per_s: free_n / branch.viscous_n_s_per_m,
                time_constant_s: self.mass_kg / branch.viscous_n_s_per_m,
                ramp_m_per_s2: free_n / self.mass_kg,
            };
            let rest_s = slide.rest_s(motion.velocity_m_per_s).filter(|rest_s| *rest_s < left_s);
            motion = slide.after(motion, rest_s.unwrap_or(left_s));
            let Some(rest_s) = rest_s else { return motion };
            motion.velocity_m_per_s = 0.0;
            left_s -= rest_s;
        }
        motion
    }
}

/// Sliding in one direction under a constant force: the velocity goes to its end as an exponential.
struct Slide {
    end_m_per_s: f64,
    time_constant_s: f64,
    ramp_m_per_s2: f64,
}

impl Slide {
    fn is_ramp(&self) -> bool {
        // NaN is that of an axis without viscosity that is in balance.
        self.time_constant_s.is_nan() || self.time_constant_s.abs() >= ENDLESS_S
    }

    fn after(&self, from: Motion, time_s: f64) -> Motion {
        let speed = from.velocity_m_per_s;
        if self.is_ramp() {
            let gained = self.ramp_m_per_s2 * time_s;
            return Motion {
                position_m: from.position_m + (speed + 0.5 * gained) * time_s,
                velocity_m_per_s: speed + gained,
            };
        }
        // 1 - exp(-t / T), without loss for short steps.
        let gone = -libm::expm1(-time_s / self.time_constant_s);
        let lacking = self.end_m_per_s - speed;
        Motion {
            position_m: from.position_m + self.end_m_per_s * time_s - lacking * self.time_constant_s * gone,
            velocity_m_per_s: speed + lacking * gone,
        }
    }

    /// When the velocity comes to zero.
    fn rest_s(&self, speed: f64) -> Option<f64> {
        let rest_s = if self.is_ramp() {
            -speed / self.ramp_m_per_s2
        } else {
            self.time_constant_s * libm::log1p(-speed / self.end_m_per_s)
        };
        (speed != 0.0 && rest_s.is_finite() && rest_s > 0.0).then_some(rest_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXIS: Rigid = Rigid {
        mass_kg: 95.0,
        forwards: Branch { coulomb_n: 20.0, viscous_n_s_per_m: 170.0 },
        backwards: Branch { coulomb_n: 21.0, viscous_n_s_per_m: 240.0 },
        offset_n: -3.0,
    };

    #[test]
    fn a_step_is_the_same_in_one_piece_or_in_many() {
        // Decelerates, reverses and speeds up the other way.
        let from = Motion { position_m: 0.1, velocity_m_per_s: 0.05 };
        let whole = AXIS.step(from, -60.0, 0.5);
        let parts = (0..1_000).fold(from, |motion, _| AXIS.step(motion, -60.0, 0.5e-3));
        assert!(whole.velocity_m_per_s < -0.01, "it reverses: {whole:?}");
        assert!((whole.position_m - parts.position_m).abs() < 1e-12, "{whole:?} {parts:?}");
        assert!((whole.velocity_m_per_s - parts.velocity_m_per_s).abs() < 1e-12);
    }

    #[test]
    fn a_force_below_friction_moves_nothing_and_stops_what_moves() {
        let still = AXIS.step(Motion::default(), 16.9, 1.0);
        assert_eq!(still, Motion::default());
        let tears = AXIS.step(Motion::default(), 17.1, 1.0);
        assert!(tears.velocity_m_per_s > 0.0);
        let stopped = AXIS.step(Motion { position_m: 0.0, velocity_m_per_s: 0.01 }, 0.0, 10.0);
        assert_eq!(stopped.velocity_m_per_s, 0.0);
        // M v² / 2 over the friction, less what viscosity takes.
        let way_m = 0.5 * 95.0 * 0.01_f64.powi(2) / 17.0;
        assert!((stopped.position_m / way_m - 1.0).abs() < 0.1, "{} m", stopped.position_m);
    }

    #[test]
    fn the_force_of_a_motion_makes_that_motion() {
        let from = Motion { position_m: 0.0, velocity_m_per_s: -0.2 };
        let step_s = 1e-6;
        let force_n = AXIS.force_n(-0.2, 0.7);
        let after = AXIS.step(from, force_n, step_s);
        let gained = (after.velocity_m_per_s + 0.2) / step_s;
        assert!((gained - 0.7).abs() < 1e-5, "{gained} m/s²");
    }

    #[test]
    fn without_viscosity_it_is_a_ramp() {
        let coulomb = Branch { coulomb_n: 10.0, viscous_n_s_per_m: 0.0 };
        let axis = Rigid { mass_kg: 10.0, forwards: coulomb, backwards: coulomb, offset_n: 0.0 };
        let end = axis.step(Motion::default(), 30.0, 2.0);
        assert_eq!((end.position_m, end.velocity_m_per_s), (4.0, 4.0));
    }
}
