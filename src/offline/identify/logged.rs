//! An axis from its logs: every parameter of its model, from the stretches that tell it, in the order in which they
//! need each other.
//!
//! ```text
//!   accelerations ──► all that moves ──► motor as a mass (the table's mass is the machine file's)
//!   steady ─────────► F_low, m, F_0
//!   reversals, ramps ──► K ──► F_max ◄──► D_v, D_v'        (twice: each of the last two needs the other)
//! ```
//!
//! Forces come from the current, so each of them is as uncertain as the torque constant: that is a term of its own
//! in their intervals, named in the source. Invariant: what its stretches do not tell is unknown, with what would
//! tell it.

use super::comparison::{Comparison, Model, Start};
use super::fall::Fall;
use super::inertia;
use super::least_squares::student95;
use super::measured::Measured;
use super::ripple::Ripple;
use super::steady::{self, Sliding, SteadyPoint};
use super::stretches::{Stretch, Stretches};
use super::{AxisFindings, Estimate, Finding, breakaway, current_loop, fall, stiffness};
use crate::base::axis::AxisId;
use crate::base::units::{Force, Velocity};
use crate::config::machine::Axis;
use crate::offline::trace::Trace;
use crate::plant::friction::Variant;

/// Slowest stretch that tells sliding friction, as long as the falling part is not known, mm/s; then a multiple of
/// its end.
const SLIDES_MM_PER_S: f64 = 0.9;
const SLIDES_RATIO: f64 = 1.3;
/// Fewest values whose scatter is an interval.
const VALUES_MIN: usize = 3;
/// How well a count of the encoder is known when the table breaks away, as half an interval: all ramps are wrong
/// alike, so their scatter does not show it. From 100 random machines with 0.1 um and 1 um.
const COUNTED: f64 = 0.2;
/// A variant is named where it leaves less than this share of what the other leaves.
const BETTER: f64 = 0.9;

/// What is believed before a log is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Half the 95 % interval of the torque constant, %.
    pub torque_constant_tolerance_percent: f64,
}

/// A log does not fit the others or the method.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum LoggedError {
    /// No log.
    #[error("no log")]
    None,
    /// Logs of different periods.
    #[error("the logs have different periods: {first_s} s and {other_s} s")]
    Periods {
        /// Of the first.
        first_s: f64,
        /// Of another.
        other_s: f64,
    },
    /// Too slow for the filters.
    #[error("a period of {period_s} s is too long, the filters need less than {needed_s} s")]
    TooSlow {
        /// Of the logs.
        period_s: f64,
        /// What would do.
        needed_s: f64,
    },
}

/// An axis as its logs tell it.
#[derive(Clone, Debug)]
pub struct LoggedAxis {
    /// Its parameters, by the keys of the machine file where it has them.
    pub findings: AxisFindings,
    /// Which variant of Eq. (1) explains reversals it was not fitted to; `None` where they do not tell.
    pub variant: Option<Variant>,
    /// Means of steady stretches.
    pub points: Vec<SteadyPoint>,
    /// The model with all that was found.
    pub model: Model,
    /// Constant force, N.
    pub offset_n: f64,
    /// A reversal of the log: time in s, measured and modelled force in N.
    pub reversal: Vec<[f64; 3]>,
    /// What was found of what, in one line.
    pub summary: String,
}

/// The work on one axis.
struct Work<'a> {
    measured: Measured,
    stretches: Stretches,
    axis: &'a Axis,
    settings: Settings,
    model: Model,
    offset_n: f64,
    ripple: Ripple,
}

impl LoggedAxis {
    /// One axis of logs of the same machine.
    ///
    /// # Errors
    /// When there is no log, or they cannot be taken together.
    pub fn identify(
        logs: &[Trace],
        id: AxisId,
        axis: &Axis,
        settings: Settings,
    ) -> Result<Self, LoggedError> {
        let mut work = Work::new(logs, id, axis, settings)?;
        Ok(work.identified())
    }
}

