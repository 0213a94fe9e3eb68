//! The survey: every kind of scripted fault at many moments of a small fast circle, and what became of each.
//!
//! ```text
//!   cases ─┐
//!   clean ─┴► plan ─► one run per case and moment, on all cores ─► a line per case ─► page, JSON
//!   circle
//! ```
//!
//! Scenarios hold single runs to what they must come to; the survey looks where nobody looked: between the
//! moments, and at severities that nobody expected anything of.
//! Invariant: what a run comes to depends on machine, seed, case and moment alone, so a part of the survey
//! gives the same lines as the whole.

mod cases;
mod line;
mod page;

use std::collections::VecDeque;
use std::convert::Infallible;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::stage::{self, Truth, Truths};
use super::{Ending, Evidence, Witness};
use crate::base::axis::{AXES_MAX, AxisId};
use crate::base::fault::Fault;
use crate::base::motion::{Circle, Direction};
use crate::base::record::CycleRecord;
use crate::base::time::{Moment, Span};
use crate::base::units::{Current, Position, Velocity};
use crate::config::Machine;
use crate::config::machine::Axis;
use crate::config::plan::{CircleRequest, PlanError};
use crate::config::scenario::Motion;
use crate::rt::drive::bend;
use crate::sim::closed_loop::Wired;
use crate::sim::script::{Effect, Script, ScriptedFault};

pub use cases::Case;
pub use line::{CarriedOn, Extent, Line};
pub use page::{page, row};

/// The circle: small, so that a run is short; fast, so that the axes turn round often.
const RADIUS: Position = Position::mm(20.0);
const FEED: Velocity = Velocity::mm_per_min(3_000.0);

/// Of the following-error limit: an encoder that stands is found before it is so far off (docs/faults/20).
const FROZEN_SHARE: f64 = 0.25;

/// Why there is no survey of a machine.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurveyError {
    /// It cannot make the circle.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// It faults when nothing goes wrong.
    #[error("machine {machine} does not complete the circle when nothing goes wrong: {ending:?}")]
    NotSound {
        /// Its name.
        machine: String,
        /// What came instead.
        ending: Ending,
    },
}

/// A survey to be made.
#[derive(Clone, Debug)]
pub struct Survey {
    machine: Machine,
    seed: u64,
    moments: usize,
    motion: Motion,
    /// Cycles of the circle itself.
    circle: Range<u64>,
    /// Furthest from it when nothing goes wrong.
    off_circle: Position,
    cases: Vec<Case>,
}

/// One run.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// When the fault began, since the first SYNC.
    pub at: Span,
    /// The axis that it happened to; `None`: the bus.
    pub axis: Option<AxisId>,
    /// What was seen.
    pub evidence: Evidence,
    /// Furthest from the circle of the true place, from then on; `None` where nothing moved.
    pub off_circle: Option<Position>,
    /// Cycles in which a drive gave current by a command that another should have followed by then, of the axis
    /// with the most of them.
    pub old_command_cycles: u64,
}

impl Run {
    /// The fault that stopped it: of the axis that was struck, or of the first that has one.
    pub fn fault(&self) -> Option<Fault> {
        let own = self.axis.and_then(|axis| self.evidence.faults[axis]);
        own.or_else(|| self.evidence.faults.as_slice().iter().copied().flatten().next())
    }
}

impl Survey {
    /// Everything to be tried on a machine, each at so many moments.
    pub fn plan(machine: &Machine, seed: u64, moments: usize) -> Result<Self, SurveyError> {
        let request = CircleRequest {
            gains: machine.gain_sets.first().cloned().unwrap_or_default(),
            circle: Circle {
                centre_x: Position::ZERO,
                centre_y: Position::ZERO,
                radius: RADIUS,
                feed: FEED,
                direction: Direction::Ccw,
                start_angle_rad: std::f64::consts::FRAC_PI_4,
                revolutions: 1,
            },
            directions: vec![Direction::Ccw],
        };
        let test = Box::new(machine.circle_test(&request)?);
        let motion = Motion::Circle { request, test };
        let (mut measured, mut off_circle) = (None, Position::ZERO);
        let clean = Script { seed, ..Script::default() };
        let ending = in_memory(machine, &motion, &clean, &mut Told::default(), |record, truth| {
            if record.stage.is_measured {
                measured = Some((measured.map_or(record.cycle, |(first, _)| first), record.cycle + 1));
            }
            if measured.is_some() {
                off_circle = further(off_circle, distance(truth));
            }
        });
        match measured {
            Some((first, end)) if ending == Ending::Complete => Ok(Self {
                machine: machine.clone(),
                seed,
                moments,
                motion,
                circle: first..end,
                off_circle,
                cases: cases::cases(machine.cycle.period),
            }),
            _ => Err(SurveyError::NotSound { machine: machine.name.clone(), ending }),
        }
    }

    /// The faults that are tried, in order of the lines.
    pub fn cases(&self) -> &[Case] {
        &self.cases
    }

    /// Only faults of this kind.
    pub fn retain(&mut self, fault: &str) {
        self.cases.retain(|case| case.fault() == fault);
    }

    /// How many runs that takes.
    pub fn runs(&self) -> usize {
        self.cases.len() * self.moments
    }

