//! Thermal growth: the screw gets longer as it gets warm, and the table scale shows it.
//!
//! ```text
//!   x_shown = x_t (1 + g (1 - exp(-t / T)))
//! ```
//!
//! 11.5 um/m for each kelvin of a steel screw. The screw is held where the axis stood at its start.
//! Invariant: no force; nothing at the start.

use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::{Action, Reading};
use super::parameter::Parameter;

pub(super) const ENTRY: Entry = Entry {
    name: "thermal-growth",
    summary: "a screw that grows as it gets warm",
    equation: "x_shown = x_t (1 + g (1 - exp(-t / T)))",
    parameters: &[
        Parameter::new("growth-um-per-m", "um/m", [-1_000.0, 1_000.0], 50.0, 50.0),
        Parameter::new("time-constant-s", "s", [10.0, 36_000.0], 1_800.0, 1_200.0),
    ],
    coordinate: Coordinate::Time,
    experiment: Experiment::Repetition,
    aliases: &[],
    law_of: None,
    action: Action::TableScale(|values, _| {
        Box::new(Growth { share: 1e-6 * values[0], per_s: 1.0 / values[1] })
    }),
};

#[derive(Debug)]
struct Growth {
    share: f64,
    per_s: f64,
}

impl Reading for Growth {
    fn error_m(&self, place_m: f64, time_s: f64) -> f64 {
        -self.share * place_m * libm::expm1(-time_s * self.per_s)
    }
}

#[cfg(test)]
mod tests {
    use super::super::entry;
    use crate::base::time::Span;
    use crate::base::units::{Current, Position};
    use crate::plant::Plant;
    use crate::plant::tests::paper_axis;

    #[test]
    fn a_scale_grows_with_the_time_though_nothing_moves_otherwise() {
        let axis = paper_axis().with_effect(entry("thermal-growth").unwrap(), [60.0, 60.0, 0.0]);
        let mut plant = Plant::new(&axis, Span::us(500));
        let far = Position::mm(100.0);
        let grown_um = |plant: &Plant| (plant.shown(Position::ZERO, far)[1] - far).as_um();
        assert_eq!(grown_um(&plant), 0.0);
        for _ in 0..2_000 {
            plant.step(Current::ZERO);
        }
        // A second of a minute.
        let expected_um = 60.0 * 0.1 * -(-1.0_f64 / 60.0).exp_m1();
        assert!((grown_um(&plant).abs() / expected_um - 1.0).abs() < 1e-6, "{} um", grown_um(&plant));
    }
}
