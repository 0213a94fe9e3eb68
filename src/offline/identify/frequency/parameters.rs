//! What a frequency response tells of an axis.
//!
//! ```text
//!   G = I / U      current loop and the delay before it: the sampled answer of a first-order lag
//!   P = V / U      with those known: both inertias, stiffness and damping of the screw, age of the encoders
//! ```
//!
//! Forces come from torques by the torque constant and the efficiency of the machine file, and are wrong as those
//! are; so is the mass. What the estimate of the velocity does is known: it is our own. Viscous friction turns the
//! lowest lines as an age of the encoders would, the other way; it is taken as the machine has it.
//! Invariant: what the lines do not tell within half of its value is not told at all.

use std::f64::consts::{SQRT_2, TAU};

use nalgebra::{Complex, DMatrix, DVector};

use super::descent::{Descent, fit};
use super::spectra::{Observed, Spectrum};
use crate::base::time::Span;
use crate::config::Machine;
use crate::config::machine::Axis;
use crate::offline::identify::least_squares::student95;
use crate::offline::identify::{AxisFindings, Estimate, Finding};
use crate::offline::loops::hold;
use crate::plant::response::{delay, sliding_speed_per_torque};
use crate::plant::{Actuator, Mechanics, Parameters};

/// Error of the models themselves, as a share: images of the spectrum around the sampling rate. With 0.1 % the
/// truth was in 90 of 100 intervals of the total inertia, with 0.3 % in all (`tests/frequency_response.rs`).
const MODEL_STD: f64 = 1.5e-3;
/// Lines above this share of the sampling rate have too much of those.
const RATE_SHARE: f64 = 0.1;
/// A value is told when its interval is not wider than this share of it, each side.
const KNOWN_SHARE: f64 = 0.5;
/// A delay is told when its interval is not wider than this, each side, s.
const KNOWN_S: f64 = 150e-6;

/// The current loop and the delay before it.
#[derive(Clone, Copy, Debug)]
struct CurrentLoop {
    delay_s: f64,
    hz: f64,
}

impl CurrentLoop {
    /// Its parameters, about one: delay in ms, logarithm of the bandwidth in Hz.
    fn of(parameters: &DVector<f64>) -> Self {
        Self { delay_s: parameters[0] * 1e-3, hz: parameters[1].exp() }
    }

    /// Measured current per command, both sampled at the SYNC: exact for a command held over the tick.
    fn response(&self, tick_s: f64, omega: f64) -> Complex<f64> {
        let ticks = (self.delay_s / tick_s).max(0.0);
        let (whole, part) = (ticks.floor(), ticks.fract());
        let kept = (-TAU * self.hz * tick_s).exp();
        let kept_after = kept.powf(1.0 - part);
        let z = Complex::from_polar(1.0, omega * tick_s);
        let back = Complex::from_polar(1.0, -omega * tick_s * whole);
        back * (z.inv() * (kept_after - kept) + (1.0 - kept_after)) / (z - kept)
    }
}

