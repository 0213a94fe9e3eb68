//! The path as a whole: the quantities of ISO 230-4, and what each axis contributes to them.
//!
//! * circular deviation `G`: width of the narrowest annulus around the path (also about the centre of
//!   the least-squares circle, which some instruments report);
//! * radial deviation `F`: farthest and nearest point about the nominal centre, minus the nominal radius;
//! * mean radius: of the least-squares circle, protrusions and all;
//! * radius decrease: nominal radius minus the *arcs between the reversals*. Protrusions push the
//!   least-squares radius outwards by their area and the wind-up tilts the arcs; the constant of the
//!   arc fit is free of both, and is what the lag of the loop makes of the radius:
//!   `dR = R/2 (w/Kp)² (1 - 2 Kp tau) - 3/8 R (w/Kp)⁴`.
//! * per axis, fitted over the command's angle `φ`: `x = c + A cosφ + B sinφ + D sgn(v)`. Lag is the
//!   phase over the angular speed, lost motion is `-2 D`.
//!
//! Invariant: one measured part in, one set of numbers out; no smoothing.

use serde::Serialize;

use super::fit::{self, ArcSample, Arcs};
use super::path::{Guard, Path, Reversal};
use super::{CircleError, UM};
use crate::base::axis::AxisId;

/// Quantities of one path.
#[derive(Clone, Debug, Serialize)]
pub struct CircleValues {
    /// Samples evaluated.
    pub samples: usize,
    /// Circular deviation G, minimum zone, um.
    pub circular_deviation_um: f64,
    /// Circular deviation about the least-squares centre, um.
    pub circular_deviation_least_squares_um: f64,
    /// Radial deviation F, farthest outside, um.
    pub radial_deviation_um_max: f64,
    /// Radial deviation F, farthest inside, um.
    pub radial_deviation_um_min: f64,
    /// Radius of the least-squares circle, mm.
    pub mean_radius_mm: f64,
    /// Nominal radius minus the radius of the arcs between the reversals, um.
    pub radius_decrease_um: f64,
    /// Centre of the least-squares circle from the nominal centre, X, um.
    pub centre_offset_x_um: f64,
    /// Centre of the least-squares circle from the nominal centre, Y, um.
    pub centre_offset_y_um: f64,
    /// The X axis.
    pub x: AxisValues,
    /// The Y axis.
    pub y: AxisValues,
    /// Lag of X minus lag of Y, ms.
    pub lag_difference_ms: f64,
}

/// What one axis does between its reversals.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AxisValues {
    /// How far the axis is behind its command, ms.
    pub lag_ms: f64,
    /// Nominal amplitude minus amplitude, um.
    pub amplitude_decrease_um: f64,
    /// Distance lost when the direction changes, um.
    pub lost_motion_um: f64,
}

impl CircleValues {
    /// Of one path and the arcs fitted to it.
    pub(super) fn of(path: &Path, arcs: &Arcs) -> Result<Self, CircleError> {
        let points_m = points(path);
        let open = undetermined(path, "a circle", points_m.len());
        let circle = fit::least_squares_circle(&points_m).ok_or_else(|| open.clone())?;
        let annulus = fit::minimum_zone(&points_m).ok_or(open)?;
        let measured_m = || path.measured_rows().map(|row| path.deviation_m[row]);
        let [x, y] = [axis_values(path, AxisId::X)?, axis_values(path, AxisId::Y)?];
        Ok(Self {
            samples: points_m.len(),
            circular_deviation_um: UM * annulus.width_m,
            circular_deviation_least_squares_um: UM * fit::width_about(&points_m, circle.centre_m),
            radial_deviation_um_max: UM * measured_m().fold(f64::NEG_INFINITY, f64::max),
            radial_deviation_um_min: UM * measured_m().fold(f64::INFINITY, f64::min),
            mean_radius_mm: 1e3 * circle.radius_m,
            radius_decrease_um: -UM * arcs.radius_m(),
            centre_offset_x_um: UM * circle.centre_m[0],
            centre_offset_y_um: UM * circle.centre_m[1],
            x,
            y,
            lag_difference_ms: x.lag_ms - y.lag_ms,
        })
    }
}

