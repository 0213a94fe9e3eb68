//! The experiments that tell what an axis is: which motions, how far, how fast, in which order.
//!
//! | purpose | motions of one axis at a time | tells |
//! |---|---|---|
//! | frequency response | a slow line each way, excited | inertia, delays, screw |
//! | inertia | lines to and fro with steep ends | total inertia |
//! | steady friction | lines to and fro over a ladder of speeds, a turn of the screw each | sliding, viscous |
//! | break-away | creeping lines both ways, from rest, at several places | break-away force, stiffness |
//! | reversal | circles, or lines to and fro where there is one axis | the fall of friction |
//!
//! A run is long enough for the position loop to settle and for something to be measured after it; where the
//! travel has no room for that, the run is left out and said so.
//! Invariant: no step leaves the travel or passes a limit of the machine file; what a step does is known before
//! anything moves.

pub(in crate::offline) mod draft;
pub(in crate::offline) mod reversals;

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Value, json};

use crate::base::axis::AxisId;
use crate::base::units::{Position, Velocity};
use crate::config::Machine;
use crate::config::machine::AXIS_NAMES;
use crate::config::plan::PlanError;
use crate::rt::cycle::procedure::{Programme, Step};
use draft::Draft;

/// What a step is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Purpose {
    /// On the way to the next.
    Positioning,
    /// Gain, delays and resonance of the velocity loop.
    FrequencyResponse,
    /// Torque against acceleration.
    Inertia,
    /// Force against speed.
    SteadyFriction,
    /// Force at which a standing table tears loose.
    BreakAway,
    /// Friction through a change of direction.
    Reversal,
}

impl Purpose {
    /// In words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Positioning => "positioning",
            Self::FrequencyResponse => "frequency response",
            Self::Inertia => "inertia",
            Self::SteadyFriction => "steady friction",
            Self::BreakAway => "break-away",
            Self::Reversal => "reversal",
        }
    }
}

/// A step with what it is for and what it does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planned {
    /// The step.
    pub step: Step,
    /// What for.
    pub purpose: Purpose,
    /// Which axis it is for; `None`: for both of a circle.
    pub axis: Option<AxisId>,
    /// Along its path.
    pub way: Position,
    /// Along its path.
    pub top_speed: Velocity,
    /// How long it takes, coming to rest included, s.
    pub duration_s: f64,
}

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Name of the gain set.
    pub gains: String,
    /// The axes; empty: all of them.
    pub axes: Vec<AxisId>,
}

impl Request {
    /// The axes of a machine that are asked for.
    pub fn axes_of(&self, machine: &Machine) -> Vec<AxisId> {
        machine.axes.axes().filter(|axis| self.axes.is_empty() || self.axes.contains(axis)).collect()
    }
}

/// All experiments of a machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Gain set of every axis.
    pub gain_set: u8,
    /// In order.
    pub steps: Vec<Planned>,
    /// What was left out, and why.
    pub left_out: Vec<String>,
}

impl Plan {
    /// The experiments that a machine allows.
    ///
    /// # Errors
    /// When there is no such gain set.
    pub fn of(machine: &Machine, request: &Request) -> Result<Self, PlanError> {
        let gain_set = machine.planned_gain_set(&request.gains)?;
        let axes = request.axes_of(machine);
        let mut draft = Draft::new(machine, gain_set);
        for axis in &axes {
            draft.of_axis(*axis);
        }
        if axes.contains(&AxisId::X) && axes.contains(&AxisId::Y) {
            draft.circles(&request.gains);
        } else {
            axes.iter().for_each(|axis| draft.swings(*axis));
        }
        for axis in axes {
            draft.go(axis, Position::ZERO);
        }
        Ok(draft.plan)
    }

    /// How long it takes, s.
    pub fn duration_s(&self) -> f64 {
        self.steps.iter().map(|planned| planned.duration_s).sum()
    }

    /// What the cycle does.
    pub fn programme(&self) -> Programme {
        Programme { gain_set: self.gain_set, steps: self.steps.iter().map(|planned| planned.step).collect() }
    }

    /// The motions by their number in the log.
    pub fn motions(&self) -> BTreeMap<u32, Value> {
        let motions = self.steps.iter().filter(|planned| planned.step.is_motion());
        (1..).zip(motions).map(|(number, planned)| (number, planned.description())).collect()
    }

    /// Steps of each purpose: how many motions, how far, how fast, how long.
    pub fn summary(&self) -> BTreeMap<Purpose, Part> {
        let mut parts = BTreeMap::<Purpose, Part>::new();
        for planned in &self.steps {
            let part = parts.entry(planned.purpose).or_default();
            part.motions += usize::from(planned.step.is_motion());
            part.way_mm += planned.way.as_mm();
            part.top_speed_mm_per_s = part.top_speed_mm_per_s.max(planned.top_speed.as_mm_per_s());
            part.duration_s += planned.duration_s;
        }
        parts
    }

    /// Lowest and highest place that an axis is sent to.
    pub fn reach(&self, axis: AxisId) -> (Position, Position) {
        self.programme().reach(axis)
    }
}

/// All steps of one purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Part {
    /// How many motions.
    pub motions: usize,
    /// Along their paths.
    pub way_mm: f64,
    /// Along their paths.
    pub top_speed_mm_per_s: f64,
    /// How long they take.
    pub duration_s: f64,
}

impl Planned {
    /// As the header of the log tells it.
    fn description(&self) -> Value {
        let axis = self.axis.map(|axis| AXIS_NAMES[axis.index()]);
        let mut said = match &self.step {
            Step::Line(way) | Step::Excited { way, .. } => json!({
                "kind": "line",
                "target_mm": way.target.map(|target| target.map(Position::as_mm)),
                "feed_mm_per_s": way.feed.as_mm_per_s(),
                "acceleration_m_per_s2": way.acceleration.as_m_per_s2(),
            }),
            Step::Circle(motion) => json!({
                "kind": "circle",
                "direction": motion.circle.direction,
                "centre_x_mm": motion.circle.centre_x.as_mm(),
                "centre_y_mm": motion.circle.centre_y.as_mm(),
                "radius_mm": motion.circle.radius.as_mm(),
                "feed_mm_per_min": motion.circle.feed.as_mm_per_min(),
                "start_angle_deg": motion.circle.start_angle_rad.to_degrees(),
                "revolutions": motion.circle.revolutions,
            }),
            Step::Dwell { cycles } => json!({ "kind": "dwell", "cycles": cycles }),
        };
        said["purpose"] = json!(self.purpose);
        said["axis"] = json!(axis);
        if let Step::Excited { excitation, .. } = &self.step {
            said["kind"] = json!("excited");
            said["amplitude_mm_per_s"] = json!(excitation.amplitude.as_mm_per_s());
            said["period_ms"] = json!(excitation.period.as_us() * 1e-3);
            said["harmonics"] = json!(excitation.harmonics().collect::<Vec<_>>());
            said["repeats"] = json!(excitation.repeats);
        }
        said
    }
}

#[cfg(test)]
mod tests;
