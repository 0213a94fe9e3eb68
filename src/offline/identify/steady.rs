//! Sliding friction from stretches of constant speed: the mean force of each over whole turns of the screw, less what
//! still accelerates, and a straight line through the means.
//!
//! ```text
//!   F  =  ± F_low  +  m v  +  F_0          v beyond the falling part of friction
//! ```
//!
//! `F_0` is what both directions have alike: a constant force, or friction that differs by direction; at constant
//! speeds the two are one (a second load would tell them apart). Ripple of nut and bearings averages out over
//! whole turns.
//!
//! How well a mean is known is told by the scatter of its rows: a fast run is short, and its noise is not that of a slow
//! one. Where the means leave more than that, each run, or each speed both ways, has a scatter beyond that of its rows, as
//! large as what is left asks for (Paule and Mandel, 1982, J. Res. NBS 87, 377; intervals by Hartung and
//! Knapp, 2001, Statistics in Medicine 20, 3875).
//! Invariant: below the falling part no stretch counts, because the axis chatters there and its mean force is not its
//! friction.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::least_squares::{FitError, student95};
use super::measured::Measured;
use super::ripple::Ripple;
use super::stretches::Stretch;
use crate::offline::median::median;

/// Rows so long, s, count as one value of their stretch: the filter makes neighbours alike.
const BLOCK_S: f64 = 0.02;
/// Fewest of them whose scatter says how well their mean is known.
const BLOCKS_MIN: usize = 8;
/// A run whose force scatters so many times as much as that of the others, by their median, is one of an axis that
/// chatters: it sticks in between, and faster than the falling part too where it has once begun.
const CHATTERS: f64 = 4.0;
/// No mean is known better, N: currents are counted.
const DEVIATION_MIN_N: f64 = 1e-3;
/// Least eigenvalue of the scaled normal equations: below it the points do not tell the line.
const CONDITION_MIN: f64 = 1e-9;
/// Coefficients of the line.
const COEFFICIENTS: usize = 3;
/// Halvings of the interval in which the scatter beyond that of the rows is looked for.
const HALVINGS: usize = 60;

/// Mean force of a stretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteadyPoint {
    /// m/s.
    pub velocity_m_per_s: f64,
    /// N.
    pub force_n: f64,
    /// Standard deviation of that, by the scatter in the stretch, N.
    pub deviation_n: f64,
    /// That scatter, N.
    pub scatter_n: f64,
    /// Whether it is a mean over whole turns of the screw.
    pub is_of_turns: bool,
}

/// The straight line.
#[derive(Clone, Debug, PartialEq)]
pub struct Sliding {
    /// Friction, the line extended to rest, N, with half its 95 % interval.
    pub at_rest_n: [f64; 2],
    /// `m`, N s/m.
    pub viscous_n_s_per_m: [f64; 2],
    /// `F_0`, N.
    pub offset_n: [f64; 2],
    /// Force at rest that each way takes, forwards and backwards, `F_0` in it, N.
    pub of_way_n: [[f64; 2]; 2],
    /// How many stretches.
    pub count: usize,
}

/// Mean forces of stretches; `mass_kg` is all that moves.
pub fn points(measured: &Measured, steady: &[Stretch], mass_kg: f64, ripple: &Ripple) -> Vec<SteadyPoint> {
    steady.iter().filter_map(|stretch| point(measured, stretch, mass_kg, ripple)).collect()
}

