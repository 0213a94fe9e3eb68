//! Pre-sliding: before it slides, the table moves by micrometres against the bristles of its guides and seals.
//!
//! ```text
//!   df/dx = σ (1 - f sign(dx) / F(v)),   σ = F_low / x_b
//!   f = Σ_j f_j,   df_j = k_j dx held within ±F(v) / N,   k_j = F_low / (N x_b (j / N)^p),   j = 1 … N
//! ```
//!
//! The first is Dahl's model with the sliding force of Eq. (1) as its end, `x_b` the way over which it is reached; for a
//! sliding force that changes evenly along a step the equation is solved in closed form. Valid for single reversals; of ways back and forth within the
//! band it knows the force but not the turning points before the last. The second is a bank of Maxwell slip elements (Lampaert, Swevers
//! and Al-Bender 2003), of which the last slips after `x_b` and none before 0.15 um: it closes each loop where that began. The table then never sticks: what holds
//! it is the force of the bristles.
//! Invariant: passive, what the bristles give back they were given.

use std::f64::consts::TAU;

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, BRISTLES, Bristles, Pace};
use super::parameter::Parameter;

/// What gives way less is stiffer than the finest step of a tick follows: one bristle, and one of many that slip at once.
const LEAST_UM: [f64; 2] = [0.1, 0.15];
/// A bank bends where one of it slips, within a step as well: its steps are as short as those of what swings so many times as fast.
const BENDS: f64 = 2.5;
const fn way(least_um: f64) -> Parameter {
    Parameter::new("way-um", "um", [least_um, 200.0], 10.0, 10.0)
}

pub(super) const ENTRY: Entry = Entry {
    name: "presliding",
    summary: "a table that moves by micrometres before it slides",
    equation: "df/dx = σ (1 - f sign(dx) / F(v)), σ = F_low / x_b",
    parameters: &[way(LEAST_UM[0])],
    coordinate: Coordinate::WaySinceReversal,
    experiment: Experiment::SmallReversals,
    aliases: &[],
    law_of: None,
    action: Action::Bristles(|values, axis| {
        let mut stiffnesses_n_per_m = [0.0; BRISTLES];
        stiffnesses_n_per_m[0] = axis.friction.sliding.as_n() / (1e-6 * values[0]);
        let frequency_hz = (stiffnesses_n_per_m[0] / axis.mechanics.mass_kg).sqrt() / TAU;
        Bristles { stiffnesses_n_per_m, count: 1, pace: Pace::of_swing(frequency_hz) }
    }),
};

pub(super) const WITH_MEMORY: Entry = Entry {
    name: "presliding-with-memory",
    summary: "a table that moves by micrometres before it slides, and remembers where it turned back",
    equation: "f = Σ_j f_j, df_j = k_j dx within ±F(v) / N, k_j = F_low / (N x_b (j / N)^p)",
    parameters: &[way(LEAST_UM[1]), Parameter::new("exponent", "", [0.5, 4.0], 1.5, 0.5)],
    law_of: Some("presliding"),
    action: Action::Bristles(|values, axis| {
        let [way_um, exponent, _] = *values;
        let (share_n, count) = (axis.friction.sliding.as_n() / BRISTLES as f64, BRISTLES as f64);
        let stiffness_n_per_m = |place: usize| {
            let share = (place + 1) as f64 / count;
            share_n / (1e-6 * (way_um * libm::pow(share, exponent)).max(LEAST_UM[1]))
        };
        let stiffnesses_n_per_m: [f64; BRISTLES] = std::array::from_fn(stiffness_n_per_m);
        let per_kg = axis.mechanics.mass_kg.recip();
        let swing_per_s = (stiffnesses_n_per_m.iter().sum::<f64>() * per_kg).sqrt();
        // What slips at once falls as fast as the law does.
        let fall_per_s = axis.friction.steepest_fall_n_s_per_m() * per_kg;
        let pace = Pace::of_swing(BENDS * swing_per_s.max(fall_per_s) / TAU);
        Bristles { stiffnesses_n_per_m, count: BRISTLES, pace }
    }),
    ..ENTRY
};

impl Entry {
    /// Whether an axis has it or that other one: they are laws of the same bristles.
    pub fn is_in_the_place_of(&self, other: &Self) -> bool {
        let are_bristles = |entry: &Self| matches!(entry.action, Action::Bristles(_));
        self.name != other.name && are_bristles(self) && are_bristles(other)
    }
}