/// What was found of an axis, and what was not with what it needs.
pub(super) fn find(machine: &Machine, observed: &Observed) -> AxisFindings {
    let axis = &machine.axes[observed.axis];
    let tick = machine.cycle.period;
    let mean = observed.mean();
    let data = Data { axis, tick, observed, mean: &mean };
    let mut findings = AxisFindings::new();
    let current_loop = data.current_loop();
    let source = data.source("current command to measured current");
    let needs =
        "the answer of the measured current to its command: lines up to the bandwidth of the current loop";
    let told = |of: fn(&CurrentLoop) -> f64, unit, bound: Bound| {
        let value = current_loop.as_ref().map(|found| found.value(|at| of(&CurrentLoop::of(at))));
        finding(value, current_loop.as_ref(), unit, &source, bound, needs)
    };
    findings.insert("current_loop".to_owned(), told(|found| found.hz, "Hz", Bound::Share));
    let delay = told(|found| found.delay_s * 1e6, "us", Bound::Most(KNOWN_S * 1e6));
    findings.insert("command_delay".to_owned(), delay);

    let mechanics = current_loop.as_ref().and_then(|found| data.mechanics(found));
    let source = data.source(&format!(
        "current command to speed, torque constant {} N m/A, efficiency {}",
        axis.control.axis.actuator.torque_constant_nm_per_a, axis.control.axis.mechanics.efficiency
    ));
    let needs = "an excitation around the frequency at which motor and table swing against each other";
    type Part = (&'static str, fn(&Mechanics) -> f64, &'static str);
    let parts: [Part; 5] = [
        ("total_inertia", Mechanics::total_inertia_kg_m2, "kg m^2"),
        ("motor_inertia", |mechanics| mechanics.inertia_kg_m2, "kg m^2"),
        ("mass", |mechanics| mechanics.mass_kg, "kg"),
        ("stiffness", |mechanics| mechanics.stiffness_n_per_m * 1e-6, "N/um"),
        ("damping", |mechanics| mechanics.damping_n_s_per_m * 1e-3, "N s/mm"),
    ];
    for (name, of, unit) in parts {
        let value = mechanics.as_ref().map(|found| found.value(|at| of(&swinging(axis, at))));
        let told = finding(value, mechanics.as_ref(), unit, &source, Bound::Share, needs);
        findings.insert(name.to_owned(), told);
    }
    let age = mechanics.as_ref().map(|found| found.value(|at| at[4] * 1e3));
    let told = finding(age, mechanics.as_ref(), "us", &source, Bound::Most(KNOWN_S * 1e6), needs);
    findings.insert("feedback_latency".to_owned(), told);
    findings
}

/// When a value is told.
enum Bound {
    /// Its interval is narrow against it.
    Share,
    /// Its interval is narrower than this, each side.
    Most(f64),
}

fn finding(
    value: Option<(f64, f64)>,
    fit: Option<&Descent>,
    unit: &'static str,
    source: &str,
    bound: Bound,
    needs: &str,
) -> Finding {
    let (Some((value, std)), Some(fit)) = (value, fit) else { return Finding::unknown(needs) };
    let half_width = student95(fit.freedom as f64) * std;
    let most = match bound {
        Bound::Share => KNOWN_SHARE * value.abs(),
        Bound::Most(most) => most,
    };
    if half_width <= most {
        Estimate::within(value, half_width, unit, source).into()
    } else {
        Finding::unknown(format!("{needs}; here it is {value:.3} {unit} give or take {half_width:.3}"))
    }
}

/// Motor and table from the parameters of their fit: logarithms of total inertia, share ratio, stiffness and
/// damping, and the age of the encoders in ms.
fn swinging(axis: &Axis, parameters: &DVector<f64>) -> Mechanics {
    let nominal = axis.control.axis.mechanics;
    let total = parameters[0].exp();
    let of_motor = 1.0 / (1.0 + (-parameters[1]).exp());
    Mechanics {
        inertia_kg_m2: total * of_motor,
        mass_kg: total * (1.0 - of_motor) * nominal.force_per_torque() / nominal.travel_per_rad_m(),
        stiffness_n_per_m: parameters[2].exp(),
        damping_n_s_per_m: parameters[3].exp(),
        ..nominal
    }
}

struct Data<'a> {
    axis: &'a Axis,
    tick: Span,
    observed: &'a Observed,
    mean: &'a [Spectrum],
}

