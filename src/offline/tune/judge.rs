//! What gains are worth on a machine: margins of both loops at their real delays, and the reversals of a circle by
//! the shipped loops, over a spread of plants.
//!
//! A case is an axis with one plant, nominal or another; axes that are alike are judged once. Constraints are held
//! in the worst case. Reversals are only run for gains that keep the margins, at several phases of the position
//! loop: whether the table sticks and slips once more before it reverses depends on them.
//! Invariant: the same gains give the same figures, in any order and on any thread.

use serde::Serialize;

use super::space::Choice;
use super::window::{Path, Window};
use crate::base::command::Limits as Acted;
use crate::config::Machine;
use crate::config::machine::{AXIS_NAMES, Axis};
use crate::offline::loops::{Gainless, Loops};
use crate::plant;

/// Phases of the position loop at which the nominal axis reverses; other plants reverse at the first.
const PHASES: usize = 4;

/// Broken by no larger a share, a constraint counts as kept in an answer: the last digit of a rounded gain. In the
/// search it is broken.
pub const KEPT: f64 = 1e-4;

/// What the loops must keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Requirements {
    /// Least phase margin, degrees.
    pub phase_margin_deg_min: f64,
    /// Least gain margin, dB.
    pub gain_margin_db_min: f64,
    /// Largest amplification of a disturbance, `Ms`.
    pub sensitivity_max: f64,
}

/// A constraint and how it is kept.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Held {
    /// What is bound.
    pub name: String,
    /// In the worst case; infinite where nothing limits it.
    pub value: f64,
    /// What it may be.
    pub bound: f64,
    /// Unit of both.
    pub unit: &'static str,
    /// Whether the bound is the least that is allowed.
    pub is_least: bool,
}

impl Held {
    /// At least a bound.
    pub fn at_least(name: impl Into<String>, value: f64, bound: f64, unit: &'static str) -> Self {
        Self { name: name.into(), value, bound, unit, is_least: true }
    }

    /// At most a bound.
    pub fn at_most(name: impl Into<String>, value: f64, bound: f64, unit: &'static str) -> Self {
        Self { name: name.into(), value, bound, unit, is_least: false }
    }

    /// By which share of the bound it is broken; negative or zero if it is kept.
    pub fn broken_by(&self) -> f64 {
        let past = if self.is_least { self.bound - self.value } else { self.value - self.bound };
        let share = past / self.bound.abs().max(1e-9);
        if share.is_nan() { f64::INFINITY } else { share }
    }

    /// Whether it is as good as at its bound, within half a percent.
    pub fn is_active(&self) -> bool {
        self.broken_by().abs() <= 5e-3
    }

    /// In words.
    pub fn in_words(&self) -> String {
        let side = if self.is_least { "at least" } else { "at most" };
        let Self { name, value, bound, unit, .. } = self;
        let space = if unit.is_empty() { "" } else { " " };
        format!("{name} {value:.4}{space}{unit}, allowed is {side} {bound}{space}{unit}")
    }
}

/// All that is broken, together; zero where all is kept.
pub fn violation(held: &[Held]) -> f64 {
    held.iter().map(|held| held.broken_by().max(0.0)).sum()
}

/// What gains are worth. Deviations are `None` where the loops do not keep their margins and nothing was run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Each constraint, in its worst case.
    pub held: Vec<Held>,
    /// Least phase margin of the velocity loop, degrees.
    pub phase_margin_deg: f64,
    /// Its least gain margin, dB.
    pub gain_margin_db: f64,
    /// Its largest `Ms`.
    pub ms: f64,
    /// Crossover of the velocity loop of the first case, Hz.
    pub crossover_hz: f64,
    /// Current that the counts of the motor encoder make, rms, the noisiest case, A.
    pub current_noise_a_rms: f64,
    /// How far a nominal axis leaves its orbit at a reversal, um.
    pub nominal_um: Option<f64>,
    /// The same in the worst case, um.
    pub worst_um: Option<f64>,
    /// The same, mean of all cases, um.
    pub mean_um: Option<f64>,
}

/// An axis with one plant.
#[derive(Clone, Debug)]
struct Case<'m> {
    axis: Axis,
    windows: Vec<Window<'m>>,
    gainless: Gainless,
    is_nominal: bool,
}

/// Judges gains.
#[derive(Clone, Debug)]
pub struct Judge<'m> {
    machine: &'m Machine,
    requirements: Requirements,
    cases: Vec<Case<'m>>,
    axes: String,
}

impl<'m> Judge<'m> {
    /// For the circle of a machine; `others` are the plants of an axis beside its own.
    pub fn new(
        machine: &'m Machine,
        path: Path,
        requirements: Requirements,
        others: impl Fn(&plant::Parameters) -> Vec<plant::Parameters>,
    ) -> Self {
        let mut cases: Vec<Case<'m>> = Vec::new();
        let mut axes: Vec<&str> = Vec::new();
        for (id, axis) in machine.axes.iter() {
            axes.push(AXIS_NAMES[id.index()]);
            let is_known = cases.iter().any(|case| case.is_nominal && are_alike(&case.axis, axis));
            if is_known {
                continue;
            }
            let phases =
                (0..PHASES).map(|phase| Window::new(machine, axis, path, phase as f64 / PHASES as f64));
            let gainless =
                |axis: &Axis| Gainless::of(&Loops::with_gains(machine, axis, &axis.control.gain_sets[0]));
            let windows = phases.collect();
            cases.push(Case { axis: *axis, windows, gainless: gainless(axis), is_nominal: true });
            for plant in others(&axis.plant) {
                let axis = Axis { plant, ..*axis };
                let windows = vec![Window::new(machine, &axis, path, 0.0)];
                cases.push(Case { axis, windows, gainless: gainless(&axis), is_nominal: false });
            }
        }
        Self { machine, requirements, cases, axes: axes.join(", ") }
    }

