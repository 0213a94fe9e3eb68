//! Circles and arcs fitted to measured points.
//!
//! * [`least_squares_circle`]: minimises `Σ (|p - c| - r)²` over centre `c` and radius `r`.
//! * [`minimum_zone`]: the centre whose annulus around all points is narrowest (ISO 230-4 `G`). With
//!   deviations of micrometres on radii of millimetres the width is, to below a nanometre,
//!   `max(d - c·u) - min(d - c·u)`, convex in `c`; it is solved exactly on the few points that touch
//!   the annulus, and points that stick out are added until none does.
//! * [`Arcs`]: the smooth path between the reversals, a linear fit of the radial deviation.
//!
//! Invariant: lengths in metres, angles in radians; a fit that its points do not determine is `None`.

use nalgebra::{SMatrix, SVector};

/// A circle through points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedCircle {
    /// Centre, m.
    pub centre_m: [f64; 2],
    /// Radius, m.
    pub radius_m: f64,
}

/// Two concentric circles that enclose all points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Annulus {
    /// Common centre, m.
    pub centre_m: [f64; 2],
    /// Outer radius minus inner radius, m.
    pub width_m: f64,
}

/// Gauss-Newton steps; each gains more digits than the last, three already reach rounding.
const STEPS: usize = 5;

/// The circle with the least squared radial distances.
pub fn least_squares_circle(points_m: &[[f64; 2]]) -> Option<FittedCircle> {
    let count = points_m.len() as f64;
    let mean = |axis: usize| points_m.iter().map(|point| point[axis]).sum::<f64>() / count;
    let mut centre_m = [mean(0), mean(1)];
    let mut radius_m = points_m.iter().map(|p| distance(*p, centre_m)).sum::<f64>() / count;
    for _ in 0..STEPS {
        let rows = points_m.iter().map(|point| {
            let r_m = distance(*point, centre_m);
            let unit = [(point[0] - centre_m[0]) / r_m, (point[1] - centre_m[1]) / r_m];
            ([unit[0], unit[1], 1.0], r_m - radius_m)
        });
        let step = solve::<3>(rows)?;
        centre_m = [centre_m[0] + step[0], centre_m[1] + step[1]];
        radius_m += step[2];
    }
    Some(FittedCircle { centre_m, radius_m })
}

/// The annulus of least width around all points.
pub fn minimum_zone(points_m: &[[f64; 2]]) -> Option<Annulus> {
    let mut centre_m = least_squares_circle(points_m)?.centre_m;
    // Twice, because the second time the points are linearised about the right centre.
    for _ in 0..2 {
        let rays: Vec<Ray> = points_m.iter().map(|point| Ray::from(*point, centre_m)).collect();
        let shift_m = narrowest(&rays);
        centre_m = [centre_m[0] + shift_m[0], centre_m[1] + shift_m[1]];
    }
    Some(Annulus { centre_m, width_m: width_about(points_m, centre_m) })
}

/// Width of the annulus around all points with a given centre, m.
pub fn width_about(points_m: &[[f64; 2]], centre_m: [f64; 2]) -> f64 {
    let radii_m = points_m.iter().map(|point| distance(*point, centre_m));
    let (least_m, most_m) =
        radii_m.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), r| (least.min(r), most.max(r)));
    most_m - least_m
}

fn distance(point_m: [f64; 2], centre_m: [f64; 2]) -> f64 {
    (point_m[0] - centre_m[0]).hypot(point_m[1] - centre_m[1])
}

/// A point as distance and direction from a centre.
#[derive(Clone, Copy)]
struct Ray {
    radius_m: f64,
    unit: [f64; 2],
}

impl Ray {
    fn from(point_m: [f64; 2], centre_m: [f64; 2]) -> Self {
        let radius_m = distance(point_m, centre_m);
        Self {
            radius_m,
            unit: [(point_m[0] - centre_m[0]) / radius_m, (point_m[1] - centre_m[1]) / radius_m],
        }
    }
    fn radius_about_m(&self, shift_m: [f64; 2]) -> f64 {
        self.radius_m - shift_m[0] * self.unit[0] - shift_m[1] * self.unit[1]
    }
}

