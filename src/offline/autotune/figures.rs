//! What is compared of a circular test.
//!
//! Of each axis: how far it leaves its orbit at its reversals, on either side, at the motor encoder and at the table;
//! the current that was asked for, and how far the motor was behind the setpoint, on the circles alone. Of both: what
//! the radius lost and how round the path is.
//! Invariant: of both directions the worse counts.

use serde::Serialize;

use crate::base::axis::AxisId;
use crate::config::machine::AXIS_NAMES;
use crate::offline::circle::{CircularTest, PointAnalysis};
use crate::offline::trace::Trace;

/// One axis on a circle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisFigures {
    /// Its name.
    pub axis: &'static str,
    /// Highest protrusion at the motor encoder, um.
    pub protrusion_um: f64,
    /// Farthest from the orbit without friction at a reversal, outside or inside, at the motor encoder, um.
    pub deviation_um: f64,
    /// The same at the table; `None` without a scale.
    pub table_deviation_um: Option<f64>,
    /// Largest current asked of the drive, A.
    pub current_a_max: f64,
    /// Largest distance of the motor from the setpoint, mm.
    pub following_error_mm_max: f64,
}

/// A circular test in figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CircleFigures {
    /// Along the path, mm/min.
    pub feed_mm_per_min: f64,
    /// Highest protrusion at the motor encoder, um.
    pub protrusion_um: f64,
    /// Nominal radius less that between the reversals, at the motor encoder, um.
    pub radius_decrease_um: f64,
    /// Circular deviation G at the motor encoder, um.
    pub circular_deviation_um: f64,
    /// The axes of the circle.
    pub axes: [AxisFigures; 2],
}

impl CircleFigures {
    /// Of a test and its whole run.
    pub fn of(test: &CircularTest, trace: &Trace) -> Self {
        Self {
            feed_mm_per_min: test.feed_mm_per_min,
            protrusion_um: test.motor.protrusion_um.max,
            radius_decrease_um: test.motor.radius_decrease_um,
            circular_deviation_um: test.motor.circular_deviation_um,
            axes: [AxisId::X, AxisId::Y].map(|axis| AxisFigures::of(axis, test, trace)),
        }
    }
}

impl AxisFigures {
    fn of(axis: AxisId, test: &CircularTest, trace: &Trace) -> Self {
        let heights = heights_um(axis, &test.motor);
        let columns = trace.axis(axis);
        let most = |value: &dyn Fn(usize) -> Option<f64>| {
            let rows = (0..trace.len()).filter(|row| trace.is_measured[*row]);
            rows.filter_map(value).map(f64::abs).fold(0.0, f64::max)
        };
        Self {
            axis: AXIS_NAMES[axis.index()],
            protrusion_um: heights.map(|[height, _]| height).fold(f64::NEG_INFINITY, f64::max),
            deviation_um: deviation_um(axis, &test.motor),
            table_deviation_um: test.table.as_ref().map(|table| deviation_um(axis, table)),
            current_a_max: most(&|row| Some(columns?.current_command_a[row])),
            following_error_mm_max: most(&|row| {
                let columns = columns?;
                let away_m = columns.setpoint_position_m[row] - columns.motor_position_m[row];
                columns.is_fresh[row].then_some(1e3 * away_m)
            }),
        }
    }
}

/// Height and undershoot of each reversal of an axis.
fn heights_um(axis: AxisId, point: &PointAnalysis) -> impl Iterator<Item = [f64; 2]> {
    let of_both = point.directions.iter().flat_map(|direction| &direction.protrusions);
    let of_axis = of_both.filter(move |protrusion| protrusion.quadrant.axis() == axis);
    of_axis.map(|protrusion| [protrusion.height_um, protrusion.undershoot_um])
}

fn deviation_um(axis: AxisId, point: &PointAnalysis) -> f64 {
    heights_um(axis, point).map(|[height, under]| height.max(-under)).fold(f64::NEG_INFINITY, f64::max)
}
