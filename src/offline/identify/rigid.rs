//! Mass, friction and constant force of an axis by linear regression on any motion that has speed and
//! acceleration: `plant::rigid`, fitted.
//!
//! ```text
//!   position ──► low-pass ──► velocity, acceleration ──► columns ──┐
//!                                                                  ├─► low-pass, every n-th row ──► regression
//!   force ─────────────────────────────────────────────────────────┘
//! ```
//!
//! The first low-pass takes the noise that differentiation would raise; the second, through which columns and
//! force go alike, takes what the model does not have (ripple, resonance) and leaves rows that tell something
//! new each. Rows in which a filter still feels the ends are left out.
//! Invariant: a fit with the force in A tells its parameters in A; what a motor's torque constant is, is not
//! guessed.

use std::collections::BTreeMap;

use serde::Serialize;
use thiserror::Error;

use super::foreign::{Controller, Effort, Foreign, ForeignAxis};
use super::least_squares::{self, Fit, FitError};
use super::smoothing::{LowPass, derivative};
use super::{AxisFindings, Estimate, Finding};
use crate::plant::rigid::{Branch, Motion, Rigid};

/// Cut-off of the first low-pass, as a share of the rate: 100 Hz at 1 kHz.
const POSITION_SHARE: f64 = 0.1;
/// Rows kept per second, at most: rigid motion of a machine axis has nothing to tell above half of that.
const ROWS_PER_S: f64 = 100.0;
/// Cut-off of the second low-pass, as a share of the rate of the rows kept.
const KEPT_SHARE: f64 = 0.4;
/// Residuals are taken to be alike for so long, s.
const MEMORY_S: f64 = 0.2;

/// Why there is no fit.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RigidError {
    /// Not enough data for the filters.
    #[error("{duration_s:.2} s of data, the filters need more than {needed_s:.2} s")]
    TooShort {
        /// What there is.
        duration_s: f64,
        /// What would do.
        needed_s: f64,
    },
    /// A rate at which nothing can be filtered.
    #[error("{rate_hz} rows per second, at least {needed_hz} are needed")]
    TooSlow {
        /// What there is.
        rate_hz: f64,
        /// What would do.
        needed_hz: f64,
    },
    /// The regression fails.
    #[error(transparent)]
    Fit(#[from] FitError),
}

/// Whether friction may differ by direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// The same both ways, and a constant force.
    Symmetric,
    /// Each way its own; the constant force is in the difference.
    Asymmetric,
}

/// One point of the friction curve: the measured force less inertia, and the fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CurvePoint {
    /// m/s.
    pub velocity_m_per_s: f64,
    /// Measured, less mass times acceleration.
    pub measured: f64,
    /// Fitted.
    pub fitted: f64,
}

/// A fit of one shape.
#[derive(Clone, Debug, PartialEq)]
pub struct RigidFit {
    /// Which.
    pub shape: Shape,
    /// The axis.
    pub axis: Rigid,
    /// Norm of what the fit leaves over the norm of the force.
    pub relative_error: f64,
    /// Rows of the regression.
    pub rows: usize,
    /// Points of the friction curve.
    pub curve: Vec<CurvePoint>,
    fit: Fit,
    has_newtons: bool,
}

/// How far a simulation of the fitted axis under its controller is from the measurement, as the norm of the
/// difference over the norm of the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ClosedLoop {
    /// Of the position.
    pub position: f64,
    /// Of the velocity.
    pub velocity: f64,
    /// Of the force.
    pub force: f64,
}

/// Velocity, acceleration and force, filtered and thinned out.
struct Rows {
    columns: Vec<Vec<f64>>,
    force: Vec<f64>,
    /// Velocity and acceleration of the rows themselves, for the curve.
    velocity: Vec<f64>,
    acceleration: Vec<f64>,
}