impl<'a> Work<'a> {
    fn new(logs: &[Trace], id: AxisId, axis: &'a Axis, settings: Settings) -> Result<Self, LoggedError> {
        let mut measured: Option<Measured> = None;
        for trace in logs {
            let Some(columns) = trace.axis(id) else { continue };
            let resolution_m = axis.scale.motor_resolution().as_m();
            let plant = &axis.plant;
            let Some(more) = Measured::new(trace, columns, &plant.mechanics, &plant.actuator, resolution_m)
            else {
                let needed_s = 0.5 / Measured::cutoff_hz_min();
                return Err(LoggedError::TooSlow { period_s: trace.period_s, needed_s });
            };
            match &mut measured {
                None => measured = Some(more),
                Some(all) if (all.period_s / more.period_s - 1.0).abs() > 1e-3 => {
                    return Err(LoggedError::Periods { first_s: all.period_s, other_s: more.period_s });
                }
                Some(all) => {
                    all.pieces.extend(more.pieces);
                    all.left_out_rows += more.left_out_rows;
                }
            }
        }
        let measured = measured.ok_or(LoggedError::None)?;
        let stretches = Stretches::of(&measured);
        let mechanics = axis.plant.mechanics;
        let model = Model { mechanics, motor_kg: mechanics.motor_mass_kg(), friction: axis.plant.friction };
        let ripple = Ripple::default();
        Ok(Self { measured, stretches, axis, settings, model, offset_n: 0.0, ripple })
    }

    fn identified(&mut self) -> LoggedAxis {
        let mut findings = AxisFindings::new();
        let mut put = |name: &str, finding: Finding| {
            findings.insert(name.to_owned(), finding);
        };
        self.ripple = Ripple::of(&self.measured, &self.stretches.steady, self.model.mechanics.lead_m);
        let (moving, inertia) = self.inertia();
        put("moving_mass", moving);
        put("total_inertia", inertia);
        let mass_kg = self.model.motor_kg + self.model.mechanics.mass_kg;
        let points = steady::points(&self.measured, &self.stretches.steady, mass_kg, &self.ripple);
        let mut sliding = steady::fit(&points, SLIDES_MM_PER_S * 1e-3).ok();
        self.take(sliding.as_ref());
        put("stiffness", self.stiffness());
        let reversals = self.reversals();
        let mut breakaway = Vec::new();
        let mut fall = None;
        for _ in 0..2 {
            breakaway = self.breakaway(&reversals);
            if let Some((mean, _)) = scatter(&breakaway) {
                self.model.friction.breakaway = Force::n(mean.max(self.model.friction.sliding.as_n()));
            }
            fall = if breakaway.len() < VALUES_MIN || sliding.is_none() || !self.measured.is_fine() {
                None
            } else {
                fall::fit(&reversals, &self.model)
            };
            if let Some(Fall { found: [end, start], end_mm_per_s: (slowest, _), .. }) = &fall {
                self.model.friction.fall_end = Velocity::mm_per_s(*end);
                self.model.friction.fall_start = Velocity::mm_per_s(*start);
                sliding = steady::fit(&points, SLIDES_RATIO * slowest * 1e-3).ok().or(sliding);
                self.take(sliding.as_ref());
            }
        }
        let held_out = fall.as_ref().and_then(|_| fall::held_out_n2(&reversals, &self.model));
        let reversal = reversals.first().map(|one| one.beside(&one.here(&self.model))).unwrap_or_default();
        if let Some(Fall { end_mm_per_s: (end, _), start_mm_per_s: (start, _), .. }) = &fall {
            self.model.friction.fall_end = Velocity::mm_per_s(*end);
            self.model.friction.fall_start = Velocity::mm_per_s(*start);
            self.take(sliding.as_ref());
        }
        self.sliding_findings(sliding.as_ref(), fall.as_ref(), &mut put);
        put("breakaway", self.breakaway_finding(&breakaway, reversals.len()));
        fall_findings(fall.as_ref(), reversals.len(), &mut put);
        self.rest_findings(&mut put);
        let variant = held_out.and_then(|[linear, nonlinear]| {
            (linear < BETTER * nonlinear)
                .then_some(Variant::Linear)
                .or((nonlinear < BETTER * linear).then_some(Variant::Nonlinear))
        });
        LoggedAxis {
            findings,
            variant,
            points,
            model: self.model,
            offset_n: self.offset_n,
            reversal,
            summary: self.summary(fall.as_ref(), held_out),
        }
    }