impl Bristles {
    /// Whether each slips at once, as the law of friction has it then.
    pub(super) const fn slip_at_once(&self) -> bool {
        self.count > 1
    }

    /// The forces of so many as hold a table together.
    pub(super) fn holding(&self, force_n: f64) -> [f64; BRISTLES] {
        std::array::from_fn(|place| if place < self.count { force_n / self.count as f64 } else { 0.0 })
    }

    /// Force of all of them on the table, N.
    pub(super) fn together_n(&self, forces_n: &[f64; BRISTLES]) -> f64 {
        if self.slip_at_once() { forces_n.iter().sum() } else { forces_n[0] }
    }

    /// Their forces after a way, N, along which that of sliding goes evenly from one to the other of `ends_n`.
    pub(super) fn move_by(&self, forces_n: &mut [f64; BRISTLES], [from_n, to_n]: [f64; 2], way_m: f64) {
        if from_n <= 0.0 || to_n <= 0.0 {
            *forces_n = [0.0; BRISTLES];
            return;
        }
        if !self.slip_at_once() {
            // `e' = F' - σ e / F` of `e = F - f`, with the mean of `F` in what it falls by.
            let mean_n = 0.5 * (from_n + to_n);
            let [left, in_mean] = fallen(self.stiffnesses_n_per_m[0] * way_m.abs(), mean_n);
            let [from_n, to_n] = [from_n, to_n].map(|end_n| end_n.copysign(way_m));
            forces_n[0] = to_n - (from_n - forces_n[0]) * left - (to_n - from_n) * in_mean;
            return;
        }
        let most_n = to_n / self.count as f64;
        for (force_n, stiffness_n_per_m) in forces_n.iter_mut().zip(&self.stiffnesses_n_per_m) {
            *force_n = (*force_n + stiffness_n_per_m * way_m).clamp(-most_n, most_n);
        }
    }
}

/// `exp(-x)` and its mean from 0 to `x`, of `x = by / of`, of what is not negative: most steps of a table that stands or runs are far
/// shorter or longer than its way.
#[inline(always)]
fn fallen(by: f64, of: f64) -> [f64; 2] {
    // Up to the one a fraction of fourth degree is right to the last bits, beyond the other nothing is left of one.
    const SHORT: f64 = 0.1;
    const LONG: f64 = 40.0;
    if by < SHORT * of {
        let [by2, of2, both] = [by * by, of * of, by * of];
        let even = 1680.0 * of2 * of2 + by2 * (180.0 * of2 + by2);
        let odd_by = 840.0 * of2 + 20.0 * by2;
        let odd = both * odd_by;
        let per = (even + odd).recip();
        [(even - odd) * per, 2.0 * of2 * odd_by * per]
    } else {
        let left = if by > LONG * of { 0.0 } else { libm::exp(-by / of) };
        [left, (1.0 - left) * of / by]
    }
}

#[cfg(test)]
mod tests {
    use super::super::entry;
    use super::super::step::Stepping;
    use super::*;
    use crate::base::time::Span;
    use crate::base::units::{Force, Position, Velocity};
    use crate::plant::Plant;
    use crate::plant::tests::paper_axis;

    /// Force after ways from where all slipped backwards, as a share of that of sliding.
    fn after(entry: &Entry, ways_um: &[f64]) -> f64 {
        let (axis, values) = (paper_axis(), [10.0, 1.5, 0.0]);
        let Action::Bristles(make) = entry.action else { panic!("{} are no bristles", entry.name) };
        let (bristles, sliding_n) = (make(&values, &axis), axis.friction.sliding.as_n());
        let moved = |mut forces_n, way_um: &f64| {
            bristles.move_by(&mut forces_n, [sliding_n; 2], 1e-6 * way_um);
            forces_n
        };
        ways_um.iter().fold(bristles.holding(-sliding_n), moved).iter().sum::<f64>() / sliding_n
    }