fn point(measured: &Measured, stretch: &Stretch, mass_kg: f64, ripple: &Ripple) -> Option<SteadyPoint> {
    let lead_m = ripple.lead_m();
    let piece = &measured.pieces[stretch.piece];
    let position = |row: usize| piece.position_m[row];
    let start = stretch.rows.start;
    let way_m = (position(stretch.rows.end - 1) - position(start)).abs();
    // From the end of the stretch backwards: the longer it lasts, the better it has settled.
    let turns_m = (way_m / lead_m).floor() * lead_m;
    let first = if turns_m > 0.0 {
        stretch
            .rows
            .clone()
            .rev()
            .find(|row| (position(stretch.rows.end - 1) - position(*row)).abs() >= turns_m)?
    } else {
        start
    };
    let rows = first..stretch.rows.end;
    let mean = |column: &[f64]| column[rows.clone()].iter().sum::<f64>() / rows.len() as f64;
    // Of a ripple whole turns leave nothing, but for what is in the way to them.
    let friction_n = |row: usize| {
        piece.force_n[row]
            - ripple.force_n(position(row), piece.velocity_m_per_s[row])
            - mass_kg * piece.acceleration_m_per_s2[row]
    };
    let all_n: Vec<f64> = rows.clone().map(friction_n).collect();
    let force_n = all_n.iter().sum::<f64>() / all_n.len() as f64;
    let blocks = all_n.chunks_exact(measured.rows(BLOCK_S).max(1));
    let count = blocks.len();
    if count < BLOCKS_MIN {
        return None;
    }
    let square = |block: &[f64]| (block.iter().sum::<f64>() / block.len() as f64 - force_n).powi(2);
    let variance = blocks.map(square).sum::<f64>() / (count - 1) as f64;
    Some(SteadyPoint {
        velocity_m_per_s: mean(&piece.velocity_m_per_s),
        force_n,
        deviation_n: (variance / count as f64).sqrt(),
        scatter_n: variance.sqrt(),
        is_of_turns: turns_m > 0.0,
    })
}

/// The line through the points that are at least as fast as `slowest_m_per_s`, but for those of an axis that chatters.
/// Those of a part of a turn count where there are not enough others: what is left of the ripple is the same in all
/// of one place.
///
/// # Errors
/// When they are too few, or all of one direction or one speed.
pub fn fit(points: &[SteadyPoint], slowest_m_per_s: f64) -> Result<Sliding, FitError> {
    let fast: Vec<_> =
        points.iter().filter(|point| point.velocity_m_per_s.abs() >= slowest_m_per_s).collect();
    let mut scatters_n: Vec<f64> = fast.iter().map(|point| point.scatter_n).collect();
    let quiet_n = CHATTERS * median(&mut scatters_n).unwrap_or(0.0);
    let slides: Vec<_> = fast.into_iter().filter(|point| point.scatter_n <= quiet_n).collect();
    let of_turns: Vec<_> = slides.iter().copied().filter(|point| point.is_of_turns).collect();
    through(&of_turns).or_else(|_| through(&slides))
}

/// The line through points.
fn through(points: &[&SteadyPoint]) -> Result<Sliding, FitError> {
    if points.len() <= COEFFICIENTS {
        return Err(FitError::TooFewRows { rows: points.len(), coefficients: COEFFICIENTS });
    }
    let [each, both] = [Beyond::EachRun, Beyond::BothWays].map(|beyond| fitted(points, beyond));
    let (each, both) = (each?, both?);
    // What the line leaves does not say which it is.
    let told = |of: [f64; COEFFICIENTS]| {
        let [value, half] = each.told(&of);
        [value, half.max(both.told(&of)[1])]
    };
    Ok(Sliding {
        at_rest_n: told([1.0, 0.0, 0.0]),
        viscous_n_s_per_m: told([0.0, 1.0, 0.0]),
        offset_n: told([0.0, 0.0, 1.0]),
        of_way_n: [told([1.0, 0.0, 1.0]), told([1.0, 0.0, -1.0])],
        count: points.len(),
    })
}

/// What the scatter beyond that of the rows belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Beyond {
    /// Each run its own: what its place on the screw does.
    EachRun,
    /// A speed, both ways alike: what friction is there beside the line.
    BothWays,
}