    /// All that moves, and what of it is the motor.
    fn inertia(&mut self) -> (Finding, Finding) {
        let masses = inertia::masses_kg(&self.measured, &self.stretches.accelerations, &self.ripple);
        let Some((mean, half)) = scatter(&masses) else {
            let needs = "at least 3 accelerations above 0.1 m/s^2 while the axis slides";
            return (Finding::unknown(needs), Finding::unknown(needs));
        };
        let mechanics = &self.model.mechanics;
        let per_kg = mechanics.travel_per_rad_m() / mechanics.force_per_torque();
        self.model.motor_kg = (mean - mechanics.mass_kg).max(0.0);
        let source = format!("{} accelerations", masses.len());
        let moving = self.of_force(Estimate::within(mean, half, "kg", source.clone()));
        // Efficiency and lead scale force and mass alike: at the shaft only the torque constant is left.
        let inertia = self.of_force(Estimate::within(mean * per_kg, half * per_kg, "kg m^2", source));
        (moving.into(), inertia.into())
    }

    fn take(&mut self, sliding: Option<&Sliding>) {
        if let Some(sliding) = sliding {
            let viscous = sliding.viscous_n_s_per_m[0].max(0.0);
            let end_m_per_s = self.model.friction.fall_end.as_m_per_s();
            self.model.friction.viscous_n_s_per_m = viscous;
            self.model.friction.sliding = Force::n(sliding.at_rest_n[0] + viscous * end_m_per_s);
            self.offset_n = sliding.offset_n[0];
        }
    }

    fn stiffness(&mut self) -> Finding {
        let mut stretches = self.stretches.reversals.clone();
        stretches.extend(self.stretches.ramps.iter().cloned());
        let values = stiffness::values_n_per_m(&self.measured, &stretches, &self.model, self.offset_n);
        let Some((mean, half)) = scatter(&values) else {
            return Finding::unknown("at least 3 reversals, or ramps against the motion before them");
        };
        self.model.mechanics.stiffness_n_per_m = mean;
        let source = format!("{} wind-ups of the screw while the table stood", values.len());
        self.of_force(Estimate::within(1e-6 * mean, 1e-6 * half, "N/um", source)).into()
    }

    fn reversals(&self) -> Vec<Comparison> {
        let new = |stretch: &Stretch| Comparison::new(&self.measured, stretch, Start::Sliding);
        self.stretches.reversals.iter().filter_map(new).collect()
    }

    fn breakaway(&self, reversals: &[Comparison]) -> Vec<f64> {
        let ramps = breakaway::of_ramps(
            &self.measured,
            &self.stretches.ramps,
            &self.model,
            self.offset_n,
            &self.ripple,
        );
        if ramps.len() < VALUES_MIN { breakaway::of_reversals(reversals, &self.model) } else { ramps }
    }

    fn breakaway_finding(&self, values: &[f64], reversals: usize) -> Finding {
        let Some((mean, half)) = scatter(values) else {
            return Finding::unknown("at least 3 slow ramps from rest, or reversals in motion");
        };
        let of = if self.stretches.ramps.len() < VALUES_MIN { reversals } else { values.len() };
        let what =
            if of == reversals && self.stretches.ramps.len() < VALUES_MIN { "reversals" } else { "ramps" };
        let coarse_n =
            COUNTED * self.axis.scale.motor_resolution().as_m() * self.model.mechanics.stiffness_n_per_m;
        let source = format!("{of} {what}");
        self.of_force(Estimate::within(mean, half.hypot(coarse_n), "N", source)).into()
    }