    #[test]
    fn what_is_left_of_a_bend_is_exponential_over_short_ways_and_long_ones() {
        for x in [0.0, 1e-12, 1e-6, 1e-3, 0.06, 0.099, 0.101, 0.5, 39.9, 40.1, 700.0] {
            let [left, mean] = fallen(1_700.0 * x, 1_700.0);
            let asked = [libm::exp(-x), if x > 0.0 { -libm::expm1(-x) / x } else { 1.0 }];
            for (found, asked) in [left, mean].iter().zip(asked) {
                assert!((found - asked).abs() <= 4.0 * f64::EPSILON, "{found} and {asked} at {x}");
            }
        }
    }

    #[test]
    fn one_bristle_follows_a_friction_that_changes_along_a_step() {
        let axis = paper_axis();
        let Action::Bristles(make) = ENTRY.action else { panic!("no bristles") };
        let bristles = make(&[10.0, 0.0, 0.0], &axis);
        let at = |share: f64| 900.0 + 100.0 * share;
        for way_um in [0.2, 5.0, 40.0, 2_000.0] {
            let [mut whole, mut parts] = [bristles.holding(-300.0); 2];
            bristles.move_by(&mut whole, [at(0.0), at(1.0)], 1e-6 * way_um);
            let count = 10_000;
            for part in 0..count {
                let ends_n = [part, part + 1].map(|end| at(f64::from(end) / f64::from(count)));
                bristles.move_by(&mut parts, ends_n, 1e-6 * way_um / f64::from(count));
            }
            let off_n = whole[0] - parts[0];
            assert!(off_n.abs() < 1.0, "{off_n} N of {} N after {way_um} um", parts[0]);
        }
    }

    #[test]
    fn a_bank_slips_after_its_way_there_and_twice_its_way_back() {
        for (ways_um, end, is_there) in [
            (&[19.9][..], 1.0, false),
            (&[20.1], 1.0, true),
            (&[30.0, -19.9], -1.0, false),
            (&[30.0, -20.1], -1.0, true),
        ] {
            let found = after(&WITH_MEMORY, ways_um);
            assert_eq!((found - end).abs() < 1e-12, is_there, "{found} after {ways_um:?} um");
        }
    }

    #[test]
    fn bristles_that_slip_need_no_fine_steps_whatever_the_friction_is() {
        let velocity = Velocity::mm_per_s(20.0);
        for of_bristles in [&ENTRY, &WITH_MEMORY] {
            let bristly = paper_axis().with_effect(of_bristles, of_bristles.nominal());
            let stribeck = entry("stribeck").expect("an effect");
            for axis in [bristly, bristly.with_effect(stribeck, [300.0, 20.0, 1.0])] {
                let mut plant = Plant::sliding(&axis, Span::us(500), velocity, Position::ZERO);
                let current = plant.state().current;
                for _ in 0..10 {
                    plant.step(current);
                }
                let acting = plant.acting.as_ref().expect("effects");
                assert_eq!(acting.pace(&plant.body), Pace::Slow, "{}: {:?}", of_bristles.name, plant.body);
            }
        }
    }

    #[test]
    fn a_bank_is_stepped_as_fast_as_it_swings_and_falls() {
        let Action::Bristles(make) = WITH_MEMORY.action else { panic!("no bristles") };
        let pace = |sliding_n: f64, way_um: f64| {
            let mut axis = paper_axis();
            axis.friction.sliding = Force::n(sliding_n);
            make(&[way_um, 1.5, 0.0], &axis).pace
        };
        let breakaway_n = paper_axis().friction.breakaway.as_n();
        assert_eq!(pace(breakaway_n, 200.0), Pace::Even);
        assert_eq!(pace(breakaway_n, 20.0), Pace::Brisk);
        assert_eq!(pace(breakaway_n, 2.0), Pace::Fast);
        assert_eq!(pace(951.3, 200.0), Pace::Fast, "it falls by 177 N within 0.4 mm/s");
    }

    #[test]
    fn a_small_loop_is_closed_by_a_bank_and_by_no_single_bristle() {
        let (way, there_and_back): (&[f64], &[f64]) = (&[6.0], &[6.0, -3.0, 3.0]);
        let apart = |entry| (after(entry, there_and_back) - after(entry, way)).abs();
        assert!(apart(&WITH_MEMORY) < 1e-12, "{}", apart(&WITH_MEMORY));
        assert!(apart(&ENTRY) > 0.02, "{}", apart(&ENTRY));
    }
}
