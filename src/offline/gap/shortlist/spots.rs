//! Places along the way at which friction is not what it is about them: where a spot of it is looked for.
//!
//! ```text
//!   what is left of the current, with the sign of the way ──► mean of each stretch ──► less that of a wider one ──► furthest from none
//! ```
//!
//! Units: m, A; mm where a place is given. Invariant: a run that is off all along its way points to no place in it.

use crate::offline::gap::measure::forward::{CURRENT, Signals};
use crate::offline::gap::model::data::Part;
use crate::offline::gap::model::problem::Problem;
use crate::offline::running_mean::running_mean;

/// Length of a bin, m, and in bins of stretches, as long as spots are, and of a wider one about them.
const BIN_M: f64 = 1e-3;
const STRETCHES: [usize; 3] = [3, 5, 11];
const ABOUT: usize = 61;
/// Fewer rows are no mean.
const ROWS: u32 = 10;
/// A slower axis may stick, m/s.
const SLOW_M_PER_S: f64 = 1e-3;
/// What is further off is no friction of a place, in standard deviations of noise.
const FAR: f64 = 4.0;
/// How many places are tried, no nearer to each other than so many bins.
const SPOTS: usize = 4;
const APART: usize = 8;

/// What is left of the current while an axis moves: where it is, and how much, with the sign of the way.
pub(super) fn by_way(
    problem: &Problem<'_>,
    place: usize,
    simulated: &Signals,
    positions_m: &[f64],
) -> Vec<[f64; 2]> {
    let Some(noise) = &problem.noises[CURRENT] else { return Vec::new() };
    let left = problem.left(place, simulated, CURRENT, Part::Fit);
    let slow_m = SLOW_M_PER_S * problem.period_s();
    let most = FAR * noise.rms;
    let rows = positions_m.windows(2).zip(&left).zip(&problem.data[place].fit);
    let moves = rows.filter(|((pair, _), counts)| **counts && (pair[1] - pair[0]).abs() > slow_m);
    moves.map(|((pair, left), _)| [pair[0], (pair[1] - pair[0]).signum() * left.clamp(-most, most)]).collect()
}

/// The places that stand out most, mm.
pub(super) fn furthest_mm(runs: &[&[[f64; 2]]]) -> Vec<f64> {
    let bin = |at_m: f64| (at_m / BIN_M).floor();
    let all = || runs.iter().copied().flatten();
    let low = all().map(|[at_m, _]| bin(*at_m)).fold(f64::INFINITY, f64::min);
    let high = all().map(|[at_m, _]| bin(*at_m)).fold(f64::NEG_INFINITY, f64::max);
    if low > high {
        return Vec::new();
    }
    let count = (high - low) as usize + 1;
    let mut stands_out = [(); STRETCHES.len()].map(|()| vec![0.0; count]);
    for run in runs {
        let mut sums = vec![(0.0, 0_u32); count];
        for [at_m, left] in *run {
            let (sum, count) = &mut sums[(bin(*at_m) - low) as usize];
            *sum += left;
            *count += 1;
        }
        // Each run by itself: each has friction of its own, of its speed and its place.
        let (numbers, means): (Vec<usize>, Vec<f64>) = sums
            .into_iter()
            .enumerate()
            .filter(|(_, (_, count))| *count >= ROWS)
            .map(|(number, (sum, count))| (number, sum / f64::from(count)))
            .unzip();
        let about = running_mean(&means, ABOUT);
        for (bins, stands_out) in STRETCHES.iter().zip(&mut stands_out) {
            // The mean of so many bins scatters by the root of their number.
            let sure = (*bins as f64).sqrt();
            for ((number, near), about) in numbers.iter().zip(running_mean(&means, *bins)).zip(&about) {
                stands_out[*number] += sure * (near - about);
            }
        }
    }
    let most = |number: usize| stands_out.iter().map(|by_length| by_length[number].abs()).fold(0.0, f64::max);
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| most(*b).total_cmp(&most(*a)));
    let mut found: Vec<usize> = Vec::new();
    for number in order {
        if found.len() < SPOTS && found.iter().all(|other| other.abs_diff(number) >= APART) {
            found.push(number);
        }
    }
    found.into_iter().map(|number| 1e3 * BIN_M * (low + number as f64 + 0.5)).collect()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn a_spot_of_a_run_is_found_whatever_others_leave_at_their_places() {
        let mut random = Pcg64Mcg::seed_from_u64(2);
        // To and fro between two places, with so much left all along, noise ten times what a spot of 10 mm at -77 mm leaves.
        let mut run = |from_m: f64, to_m: f64, level: f64| -> Vec<[f64; 2]> {
            let row = |row: u32| {
                let at_m = from_m + (to_m - from_m) * f64::from(row % 20_000) / 20_000.0;
                let spot = 0.02 * (-0.5 * ((at_m + 0.077) / 0.01).powi(2)).exp();
                [at_m, level + spot + random.random_range(-0.2..0.2)]
            };
            (0..40_000).map(row).collect()
        };
        let runs = [run(-0.12, -0.03, 0.0), run(0.0, 0.06, 0.3), run(0.02, 0.05, -0.2)];
        let found = furthest_mm(&runs.each_ref().map(Vec::as_slice));
        assert!((found[0] + 77.0).abs() < 5.0, "{found:?}");
        assert_eq!(furthest_mm(&[]), Vec::<f64>::new());
    }

    #[test]
    fn a_short_spot_is_not_lost_in_what_is_about_it() {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        // Five ways of 60 mm, noise ten times what a spot of 1.5 mm leaves.
        let row = |row: u32| {
            let at_m = 0.06 * f64::from(row % 2_000) / 2_000.0;
            let spot = 0.02 * (-0.5 * ((at_m - 0.0423) / 1.5e-3).powi(2)).exp();
            [at_m, spot + random.random_range(-0.2..0.2)]
        };
        let run: Vec<[f64; 2]> = (0..10_000).map(row).collect();
        let found = furthest_mm(&[&run]);
        assert!((found[0] - 42.3).abs() < 2.0, "{found:?}");
    }
}