impl Data<'_> {
    fn source(&self, what: &str) -> String {
        let lines = self.observed.frequencies_hz();
        let [low, high] = [lines.first(), lines.last()].map(|hz| hz.copied().unwrap_or(f64::NAN));
        let (count, periods) = (lines.len(), self.observed.periods.len());
        format!("{what}: {count} lines from {low:.0} to {high:.0} Hz in {periods} periods")
    }

    /// Weighted differences of a model from a measured response, as shares of it, for the lines in reach.
    fn fit(
        &self,
        measured: fn(&Spectrum) -> Complex<f64>,
        model: impl Fn(&DVector<f64>, f64) -> Complex<f64>,
        start: DVector<f64>,
    ) -> Option<Descent> {
        let scatter = self.observed.scatter(measured);
        let highest_hz = RATE_SHARE / self.tick.as_s();
        let frequencies = self.observed.frequencies_hz();
        let rows: Vec<(f64, Complex<f64>, f64)> = (frequencies.iter().zip(self.mean).zip(scatter))
            .filter(|((hz, _), _)| **hz <= highest_hz)
            .map(|((hz, line), scatter)| {
                let response = measured(line);
                // The scatter is that of both parts of a complex number together.
                let of_part = scatter / (SQRT_2 * response.norm());
                (TAU * hz, response, of_part.hypot(MODEL_STD))
            })
            .collect();
        let residuals = |at: &DVector<f64>| {
            let both = rows.iter().flat_map(|(omega, response, std)| {
                let off = (model(at, *omega) / response - 1.0) / *std;
                [off.re, off.im]
            });
            DVector::from_vec(both.collect())
        };
        fit(residuals, start)
    }

    fn current_loop(&self) -> Option<Descent> {
        let tick_s = self.tick.as_s();
        let actuator = &self.axis.control.axis.actuator;
        let delay = self.axis.sheet.command_delay(self.tick) + actuator.dead_time;
        // Off the edge of a tick, where the derivative of the delay has two values.
        let start = DVector::from_vec(vec![delay.as_s() * 1e3 + 0.02, actuator.current_loop_hz.ln()]);
        let model = |at: &DVector<f64>, omega: f64| CurrentLoop::of(at).response(tick_s, omega);
        self.fit(Spectrum::actuator, model, start)
    }

    /// Motor, table and screw, as unsure as the lines and the current loop leave them.
    fn mechanics(&self, current_loop: &Descent) -> Option<Descent> {
        let mut found = self.mechanics_behind(&current_loop.parameters, self.nominal())?;
        let moved = (0..current_loop.parameters.len()).map(|place| {
            let std = current_loop.covariance[(place, place)].sqrt();
            let mut other = current_loop.parameters.clone();
            other[place] += std;
            let beside = self.mechanics_behind(&other, found.parameters.clone())?;
            Some((beside.parameters - &found.parameters) / std)
        });
        let moved = DMatrix::from_columns(&moved.collect::<Option<Vec<_>>>()?);
        found.covariance += &moved * &current_loop.covariance * moved.transpose();
        Some(found)
    }

    /// The parameters of [`swinging`] as the machine file has them.
    fn nominal(&self) -> DVector<f64> {
        let axis = self.axis;
        let nominal = axis.control.axis.mechanics;
        let total = nominal.total_inertia_kg_m2();
        let of_table = total - nominal.inertia_kg_m2;
        DVector::from_vec(vec![
            total.ln(),
            (nominal.inertia_kg_m2 / of_table).ln(),
            nominal.stiffness_n_per_m.ln(),
            nominal.damping_n_s_per_m.max(1.0).ln(),
            axis.feedback_latency.as_s() * 1e3,
        ])
    }

    /// Motor, table and screw behind a current loop that is known.
    fn mechanics_behind(&self, current_loop: &DVector<f64>, start: DVector<f64>) -> Option<Descent> {
        let (axis, current_loop) = (self.axis, CurrentLoop::of(current_loop));
        let nominal = axis.control.axis.mechanics;
        let actuator = Actuator {
            current_loop_hz: current_loop.hz,
            filter_s: 0.0,
            dead_time: Span::ZERO,
            ..axis.control.axis.actuator
        };
        let (per_a, m_per_rad) = (actuator.torque_constant_nm_per_a, nominal.travel_per_rad_m());
        let model = |at: &DVector<f64>, omega: f64| {
            let candidate = Parameters { mechanics: swinging(axis, at), actuator, ..axis.control.axis };
            let waits = delay(current_loop.delay_s + at[4] * 1e-3, omega) * hold(self.tick.as_s(), omega);
            let seen = axis.velocity_estimate.response(self.tick, omega);
            sliding_speed_per_torque(&candidate, omega) * waits * seen * (per_a * m_per_rad)
        };
        self.fit(Spectrum::plant, model, start)
    }
}
