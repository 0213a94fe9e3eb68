//! Velocity loop of one axis, Eq. (5) of the paper, at every tick:
//!
//! ```text
//!   T = a V_p (1 + b V_i / (t s + 1)) e,   e = ω_command - ω
//! ```
//!
//! In its two readings: with `t` long against the loop it is a true integrator,
//! `K_vp (1 + 1/(T_i s))` with `K_vp = a V_p` and `K_vi = a V_p V_i b/t`; with a finite `t` it is a lag
//! whose stiffness at rest is finite. The integral is kept as a torque, so that a change of gains does
//! not move it. Sampled by forward Euler: the integral of a tick holds the errors of the ticks before it
//! (the reading behind the known protrusions; backward Euler gives 24.79 um instead of 25.01 um).
//!
//! Units: gains at the motor shaft (N m s/rad, N m/rad), errors in rad/s.
//! Invariant: the integral never grows in the direction in which the current is held.

use nalgebra::Complex;

use crate::base::time::Span;
use crate::base::units::Torque;

/// How the integral part remembers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Memory {
    /// A true integrator of this gain, N m/rad.
    Integrator {
        /// `K_vi = a V_p V_i b/t`.
        gain_nm_per_rad: f64,
    },
    /// The lag of Eq. (5) as printed.
    Lag {
        /// `a V_p b V_i`, its gain at rest, N m s/rad.
        gain_nm_s_per_rad: f64,
        /// `t`, s.
        time_constant_s: f64,
    },
}

/// Gains of the velocity loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// `K_vp = a V_p`, N m s/rad.
    pub proportional_nm_s_per_rad: f64,
    /// The integral part.
    pub memory: Memory,
}

impl Gains {
    /// Whether the integral part does anything.
    pub const fn has_integral(&self) -> bool {
        match self.memory {
            Memory::Integrator { gain_nm_per_rad } => gain_nm_per_rad != 0.0,
            Memory::Lag { gain_nm_s_per_rad, .. } => gain_nm_s_per_rad != 0.0,
        }
    }

    /// So many times these.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let memory = match self.memory {
            Memory::Integrator { gain_nm_per_rad } => {
                Memory::Integrator { gain_nm_per_rad: factor * gain_nm_per_rad }
            }
            Memory::Lag { gain_nm_s_per_rad, time_constant_s } => {
                Memory::Lag { gain_nm_s_per_rad: factor * gain_nm_s_per_rad, time_constant_s }
            }
        };
        Self { proportional_nm_s_per_rad: factor * self.proportional_nm_s_per_rad, memory }
    }

    /// The integral after a tick is `keep * integral + gain * error`: both numbers.
    fn recursion(&self, tick: Span) -> (f64, f64) {
        match self.memory {
            Memory::Integrator { gain_nm_per_rad } => (1.0, gain_nm_per_rad * tick.as_s()),
            Memory::Lag { gain_nm_s_per_rad, time_constant_s } => {
                let keep = time_constant_s / (time_constant_s + tick.as_s());
                (keep, gain_nm_s_per_rad * (1.0 - keep))
            }
        }
    }

    /// Frequency response of the loop as it is sampled, torque per speed error in N m s/rad:
    /// `K_vp + gain / (z - keep)`. For loop margins (`offline/margins`).
    pub fn response(&self, tick: Span, omega_rad_per_s: f64) -> Complex<f64> {
        let (keep, gain_nm_s_per_rad) = self.recursion(tick);
        let z = Complex::from_polar(1.0, omega_rad_per_s * tick.as_s());
        Complex::new(gain_nm_s_per_rad, 0.0) / (z - keep) + self.proportional_nm_s_per_rad
    }

    /// Torque that a lasting speed error makes in the end, N m s/rad; infinite for the integrator.
    pub fn gain_at_rest_nm_s_per_rad(&self) -> f64 {
        match self.memory {
            Memory::Integrator { gain_nm_per_rad: 0.0 } => self.proportional_nm_s_per_rad,
            Memory::Integrator { .. } => f64::INFINITY,
            Memory::Lag { gain_nm_s_per_rad, .. } => self.proportional_nm_s_per_rad + gain_nm_s_per_rad,
        }
    }

    /// Damping of the loop around a rigid inertia without any delay:
    /// `K_vp / (2 sqrt(J K_vi))`, and its like for the lag. Infinite without an integral part.
    pub fn damping(&self, inertia_kg_m2: f64) -> f64 {
        let kvp = self.proportional_nm_s_per_rad;
        match self.memory {
            Memory::Integrator { gain_nm_per_rad } => 0.5 * kvp / (inertia_kg_m2 * gain_nm_per_rad).sqrt(),
            // J t s^2 + (J + K_vp t) s + K_vp (1 + b V_i) = 0
            Memory::Lag { gain_nm_s_per_rad, time_constant_s } => {
                let product = inertia_kg_m2 * time_constant_s * (kvp + gain_nm_s_per_rad);
                0.5 * (inertia_kg_m2 + kvp * time_constant_s) / product.sqrt()
            }
        }
    }
}

