//! Tuning: gains that make the least protrusion and keep what the loops must keep.
//!
//! ```text
//!   request ──► space ──► evolve ──► judge: margins (loops), reversals (window) ──► Tuned ──► machine file, report
//!                  ▲         │ whole generations, shared among threads                 │
//!                  └─────────┘                                                     whole circle, before and after
//! ```
//!
//! [`paper`] is the problem that the paper states, as it states it. The other goals are figures of the machine:
//! [`judge`] runs the shipped loops against the plant, at the delays of the bus. [`evolve`] searches and knows
//! nothing of either; what it found is checked by [`whole`], on the whole circle over frames. [`gain_set`] writes.
//! All axes get the same `V_p` and `V_i`, and the worst axis counts: axes of one circle must answer alike.
//! Invariant: the same request gives the same gains, to the bit, on any number of threads.

pub mod evolve;
pub mod gain_set;
pub mod judge;
pub mod map;
pub mod paper;
pub mod space;
pub mod spread;
pub mod whole;
pub mod window;

use std::ops::ControlFlow;

use rayon::prelude::*;
use serde::Serialize;

use self::evolve::{Evolved, Member, Worth};
use self::judge::{Figures, Held, Judge, KEPT, Requirements, violation};
use self::space::{Choice, Space};
use self::spread::Spread;
use self::window::Path;
use crate::config::Machine;

/// Members of the population for each number that is varied, and least of them.
const POPULATION: [usize; 2] = [8, 20];
/// Members of a front.
const FRONT: usize = 40;
/// The search is over once the gains of all members lie within this share of their range: of three decades, that is
/// a third of a percent in a gain.
const SETTLED: f64 = 5e-4;
/// Or once so many generations made the best less by no more than this share: below it are the steps that come and
/// go with the last digit of a gain.
const PATIENCE: usize = 25;
const WORTH_MORE: f64 = 1e-3;

/// A figure to be made small.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Objective {
    /// How far the axes leave their orbit at a reversal.
    Protrusion,
    /// `Ms` of the velocity loop.
    Sensitivity,
    /// Current that the encoder's counts make.
    Noise,
}

impl Objective {
    /// Name with unit.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Protrusion => "protrusion, um",
            Self::Sensitivity => "Ms of the velocity loop",
            Self::Noise => "current noise, mA rms",
        }
    }
}

/// How a spread of plants counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counts {
    /// The worst of them.
    Worst,
    /// Their mean.
    Mean,
}

/// What is to be made small.
#[derive(Clone, Debug, PartialEq)]
pub enum Goal {
    /// Eq. (8) of the paper.
    Paper(paper::Request),
    /// Figures of the machine; more than one give a front.
    Machine {
        /// Which.
        objectives: Vec<Objective>,
        /// How plants count in the protrusion.
        counts: Counts,
    },
}

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// What is to be made small.
    pub goal: Goal,
    /// What may be varied, and the rest.
    pub space: Space,
    /// What the loops must keep.
    pub requirements: Requirements,
    /// The plants that must keep it too.
    pub spread: Spread,
    /// The circle.
    pub path: Path,
    /// Most evaluations.
    pub evaluations_max: usize,
    /// Of everything random.
    pub seed: u64,
}

/// Gains with their figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// The gains.
    #[serde(flatten)]
    pub choice: Choice,
    /// Their figures.
    #[serde(flatten)]
    pub figures: Figures,
    /// Values of the objectives, in order.
    pub objectives: Vec<f64>,
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// The best by the first objective.
    pub best: Judged,
    /// With several objectives, all that none is better than, by the first objective.
    pub front: Vec<Judged>,
    /// Constraints and bounds that hold the best where it is, in words.
    pub active: Vec<String>,
    /// Constraints that are broken, in words: no gains keep all.
    pub broken: Vec<String>,
    /// Gains that were looked at.
    pub evaluations: usize,
    /// Plants that each was judged on.
    pub cases: usize,
    /// Whether the search went on to its end.
    pub is_complete: bool,
}

/// How far the search is.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Gains that were looked at.
    pub evaluations: usize,
    /// Best value of the first objective among those that keep all constraints.
    pub best: Option<f64>,
}

/// Judges gains by a request: the same in the search, in the map and in the answer.
#[derive(Clone, Debug)]
pub struct Valuer<'m> {
    request: &'m Request,
    judge: Judge<'m>,
    machine: &'m Machine,
}

impl<'m> Valuer<'m> {
    /// For a machine.
    pub fn new(machine: &'m Machine, request: &'m Request) -> Self {
        // The paper knows one plant only.
        let spread = match request.goal {
            Goal::Paper(_) => Spread::Nominal,
            Goal::Machine { .. } => request.spread,
        };
        let judge = Judge::new(machine, request.path, request.requirements, |nominal| spread.plants(nominal));
        Self { request, judge, machine }
    }