    fn sliding_findings(
        &self,
        sliding: Option<&Sliding>,
        fall: Option<&Fall>,
        put: &mut impl FnMut(&str, Finding),
    ) {
        let Some(Sliding { at_rest_n, viscous_n_s_per_m, offset_n, count }) = sliding else {
            let needs = "runs at constant speeds of 1 mm/s and more, both ways, at least 4";
            for name in ["sliding", "viscous", "constant_force"] {
                put(name, Finding::unknown(needs));
            }
            return;
        };
        let source = || format!("{count} runs at constant speed");
        let sliding_n = self.model.friction.sliding.as_n();
        // The line goes through the end of the fall, which is not known to the last digit either.
        let end_m_per_s = match fall {
            Some(Fall { end_mm_per_s: (_, [low, high]), .. }) => 0.5e-3 * (high - low),
            None => self.model.friction.fall_end.as_m_per_s(),
        };
        let half_n = at_rest_n[1].hypot(viscous_n_s_per_m[0] * end_m_per_s);
        put("sliding", self.of_force(Estimate::within(sliding_n, half_n, "N", source())).into());
        let [m, half] = viscous_n_s_per_m.map(|value| 1e-3 * value);
        put("viscous", self.of_force(Estimate::within(m, half, "N s/mm", source())).into());
        let offset = format!("{}; a constant force, or friction that differs by direction", source());
        put("constant_force", self.of_force(Estimate::within(offset_n[0], offset_n[1], "N", offset)).into());
    }

    /// What these methods do not tell, and the current loop.
    fn rest_findings(&self, put: &mut impl FnMut(&str, Finding)) {
        let apart = "the same log with a second load of known mass: only their sum moves";
        put("mass", Finding::unknown(apart));
        put("motor_inertia", Finding::unknown(apart));
        put("damping", Finding::unknown("a frequency response around the resonance"));
        let [lag, dead] = current_loop::findings(&self.measured, &self.stretches, self.axis);
        put("current_loop", lag);
        put("dead_time", dead);
    }

    /// The interval of a force is that of its scatter and of the torque constant.
    fn of_force(&self, estimate: Estimate) -> Estimate {
        estimate.with_scale(self.settings.torque_constant_tolerance_percent, "torque constant")
    }

    fn summary(&self, fall: Option<&Fall>, held_out: Option<[f64; 2]>) -> String {
        let Stretches { steady, ramps, reversals, accelerations } = &self.stretches;
        let mut text = format!(
            "{} steady stretches, {} ramps, {} reversals, {} accelerations; {} rows left out",
            steady.len(),
            ramps.len(),
            reversals.len(),
            accelerations.len(),
            self.measured.left_out_rows
        );
        if let Some(fall) = fall {
            text += &format!("; the model leaves {:.1} N of a reversal below 15 Hz", fall.left_n);
        }
        if let Some([linear, nonlinear]) = held_out {
            text += &format!(
                ", of reversals it has not seen {:.1} N with the nonlinear and {:.1} N with the linear variant",
                nonlinear.sqrt(),
                linear.sqrt()
            );
        }
        text
    }
}

fn fall_findings(fall: Option<&Fall>, reversals: usize, put: &mut impl FnMut(&str, Finding)) {
    let names = ["fall_end", "fall_start"];
    let Some(Fall { end_mm_per_s, start_mm_per_s, .. }) = fall else {
        let needs = "at least 3 reversals in motion (500 mm/min), runs and ramps that tell sliding and break-away \
                     force, and an encoder of 0.1 um or finer";
        for name in names {
            put(name, Finding::unknown(needs));
        }
        return;
    };
    for (name, (value, ci95)) in names.into_iter().zip([*end_mm_per_s, *start_mm_per_s]) {
        let source = format!("{reversals} reversals");
        put(name, Estimate { value, ci95, unit: "mm/s", source }.into());
    }
}

/// Mean of values and half its 95 % interval, from their scatter.
fn scatter(values: &[f64]) -> Option<(f64, f64)> {
    if values.len() < VALUES_MIN {
        return None;
    }
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    Some((mean, student95(count - 1.0) * (variance / count).sqrt()))
}
