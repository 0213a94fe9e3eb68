//! Stribeck: friction that falls as a film of oil builds up, further out than the fall of Eq. (1).
//!
//! ```text
//!   F(v) + S exp(-(v / v_s)^n)
//! ```
//!
//! A standing table resists by `S` more. Of the laws in use, that of Tustin has an exponent of 1 and the Gaussian one of 2 (Armstrong-Hélouvry,
//! Dupont and Canudas de Wit 1994); held against the other one, the same friction comes out a third off. The fall of the law itself,
//! `F_max` to `F_low`, is a parameter of the base model.
//! Invariant: against the way.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Friction, Instant};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "stribeck",
    summary: "friction that falls with the speed",
    equation: "F(v) + S exp(-(v / v_s)^n)",
    parameters: &[
        Parameter::new("extra-n", "N", [0.0, 1e5], 100.0, 100.0),
        Parameter::new("velocity-mm-per-s", "mm/s", [0.05, 200.0], 5.0, 5.0),
        Parameter::new("exponent", "", [1.0, 4.0], 2.0, 1.0),
    ],
    coordinate: Coordinate::Velocity,
    experiment: Experiment::Sweep,
    aliases: &[],
    law_of: None,
    action: Action::Friction(|values, _| {
        let [extra_n, velocity_mm_per_s, exponent] = *values;
        Box::new(Fall::new(extra_n, 1e-3 * velocity_mm_per_s, exponent))
    }),
};

/// From this power of the speed on nothing is left of it: `exp(-LOST)` is less than what 1 resolves.
const LOST: f64 = 40.0;
/// Pieces of the shape up to there, along the root of the speed: all exponents start flat in it.
const PIECES: usize = 128;

#[derive(Debug)]
struct Fall {
    extra_n: f64,
    steepest_n_s_per_m: f64,
    pieces_per_root: f64,
    shape: Box<[[f64; 4]; PIECES]>,
}

impl Fall {
    /// `exp(-w^(2 n))` over `w = sqrt(v / v_s)`, by the cubic of each piece that has its values and slopes at both ends: a power and an
    /// exponential in each step are a third of the time of a gap. It is off by less than 1e-5.
    fn new(extra_n: f64, velocity_m_per_s: f64, exponent: f64) -> Self {
        let power = 2.0 * exponent;
        let width = libm::pow(LOST, power.recip()) / PIECES as f64;
        let end = |place: usize| {
            let root = place as f64 * width;
            let value = libm::exp(-libm::pow(root, power));
            [value, -width * power * libm::pow(root, power - 1.0) * value]
        };
        let cubic = |place: usize| {
            let ([from, starts], [to, ends]) = (end(place), end(place + 1));
            let by = to - from;
            [from, starts, 3.0 * by - 2.0 * starts - ends, starts + ends - 2.0 * by]
        };
        let pieces_per_root = (velocity_m_per_s.sqrt() * width).recip();
        // Of `exp(-u^n)`: at `u = (1 - 1 / n)^(1 / n)`.
        let bent = 1.0 - exponent.recip();
        let steepest = exponent * libm::pow(bent, bent) * libm::exp(-bent);
        let steepest_n_s_per_m = steepest * extra_n / velocity_m_per_s;
        Self { extra_n, steepest_n_s_per_m, pieces_per_root, shape: Box::new(std::array::from_fn(cubic)) }
    }
}

impl Friction for Fall {
    fn steepest_fall_n_s_per_m(&self) -> f64 {
        self.steepest_n_s_per_m
    }

    fn added_n(&self, at: &Instant) -> f64 {
        let along = at.speed_m_per_s.sqrt() * self.pieces_per_root;
        let Some([a, b, c, d]) = self.shape.get(along as usize) else { return 0.0 };
        let within = along.fract();
        self.extra_n * (a + within * (b + within * (c + within * d)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::acting::Acting;
    use super::*;
    use crate::base::units::{Position, Velocity};
    use crate::plant::friction::Law;
    use crate::plant::tests::paper_axis;

    #[test]
    fn it_is_the_exponential_of_its_equation_at_all_speeds_and_exponents() {
        for exponent in [1.0, 1.3, 2.0, 4.0] {
            let axis = paper_axis().with_effect(&ENTRY, [100.0, 5.0, exponent]);
            let (law, acting) = (Law::new(axis.friction), Acting::new(&axis).expect("effects"));
            for step in 0..2_000 {
                let m_per_s = 1e-7 * f64::from(step).powi(2);
                let all_n = acting.steady_friction_n(&law, Velocity::m_per_s(m_per_s), Position::ZERO);
                let asked_n = 100.0 * libm::exp(-libm::pow(m_per_s / 5e-3, exponent));
                let off_n = all_n - law.magnitude_n(m_per_s) - asked_n;
                assert!(off_n.abs() < 1e-3, "{off_n} N at {m_per_s} m/s, exponent {exponent}");
            }
        }
    }
}