/// The loop with its divisions done, and what it remembers.
#[derive(Clone, Copy, Debug)]
pub struct VelocityLoop {
    proportional_nm_s_per_rad: f64,
    /// See [`Gains::recursion`].
    keep: f64,
    gain_nm_s_per_rad: f64,
    integral_nm: f64,
}

/// The two parts of the torque.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parts {
    /// Proportional part.
    pub proportional: Torque,
    /// Integral part.
    pub integral: Torque,
}

impl VelocityLoop {
    /// A loop with an empty integral.
    pub fn new(gains: &Gains, tick: Span) -> Self {
        let (keep, gain_nm_s_per_rad) = gains.recursion(tick);
        Self {
            proportional_nm_s_per_rad: gains.proportional_nm_s_per_rad,
            keep,
            gain_nm_s_per_rad,
            integral_nm: 0.0,
        }
    }

    /// One tick. `feed_forward` is added outside and `bound` is the torque the axis can have: where the
    /// sum would pass it, the integral is not driven further that way.
    pub fn step(&mut self, error_rad_per_s: f64, feed_forward: Torque, bound: Torque) -> Parts {
        let proportional_nm = self.proportional_nm_s_per_rad * error_rad_per_s;
        let parts =
            Parts { proportional: Torque::nm(proportional_nm), integral: Torque::nm(self.integral_nm) };
        let next_nm = self.keep * self.integral_nm + self.gain_nm_s_per_rad * error_rad_per_s;
        let others_nm = proportional_nm + feed_forward.as_nm();
        let (top_nm, bottom_nm) = (bound.as_nm() - others_nm, -bound.as_nm() - others_nm);
        // Beyond a bound the integral may shrink or stay, not grow.
        self.integral_nm = if next_nm > top_nm {
            next_nm.min(self.integral_nm.max(top_nm))
        } else if next_nm < bottom_nm {
            next_nm.max(self.integral_nm.min(bottom_nm))
        } else {
            next_nm
        };
        parts
    }

    /// Other gains from the next tick on, with the same torque at the same error. `fed_more` is what the
    /// feed-forwards give more than before; the integral gives it up.
    pub fn swap(&mut self, gains: &Gains, tick: Span, error_rad_per_s: f64, fed_more: Torque) {
        let before_nm = self.proportional_nm_s_per_rad * error_rad_per_s + self.integral_nm;
        *self = Self::new(gains, tick);
        self.integral_nm = before_nm - self.proportional_nm_s_per_rad * error_rad_per_s - fed_more.as_nm();
    }

    /// Give this torque at this error from the next tick on, as if the integral had come to it.
    pub fn hold(&mut self, error_rad_per_s: f64, torque: Torque) {
        self.integral_nm = torque.as_nm() - self.proportional_nm_s_per_rad * error_rad_per_s;
    }

