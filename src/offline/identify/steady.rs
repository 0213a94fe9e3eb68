//! Sliding friction from stretches of constant speed: the mean force of each over whole turns of the screw, less what
//! still accelerates, and a straight line through the means.
//!
//! ```text
//!   F  =  ± F_low  +  m v  +  F_0          v beyond the falling part of friction
//! ```
//!
//! `F_0` is what both directions have alike: a constant force, or friction that differs by direction; at constant
//! speeds the two are one (a second load would tell them apart). Ripple of nut and bearings averages out over
//! whole turns. Invariant: below the falling part no stretch counts, because the axis chatters there and its mean
//! force is not its friction.

use super::least_squares::{self, FitError, student95};
use super::measured::Measured;
use super::ripple::Ripple;
use super::stretches::Stretch;

/// Mean force of a stretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteadyPoint {
    /// m/s.
    pub velocity_m_per_s: f64,
    /// N.
    pub force_n: f64,
}

impl SteadyPoint {
    fn speed(&self) -> f64 {
        self.velocity_m_per_s.abs()
    }
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
    let velocity_m_per_s = mean(&piece.velocity_m_per_s);
    // Of whole turns there is none left, but for what is in the way to them.
    let ripple_n = rows.clone().map(|row| ripple.force_n(position(row), velocity_m_per_s)).sum::<f64>();
    Some(SteadyPoint {
        velocity_m_per_s,
        force_n: mean(&piece.force_n)
            - ripple_n / rows.len() as f64
            - mass_kg * mean(&piece.acceleration_m_per_s2),
    })
}

/// The line through the points that are at least as fast as `slowest_m_per_s`.
///
/// # Errors
/// When they are too few, or all of one direction or one speed.
pub fn fit(points: &[SteadyPoint], slowest_m_per_s: f64) -> Result<Sliding, FitError> {
    let points: Vec<_> =
        points.iter().filter(|point| point.velocity_m_per_s.abs() >= slowest_m_per_s).collect();
    let coefficients = line(&points)?;
    // A speed at the end of the line draws it to itself and then leaves little, and what is wrong with a speed is
    // wrong with it both ways: without each speed in turn it shows.
    let speeds = speeds(&points);
    let without: Vec<[f64; 3]> = speeds
        .iter()
        .map(|speed| {
            let rest: Vec<_> =
                points.iter().copied().filter(|point| !is_same_speed(point.speed(), *speed)).collect();
            line(&rest)
        })
        .collect::<Result<_, _>>()?;
    let count = speeds.len() as f64;
    let told = |of: &dyn Fn(&[f64; 3]) -> f64| {
        let mean = without.iter().map(of).sum::<f64>() / count;
        let square = without.iter().map(|line| (of(line) - mean).powi(2)).sum::<f64>();
        [of(&coefficients), student95(count - 1.0) * ((count - 1.0) / count * square).sqrt()]
    };
    Ok(Sliding {
        at_rest_n: told(&|line| line[0]),
        viscous_n_s_per_m: told(&|line| line[1]),
        offset_n: told(&|line| line[2]),
        of_way_n: [told(&|line| line[0] + line[2]), told(&|line| line[0] - line[2])],
        count: points.len(),
    })
}

/// Whether two runs were made at one speed.
fn is_same_speed(a: f64, b: f64) -> bool {
    (a / b - 1.0).abs() < 0.05
}

/// Different speeds of points, both ways together.
fn speeds(points: &[&SteadyPoint]) -> Vec<f64> {
    let mut speeds: Vec<f64> = Vec::new();
    for point in points {
        if !speeds.iter().any(|speed| is_same_speed(point.speed(), *speed)) {
            speeds.push(point.speed());
        }
    }
    speeds
}

fn line(points: &[&SteadyPoint]) -> Result<[f64; 3], FitError> {
    let column = |of: fn(&SteadyPoint) -> f64| -> Vec<f64> { points.iter().map(|point| of(point)).collect() };
    let columns = [
        column(|point| point.velocity_m_per_s.signum()),
        column(|point| point.velocity_m_per_s),
        vec![1.0; points.len()],
    ];
    let fit = least_squares::fit(&columns, &column(|point| point.force_n), 0)?;
    Ok([fit.coefficients[0], fit.coefficients[1], fit.coefficients[2]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_way_is_told_for_itself() {
        // Forwards 40 N more than backwards, each with a little error of its own.
        let point = |(number, mm_per_s): (usize, f64)| {
            let error_n = [0.3, -0.2, -0.3, 0.4, -0.1, 0.2, -0.4, 0.1][number % 8];
            let level_n = if mm_per_s > 0.0 { 920.0 } else { -880.0 };
            SteadyPoint { velocity_m_per_s: 1e-3 * mm_per_s, force_n: level_n + 0.5 * mm_per_s + error_n }
        };
        let speeds = [1.0, -1.0, 2.0, -2.0, 5.0, -5.0, 10.0, -10.0, 50.0, -50.0];
        let points: Vec<SteadyPoint> = speeds.into_iter().enumerate().map(point).collect();
        let sliding = fit(&points, 0.9e-3).expect("a line");
        // The slope hangs on the fastest runs, and without them it is told by those up to 10 mm/s.
        let truths = [
            (sliding.at_rest_n, 900.0, 0.05),
            (sliding.offset_n, 20.0, 0.05),
            (sliding.of_way_n[0], 920.0, 0.05),
            (sliding.of_way_n[1], 880.0, 0.05),
            (sliding.viscous_n_s_per_m, 500.0, 0.2),
        ];
        for ([value, half], truth, widest) in truths {
            assert!((value - truth).abs() <= half, "{value} ± {half}, truth {truth}");
            assert!(half < widest * truth, "{value} ± {half} says nothing");
        }
    }
}