/// The line with as much scatter beyond that of the rows as makes what it leaves likely.
fn fitted(points: &[&SteadyPoint], beyond: Beyond) -> Result<Line, FitError> {
    let freedom = (points.len() - COEFFICIENTS) as f64;
    let [mut low_n2, mut high_n2] = [0.0, line(points, beyond, 0.0)?.left_n.norm_squared()];
    for _ in 0..HALVINGS {
        let middle_n2 = 0.5 * (low_n2 + high_n2);
        let is_too_little = line(points, beyond, middle_n2)?.chi_square > freedom;
        (if is_too_little { &mut low_n2 } else { &mut high_n2 }).clone_from(&middle_n2);
    }
    line(points, beyond, high_n2)
}

/// A weighted line, with its coefficients at rest, by speed, and constant.
struct Line {
    coefficients: DVector<f64>,
    /// Where the deviations are what they are taken for.
    covariance: DMatrix<f64>,
    left_n: DVector<f64>,
    /// Of what is left, in units of the deviations.
    chi_square: f64,
    /// Different values that tell it, less what it is told by them.
    freedom: f64,
}

impl Line {
    /// A sum of so much of each coefficient, with half its 95 % interval.
    fn told(&self, of: &[f64]) -> [f64; 2] {
        let of = DVector::from_row_slice(of);
        let mean_square = self.chi_square / (self.left_n.len() - COEFFICIENTS) as f64;
        let variance = of.dot(&(&self.covariance * &of)) * mean_square;
        [of.dot(&self.coefficients), student95(self.freedom) * variance.max(0.0).sqrt()]
    }
}

/// The line of points that have so much variance beyond their own.
fn line(points: &[&SteadyPoint], beyond: Beyond, beyond_n2: f64) -> Result<Line, FitError> {
    let count = points.len();
    let way = |point: usize| points[point].velocity_m_per_s.signum();
    let speed = |point: usize| points[point].velocity_m_per_s.abs();
    // The first of the points of a speed stands for all.
    let first = |point: usize| (0..point).find(|other| is_same_speed(speed(*other), speed(point)));
    let speeds: Vec<usize> = (0..count).map(|point| first(point).unwrap_or(point)).collect();
    let covariance = DMatrix::from_fn(count, count, |a, b| {
        let own_n2 = if a == b { points[a].deviation_n.max(DEVIATION_MIN_N).powi(2) } else { 0.0 };
        let is_shared = match beyond {
            Beyond::EachRun => a == b,
            Beyond::BothWays => speeds[a] == speeds[b],
        };
        own_n2 + if is_shared { way(a) * way(b) * beyond_n2 } else { 0.0 }
    });
    let weights = Cholesky::new(covariance).ok_or(FitError::NotFinite)?;
    let columns = DMatrix::from_fn(count, COEFFICIENTS, |point, coefficient| {
        [way(point), points[point].velocity_m_per_s, 1.0][coefficient]
    });
    let force_n = DVector::from_iterator(count, points.iter().map(|point| point.force_n));
    let normal = columns.transpose() * weights.solve(&columns);
    let scale = DMatrix::from_diagonal(&normal.diagonal().map(|square| 1.0 / square.sqrt()));
    let scaled = &scale * normal * &scale;
    let condition = scaled.symmetric_eigenvalues().min();
    if condition.is_nan() || condition < CONDITION_MIN {
        return Err(FitError::Singular { condition });
    }
    let inverse = scaled.try_inverse().ok_or(FitError::Singular { condition })?;
    let covariance = &scale * inverse * &scale;
    let coefficients = &covariance * columns.transpose() * weights.solve(&force_n);
    let left_n = force_n - columns * &coefficients;
    let freedom = match beyond {
        Beyond::EachRun => count as f64 - COEFFICIENTS as f64,
        // Both runs of a speed are one value, for friction at rest and its rise.
        Beyond::BothWays => (0..count).filter(|point| speeds[*point] == *point).count() as f64 - 2.0,
    };
    let chi_square = left_n.dot(&weights.solve(&left_n));
    Ok(Line { coefficients, covariance, left_n, chi_square, freedom })
}