    /// Values of the objectives and the constraints that count for them.
    pub fn worth(&self, choice: &Choice) -> (Vec<f64>, Vec<Held>) {
        match &self.request.goal {
            Goal::Paper(asked) => self.paper_worth(asked, choice),
            Goal::Machine { .. } => {
                let figures = self.judge.figures(choice);
                (self.objectives(choice, &figures), figures.held)
            }
        }
    }

    /// The same where the margins are not kept: beyond the borders of a map.
    pub fn explored(&self, choice: &Choice) -> (Vec<f64>, Vec<Held>) {
        match &self.request.goal {
            Goal::Paper(asked) => self.paper_worth(asked, choice),
            Goal::Machine { .. } => {
                let figures = self.judge.explored(choice);
                (self.objectives(choice, &figures), figures.held)
            }
        }
    }

    /// Gains with all their figures.
    pub fn judged(&self, choice: Choice) -> Judged {
        let mut figures = self.judge.figures(&choice);
        let objectives = self.objectives(&choice, &figures);
        if let Goal::Paper(asked) = &self.request.goal {
            figures.held = self.paper_worth(asked, &choice).1;
        }
        Judged { choice, figures, objectives }
    }

    /// How many plants count.
    pub fn cases(&self) -> usize {
        self.judge.cases()
    }

    fn objectives(&self, choice: &Choice, figures: &Figures) -> Vec<f64> {
        match &self.request.goal {
            Goal::Paper(asked) => self.paper_worth(asked, choice).0,
            Goal::Machine { objectives, counts } => {
                let deviation_um = match counts {
                    Counts::Worst => figures.worst_um,
                    Counts::Mean => figures.mean_um,
                };
                let value = |objective: &Objective| match objective {
                    Objective::Protrusion => deviation_um.unwrap_or(f64::INFINITY),
                    Objective::Sensitivity => figures.ms,
                    Objective::Noise => 1e3 * figures.current_noise_a_rms,
                };
                objectives.iter().map(value).collect()
            }
        }
    }

    fn paper_worth(&self, asked: &paper::Request, choice: &Choice) -> (Vec<f64>, Vec<Held>) {
        let problem = paper::Problem::new(&self.machine.axes.as_slice()[0]);
        let (v_p, v_i) = (choice.v_p, choice.v_i);
        let margin_deg = problem.phase_margin_deg(v_p, v_i);
        let (time_s, time_s_max) = (problem.acceleration_time_s(), asked.acceleration_time_s_max);
        let held = vec![
            Held::at_least(
                "phase margin by the printed formula",
                margin_deg,
                asked.phase_margin_deg_min,
                "deg",
            ),
            Held::at_most("acceleration time", time_s, time_s_max, "s"),
        ];
        (vec![problem.objective(v_p, v_i)], held)
    }
}

/// Search; `watch` hears after each generation and may end it.
pub fn tune(
    machine: &Machine,
    request: &Request,
    mut watch: impl FnMut(&Progress) -> ControlFlow<()>,
) -> Tuned {
    let valuer = Valuer::new(machine, request);
    let space = &request.space;
    let is_front = matches!(&request.goal, Goal::Machine { objectives, .. } if objectives.len() > 1);
    let [for_each, least] = POPULATION;
    let settings = evolve::Settings {
        population: if is_front { FRONT } else { least.max(for_each * space.ranges.len()) },
        evaluations_max: request.evaluations_max,
        settled: SETTLED,
        patience: PATIENCE,
        worth_more: WORTH_MORE,
        seed: request.seed,
    };
    let worth = |place: &Vec<f64>| {
        let (objectives, held) = valuer.worth(&space.choice(place));
        Worth { objectives, violation: violation(&held) }
    };
    let Evolved { front, evaluations, is_complete } = evolve::evolve(
        &space.bounds(),
        &[space.place(space.fixed)],
        &settings,
        |places| places.par_iter().map(worth).collect(),
        |members: &[Member], evaluations| {
            let kept = members.iter().filter(|member| member.worth.violation <= 0.0);
            let best = kept.map(|member| member.worth.objectives[0]).min_by(f64::total_cmp);
            watch(&Progress { evaluations, best })
        },
    );
    let judged = |member: &Member| valuer.judged(space.choice(&member.place).rounded());
    let front: Vec<Judged> = front.iter().map(judged).collect();
    let best = front[0].clone();
    let held = &best.figures.held;
    let mut active: Vec<String> = held.iter().filter(|held| held.is_active()).map(Held::in_words).collect();
    active.extend(space.active(best.choice));
    let broken = held.iter().filter(|held| held.broken_by() > KEPT).map(Held::in_words).collect();
    Tuned { best, front, active, broken, evaluations, cases: valuer.cases(), is_complete }
}
