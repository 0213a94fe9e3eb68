//! A case: a machine with its effects at their severity, what its owner believes of it, all the nuisances of a real
//! measurement, its files, and the truth beside them.
//!
//! Nuisances: base parameters off by up to 10 or 30 % (in one of ten cases two of them by a factor of two), coloured
//! noise, counts, stamps that jitter, one outlier lap in ten cases, no table scale in 40 of 100, a wander of sensors
//! below the noise, in a quarter of the cases one kind of run that is absent, and in a quarter a friction that drifts
//! by up to 2 % in 100 s.
//! Invariant: a case is a function of its plan, and what is judged reads no file that knows the truth.

use std::fs;
use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::controller::PERIOD;
use crate::effect::{Effect, features_of};
use crate::features::{Features, Growth};
use crate::machine::{Machine, Random, random};
use crate::machine_file;
use crate::path::{Motion, Run};
use crate::plan::{Form, Plan, Role, Severity};
use crate::plant::Plant;
use crate::rig::{Bump, Row, STEPS};
use crate::session::Session;
use crate::severity::{self, Visible, Yardstick};
use crate::trace;

/// Simulations until a severity is met or given up.
const TRIALS: usize = 7;
/// Time constant of a friction that drifts: far beyond a session, s.
const DRIFTS: f64 = 5000.0;
/// Rest that is recorded before and after a run of a session in one go, s.
const STILL: f64 = 0.4;

/// An effect as the truth tells it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TrueEffect {
    /// x or y.
    pub axis: String,
    /// Its name.
    pub name: String,
    /// Its parameters, as a machine file would call them.
    pub parameters: Map<String, Value>,
    /// How strong it is alone.
    pub d_prime: f64,
}

/// What lies beside the data of a case for whoever judges.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Truth {
    /// Name of the case.
    pub id: String,
    /// What it is about.
    pub role: Role,
    /// Verdicts that are right.
    pub verdicts: Vec<String>,
    /// What is missing in the machine file.
    pub effects: Vec<TrueEffect>,
    /// How strong each is meant to be.
    pub severity: Option<Severity>,
    /// How its runs are delivered.
    #[serde(default)]
    pub form: Form,
    /// How strong all together are.
    pub d_prime: f64,
    /// Of the case and of its machine.
    pub seeds: [u64; 2],
    /// There is a table scale.
    pub has_table: bool,
    /// Kind of run that is absent.
    pub absent: Option<String>,
    /// The run in which somebody leaned on the table.
    pub outlier: Option<String>,
    /// Largest share by which a base parameter is off.
    pub base_error: f64,
}

/// What disturbs a measurement.
struct Nuisance {
    told: [Plant; 2],
    has_table: bool,
    absent: Option<&'static str>,
    bump: Option<(usize, Bump)>,
    drift: [[f64; 2]; 2],
    /// Share of the friction that is gone after a second, by axis.
    friction_drift: [f64; 2],
    stamp_jitter: f64,
    base_error: f64,
    current_gain: Option<f64>,
}

/// A machine with its yardstick.
pub struct Bench {
    machine: Machine,
    stick: Yardstick,
}

impl Bench {
    /// For the machine of a seed, with runs that may be brief.
    pub fn new(seed: u64, is_brief: bool) -> Self {
        let machine = Machine::drawn(seed);
        Self::of(if is_brief { machine.brief() } else { machine })
    }

    /// For this machine.
    pub fn of(machine: Machine) -> Self {
        let stick = Yardstick::new(&machine);
        Self { machine, stick }
    }

