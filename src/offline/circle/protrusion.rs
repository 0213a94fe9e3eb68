//! Quadrant protrusions: the outward spike an axis leaves where it turns around, because friction
//! holds it until the loop has built up the opposite force.
//!
//! Height is the greatest excess `d(t) - d0(t)` of the radial deviation within the guard of a
//! reversal. The baseline `d0` is the friction-free response of the same loop, sample by sample, or
//! the arc fitted between the reversals; at the table both heights contain the wind-up `F/K`, because
//! neither baseline has one. Width is taken at half height, delay from the command's reversal.
//!
//! Invariant: heights compare like with like; which baseline gave `height_um` is said beside it.

use serde::Serialize;

use super::path::{Guard, Path, Reversal};
use super::{Quadrant, UM};

/// What a height is measured from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Baseline {
    /// The response of the same loop without friction.
    FrictionFree,
    /// The arc fitted between the reversals.
    FittedArc,
}

impl Baseline {
    /// Name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::FrictionFree => "friction-free response",
            Self::FittedArc => "arc fitted between the reversals",
        }
    }
}

/// One protrusion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Protrusion {
    /// Where.
    pub quadrant: Quadrant,
    /// Turn, from 1.
    pub revolution: u32,
    /// Height above the baseline, um.
    pub height_um: f64,
    /// Which baseline.
    pub baseline: Baseline,
    /// Height above the fitted arc, um, whatever the baseline.
    pub height_over_arc_um: f64,
    /// Radial deviation at the peak, about the nominal centre, um.
    pub peak_deviation_um: f64,
    /// Deepest point below the baseline near the reversal, um; negative is inward.
    pub undershoot_um: f64,
    /// Angle of the peak, degrees counter-clockwise from +X.
    pub angle_deg: f64,
    /// Time at half height or more, ms; `None` if the path does not come back down to it.
    pub width_ms: Option<f64>,
    /// Angle travelled meanwhile, degrees.
    pub width_deg: Option<f64>,
    /// From the command's reversal to the peak, ms.
    pub delay_ms: f64,
    /// When the command reversed, s since the evaluated part began.
    pub reversal_s: f64,
}

/// The highest protrusion of each quadrant, um.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct QuadrantHeights {
    /// Of all four.
    pub max: f64,
    /// At 0°.
    pub x_plus: f64,
    /// At 90°.
    pub y_plus: f64,
    /// At 180°.
    pub x_minus: f64,
    /// At 270°.
    pub y_minus: f64,
}

impl QuadrantHeights {
    pub(super) fn of<'a>(protrusions: impl Iterator<Item = &'a Protrusion>) -> Self {
        let mut highest_um = [f64::NEG_INFINITY; 4];
        for protrusion in protrusions {
            let slot = &mut highest_um[protrusion.quadrant.index()];
            *slot = slot.max(protrusion.height_um);
        }
        let [x_plus, y_plus, x_minus, y_minus] = highest_um;
        Self {
            max: highest_um.into_iter().fold(f64::NEG_INFINITY, f64::max),
            x_plus,
            y_plus,
            x_minus,
            y_minus,
        }
    }

    /// Of one quadrant.
    pub const fn of_quadrant(&self, quadrant: Quadrant) -> f64 {
        match quadrant {
            Quadrant::XPlus => self.x_plus,
            Quadrant::YPlus => self.y_plus,
            Quadrant::XMinus => self.x_minus,
            Quadrant::YMinus => self.y_minus,
        }
    }
}

/// Mean over the revolutions of one quadrant, um; `None` without one.
pub fn mean_height_um(protrusions: &[Protrusion], quadrant: Quadrant) -> Option<f64> {
    let (mut count, mut sum_um) = (0_u32, 0.0);
    for protrusion in protrusions.iter().filter(|protrusion| protrusion.quadrant == quadrant) {
        count += 1;
        sum_um += protrusion.height_um;
    }
    (count > 0).then(|| sum_um / f64::from(count))
}

/// Every protrusion of the evaluated part, in order.
pub(super) fn measure(path: &Path, arc_m: &[f64], friction_free_m: Option<&[f64]>) -> Vec<Protrusion> {
    let guard = Guard::of(&path.nominal);
    let reversals = path.reversals();
    reversals
        .iter()
        .filter_map(|reversal| measure_one(path, &guard, reversal, arc_m, friction_free_m))
        .collect()
}

fn measure_one(
    path: &Path,
    guard: &Guard,
    reversal: &Reversal,
    arc_m: &[f64],
    friction_free_m: Option<&[f64]>,
) -> Option<Protrusion> {
    let is_known = |row: usize| path.is_fresh[row] && friction_free_m.is_none_or(|m| m[row].is_finite());
    let rows: Vec<usize> = (path.on_circle.clone())
        .filter(|row| guard.covers(reversal, path.time_s[*row]) && is_known(*row))
        .collect();
    let above =
        |baseline_m: &[f64]| rows.iter().map(|&row| path.deviation_m[row] - baseline_m[row]).collect();
    let over_arc_m: Vec<f64> = above(arc_m);
    let over_twin_m: Option<Vec<f64>> = friction_free_m.map(above);
    let baseline = if over_twin_m.is_some() { Baseline::FrictionFree } else { Baseline::FittedArc };
    let excess_m = over_twin_m.as_ref().unwrap_or(&over_arc_m);
    let peak = highest(excess_m)?;
    let peak_row = rows[peak];
    let half = half_height(path, &rows, excess_m, peak);
    Some(Protrusion {
        quadrant: reversal.quadrant,
        revolution: reversal.revolution,
        height_um: UM * excess_m[peak],
        baseline,
        height_over_arc_um: UM * over_arc_m[highest(&over_arc_m)?],
        peak_deviation_um: UM * path.deviation_m[peak_row],
        undershoot_um: UM * excess_m.iter().copied().fold(f64::INFINITY, f64::min),
        angle_deg: path.angle_rad(peak_row).to_degrees(),
        width_ms: half.map(|[from, to]| 1e3 * (to.time_s - from.time_s)),
        width_deg: half.map(|[from, to]| (to.progress_rad - from.progress_rad).to_degrees()),
        delay_ms: 1e3 * (path.time_s[peak_row] - reversal.time_s),
        reversal_s: reversal.time_s,
    })
}

fn highest(excess_m: &[f64]) -> Option<usize> {
    (0..excess_m.len()).max_by(|a, b| excess_m[*a].total_cmp(&excess_m[*b]))
}

/// A point between two rows.
#[derive(Clone, Copy)]
struct Crossing {
    time_s: f64,
    progress_rad: f64,
}

/// Where the excess passes half its peak on the way up and on the way down.
fn half_height(path: &Path, rows: &[usize], excess_m: &[f64], peak: usize) -> Option<[Crossing; 2]> {
    let half_m = 0.5 * excess_m[peak];
    let below = |at: &usize| excess_m[*at] < half_m;
    let rise = (0..peak).rev().find(below)?;
    let fall = (peak + 1..rows.len()).find(below)?;
    let between = |near: usize, far: usize| {
        let share = (half_m - excess_m[near]) / (excess_m[far] - excess_m[near]);
        let mix = |column: &[f64]| column[rows[near]] + share * (column[rows[far]] - column[rows[near]]);
        Crossing { time_s: mix(&path.time_s), progress_rad: mix(&path.progress_rad) }
    };
    Some([between(rise, rise + 1), between(fall, fall - 1)])
}