/// Whether two runs were made at one speed.
fn is_same_speed(a: f64, b: f64) -> bool {
    (a / b - 1.0).abs() < 0.05
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Runs at speeds both ways, with what each is off, N.
    fn runs(off_n: impl Fn(usize, f64) -> f64, deviation_n: f64) -> Vec<SteadyPoint> {
        let speeds = [1.0, -1.0, 2.0, -2.0, 5.0, -5.0, 10.0, -10.0, 50.0, -50.0];
        let point = |(number, mm_per_s): (usize, f64)| {
            // Forwards 40 N more than backwards.
            let level_n = if mm_per_s > 0.0 { 920.0 } else { -880.0 };
            let force_n = level_n + 0.5 * mm_per_s + off_n(number, mm_per_s);
            SteadyPoint {
                velocity_m_per_s: 1e-3 * mm_per_s,
                force_n,
                deviation_n,
                scatter_n: 5.0,
                is_of_turns: true,
            }
        };
        speeds.into_iter().enumerate().map(point).collect()
    }

    fn truths(sliding: &Sliding) -> [([f64; 2], f64); 5] {
        [
            (sliding.at_rest_n, 900.0),
            (sliding.offset_n, 20.0),
            (sliding.of_way_n[0], 920.0),
            (sliding.of_way_n[1], 880.0),
            (sliding.viscous_n_s_per_m, 500.0),
        ]
    }

    #[test]
    fn each_way_is_told_for_itself() {
        let off_n = |number: usize, _| [0.3, -0.2, -0.3, 0.4, -0.1, 0.2, -0.4, 0.1][number % 8];
        let sliding = fit(&runs(off_n, 0.3), 0.9e-3).expect("a line");
        for ([value, half], truth) in truths(&sliding) {
            assert!((value - truth).abs() <= half, "{value} ± {half}, truth {truth}");
            assert!(half < 0.05 * truth, "{value} ± {half} says nothing");
        }
    }

    #[test]
    fn a_run_that_chatters_and_one_of_a_part_of_a_turn_do_not_count() {
        let good = runs(|_, _| 0.0, 0.3);
        let line = fit(&good, 0.9e-3).expect("a line");
        let mut spoilt = good.clone();
        let run = SteadyPoint { velocity_m_per_s: 1.1e-3, force_n: 1_000.0, ..good[0] };
        spoilt.push(SteadyPoint { scatter_n: 50.0, ..run });
        spoilt.push(SteadyPoint { is_of_turns: false, ..run });
        assert_eq!(fit(&spoilt, 0.9e-3), Ok(line));
        spoilt.push(run);
        assert_ne!(fit(&spoilt, 0.9e-3), fit(&good, 0.9e-3), "the test cannot tell");
    }

    /// How many per cent of all intervals contain the truth, where each run is off by so much as it says, and each
    /// speed by so much both ways.
    fn inside_percent(common_n: f64) -> f64 {
        const TRIALS: usize = 1_000;
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let mut inside = 0;
        for _ in 0..TRIALS {
            let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
            let own: Vec<f64> = (0..10).map(|_| 0.3 * normal()).collect();
            let common: Vec<f64> = (0..5).map(|_| common_n * normal()).collect();
            let off_n = |number: usize, mm_per_s: f64| own[number] + mm_per_s.signum() * common[number / 2];
            let sliding = fit(&runs(off_n, 0.3), 0.9e-3).expect("a line");
            let is_inside = |([value, half], truth): &([f64; 2], f64)| (value - truth).abs() <= *half;
            inside += truths(&sliding).iter().filter(|told| is_inside(told)).count();
        }
        100.0 * inside as f64 / (5 * TRIALS) as f64
    }

    #[test]
    fn intervals_contain_the_truth_as_often_as_they_say() {
        // Of two intervals the wider one is told: with five speeds a little more often than 95 %.
        let straight = inside_percent(0.0);
        assert!((93.0..99.0).contains(&straight), "{straight} % of a straight line");
        let bent = inside_percent(2.0);
        assert!((90.0..99.0).contains(&bent), "{bent} % of one that is off at each speed");
    }
}