    /// All of it, on every core; `progress` is called after each run.
    pub fn run(&self, progress: &(dyn Fn() + Sync)) -> Vec<Line> {
        self.run_cases(&(0..self.cases.len()).collect::<Vec<_>>(), progress)
    }

    /// Some of the cases, by their place among all.
    pub fn run_cases(&self, wanted: &[usize], progress: &(dyn Fn() + Sync)) -> Vec<Line> {
        let next = AtomicUsize::new(0);
        let work = || {
            let mut done = Vec::new();
            loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                let Some(case) = wanted.get(number / self.moments.max(1)) else { return done };
                done.push((number, self.run_one(&self.cases[*case], number % self.moments)));
                progress();
            }
        };
        let workers = thread::available_parallelism().map_or(1, usize::from);
        let mut done: Vec<(usize, Run)> = thread::scope(|scope| {
            let workers: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
            let joined = workers.into_iter().map(|worker| worker.join());
            joined.flat_map(|done| done.unwrap_or_else(|panic| std::panic::resume_unwind(panic))).collect()
        });
        done.sort_by_key(|(number, _)| *number);
        let runs: Vec<Run> = done.into_iter().map(|(_, run)| run).collect();
        let of_cases = wanted.iter().zip(runs.chunks(self.moments.max(1)));
        of_cases.map(|(case, runs)| Line::of(&self.cases[*case], runs, self)).collect()
    }

    /// A case at one of its moments: each in its own part of the circle, the axes in turn.
    fn run_one(&self, case: &Case, moment: usize) -> Run {
        let seed = self.seed_of(case, moment);
        let part = Pcg64Mcg::seed_from_u64(seed).random::<f64>();
        let length = (self.circle.end - self.circle.start) as f64;
        let into = (moment as f64 + part) / self.moments as f64 * length;
        let at = self.machine.cycle.period * (self.circle.start + into as u64) as i64;
        let axis = AxisId::new(moment % self.machine.axes.count());
        let axis = case.is_of_axis().then_some(axis);
        let fault = ScriptedFault { at, lasts: case.lasts, axis, effect: case.effect };
        let script = Script { seed, faults: vec![fault] };
        let mut witness = Witness::new(&self.machine, &script);
        let (mut told, mut off_circle) = (Told::default(), None);
        let ending = in_memory(&self.machine, &self.motion, &script, &mut told, |record, truth| {
            witness.see(record, truth);
            if record.timing.scheduled >= Moment::ZERO + at {
                off_circle = Some(further(off_circle.unwrap_or_default(), distance(truth)));
            }
        });
        let old_command_cycles = told.old_command_cycles.into_iter().max().unwrap_or(0);
        Run { at, axis, evidence: witness.finish(ending), off_circle, old_command_cycles }
    }

    /// By name, so that a case more changes none of the others.
    fn seed_of(&self, case: &Case, moment: usize) -> u64 {
        let name = format!("{} {} {moment}", case.fault(), case.how);
        self.seed.wrapping_mul(1 << 32) ^ u64::from(crc32fast::hash(name.as_bytes()))
    }

    /// What a fault may do to a position before it is seen, at the speed of the circle.
    pub fn unseen(&self, effect: &Effect) -> Position {
        let of_axis = |axis: &Axis| match effect {
            Effect::EncoderFrozen => axis.control.limits.following_error * FROZEN_SHARE,
            // A jump is the difference of two positions to those before them.
            _ => axis.control.unseen_jump() + bend::doubt(axis.scale.motor_resolution(), FEED) * 2.0,
        };
        let all = self.machine.axes.as_slice().iter().map(of_axis);
        all.fold(Position::ZERO, further)
    }
}

/// What the machine at hand tells beside its records: its truth, and on which commands it acts.
#[derive(Debug, Default)]
struct Told {
    old_command_cycles: [u64; AXES_MAX],
}

impl Truths<Wired> for Told {
    type Error = Infallible;

    fn learn(&mut self, bus: &Wired, cycle: u64, known: &mut VecDeque<Truth>) -> Result<(), Infallible> {
        let truths = bus.rack().truths();
        for ((axis, truth), old) in truths.iter().zip(&mut self.old_command_cycles) {
            // At a SYNC it is the command of the cycle before that acts, wherever it was taken.
            let acting = bus.rack().acting_command(axis);
            let age = acting.map_or(0, |acting| (cycle as u8).wrapping_sub(acting));
            *old += u64::from(truth.current != Current::ZERO && age > 1);
        }
        known.push_back(Some(truths));
        Ok(())
    }
}

/// One run; `see` is shown each cycle of it, and the truth.
fn in_memory(
    machine: &Machine,
    motion: &Motion,
    script: &Script,
    told: &mut Told,
    mut see: impl FnMut(&CycleRecord, &Truth),
) -> Ending {
    let mut bus = Wired::new(machine.rack(script.seed).with_script(script));
    let Ok(ending) = stage::run(machine, motion, &mut bus, told, |record, _, truth| see(record, truth));
    ending
}

/// How far the axes are from the circle.
fn distance(truth: &Truth) -> Position {
    let place = |axis| truth.as_ref().map_or(Position::ZERO, |truth| truth[axis].position).as_m();
    Position::m((libm::hypot(place(AxisId::X), place(AxisId::Y)) - RADIUS.as_m()).abs())
}

fn further(most: Position, own: Position) -> Position {
    if own > most { own } else { most }
}