/// Bidirectional circular deviation G(b), um: one annulus around all paths together.
pub(super) fn bidirectional_um<'a>(paths: impl Iterator<Item = &'a Path>) -> Option<f64> {
    let points_m: Vec<[f64; 2]> = paths.flat_map(points).collect();
    fit::minimum_zone(&points_m).map(|annulus| UM * annulus.width_m)
}

/// A path that broke off is no circle.
pub(super) fn check_complete(path: &Path) -> Result<(), CircleError> {
    let rows = path.measured.clone();
    let got_deg = (path.progress_rad[rows.end - 1] - path.progress_rad[rows.start]).to_degrees();
    let expected_deg = 360.0 * f64::from(path.nominal.revolutions);
    // The last row lies up to a period before the end: on a small fast circle that is a whole degree. Where
    // it is less, some rows may be missing.
    let per_row_deg = got_deg / (rows.len().max(2) - 1) as f64;
    if got_deg > expected_deg - (1.5 * per_row_deg).max(0.5) && path.nominal.revolutions > 0 {
        return Ok(());
    }
    Err(CircleError::Incomplete { direction: path.nominal.direction, got_deg, expected_deg })
}

/// The arcs of the measured part outside all guards.
pub(super) fn fit_arcs(path: &Path) -> Result<Arcs, CircleError> {
    let rows = free_rows(path, &path.disturbances());
    let samples = rows.iter().map(|&row| ArcSample {
        angle_rad: path.angle_rad(row),
        sign: [path.sign[0][row], path.sign[1][row]],
        deviation_m: path.deviation_m[row],
    });
    Arcs::fit(samples).ok_or_else(|| undetermined(path, "the arcs between the reversals", rows.len()))
}

fn axis_values(path: &Path, axis: AxisId) -> Result<AxisValues, CircleError> {
    let own: Vec<Reversal> =
        path.disturbances().into_iter().filter(|reversal| reversal.quadrant.axis() == axis).collect();
    let rows = free_rows(path, &own);
    let place_m = if axis == AxisId::X { &path.x_m } else { &path.y_m };
    let sign = &path.sign[axis.index()];
    let fitted = fit::solve::<4>(rows.iter().map(|&row| {
        let (sin, cos) = path.command_angle_rad(row).sin_cos();
        ([1.0, cos, sin, sign[row]], place_m[row])
    }));
    let [_, cos_m, sin_m, wound_m] =
        fitted.ok_or_else(|| undetermined(path, "the response of an axis", rows.len()))?;
    // x = r cos(φ - δ) gives (cosδ, sinδ), y = r sin(φ - δ) gives (-sinδ, cosδ).
    let (along_m, behind_m) = if axis == AxisId::X { (cos_m, sin_m) } else { (sin_m, -cos_m) };
    let angle_rad = path.nominal.direction.sign() * behind_m.atan2(along_m);
    Ok(AxisValues {
        lag_ms: 1e3 * angle_rad / path.nominal.angular_speed_rad_per_s(),
        amplitude_decrease_um: UM * (path.nominal.radius.as_m() - along_m.hypot(behind_m)),
        lost_motion_um: -2.0 * UM * wound_m,
    })
}

fn free_rows(path: &Path, reversals: &[Reversal]) -> Vec<usize> {
    let guard = Guard::of(&path.nominal);
    let is_free = |row: &usize| !reversals.iter().any(|reversal| guard.covers(reversal, path.time_s[*row]));
    path.measured_rows().filter(is_free).collect()
}

fn points(path: &Path) -> Vec<[f64; 2]> {
    path.measured_rows().map(|row| [path.x_m[row], path.y_m[row]]).collect()
}

fn undetermined(path: &Path, what: &'static str, samples: usize) -> CircleError {
    CircleError::Undetermined { direction: path.nominal.direction, what, samples }
}
