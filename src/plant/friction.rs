//! Friction of one axis against the speed of its table: Eq. (1) of the paper in the reading that is
//! odd, bounded and dissipative.
//!
//! With `a = |v|`, both variants stick at `v = 0` as long as the applied force stays within `F_max`, then
//!
//! ```text
//!   nonlinear   a < D_v'          F_max
//!               D_v' <= a < D_v   F_low + p (a - D_v)^2,   p = (F_max - F_low) / (D_v - D_v')^2
//!               a >= D_v          F_low + m (a - D_v)
//!   linear      a < D_v           F_max
//!               a >= D_v          F_low + m (a - D_v)
//! ```
//!
//! Used by the simulated plant, the feed-forward, identification and gap.
//! Invariant: this formula exists nowhere else.

use crate::base::units::{Force, Velocity};

/// Shape of the fall from `F_max` to `F_low`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// A drop at `D_v` (Fig. 2a of the paper).
    Linear,
    /// A parabola from `D_v'` to `D_v` (Fig. 2b).
    Nonlinear,
}

/// The numbers of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Which shape.
    pub variant: Variant,
    /// Break-away force, `F_max`.
    pub breakaway: Force,
    /// Sliding force at the end of the fall, `F_low`.
    pub sliding: Force,
    /// Speed at which the fall ends, `D_v`.
    pub fall_end: Velocity,
    /// Speed up to which the force stays at `F_max`, `D_v'`; nonlinear variant only.
    pub fall_start: Velocity,
    /// Rise of the force above `D_v`, `m`, in N s/m.
    pub viscous_n_s_per_m: f64,
}

impl Parameters {
    /// No friction at all: the twin a protrusion is measured against.
    pub const NONE: Self = Self {
        variant: Variant::Linear,
        breakaway: Force::ZERO,
        sliding: Force::ZERO,
        fall_end: Velocity::mm_per_s(0.5),
        fall_start: Velocity::mm_per_s(0.1),
        viscous_n_s_per_m: 0.0,
    };

    /// By how much the force falls with the speed where it falls most, N s/m.
    pub fn steepest_fall_n_s_per_m(&self) -> f64 {
        match self.variant {
            _ if self.breakaway == self.sliding => 0.0,
            Variant::Linear => f64::INFINITY,
            Variant::Nonlinear => {
                let over = self.fall_end - self.fall_start;
                2.0 * (self.breakaway - self.sliding).as_n() / over.as_m_per_s()
            }
        }
    }

    /// All forces multiplied; the speeds at which they change stay.
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            breakaway: self.breakaway * factor,
            sliding: self.sliding * factor,
            viscous_n_s_per_m: self.viscous_n_s_per_m * factor,
            ..self
        }
    }
}

/// A piece of the law, within which it has no bend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Piece {
    /// At `F_max`.
    Held,
    /// From `F_max` to `F_low`.
    Falling,
    /// At `F_low`, and what it rises from there.
    Fallen,
}

/// The law with its divisions done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    breakaway_n: f64,
    sliding_n: f64,
    fall_start_m_per_s: f64,
    fall_end_m_per_s: f64,
    parabola_n_s2_per_m2: f64,
    viscous_n_s_per_m: f64,
}

impl Law {
    /// Prepare a law.
    pub fn new(parameters: Parameters) -> Self {
        let drop_n = parameters.breakaway.as_n() - parameters.sliding.as_n();
        let fall_end_m_per_s = parameters.fall_end.as_m_per_s();
        let (fall_start_m_per_s, parabola_n_s2_per_m2) = match parameters.variant {
            Variant::Linear => (fall_end_m_per_s, 0.0),
            Variant::Nonlinear => {
                let start = parameters.fall_start.as_m_per_s();
                (start, drop_n / (fall_end_m_per_s - start).powi(2))
            }
        };
        Self {
            breakaway_n: parameters.breakaway.as_n(),
            sliding_n: parameters.sliding.as_n(),
            fall_start_m_per_s,
            fall_end_m_per_s,
            parabola_n_s2_per_m2,
            viscous_n_s_per_m: parameters.viscous_n_s_per_m,
        }
    }