/// Shift of the centre that makes `max - min` of all rays least.
fn narrowest(rays: &[Ray]) -> [f64; 2] {
    let mut shift_m = [0.0, 0.0];
    let (low, high) = extremes(rays, shift_m);
    // Moving the centre by s widens a full circle's annulus by 2 s less what it had: no need to look further.
    let reach_m = rays[high].radius_m - rays[low].radius_m;
    let mut touching = vec![rays[low], rays[high]];
    // Each round adds a point that sticks out; far fewer are ever needed.
    for _ in 0..200 {
        shift_m = narrowest_of_few(&touching, reach_m);
        let (low, high) = extremes(rays, shift_m);
        let width_m = rays[high].radius_about_m(shift_m) - rays[low].radius_about_m(shift_m);
        if width_m - spread_m(&touching, shift_m) < 1e-11 {
            break;
        }
        touching.extend([rays[low], rays[high]]);
    }
    shift_m
}

/// Nested golden section: the width is convex in both coordinates.
fn narrowest_of_few(rays: &[Ray], reach_m: f64) -> [f64; 2] {
    let best_y_m = |x_m: f64| golden_section(reach_m, |y_m| spread_m(rays, [x_m, y_m]));
    let x_m = golden_section(reach_m, |x_m| spread_m(rays, [x_m, best_y_m(x_m)]));
    [x_m, best_y_m(x_m)]
}

/// Where a convex function is least within `±reach`, to 1e-9 of the reach.
fn golden_section(reach_m: f64, width_m: impl Fn(f64) -> f64) -> f64 {
    const SHARE: f64 = 0.618_033_988_749_894_9;
    let (mut low, mut high) = (-reach_m, reach_m);
    let (mut left, mut right) = (high - SHARE * (high - low), low + SHARE * (high - low));
    let (mut width_left, mut width_right) = (width_m(left), width_m(right));
    for _ in 0..45 {
        if width_left < width_right {
            (high, right, width_right) = (right, left, width_left);
            left = high - SHARE * (high - low);
            width_left = width_m(left);
        } else {
            (low, left, width_left) = (left, right, width_right);
            right = low + SHARE * (high - low);
            width_right = width_m(right);
        }
    }
    0.5 * (low + high)
}

fn spread_m(rays: &[Ray], shift_m: [f64; 2]) -> f64 {
    let (mut least_m, mut most_m) = (f64::INFINITY, f64::NEG_INFINITY);
    for ray in rays {
        let radius_m = ray.radius_about_m(shift_m);
        (least_m, most_m) = (least_m.min(radius_m), most_m.max(radius_m));
    }
    most_m - least_m
}

/// Which rays are shortest and longest.
fn extremes(rays: &[Ray], shift_m: [f64; 2]) -> (usize, usize) {
    let (mut low, mut high) = (0, 0);
    let radii_m: Vec<f64> = rays.iter().map(|ray| ray.radius_about_m(shift_m)).collect();
    for (index, radius_m) in radii_m.iter().enumerate() {
        if *radius_m < radii_m[low] {
            low = index;
        }
        if *radius_m > radii_m[high] {
            high = index;
        }
    }
    (low, high)
}

/// The path between the reversals:
/// `d(θ) = a0 + a1 cosθ + a2 sinθ + a3 cos2θ + a4 sin2θ + a5 sgn(vx) cosθ + a6 sgn(vy) sinθ`.
///
/// In order: radius, centre, scale mismatch, lag mismatch or squareness, and the wind-up (lost motion)
/// of each axis, which flips with its direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arcs([f64; 7]);

/// One row for the fit: angle, sign of each axis' velocity, and radial deviation.
#[derive(Clone, Copy, Debug)]
pub struct ArcSample {
    /// Actual angle, rad.
    pub angle_rad: f64,
    /// Sign of the velocity of each axis.
    pub sign: [f64; 2],
    /// Radius minus nominal radius, m.
    pub deviation_m: f64,
}

impl Arcs {
    /// Least squares over samples that keep away from the reversals.
    pub fn fit(samples: impl Iterator<Item = ArcSample>) -> Option<Self> {
        let rows = samples.map(|sample| {
            let (sin, cos) = sample.angle_rad.sin_cos();
            let (sin2, cos2) = (2.0 * sample.angle_rad).sin_cos();
            let row = [1.0, cos, sin, cos2, sin2, sample.sign[0] * cos, sample.sign[1] * sin];
            (row, sample.deviation_m)
        });
        solve::<7>(rows).map(Self)
    }

    /// The arc under a protrusion, m. Leaves the wind-up out: a friction-free axis has none, so the
    /// height above this arc means the same as the height above a friction-free response.
    pub fn deviation_m(&self, angle_rad: f64) -> f64 {
        let [radius, x, y, cos2_m, sin2_m, ..] = self.0;
        let (sin, cos) = angle_rad.sin_cos();
        let (sin2, cos2) = (2.0 * angle_rad).sin_cos();
        radius + x * cos + y * sin + cos2_m * cos2 + sin2_m * sin2
    }

