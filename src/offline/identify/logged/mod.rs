//! An axis from its logs: every parameter of its model, from the stretches that tell it, in the order in which they
//! need each other.
//!
//! ```text
//!   accelerations ──► all that moves ──► motor as a mass (the table's mass is the machine file's)
//!   steady ─────────► F_low, m, F_0
//!   reversals, ramps ──► K ──► F_max ──► D_v, D_v' ──► F_low again, where the line ends
//! ```
//!
//! Forces come from the current, so each of them is as uncertain as the torque constant: that is a term of its own
//! in their intervals, named in the source. Invariant: what its stretches do not tell is unknown, with what would
//! tell it.

mod findings;

use super::comparison::{Comparison, Model, Start};
use super::fall::known::{Known, Uncertainty};
use super::fall::passage::Believed;
use super::fall::ramp::Ramp;
use super::fall::reversal::Reversal;
use super::fall::{Depth, Evidence, Falls};
use super::inertia;
use super::least_squares::student95;
use super::measured::Measured;
use super::ripple::Ripple;
use super::steady::{self, Sliding, SteadyPoint};
use super::stretches::{Stretch, Stretches};
use super::{AxisFindings, Estimate, Finding, breakaway, current_loop, stiffness};
use crate::base::axis::AxisId;
use crate::base::time::Span;
use crate::base::units::Force;
use crate::config::machine::Axis;
use crate::offline::trace::Trace;
use crate::plant::effects::Effects;
use crate::plant::friction::Variant;
use crate::plant::{Actuator, Parameters};
use findings::{fall_findings, rest_findings};

/// Slowest stretch that tells sliding friction, as long as the falling part is not known, mm/s; then a multiple of
/// the last speed at which it may end: one run that still chatters draws the whole line to itself.
const SLIDES_MM_PER_S: f64 = 0.9;
const SLIDES_RATIO: f64 = 1.4;
/// Fewest values whose scatter is an interval.
const VALUES_MIN: usize = 3;
/// How well a count of the encoder is known when the table breaks away, as half an interval: all ramps are wrong
/// alike, so their scatter does not show it. From 100 random machines with 0.1 um and 1 um.
const COUNTED: f64 = 0.2;
/// Regions that are looked at for the falling part before sliding is taken again with it, and after; how much of the log
/// for each. Where to look is told by little, and what is there by all that tells more.
const LOOKS: [(usize, Depth); 2] =
    [(2, Depth { reversals: 2, ramps: 1, draws: 100 }), (2, Depth { reversals: 6, ramps: 4, draws: 120 })];
