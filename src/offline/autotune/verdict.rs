//! Whether a circle with new gains is one to keep, against the circle before.
//!
//! An objection is a sentence with both values and their unit. What differs by less than [`ALIKE_UM`] is alike: the
//! place between two counts at which a run begins moves a figure by as much.
//! Invariant: no objection to a circle that equals the one before.

use super::figures::{AxisFigures, CircleFigures};
use crate::base::axis::{AxisId, PerAxis};
use crate::base::units::Current;

/// Figures closer than this are alike, um: what the protrusion of the reference machine scatters by, from seed to
/// seed of its encoder counters and its noise.
pub const ALIKE_UM: f64 = 0.2;
/// So much more or less radius is no matter, um.
const RADIUS_UM: f64 = 1.0;

/// Why a circle is worse than the one before: an axis farther off at its reversals, a path less round, a radius
/// farther off, or an axis at its current limit. Empty: it is not worse.
pub fn worse(before: &CircleFigures, after: &CircleFigures, limits: &PerAxis<Current>) -> Vec<String> {
    let mut objections = Vec::new();
    let axes = [AxisId::X, AxisId::Y].into_iter().zip(before.axes.iter().zip(&after.axes));
    for (id, (before, after)) in axes {
        let AxisFigures { axis, deviation_um, table_deviation_um, current_a_max, .. } = after;
        let mut more = |what: &str, before_um: f64, after_um: f64| {
            // Written so that what is no number is an objection too.
            let is_kept = after_um <= before_um + ALIKE_UM;
            if !is_kept {
                objections.push(format!(
                    "axis {axis} leaves its orbit by {after_um:.2} um at {what}, before by {before_um:.2} um"
                ));
            }
        };
        more("the motor encoder", before.deviation_um, *deviation_um);
        if let (Some(before_um), Some(after_um)) = (before.table_deviation_um, *table_deviation_um) {
            more("the table", before_um, after_um);
        }
        let limit_a = limits[id].as_a();
        let is_free = *current_a_max < limit_a;
        if !is_free {
            objections
                .push(format!("axis {axis} asked for {current_a_max:.2} A, its limit is {limit_a:.2} A"));
        }
    }
    let figures = [
        ("circular deviation", before.circular_deviation_um, after.circular_deviation_um, ALIKE_UM),
        ("radius off by", before.radius_decrease_um.abs(), after.radius_decrease_um.abs(), RADIUS_UM),
    ];
    for (name, before_um, after_um, alike_um) in figures {
        let is_kept = after_um <= before_um + alike_um;
        if !is_kept {
            objections.push(format!("{name} {after_um:.2} um, before {before_um:.2} um"));
        }
    }
    objections
}

/// Why a circle is no better than the one before; `None` if it is.
pub fn no_better(before: &CircleFigures, after: &CircleFigures) -> Option<String> {
    let [old_um, new_um] = [before.protrusion_um, after.protrusion_um];
    let is_better = new_um < old_um - ALIKE_UM;
    (!is_better).then(|| {
        format!(
            "the highest protrusion is {new_um:.2} um, before {old_um:.2} um; less by {ALIKE_UM} um is better"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle(change: impl Fn(&mut CircleFigures)) -> CircleFigures {
        let axis = |axis| AxisFigures {
            axis,
            protrusion_um: 25.0,
            deviation_um: 25.0,
            table_deviation_um: Some(31.0),
            current_a_max: 3.0,
            following_error_mm_max: 3.9,
        };
        let mut figures = CircleFigures {
            feed_mm_per_min: 2000.0,
            protrusion_um: 25.0,
            radius_decrease_um: -50.0,
            circular_deviation_um: 28.0,
            axes: [axis("x"), axis("y")],
        };
        change(&mut figures);
        figures
    }

    fn objections(change: impl Fn(&mut CircleFigures)) -> Vec<String> {
        worse(&circle(|_| ()), &circle(change), &PerAxis::filled(2, Current::a(20.0)))
    }

    #[test]
    fn the_same_circle_again_is_not_worse_and_not_better() {
        assert_eq!(objections(|_| ()), Vec::<String>::new());
        let said = no_better(&circle(|_| ()), &circle(|_| ())).expect("it is no better");
        assert!(said.starts_with("the highest protrusion is 25.00 um, before 25.00 um"), "{said}");
        assert_eq!(no_better(&circle(|_| ()), &circle(|after| after.protrusion_um = 24.7)), None);
        assert!(no_better(&circle(|_| ()), &circle(|after| after.protrusion_um = f64::NAN)).is_some());
    }

    #[test]
    fn each_figure_that_is_worse_is_named_with_both_values() {
        type Change = fn(&mut CircleFigures);
        let changes: [(Change, &str); 7] = [
            (|c| c.axes[1].deviation_um = 25.3, "axis y leaves its orbit by 25.30 um at the motor encoder"),
            (|c| c.axes[0].deviation_um = f64::NAN, "axis x leaves its orbit by NaN um"),
            (|c| c.axes[0].table_deviation_um = Some(32.0), "by 32.00 um at the table, before by 31.00 um"),
            (|c| c.axes[1].current_a_max = 20.0, "axis y asked for 20.00 A, its limit is 20.00 A"),
            (|c| c.circular_deviation_um = 28.5, "circular deviation 28.50 um, before 28.00 um"),
            (|c| c.radius_decrease_um = -52.0, "radius off by 52.00 um, before 50.00 um"),
            (|c| c.radius_decrease_um = 52.0, "radius off by 52.00 um, before 50.00 um"),
        ];
        for (change, words) in changes {
            let said = objections(change);
            assert!(said.len() == 1 && said[0].contains(words), "`{words}` is not all of {said:?}");
        }
        assert!(objections(|c| c.axes[0].deviation_um = 12.0).is_empty());
        assert!(objections(|c| c.radius_decrease_um = 0.5).is_empty());
    }
}