    /// Mean radial deviation of the arcs, m.
    pub fn radius_m(&self) -> f64 {
        self.0[0]
    }
}

/// Linear least squares over rows of (regressors, value).
///
/// Normal equations are good enough: the regressors are bounded by 1 and their condition stays below
/// 1e4, so ten digits of micrometres remain. `None` when the rows leave a term undetermined.
pub(super) fn solve<const N: usize>(rows: impl Iterator<Item = ([f64; N], f64)>) -> Option<[f64; N]> {
    // Summed in plain arrays: a log has 1e5 rows and more, and this loop is all of the fit's time.
    let (mut normal, mut right) = ([[0.0; N]; N], [0.0; N]);
    let mut count = 0_usize;
    for (row, value) in rows {
        for i in 0..N {
            right[i] += row[i] * value;
            for j in 0..=i {
                normal[i][j] += row[i] * row[j];
            }
        }
        count += 1;
    }
    if count < N {
        return None;
    }
    let normal = SMatrix::<f64, N, N>::from_fn(|i, j| normal[i.max(j)][i.min(j)]);
    let factor = normal.cholesky()?;
    let solution = factor.solve(&SVector::from(right));
    let pivots = factor.l().diagonal();
    let is_determined = pivots.min() > 1e-7 * pivots.max() && solution.iter().all(|term| term.is_finite());
    is_determined.then(|| solution.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn ring(count: usize, radius_m: impl Fn(f64) -> f64, centre_m: [f64; 2]) -> Vec<[f64; 2]> {
        let angles = (0..count).map(|i| TAU * i as f64 / count as f64);
        angles.map(|a| [centre_m[0] + radius_m(a) * a.cos(), centre_m[1] + radius_m(a) * a.sin()]).collect()
    }

    #[test]
    fn a_circle_off_centre_is_found() {
        let points = ring(360, |_| 0.149_95, [3e-6, -4e-6]);
        let circle = least_squares_circle(&points).unwrap();
        assert!((circle.radius_m - 0.149_95).abs() < 1e-12, "radius {} m", circle.radius_m);
        assert!((circle.centre_m[0] - 3e-6).abs() < 1e-12, "centre {:?} m", circle.centre_m);
        assert!(minimum_zone(&points).unwrap().width_m < 1e-12);
    }

    #[test]
    fn an_ellipse_and_a_three_lobe_have_their_known_widths() {
        let ellipse = minimum_zone(&ring(720, |a| 0.15 + 5e-6 * (2.0 * a).cos(), [0.0, 0.0])).unwrap();
        assert!((ellipse.width_m - 10e-6).abs() < 1e-9, "width {} m", ellipse.width_m);
        let lobes = minimum_zone(&ring(720, |a| 0.15 + 5e-6 * (3.0 * a).cos(), [2e-6, 9e-6])).unwrap();
        assert!((lobes.width_m - 10e-6).abs() < 1e-9, "width {} m", lobes.width_m);
    }

    #[test]
    fn no_other_centre_is_narrower_for_a_lopsided_path() {
        let bump = |a: f64| 0.15 + 8e-6 * (-(a - 1.0).powi(2) / 0.1).exp() + 3e-6 * (2.0 * a).cos();
        let points = ring(720, bump, [0.0, 0.0]);
        let annulus = minimum_zone(&points).unwrap();
        let least_squares = least_squares_circle(&points).unwrap();
        assert!(annulus.width_m < width_about(&points, least_squares.centre_m) - 0.1e-6);
        for step in 0..64 {
            let (sin, cos) = (TAU * f64::from(step) / 64.0).sin_cos();
            for by_m in [0.01e-6, 0.1e-6, 1e-6] {
                let centre_m = [annulus.centre_m[0] + by_m * cos, annulus.centre_m[1] + by_m * sin];
                let wider_m = width_about(&points, centre_m) - annulus.width_m;
                assert!(wider_m > -1e-12, "moved by {by_m} m it is {wider_m} m wider");
            }
        }
    }

    #[test]
    fn terms_that_the_points_leave_open_are_refused() {
        let sample =
            |i: usize| ArcSample { angle_rad: 1.0 + 1e-6 * i as f64, sign: [1.0, 1.0], deviation_m: 0.0 };
        assert_eq!(Arcs::fit((0..100).map(sample)), None);
    }
}