    /// Forget everything: the axis has no current.
    pub fn reset(&mut self) {
        self.integral_nm = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: Span = Span::us(500);
    const UNBOUND: Torque = Torque::nm(1e9);

    fn integrator(kvp: f64, kvi: f64) -> Gains {
        Gains { proportional_nm_s_per_rad: kvp, memory: Memory::Integrator { gain_nm_per_rad: kvi } }
    }

    #[test]
    fn the_lag_ends_at_its_finite_gain_and_starts_like_the_integrator() {
        let lag = Gains {
            proportional_nm_s_per_rad: 1.5,
            memory: Memory::Lag { gain_nm_s_per_rad: 10.0, time_constant_s: 0.069 },
        };
        let mut lagging = VelocityLoop::new(&lag, TICK);
        let mut integrating = VelocityLoop::new(&integrator(1.5, 10.0 / 0.069), TICK);
        lagging.step(1.0, Torque::ZERO, UNBOUND);
        integrating.step(1.0, Torque::ZERO, UNBOUND);
        let first = (lagging.step(1.0, Torque::ZERO, UNBOUND), integrating.step(1.0, Torque::ZERO, UNBOUND));
        assert!((first.0.integral / first.1.integral - 1.0).abs() < 0.01, "{first:?}");
        for _ in 0..10_000 {
            lagging.step(1.0, Torque::ZERO, UNBOUND);
        }
        let rest = lagging.step(1.0, Torque::ZERO, UNBOUND);
        assert!((rest.integral.as_nm() - 10.0).abs() < 1e-9, "{rest:?}");
    }

    #[test]
    fn the_integral_stops_at_the_bound_and_leaves_it_at_once() {
        let mut loop_ = VelocityLoop::new(&integrator(1.5, 178.7), TICK);
        for _ in 0..20_000 {
            let parts = loop_.step(5.0, Torque::nm(0.5), Torque::nm(30.0));
            let torque_nm = (parts.proportional + parts.integral).as_nm() + 0.5;
            assert!(torque_nm <= 30.0 + 1e-9, "{torque_nm} N m above the bound of 30 N m");
        }
        let back = loop_.step(-0.5, Torque::nm(0.5), Torque::nm(30.0));
        assert!((back.proportional + back.integral).as_nm() < 30.0, "no wound-up integral: {back:?}");
    }

    #[test]
    fn a_large_error_at_the_bound_does_not_drag_the_integral_backwards() {
        let mut loop_ = VelocityLoop::new(&integrator(1.5, 178.7), TICK);
        loop_.integral_nm = 10.0;
        // The proportional part alone passes the bound; the integral keeps what the load needs.
        loop_.step(40.0, Torque::ZERO, Torque::nm(30.0));
        assert_eq!(loop_.integral_nm, 10.0);
    }

    #[test]
    fn a_swap_keeps_the_torque() {
        let mut loop_ = VelocityLoop::new(&integrator(1.517, 178.7), TICK);
        for _ in 0..50 {
            loop_.step(2.0, Torque::ZERO, UNBOUND);
        }
        let before_nm = loop_.proportional_nm_s_per_rad * 2.0 + loop_.integral_nm;
        let slow = integrator(3.0, 0.0);
        loop_.swap(&slow, TICK, 2.0, Torque::nm(0.7));
        let after = loop_.step(2.0, Torque::nm(0.7), UNBOUND);
        let after_nm = (after.proportional + after.integral).as_nm() + 0.7;
        assert!((after_nm - before_nm).abs() < 1e-12, "{before_nm} N m became {after_nm} N m");
    }

    /// The response found by running the loop on a sampled sine, N m s/rad. `SETTLED` ticks are whole turns
    /// of it and long enough for a lag to forget its start.
    fn measured_response(gains: &Gains, ticks_per_turn: u32) -> Complex<f64> {
        const SETTLED: u32 = 4000;
        let mut loop_ = VelocityLoop::new(gains, TICK);
        let mut sum = Complex::new(0.0, 0.0);
        for tick in 0..SETTLED + ticks_per_turn {
            let phase =
                Complex::from_polar(1.0, std::f64::consts::TAU * f64::from(tick) / f64::from(ticks_per_turn));
            let parts = loop_.step(phase.re, Torque::ZERO, UNBOUND);
            if tick >= SETTLED {
                sum += phase.conj() * (parts.proportional + parts.integral).as_nm();
            }
        }
        sum * 2.0 / f64::from(ticks_per_turn)
    }

    #[test]
    fn the_response_is_that_of_the_running_loop() {
        let lag = Gains {
            proportional_nm_s_per_rad: 1.295,
            memory: Memory::Lag { gain_nm_s_per_rad: 9.0, time_constant_s: 0.069 },
        };
        for gains in [integrator(1.517, 178.7), lag] {
            for ticks_per_turn in [8_u32, 40, 200] {
                let omega = std::f64::consts::TAU / (f64::from(ticks_per_turn) * TICK.as_s());
                let (stated, measured) =
                    (gains.response(TICK, omega), measured_response(&gains, ticks_per_turn));
                let off = (stated - measured).norm() / stated.norm();
                assert!(off < 1e-9, "{gains:?} at {omega} rad/s: {stated} stated, {measured} measured");
            }
        }
    }

    #[test]
    fn damping_is_that_of_the_known_sets() {
        // Motor and screw of the reference axis; the lag's parameters are known to two digits only.
        let lag = |kvp: f64, v_i: f64| Gains {
            proportional_nm_s_per_rad: kvp,
            memory: Memory::Lag { gain_nm_s_per_rad: kvp * 6.1 * v_i, time_constant_s: 0.069 },
        };
        for (gains, known, bound) in [
            (integrator(1.517, 178.7), 0.709, 5e-4),
            (integrator(1.493, 400.5), 0.466, 5e-4),
            (lag(0.01281 * 101.121, 1.140), 0.715, 6e-3),
            (lag(0.01281 * 99.522, 2.596), 0.488, 6e-3),
        ] {
            let damping = gains.damping(0.0064);
            assert!((damping - known).abs() < bound, "{gains:?}: damping {damping}, known {known}");
        }
    }
}