    /// Largest force that a standing table resists, `F_max`.
    pub const fn breakaway(&self) -> Force {
        Force::n(self.breakaway_n)
    }

    /// Force against a sliding table, signed like its velocity; zero at rest, where the law is a set.
    pub fn sliding(&self, velocity: Velocity) -> Force {
        let v = velocity.as_m_per_s();
        if v == 0.0 { Force::ZERO } else { Force::n(self.magnitude_n(v.abs()).copysign(v)) }
    }

    /// Magnitude in N at a speed in m/s; the value just after break-away for speed 0.
    #[inline]
    pub(super) fn magnitude_n(&self, speed_m_per_s: f64) -> f64 {
        if speed_m_per_s >= self.fall_end_m_per_s {
            self.sliding_n + self.viscous_n_s_per_m * (speed_m_per_s - self.fall_end_m_per_s)
        } else if speed_m_per_s >= self.fall_start_m_per_s {
            let below_m_per_s = self.fall_end_m_per_s - speed_m_per_s;
            self.sliding_n + self.parabola_n_s2_per_m2 * below_m_per_s * below_m_per_s
        } else {
            self.breakaway_n
        }
    }

    /// Whether the table goes so fast that its friction has fallen to that of sliding.
    #[inline]
    pub(super) fn has_fallen_at(&self, speed_m_per_s: f64) -> bool {
        speed_m_per_s > self.fall_end_m_per_s
    }

    /// In which piece of the law a speed is.
    #[inline]
    pub(super) fn piece(&self, speed_m_per_s: f64) -> Piece {
        if self.has_fallen_at(speed_m_per_s) {
            Piece::Fallen
        } else if speed_m_per_s >= self.fall_start_m_per_s {
            Piece::Falling
        } else {
            Piece::Held
        }
    }

    /// Whether the force is the same at every speed from this one up, so that one evaluation serves a step.
    #[inline]
    pub(super) fn is_flat_above(&self, speed_m_per_s: f64) -> bool {
        self.viscous_n_s_per_m == 0.0 && speed_m_per_s >= self.fall_end_m_per_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paper(variant: Variant) -> Law {
        Law::new(Parameters {
            variant,
            breakaway: Force::n(1127.8),
            sliding: Force::n(951.3),
            fall_end: Velocity::mm_per_s(0.5),
            fall_start: Velocity::mm_per_s(0.1),
            viscous_n_s_per_m: 3000.0,
        })
    }

    fn at(law: &Law, mm_per_s: f64) -> f64 {
        law.sliding(Velocity::mm_per_s(mm_per_s)).as_n()
    }

    #[test]
    fn the_parabola_meets_both_ends() {
        let law = paper(Variant::Nonlinear);
        assert!((at(&law, 0.05) - 1127.8).abs() < 1e-9);
        assert!((at(&law, 0.1) - 1127.8).abs() < 1e-9, "F_max at D_v'");
        assert!((at(&law, 0.3) - (951.3 + 176.5 / 4.0)).abs() < 1e-9, "a quarter of the drop half way");
        assert!((at(&law, 0.5 - 1e-9) - 951.3).abs() < 1e-6, "F_low at D_v");
        assert!((at(&law, 100.5) - (951.3 + 3000.0 * 0.1)).abs() < 1e-9, "m above D_v");
    }

    #[test]
    fn the_linear_variant_drops_at_the_end_of_its_band() {
        let law = paper(Variant::Linear);
        assert!((at(&law, 0.499) - 1127.8).abs() < 1e-9);
        assert!((at(&law, 0.5) - 951.3).abs() < 1e-9);
    }

    #[test]
    fn the_law_is_odd_and_takes_power_at_every_speed() {
        for variant in [Variant::Linear, Variant::Nonlinear] {
            let law = paper(variant);
            for step in 1..4000 {
                let v = f64::from(step) * 0.01;
                assert_eq!(at(&law, v), -at(&law, -v));
                assert!(at(&law, v) * v > 0.0, "friction at {v} mm/s gives power");
            }
        }
    }
}