    /// Make a case below `folder`. `None`: its effect is not to be seen on this machine with its runs and sensors.
    pub fn make(&self, plan: &Plan, folder: &Path) -> Result<Option<Truth>> {
        let mut source = random(plan.seed, 4);
        let mut effects: Vec<Effect> =
            plan.what.iter().map(|what| Effect::drawn(*what, &mut source)).collect();
        let needs_table = effects.iter().any(Effect::needs_table);
        let nuisance = Nuisance::drawn(&self.machine, plan, needs_table, &mut source);
        let visible = nuisance.visible(&self.machine);
        let mut each = Vec::new();
        for effect in &mut effects {
            // The file knows this parameter of this machine: it would be no missing effect.
            let is_known = effect.name() == "viscous-friction" && self.machine.axes[0].plant.viscous > 0.0;
            let range = plan.severity.context("an effect has a severity")?.range();
            let Some(found) = self.scale(effect, range, &visible, &mut source).filter(|_| !is_known) else {
                return Ok(None);
            };
            each.push(found);
        }
        let features = features_of(&effects, &self.machine);
        let together = match effects.len() {
            0 => 0.0,
            1 => each[0],
            _ => self.severity(features, &visible),
        };
        let files = self.run(plan, &nuisance, features);
        if files.iter().any(|file| !severity::is_sane(&file.rows)) {
            // Its loops do not bear the effect together with the noise.
            return Ok(None);
        }
        let case = folder.join(&plan.id);
        self.write(plan, &nuisance, &files, &case)?;
        let effects = effects.iter().zip(&each).map(|(effect, d_prime)| TrueEffect {
            axis: ["x", "y"][effect.axis].to_owned(),
            name: effect.name().to_owned(),
            parameters: effect.set(&self.machine, &mut Default::default()),
            d_prime: *d_prime,
        });
        let run_name = |(run, _): (usize, Bump)| self.machine.runs[run].name.clone();
        let truth = Truth {
            id: plan.id.clone(),
            role: plan.role,
            verdicts: verdicts(plan.role).iter().map(|verdict| (*verdict).to_owned()).collect(),
            effects: effects.collect(),
            severity: plan.severity,
            form: plan.form,
            d_prime: together,
            seeds: [plan.seed, plan.machine],
            has_table: nuisance.has_table,
            absent: nuisance.absent.map(str::to_owned),
            outlier: nuisance.bump.map(run_name),
            base_error: nuisance.base_error,
        };
        fs::write(case.join("truth.json"), serde_json::to_vec_pretty(&truth)?)?;
        Ok(Some(truth))
    }

    fn severity(&self, features: [Features; 2], visible: &Visible) -> f64 {
        self.stick.severity(&Session::quiet(&self.machine, features, severity::STEPS).run(), visible)
    }

    /// Turns the amplitude until the severity lies in the range; `None` if no amplitude that could be met does.
    fn scale(
        &self,
        effect: &mut Effect,
        range: [f64; 2],
        visible: &Visible,
        source: &mut Random,
    ) -> Option<f64> {
        let [low, high] = range;
        // In the middle of the range, so that the first or second trial meets it.
        let target = low * (high / low).powf(source.random_range(0.25..0.75));
        let (mut below, mut above) = (0.0, effect.amplitude_max());
        effect.amplitude = 0.1 * above.min(1.0);
        for _ in 0..TRIALS {
            let found = self.severity(features_of(&[*effect], &self.machine), visible);
            if (low..=high).contains(&found) {
                return Some(found);
            }
            if found < target {
                below = effect.amplitude
            } else {
                above = effect.amplitude
            }
            let proportional = effect.amplitude * (target / found.max(1e-3)).clamp(1e-3, 30.0);
            effect.amplitude = if below < proportional && proportional < above {
                proportional
            } else if found < target && above == effect.amplitude_max() {
                // Not even at its most.
                if effect.amplitude >= 0.999 * above {
                    return None;
                }
                above
            } else {
                0.5 * (below + above)
            };
        }
        None
    }