    /// The axes that are judged, by name.
    pub fn axes(&self) -> &str {
        &self.axes
    }

    /// How many cases there are.
    pub fn cases(&self) -> usize {
        self.cases.len()
    }

    /// Judge gains.
    pub fn figures(&self, choice: &Choice) -> Figures {
        let mut figures = self.margins(choice);
        if violation(&figures.held) <= KEPT {
            self.run(choice, &mut figures);
        }
        figures
    }

    /// Judge gains and run them even where they do not keep the margins.
    pub fn explored(&self, choice: &Choice) -> Figures {
        let mut figures = self.margins(choice);
        self.run(choice, &mut figures);
        figures
    }

    fn margins(&self, choice: &Choice) -> Figures {
        let mut velocity = [f64::INFINITY, f64::INFINITY, 0.0];
        let mut position = velocity;
        let (mut noise_a, mut crossover_hz) = (0.0_f64, f64::NAN);
        for case in &self.cases {
            let gains = choice.gains(&case.axis);
            let loops = Loops::with_gains(self.machine, &case.axis, &gains);
            let [of_velocity, of_position] = loops.margins_on(&case.gainless);
            for (worst, margins) in [(&mut velocity, of_velocity), (&mut position, of_position)] {
                // A loop without crossover holds nothing; one that never turns by 180 degrees has all the gain.
                worst[0] = worst[0].min(margins.phase_margin_deg.unwrap_or(0.0));
                worst[1] = worst[1].min(margins.gain_margin_db.unwrap_or(f64::INFINITY));
                worst[2] = f64::max(worst[2], margins.sensitivity_max);
                if crossover_hz.is_nan() {
                    crossover_hz = margins.crossover_hz.unwrap_or(f64::INFINITY);
                }
            }
            noise_a = noise_a.max(loops.current_noise().as_a());
        }
        let Requirements { phase_margin_deg_min, gain_margin_db_min, sensitivity_max } = self.requirements;
        let mut held = Vec::new();
        for (name, [phase_deg, gain_db, ms]) in [("velocity loop", velocity), ("position loop", position)] {
            held.push(Held::at_least(
                format!("phase margin, {name}"),
                phase_deg,
                phase_margin_deg_min,
                "deg",
            ));
            held.push(Held::at_least(format!("gain margin, {name}"), gain_db, gain_margin_db_min, "dB"));
            held.push(Held::at_most(format!("Ms, {name}"), ms, sensitivity_max, ""));
        }
        Figures {
            held,
            phase_margin_deg: velocity[0],
            gain_margin_db: velocity[1],
            ms: velocity[2],
            crossover_hz,
            current_noise_a_rms: noise_a,
            nominal_um: None,
            worst_um: None,
            mean_um: None,
        }
    }

    fn run(&self, choice: &Choice, figures: &mut Figures) {
        let (mut nominal_um, mut worst_um, mut sum_um) = (0.0_f64, 0.0_f64, 0.0);
        let mut current: Option<Held> = None;
        let (mut faults, mut is_held_back) = (0.0, false);
        for case in &self.cases {
            let gains = choice.gains(&case.axis);
            let mut case_um = 0.0_f64;
            for seen in case.windows.iter().map(|window| window.run(&gains)) {
                case_um = case_um.max(seen.deviation_um());
                faults += f64::from(u8::from(seen.fault.is_some()));
                is_held_back |= seen.limits.contains(Acted::CURRENT);
                let limit_a = case.axis.control.limits.current.as_a();
                let asked = Held::at_most("current of a reversal", seen.current_max.as_a(), limit_a, "A");
                if current.as_ref().is_none_or(|worst| worst.broken_by() < asked.broken_by()) {
                    current = Some(asked);
                }
            }
            sum_um += case_um;
            worst_um = worst_um.max(case_um);
            if case.is_nominal {
                nominal_um = nominal_um.max(case_um);
            }
        }
        figures.held.extend(current);
        // At the limit itself nothing tells how much more was wanted.
        let stops = faults + f64::from(u8::from(is_held_back));
        if stops > 0.0 {
            figures.held.push(Held::at_most(
                "reversals at the current limit or with a fault",
                stops,
                0.0,
                "",
            ));
        }
        figures.nominal_um = Some(nominal_um);
        figures.worst_um = Some(worst_um);
        figures.mean_um = Some(sum_um / self.cases.len() as f64);
    }
}

/// Whether two axes differ in nothing but their place on the bus.
fn are_alike(one: &Axis, other: &Axis) -> bool {
    Axis { node: other.node, ..*one } == *other
}
