//! Frequency response of the velocity loop, from the excited motions of a log.
//!
//! ```text
//!   records ──► spectra by period ──► L = V / (R - V), P = V / U, G = I / U ──► margins, parameters
//! ```
//!
//! With `R` the excited velocity command, `V` the velocity as the loop sees it, `U` the current command and `I` the
//! measured current, each a line of the excitation averaged over its periods. What is not periodic averages out:
//! the excitation is the instrument, and the loop may stay closed. How the periods scatter is the uncertainty.
//!
//! Margins are those of the measured open loop; between its lines it is taken to follow the computed loop, times
//! the ratio of measured and computed ([`margins`]). Parameters come from `G` and `P` ([`parameters`]).
//! Invariant: a period in which a sample was stale or a record is missing is not used.

mod descent;
pub mod margins;
pub mod parameters;
pub mod spectra;

use std::collections::BTreeMap;

use nalgebra::Complex;
use serde::Serialize;

use super::{AxisFindings, Finding};
use crate::config::Machine;
use crate::config::machine::AXIS_NAMES;
use crate::offline::loops::Loops;
use crate::offline::margins::Margins;
use margins::Uncertainty;
use spectra::Observed;

/// One line of the excitation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Line {
    /// Hz.
    pub frequency_hz: f64,
    /// Open velocity loop, magnitude.
    pub open_db: f64,
    /// Open velocity loop, phase.
    pub open_deg: f64,
    /// Standard deviation of the open loop, as a share of its magnitude.
    pub open_std: f64,
    /// What the machine file and the gains say it is, magnitude.
    pub computed_db: f64,
    /// The same, phase.
    pub computed_deg: f64,
    /// Speed of the motor, as the loop sees it, per torque asked for: magnitude, dB of (rad/s)/(N m).
    pub plant_db: f64,
    /// The same, phase.
    pub plant_deg: f64,
    /// Share of the velocity that repeats from period to period.
    pub coherence: f64,
}

/// The velocity loop of one axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisResponse {
    /// Gain set that acted.
    pub gains: String,
    /// Periods that were used.
    pub periods: usize,
    /// By frequency.
    pub lines: Vec<Line>,
    /// The computed loop between the outer lines: frequency in Hz, magnitude in dB, phase in degrees.
    #[serde(skip)]
    pub curve: Vec<[f64; 3]>,
    /// Of the measured loop.
    pub measured: Margins,
    /// Standard deviations of two of them.
    pub uncertainty: Uncertainty,
    /// Of the loop that machine file and gains say.
    pub computed: Margins,
    /// What the response tells of the axis.
    pub findings: AxisFindings,
}

/// What the torque constant scales.
const BY_TORQUE: [&str; 5] = ["total_inertia", "motor_inertia", "mass", "stiffness", "damping"];

impl AxisResponse {
    /// What the response tells, with the uncertainty of the torque constant (half its 95 % interval, %) in all
    /// that it scales.
    pub fn findings_within(&self, torque_constant_tolerance_percent: f64) -> AxisFindings {
        let mut findings = self.findings.clone();
        for name in BY_TORQUE {
            if let Some(Finding::Found(estimate)) = findings.get_mut(name) {
                *estimate = estimate.clone().with_scale(torque_constant_tolerance_percent, "torque constant");
            }
        }
        findings
    }
}

/// The axes of a machine that were excited, by name; of one that was excited several times, the last.
pub fn of_observed(machine: &Machine, observed: &[Observed]) -> BTreeMap<String, AxisResponse> {
    let one = |axis: &Observed| (AXIS_NAMES[axis.axis.index()].to_owned(), respond(machine, axis));
    observed.iter().map(one).collect()
}

/// The response of one axis against what its machine says.
pub fn respond(machine: &Machine, observed: &Observed) -> AxisResponse {
    let loops = Loops::new(machine, observed.axis, observed.gain_set);
    let whole = observed.mean();
    let coherence = observed.coherence();
    let open_std = observed.scatter(|line| line.open());
    let torque_per_a = machine.axes[observed.axis].control.axis.actuator.torque_constant_nm_per_a;
    let rad_per_m = 1.0 / machine.axes[observed.axis].control.axis.mechanics.travel_per_rad_m();
    let lines = observed
        .frequencies_hz()
        .into_iter()
        .zip(&whole)
        .enumerate()
        .map(|(place, (frequency_hz, line))| {
            let computed = loops.velocity_open(std::f64::consts::TAU * frequency_hz);
            let plant = line.plant() * (rad_per_m / torque_per_a);
            Line {
                frequency_hz,
                open_db: decibel(line.open()),
                open_deg: below(line.open()),
                open_std: open_std[place] / line.open().norm(),
                computed_db: decibel(computed),
                computed_deg: below(computed),
                plant_db: decibel(plant),
                plant_deg: below(plant),
                coherence: coherence[place],
            }
        })
        .collect();
    let (measured, uncertainty) = margins::measured(machine, &loops, observed);
    AxisResponse {
        gains: machine.gain_sets[usize::from(observed.gain_set)].clone(),
        periods: observed.periods.len(),
        lines,
        curve: curve(&loops, &observed.frequencies_hz()),
        measured,
        uncertainty,
        computed: loops.velocity_margins(),
        findings: parameters::find(machine, observed),
    }
}

/// Points of the curve.
const CURVE_POINTS: usize = 400;

fn curve(loops: &Loops<'_>, lines_hz: &[f64]) -> Vec<[f64; 3]> {
    let (Some(low), Some(high)) = (lines_hz.first(), lines_hz.last()) else { return Vec::new() };
    let point = |place: usize| {
        let hz = low * (high / low).powf(place as f64 / CURVE_POINTS as f64);
        let open = loops.velocity_open(std::f64::consts::TAU * hz);
        [hz, decibel(open), below(open)]
    };
    (0..=CURVE_POINTS).map(point).collect()
}

fn decibel(response: Complex<f64>) -> f64 {
    20.0 * response.norm().log10()
}

/// The phase as a loop with lag has it: from 0 down to -360 degrees.
fn below(response: Complex<f64>) -> f64 {
    let degrees = response.arg().to_degrees();
    if degrees > 0.0 { degrees - 360.0 } else { degrees }
}
