//! Margins of a measured open loop.
//!
//! Between its lines the loop is taken to be the computed one times the ratio of measured and computed, which is
//! near one and smooth where the loop itself is neither: a resonance between two lines keeps its shape. Above
//! the last line the ratio stays as it is there. Below the first only its magnitude does: an integrator before an
//! inertia comes to -180 degrees at rest, and a ratio that turned it by a hundredth more would make up a crossing.
//! Invariant: with a machine file that is right the measured margins are those of the measurement all the same.

use std::f64::consts::TAU;

use nalgebra::Complex;
use serde::Serialize;

use super::spectra::{Observed, Spectrum};
use crate::config::Machine;
use crate::offline::loops::Loops;
use crate::offline::margins::Margins;

/// How sure the measured margins are: standard deviations. `None` where a margin is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Uncertainty {
    /// Degrees.
    pub phase_margin_deg: Option<f64>,
    /// Decibel.
    pub gain_margin_db: Option<f64>,
}

/// The margins of the measured loop, and how they scatter when one period after the other is left out.
pub(super) fn measured(machine: &Machine, loops: &Loops<'_>, observed: &Observed) -> (Margins, Uncertainty) {
    let of = |lines: Vec<Spectrum>| margins_of(machine, loops, observed, &lines);
    let whole = of(observed.mean());
    let count = observed.periods.len();
    let others: Vec<Margins> = (0..count).map(|period| of(observed.mean_without(Some(period)))).collect();
    let spread = |of: fn(&Margins) -> Option<f64>| {
        let values: Option<Vec<f64>> = others.iter().map(of).collect();
        values.filter(|values| values.len() > 1).map(|values| jackknife(&values))
    };
    let uncertainty = Uncertainty {
        phase_margin_deg: spread(|margins| margins.phase_margin_deg),
        gain_margin_db: spread(|margins| margins.gain_margin_db),
    };
    (whole, uncertainty)
}

/// Standard deviation from values that each lack one of the data (Quenouille, Tukey).
pub(super) fn jackknife(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (square * (count - 1.0) / count).sqrt()
}

fn margins_of(machine: &Machine, loops: &Loops<'_>, observed: &Observed, lines: &[Spectrum]) -> Margins {
    let ratios: Vec<(f64, Complex<f64>)> = observed
        .frequencies_hz()
        .into_iter()
        .zip(lines)
        .map(|(hz, line)| (hz.ln(), line.open() / loops.velocity_open(TAU * hz)))
        .collect();
    let open = |omega: f64| loops.velocity_open(omega) * between(&ratios, (omega / TAU).ln());
    let rate_hz = 1.0 / machine.cycle.period.as_s();
    Margins::of(open, rate_hz, machine.axes[observed.axis].plant.mechanics.resonance_hz())
}

/// A value between points in rising order, straight; outside that of the nearest end, below without its phase.
fn between(points: &[(f64, Complex<f64>)], place: f64) -> Complex<f64> {
    let above = points.partition_point(|point| point.0 < place);
    match (above.checked_sub(1).and_then(|below| points.get(below)), points.get(above)) {
        (Some(low), Some(high)) => low.1 + (high.1 - low.1) * ((place - low.0) / (high.0 - low.0)),
        (Some(end), None) => end.1,
        (None, Some(end)) => Complex::new(end.1.norm(), 0.0),
        (None, None) => Complex::new(1.0, 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_between_points_lie_on_the_line_and_outside_on_the_ends() {
        let points = [(0.0, Complex::new(0.0, 2.0)), (2.0, Complex::new(3.0, 1.0))];
        assert_eq!(between(&points, 1.0), Complex::new(1.5, 1.5));
        assert_eq!(between(&points, -5.0), Complex::new(2.0, 0.0));
        assert_eq!(between(&points, 7.0), points[1].1);
    }

    #[test]
    fn the_jackknife_of_means_is_their_standard_error() {
        let data = [1.0, 4.0, 2.0, 8.0, 5.0];
        let sum: f64 = data.iter().sum();
        let without: Vec<f64> = data.iter().map(|value| (sum - value) / 4.0).collect();
        let variance = data.iter().map(|value| (value - sum / 5.0_f64).powi(2)).sum::<f64>() / 4.0;
        assert!((jackknife(&without) - (variance / 5.0).sqrt()).abs() < 1e-12);
    }
}