/// Half of a 95 % interval in standard deviations.
const OF_95: f64 = 1.96;

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
    actuator: Actuator,
    uncertainty: Uncertainty,
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
        let uncertainty = Uncertainty {
            torque_constant: 0.01 * settings.torque_constant_tolerance_percent / OF_95,
            ..Uncertainty::default()
        };
        let ripple = Ripple::of(&measured, &stretches.steady, &model);
        Ok(Self {
            measured,
            stretches,
            axis,
            settings,
            model,
            offset_n: 0.0,
            ripple,
            actuator: axis.plant.actuator,
            uncertainty,
        })
    }

    fn identified(&mut self) -> LoggedAxis {
        let mut findings = AxisFindings::new();
        let mut put = |name: &str, finding: Finding| {
            findings.insert(name.to_owned(), finding);
        };
        let (mut points, mut sliding) = (Vec::new(), None);
        // Twice: a ripple is a share of friction, and found less what the mass does.
        for _ in 0..2 {
            let (moving, inertia) = self.inertia();
            put("moving_mass", moving);
            put("total_inertia", inertia);
            let (steady, moving_kg) = (&self.stretches.steady, self.model.moving_kg());
            points = steady::points(&self.measured, steady, moving_kg, &self.ripple);
            sliding = steady::fit(&points, SLIDES_MM_PER_S * 1e-3).ok();
            self.take(sliding.as_ref());
            self.ripple = Ripple::of(&self.measured, &self.stretches.steady, &self.model);
        }
        put("stiffness", self.stiffness());
        let [lag, dead] = current_loop::findings(&self.measured, &self.stretches, self.axis);
        self.take_current_loop([&lag, &dead]);
        put("current_loop", lag);
        put("dead_time", dead);
        let comparisons = self.comparisons();
        let mut breakaway = self.breakaway(&comparisons);
        let mut falls: Option<Falls> = None;
        for (looks, depth) in LOOKS {
            let is_known = self.take_breakaway(&breakaway) && sliding.is_some();
            let Some(evidence) = self.evidence(depth).filter(|_| is_known) else { break };
            let falls = falls.get_or_insert_default();
            falls.look(&evidence, &self.known(), looks);
            if falls.best().is_explained() {
                falls.best().put(&mut self.model.friction);
            }
            if let Some(end) = falls.best().end_mm_per_s() {
                sliding = steady::fit(&points, SLIDES_RATIO * end.ci95[1] * 1e-3).ok().or(sliding);
            }
            self.take(sliding.as_ref());
            breakaway = self.breakaway(&comparisons);
        }
        self.take_breakaway(&breakaway);
        if let Some(falls) = falls.as_mut().filter(|falls| falls.may_be_a_drop()) {
            for (looks, depth) in LOOKS {
                if let Some(evidence) = self.evidence(depth) {
                    falls.look_for_a_drop(&evidence, &self.known(), looks);
                }
            }
        }
        let best = falls.as_ref().map(Falls::best);
        if let Some(best) = best.filter(|best| best.is_explained()) {
            best.put(&mut self.model.friction);
        }
        let evidence = self.evidence(LOOKS[1].1);
        self.sliding_findings(sliding.as_ref(), best, &mut put);
        self.breakaway_findings(&breakaway, comparisons.len(), best, &mut put);
        fall_findings(best, evidence.as_ref().map_or(0, Evidence::count), &mut put);
        rest_findings(&mut put);
        LoggedAxis {
            findings,
            variant: falls.as_ref().and_then(Falls::variant),
            points,
            model: self.model,
            offset_n: self.offset_n,
            reversal: evidence.map(|all| all.first().beside(&self.known().axis)).unwrap_or_default(),
            summary: self.summary(falls.as_ref()),
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
        self.uncertainty.moving_kg = half / OF_95;
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
            self.uncertainty.sliding_n = sliding.at_rest_n[1] / OF_95;
            self.uncertainty.viscous_n_s_per_m = sliding.viscous_n_s_per_m[1] / OF_95;
        }
    }

    /// The current loop; its dead time where it is not that of the machine file.
    fn take_current_loop(&mut self, [lag, dead]: [&Finding; 2]) {
        if let Some(Estimate { value, ci95: [low, high], .. }) = lag.estimate() {
            self.actuator.current_loop_hz = *value;
            self.uncertainty.current_loop = 0.5 * (high - low) / (OF_95 * value);
        }
        if let Some(Estimate { value, ci95: [low, high], .. }) = dead.estimate()
            && !(*low..=*high).contains(&(1e6 * self.actuator.dead_time.as_s()))
        {
            self.actuator.dead_time = Span::s(1e-6 * value.max(0.0));
        }
    }

    /// The break-away force; whether there is one.
    fn take_breakaway(&mut self, values: &[f64]) -> bool {
        let Some((mean, half)) = scatter(&sizes(values)) else { return false };
        self.model.friction.breakaway = Force::n(mean.max(self.model.friction.sliding.as_n()));
        self.uncertainty.breakaway_n = half.hypot(self.coarse_n()) / OF_95;
        self.uncertainty.place = between_places_n(values) / mean;
        true
    }

    /// How well a count of the encoder leaves the break-away force known, as half an interval, N.
    fn coarse_n(&self) -> f64 {
        COUNTED * self.axis.scale.motor_resolution().as_m().abs() * self.model.mechanics.stiffness_n_per_m
    }

    /// The axis as far as it is known.
    fn known(&self) -> Known {
        let mut axis = *self.axis;
        axis.plant = Parameters {
            mechanics: self.model.mechanics,
            friction: self.model.friction,
            actuator: self.actuator,
            effects: Effects::NONE,
        };
        let mechanics = &mut axis.plant.mechanics;
        mechanics.inertia_kg_m2 =
            self.model.motor_kg * mechanics.travel_per_rad_m() / mechanics.force_per_torque();
        Known { axis, uncertainty: self.uncertainty }
    }

    fn stiffness(&mut self) -> Finding {
        let mut stretches = self.stretches.reversals.clone();
        stretches.extend(self.stretches.ramps.iter().cloned());
        let values = stiffness::values_n_per_m(&self.measured, &stretches, &self.model, self.offset_n);
        let Some((mean, half)) = scatter(&values) else {
            return Finding::unknown("at least 3 reversals, or ramps against the motion before them");
        };
        self.model.mechanics.stiffness_n_per_m = mean;
        self.uncertainty.stiffness_n_per_m = half / OF_95;
        let source = format!("{} wind-ups of the screw while the table stood", values.len());
        self.of_force(Estimate::within(1e-6 * mean, 1e-6 * half, "N/um", source)).into()
    }

    /// What tells the falling part.
    fn evidence(&self, depth: Depth) -> Option<Evidence> {
        let plant = self.known().axis.plant;
        let believed =
            Believed { axis: self.axis, plant: &plant, ripple: &self.ripple, offset_n: self.offset_n };
        let reversal = |stretch: &Stretch| Reversal::new(&self.measured, stretch, &believed);
        let reversals: Vec<Reversal> = self.stretches.reversals.iter().filter_map(reversal).collect();
        let ramp = |stretch: &Stretch| Ramp::new(&self.measured, stretch, &believed);
        let ramps: Vec<Ramp> = self.stretches.ramps.iter().filter_map(ramp).collect();
        Evidence::new(&reversals, &ramps, depth, self.measured.period_s)
    }

    fn comparisons(&self) -> Vec<Comparison> {
        let new = |stretch: &Stretch| Comparison::new(&self.measured, stretch, Start::Sliding);
        self.stretches.reversals.iter().filter_map(new).collect()
    }

    /// Break-away forces, those of ramps with the sign of their way.
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

    /// The interval of a force is that of its scatter and of the torque constant.
    fn of_force(&self, estimate: Estimate) -> Estimate {
        estimate.with_scale(self.settings.torque_constant_tolerance_percent, "torque constant")
    }
}

/// Standard deviation of values of one way from each other: friction may differ by direction.
fn between_places_n(values: &[f64]) -> f64 {
    let of_way =
        |way: f64| -> Vec<f64> { values.iter().copied().filter(|value| value * way > 0.0).collect() };
    let (mut square, mut freedom) = (0.0, 0.0);
    for values in [of_way(1.0), of_way(-1.0)].iter().filter(|values| values.len() > 1) {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        square += values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        freedom += (values.len() - 1) as f64;
    }
    if freedom > 0.0 { (square / freedom).sqrt() } else { 0.0 }
}

/// Values without the sign of their way.
fn sizes(values: &[f64]) -> Vec<f64> {
    values.iter().map(|value| value.abs()).collect()
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