/// Fit a shape to a measured axis.
///
/// # Errors
/// When the data are too short or too slow for the filters, or do not tell the parameters apart.
pub fn fit(axis: &ForeignAxis, period_s: f64, shape: Shape) -> Result<RigidFit, RigidError> {
    let rows = rows(axis, period_s, shape)?;
    let kept_s = kept_every(period_s) as f64 * period_s;
    let lag = (MEMORY_S / kept_s).round() as usize;
    let fit = least_squares::fit(&rows.columns, &rows.force, lag)?;
    let c = &fit.coefficients;
    let rigid = match shape {
        Shape::Symmetric => {
            let both = Branch { coulomb_n: c[2], viscous_n_s_per_m: c[1] };
            Rigid { mass_kg: c[0], forwards: both, backwards: both, offset_n: c[3] }
        }
        Shape::Asymmetric => {
            let branch = |k: usize| Branch { coulomb_n: c[k], viscous_n_s_per_m: c[k + 1] };
            Rigid { mass_kg: c[0], forwards: branch(1), backwards: branch(3), offset_n: 0.0 }
        }
    };
    let point = |row: usize| {
        let (velocity, acceleration) = (rows.velocity[row], rows.acceleration[row]);
        CurvePoint {
            velocity_m_per_s: velocity,
            measured: rows.force[row] - rigid.mass_kg * acceleration,
            fitted: rigid.force_n(velocity, 0.0),
        }
    };
    Ok(RigidFit {
        shape,
        axis: rigid,
        relative_error: fit.relative_error,
        rows: rows.force.len(),
        curve: (0..rows.force.len()).map(point).collect(),
        fit,
        has_newtons: matches!(axis.effort, Effort::Force(_)),
    })
}

fn kept_every(period_s: f64) -> usize {
    (1.0 / (period_s * ROWS_PER_S)).round().max(1.0) as usize
}

fn rows(axis: &ForeignAxis, period_s: f64, shape: Shape) -> Result<Rows, RigidError> {
    let rate_hz = 1.0 / period_s;
    let every = kept_every(period_s);
    let too_slow = RigidError::TooSlow { rate_hz, needed_hz: 2.5 * ROWS_PER_S };
    if rate_hz < 2.5 * ROWS_PER_S {
        return Err(too_slow);
    }
    let first = LowPass::new(POSITION_SHARE * rate_hz, rate_hz).ok_or_else(|| too_slow.clone())?;
    let second = LowPass::new(KEPT_SHARE * rate_hz / every as f64, rate_hz).ok_or(too_slow)?;
    let ends = second.memory_rows();
    let length = axis.position_m.len();
    if length < 4 * ends {
        let (duration_s, needed_s) = (length as f64 * period_s, 4.0 * ends as f64 * period_s);
        return Err(RigidError::TooShort { duration_s, needed_s });
    }
    let velocity = derivative(&first.smooth(&axis.position_m), period_s);
    let acceleration = derivative(&velocity, period_s);
    let thinned = |column: &[f64]| -> Vec<f64> {
        second.smooth(column)[ends..length - ends].iter().copied().step_by(every).collect()
    };
    let column = |of: fn(f64) -> f64| thinned(&velocity.iter().copied().map(of).collect::<Vec<_>>());
    let mass = thinned(&acceleration);
    let columns = match shape {
        Shape::Symmetric => vec![mass, column(|v| v), column(sign), column(|_| 1.0)],
        Shape::Asymmetric => vec![
            mass,
            column(|v| f64::from(v > 0.0)),
            column(|v| v.max(0.0)),
            column(|v| -f64::from(v < 0.0)),
            column(|v| v.min(0.0)),
        ],
    };
    Ok(Rows {
        columns,
        force: thinned(axis.effort.values()),
        velocity: thinned(&velocity),
        acceleration: thinned(&acceleration),
    })
}

fn sign(velocity: f64) -> f64 {
    if velocity == 0.0 { 0.0 } else { velocity.signum() }
}

impl RigidFit {
    /// Units of mass, viscous friction and force.
    pub const fn units(&self) -> [&'static str; 3] {
        if self.has_newtons { ["kg", "N s/m", "N"] } else { ["A s^2/m", "A s/m", "A"] }
    }

    /// The parameters by name.
    pub fn findings(&self, data: &str) -> AxisFindings {
        let units = self.units();
        let names: &[(&str, usize)] = match self.shape {
            Shape::Symmetric => {
                &[("mass", 0), ("viscous_friction", 1), ("coulomb_friction", 2), ("constant_force", 2)]
            }
            Shape::Asymmetric => &[
                ("mass", 0),
                ("coulomb_friction_forwards", 2),
                ("viscous_friction_forwards", 1),
                ("coulomb_friction_backwards", 2),
                ("viscous_friction_backwards", 1),
            ],
        };
        let source = format!("{data}: regression over {} rows", self.rows);
        let finding = |(place, (name, unit)): (usize, &(&str, usize))| {
            let (value, half) = (self.fit.coefficients[place], self.fit.half_width95[place]);
            ((*name).to_owned(), Finding::from(Estimate::within(value, half, units[*unit], source.as_str())))
        };
        names.iter().enumerate().map(finding).collect()
    }