    /// The session as it is measured, file by file.
    fn run(&self, plan: &Plan, nuisance: &Nuisance, mut features: [Features; 2]) -> Vec<Recording> {
        for (own, drift) in features.iter_mut().zip(nuisance.friction_drift) {
            own.reading.current_gain = nuisance.current_gain.unwrap_or(0.0);
            // Clocks that begin anew do not tell of it.
            if own.rubbing.warm == Growth::default() && plan.form != Form::AtZero {
                own.rubbing.warm = Growth { amplitude: drift * DRIFTS, time: DRIFTS };
            }
        }
        let mut session = Session {
            machine: &self.machine,
            told: nuisance.told,
            features,
            noise: Some(plan.seed),
            steps: STEPS,
            bump: nuisance.bump,
            drift: nuisance.drift,
        };
        let named = |run: &Run| run.name.clone();
        if matches!(plan.form, Form::Apart | Form::EverySecond) {
            let runs = self.machine.runs.iter().zip(Session::starts(&self.machine)).zip(session.run());
            return runs
                .filter(|((run, _), _)| nuisance.has(run))
                .map(|((run, start), rows)| Recording { name: named(run), start, rows })
                .collect();
        }
        // What is absent was never driven.
        let mut machine = self.machine.clone();
        machine.runs.retain(|run| nuisance.has(run));
        let place = |run: usize| machine.runs.iter().position(|other| *other == self.machine.runs[run]);
        session.bump = nuisance.bump.and_then(|(run, bump)| Some((place(run)?, bump)));
        session.machine = &machine;
        let (rows, spans) = session.in_one_go();
        if plan.form == Form::OneFile {
            return vec![Recording { name: "session".to_owned(), start: 0.0, rows }];
        }
        let still = (STILL / PERIOD) as usize;
        let cut = |(run, span): (&Run, Range<usize>)| {
            let (from, to) = (span.start - still, span.end + still);
            let start = if plan.form == Form::AtZero { 0.0 } else { from as f64 * PERIOD };
            Recording { name: named(run), start, rows: rows[from..to].to_vec() }
        };
        machine.runs.iter().zip(spans).map(cut).collect()
    }

    /// The files of a case: its runs and its machine file.
    fn write(&self, plan: &Plan, nuisance: &Nuisance, files: &[Recording], case: &Path) -> Result<()> {
        fs::create_dir_all(case).with_context(|| format!("cannot make {}", case.display()))?;
        let mut source = random(plan.seed, 8);
        for Recording { name, start, rows } in files {
            let stamps: Vec<f64> = (0..rows.len())
                .map(|_| {
                    let late: f64 = StandardNormal.sample(&mut source);
                    nuisance.stamp_jitter * late.clamp(-3.0, 3.0)
                })
                .collect();
            let path = case.join(format!("{name}.csv"));
            trace::write(&path, (rows, plan.form.periods()), *start, |n| stamps[n], nuisance.has_table)
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
        let text = machine_file::text(&self.machine, &nuisance.told, nuisance.has_table);
        fs::write(case.join("machine.toml"), text)?;
        Ok(())
    }
}

/// What becomes a file of data.
struct Recording {
    /// Its name, without its end.
    name: String,
    /// What its clock says at its first row, s.
    start: f64,
    rows: Vec<Row>,
}

/// What may be said of a case of this role.
fn verdicts(role: Role) -> &'static [&'static str] {
    match role {
        Role::Single | Role::Pair => &["named", "class"],
        Role::Null | Role::Decoy => &["nothing-missing", "parameter-only"],
        Role::Unknown => &["unknown", "insufficient"],
    }
}

/// The kinds of run of which one may be absent.
fn kind_of(motion: &Motion, is_held_out: bool) -> &'static str {
    match motion {
        _ if is_held_out => "held-out",
        Motion::Circle { feed, .. } if *feed < 0.04 => "slow-circles",
        Motion::Circle { .. } => "fast-circles",
        Motion::Sweep { .. } => "sweep",
        Motion::MicroReversals { .. } => "micro-reversals",
        Motion::Acceleration { .. } => "acceleration",
    }
}