    /// The axis under its controller, against the measurement. `None` without controller, setpoint or forces
    /// in N.
    pub fn closed_loop(&self, measured: &ForeignAxis, period_s: f64) -> Option<ClosedLoop> {
        let controller = measured.controller?;
        let setpoint = measured.setpoint_m.as_deref()?;
        let Effort::Force(force) = &measured.effort else { return None };
        let simulated = simulate(&self.axis, &controller, setpoint, measured.position_m[0], period_s);
        // Both through the same filter: the measured velocity has to be made of counts.
        let low_pass = LowPass::new(POSITION_SHARE / period_s, 1.0 / period_s)?;
        let velocity = |position: &[f64]| derivative(&low_pass.smooth(position), period_s);
        Some(ClosedLoop {
            position: difference(&simulated.position, &measured.position_m),
            velocity: difference(&velocity(&simulated.position), &velocity(&measured.position_m)),
            force: difference(&simulated.force, force),
        })
    }
}

struct Simulated {
    position: Vec<f64>,
    force: Vec<f64>,
}

/// Position P and velocity P from sampled positions; the velocity is that of the last two.
fn simulate(
    axis: &Rigid,
    controller: &Controller,
    setpoint_m: &[f64],
    start_m: f64,
    period_s: f64,
) -> Simulated {
    let mut motion = Motion { position_m: start_m, velocity_m_per_s: 0.0 };
    let mut last_m = start_m;
    let mut simulated = Simulated { position: Vec::new(), force: Vec::new() };
    for wanted_m in setpoint_m {
        let velocity = (motion.position_m - last_m) / period_s;
        last_m = motion.position_m;
        let command = controller.position_gain_per_s * (wanted_m - motion.position_m);
        let force = controller.velocity_gain_n_s_per_m * (command - velocity);
        let force = force.clamp(-controller.force_limit_n, controller.force_limit_n);
        simulated.position.push(motion.position_m);
        simulated.force.push(force);
        motion = axis.step(motion, force, period_s);
    }
    simulated
}

/// Norm of the difference over the norm of what was measured.
fn difference(simulated: &[f64], measured: &[f64]) -> f64 {
    let square = |sum: f64, value: f64| sum + value * value;
    let off = simulated.iter().zip(measured).map(|(a, b)| a - b).fold(0.0, square);
    (off / measured.iter().copied().fold(0.0, square)).sqrt()
}

/// What a measured axis is found to be, without and with a difference between the directions.
#[derive(Clone, Debug, PartialEq)]
pub struct RigidAxis {
    /// The same friction both ways.
    pub symmetric: RigidFit,
    /// Each way its own.
    pub asymmetric: RigidFit,
    /// The asymmetric axis under its controller, if that is known.
    pub closed_loop: Option<ClosedLoop>,
}

impl RigidAxis {
    /// Fit every axis of the measurements.
    ///
    /// # Errors
    /// When the data of an axis do not tell it; named.
    pub fn identify(foreign: &Foreign) -> Result<BTreeMap<String, Self>, AxisError> {
        let one = |axis: &ForeignAxis| -> Result<Self, RigidError> {
            let symmetric = fit(axis, foreign.period_s, Shape::Symmetric)?;
            let asymmetric = fit(axis, foreign.period_s, Shape::Asymmetric)?;
            let closed_loop = asymmetric.closed_loop(axis, foreign.period_s);
            Ok(Self { symmetric, asymmetric, closed_loop })
        };
        let named = |(name, axis): (&String, &ForeignAxis)| match one(axis) {
            Ok(found) => Ok((name.clone(), found)),
            Err(cause) => Err(AxisError { axis: name.clone(), cause }),
        };
        foreign.axes.iter().map(named).collect()
    }

    /// The parameters of both fits by name; the mass is that of the symmetric one.
    pub fn findings(&self, data: &str) -> AxisFindings {
        let mut findings = self.asymmetric.findings(data);
        findings.extend(self.symmetric.findings(data));
        findings
    }

    /// How well the fits explain the force, and the simulation the record, in one line.
    pub fn summary(&self) -> String {
        let percent = |share: f64| 100.0 * share;
        let mut text = format!(
            "relative force error {:.2} % with symmetric friction, {:.2} % with friction by direction",
            percent(self.symmetric.relative_error),
            percent(self.asymmetric.relative_error)
        );
        if let Some(ClosedLoop { position, velocity, force }) = self.closed_loop {
            text += &format!(
                "; simulated under its controller: position {:.4} %, velocity {:.3} %, force {:.2} %",
                percent(position),
                percent(velocity),
                percent(force)
            );
        }
        text
    }
}

/// An axis whose data do not tell it.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("axis {axis}: {cause}")]
pub struct AxisError {
    /// Which.
    pub axis: String,
    /// Why.
    pub cause: RigidError,
}