impl Nuisance {
    fn drawn(machine: &Machine, plan: &Plan, needs_table: bool, source: &mut Random) -> Self {
        let level = if source.random_bool(0.5) { 0.1 } else { 0.3 };
        let is_gross = source.random_bool(0.1);
        let decoy_by_current = source.random_bool(0.5);
        let is_decoy = plan.role == Role::Decoy;
        let gross = if is_gross || (is_decoy && !decoy_by_current) { 2 } else { 0 };
        let told = machine.axes.map(|axis| believed(&axis.plant, level, gross, source));
        let is_absent = source.random_bool(0.25);
        let kinds = ["slow-circles", "fast-circles", "sweep", "micro-reversals", "acceleration"];
        let absent = kinds[source.random_range(0..kinds.len())];
        let has_bump = source.random_bool(0.1);
        let (run, at) = (source.random_range(0..machine.runs.len()), source.random_range(0.5..2.5));
        let force = machine.axes.map(|axis| axis.plant.sliding * source.random_range(-0.3..0.3));
        let bump = Bump { span: [at, at + source.random_range(0.05..0.3)], force };
        let wander = source.random_bool(0.3);
        let drift = machine.axes.map(|axis| {
            // Over the whole session less than a fifth of what is noise or a count.
            let by = |size: f64, share: f64| size * share / 100.0;
            let shares = [source.random_range(-0.2..0.2), source.random_range(-0.2..0.2)];
            let [current, scale] = [axis.sensors.current_noise, axis.sensors.table_count];
            if wander { [by(current, shares[0]), by(scale, shares[1])] } else { [0.0; 2] }
        });
        let stamp_jitter = if source.random_bool(0.5) { source.random_range(1e-6..30e-6) } else { 0.0 };
        let current_gain = source.random_range(-0.15..0.15);
        let mut warmth = random(plan.seed, 5);
        let is_drifting = warmth.random_bool(0.25);
        let drifts = machine.axes.map(|_| warmth.random_range(-1e-4..2e-4));
        Self {
            told,
            has_table: !source.random_bool(0.4) || needs_table,
            absent: is_absent.then_some(absent),
            bump: has_bump.then_some((run, bump)),
            drift,
            friction_drift: if is_drifting { drifts } else { [0.0; 2] },
            stamp_jitter,
            base_error: if gross > 0 { 1.0 } else { level },
            current_gain: (is_decoy && decoy_by_current).then_some(current_gain),
        }
    }

    /// Whether a run is there.
    fn has(&self, run: &Run) -> bool {
        self.absent != Some(kind_of(&run.motion, run.is_held_out))
    }

    fn visible(&self, machine: &Machine) -> Visible {
        let runs = machine.runs.iter().map(|run| self.has(run)).collect();
        Visible { has_table: self.has_table, runs }
    }
}

/// What the owner believes of an axis: every base parameter off by up to `level`, `gross` of them by a factor of two.
fn believed(plant: &Plant, level: f64, gross: usize, source: &mut Random) -> Plant {
    let mut told = *plant;
    // The level of the friction and its fall are two parameters, so that the break-away force stays the larger one.
    let fall = plant.breakaway / plant.sliding - 1.0;
    let mut factor = [1.0; 6];
    for value in &mut factor {
        *value += source.random_range(-level..level);
    }
    for _ in 0..gross {
        let which = source.random_range(0..5);
        factor[which] = if source.random_bool(0.5) { 2.0 } else { 0.5 };
    }
    told.mass *= factor[0];
    told.stiffness *= factor[1];
    told.damping *= factor[2];
    told.inertia *= factor[3];
    told.sliding *= factor[4];
    told.breakaway = told.sliding * (1.0 + fall * factor[5]);
    let mut by = |value: &mut f64, level: f64| *value *= 1.0 + source.random_range(-level..level);
    by(&mut told.viscous, level);
    // A data sheet is better than that.
    by(&mut told.torque_constant, 0.5 * level.min(0.1));
    by(&mut told.current_loop_hz, 0.5 * level.min(0.1));
    by(&mut told.fall_end, level);
    told.fall_start = plant.fall_start / plant.fall_end * told.fall_end;
    told
}
