//! Which cases there are: every name on every machine at three severities, and those that nobody should name.
//!
//! A share of them is a fixed one that has all of its kinds in it, the cases being dealt out like cards; but not where 2 or 3
//! divides it: each name has three severities on six machines, and the same ones would be drawn of each.
//! Invariant: the same choice gives the same list.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::effect::{Kind, NAMES, Strangeness, What};
use crate::machine::random;

/// Effects that hide each other: the first two cancel in the current, the others show in the same place.
const HARD_PAIRS: [[Kind; 2]; 6] = [
    [Kind::Stribeck, Kind::ReversalCompensation],
    [Kind::Stribeck, Kind::Presliding],
    [Kind::Backlash, Kind::SoftZone],
    [Kind::MotorCogging, Kind::TorqueRipple],
    [Kind::PositionDependentFriction, Kind::PositionDependentStiffness],
    [Kind::ActuatorDelay, Kind::CurrentLoopLag],
];

/// How strong, by `d'`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// `d'` 8 to 15.
    Small,
    /// `d'` 30 to 60.
    Medium,
    /// `d'` above 100.
    Large,
}

impl Severity {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Small, Self::Medium, Self::Large];

    /// What is aimed at, and what is good enough.
    pub const fn range(self) -> [f64; 2] {
        match self {
            Self::Small => [8.0, 15.0],
            Self::Medium => [30.0, 60.0],
            Self::Large => [100.0, 300.0],
        }
    }

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Small => "small",
            Self::Medium => "medium",
            Self::Large => "large",
        }
    }
}

/// What a case is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// One effect that has a name.
    Single,
    /// Two of them.
    Pair,
    /// None; base parameters are off.
    Null,
    /// One that no catalogue has.
    Unknown,
    /// Nothing is missing, but something looks like it: base parameters off by a factor of two, or a current sensor
    /// that is off.
    Decoy,
}

/// How runs are recorded and delivered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// A file each, from a machine that was just switched on, on one clock.
    #[default]
    Apart,
    /// A file each from a session in one go, with a rest at either end: no axis begins without being wound up.
    Rests,
    /// The same, and the time of each file begins at zero.
    AtZero,
    /// One file with all of them and the ways between them.
    OneFile,
    /// A file each as apart, with a row in every second period, as scopes of drives write them.
    EverySecond,
}

impl Form {
    /// Periods from row to row.
    pub fn periods(self) -> usize {
        if self == Self::EverySecond { 2 } else { 1 }
    }

    /// One of these drawn; apart where there are none.
    fn drawn(of: &[Self], seed: u64) -> Self {
        if of.is_empty() { Self::default() } else { of[random(seed, 9).random_range(0..of.len())] }
    }
}

/// A case that is to be made.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Name of its folder.
    pub id: String,
    /// Its seed.
    pub seed: u64,
    /// Seed of its machine.
    pub machine: u64,
    /// What it is about.
    pub role: Role,
    /// Its effects.
    pub what: Vec<What>,
    /// How strong each of them is.
    pub severity: Option<Severity>,
    /// How its runs are delivered.
    pub form: Form,
}

/// What is wanted.
#[derive(Clone, Debug, clap::Args)]
pub struct Choice {
    /// Seed of all cases
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// How many machines
    #[arg(long, default_value_t = 6)]
    pub machines: u64,
    /// Only this effect, and no case without it
    #[arg(long, value_name = "NAME")]
    pub only: Option<String>,
    /// Only cases of this kind
    #[arg(long)]
    pub role: Option<Role>,
    /// Only this severity
    #[arg(long)]
    pub severity: Option<Severity>,
    /// How many cases with nothing missing
    #[arg(long, default_value_t = 300)]
    pub nulls: u64,
    /// How many cases with two effects
    #[arg(long, default_value_t = 60)]
    pub pairs: u64,
    /// How many cases with an effect that no catalogue has
    #[arg(long, default_value_t = 48)]
    pub unknown: u64,
    /// How many cases that only look as if something were missing
    #[arg(long, default_value_t = 30)]
    pub decoys: u64,
    /// How runs are recorded and delivered; of several one is drawn for each case
    #[arg(long, value_enum, value_delimiter = ',', default_value = "apart")]
    pub form: Vec<Form>,
    /// Runs that take less than half as long
    #[arg(long)]
    pub brief: bool,
    /// A fixed part of them, as 1/5; with a number that 2 or 3 divides, some machines and severities are left out
    #[arg(long, default_value = "1/1", value_parser = one_in)]
    pub share: u64,
}

fn one_in(text: &str) -> Result<u64, String> {
    let parts = text.split_once('/').and_then(|(one, many)| Some((one.parse().ok()?, many.parse().ok()?)));
    match parts {
        Some((1, many @ 1..)) => Ok(many),
        _ => Err(format!("{text} is no share, wanted is 1/1, 1/2, 1/3 and so on")),
    }
}

/// The list of what is wanted, those of a machine together.
pub fn list(choice: &Choice) -> Vec<Plan> {
    let machines: Vec<u64> =
        (0..choice.machines).map(|n| choice.seed.wrapping_mul(1_000_003) * 6 + n).collect();
    let mut plans = Vec::new();
    for (n, (kind, name)) in NAMES.iter().enumerate() {
        for (s, severity) in Severity::ALL.into_iter().enumerate() {
            for (m, machine) in machines.iter().enumerate() {
                let number = (n * Severity::ALL.len() + s) * machines.len() + m;
                if (number as u64).is_multiple_of(choice.share) {
                    let id = format!("m{m}-{name}-{}", severity.name());
                    let what = vec![What::Named(*kind)];
                    plans.push(plan(choice, id, *machine, Role::Single, what, Some(severity)));
                }
            }
        }
    }
    let others = [
        (Role::Null, choice.nulls),
        (Role::Pair, choice.pairs),
        (Role::Unknown, choice.unknown),
        (Role::Decoy, choice.decoys),
    ];
    for (role, count) in others {
        for n in (0..count).step_by(choice.share as usize) {
            let machine = n as usize % machines.len().max(1);
            let id = format!("m{machine}-{}-{n:03}", role_name(role));
            let mut source = random(choice.seed ^ (n << 8), 5 + role as u64);
            let severity = Severity::ALL[source.random_range(0..3)];
            let (what, severity) = match role {
                Role::Pair => {
                    let one = source.random_range(0..NAMES.len());
                    let other = (one + source.random_range(1..NAMES.len())) % NAMES.len();
                    let hard = HARD_PAIRS[(n / 3) as usize % HARD_PAIRS.len()];
                    let pair = if n.is_multiple_of(3) { hard } else { [NAMES[one].0, NAMES[other].0] };
                    let stronger = if severity == Severity::Small { Severity::Medium } else { severity };
                    (pair.map(What::Named).to_vec(), Some(stronger))
                }
                Role::Unknown => {
                    let kind =
                        Strangeness::ALL[(n / choice.machines.max(1)) as usize % Strangeness::ALL.len()];
                    (vec![What::Strange(kind)], Some(severity))
                }
                _ => (Vec::new(), None),
            };
            plans.push(plan(choice, id, machines[machine], role, what, severity));
        }
    }
    plans.retain(|plan| is_wanted(plan, choice));
    plans.sort_by_key(|plan| plan.machine);
    plans
}

fn plan(
    choice: &Choice,
    id: String,
    machine: u64,
    role: Role,
    what: Vec<What>,
    severity: Option<Severity>,
) -> Plan {
    // By its name, so that a case stays the same whatever else is chosen.
    let seed = id
        .bytes()
        .fold(choice.seed, |seed, byte| (seed ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3));
    let grows = |what: &What| matches!(what, What::Named(Kind::FrictionWarmUp | Kind::ThermalGrowth));
    let form = match Form::drawn(&choice.form, seed) {
        // Without a clock in common nobody sees what grows.
        Form::AtZero if what.iter().any(grows) => Form::Rests,
        drawn => drawn,
    };
    Plan { id, seed, machine, role, what, severity, form }
}

fn is_wanted(plan: &Plan, choice: &Choice) -> bool {
    let severity = choice.severity.is_none_or(|wanted| plan.severity.is_none_or(|is| is == wanted));
    let name = choice.only.as_ref().is_none_or(|wanted| {
        plan.role == Role::Single
            && plan.what.iter().any(|what| matches!(what, What::Named(kind) if kind.name() == wanted))
    });
    severity && name && choice.role.is_none_or(|wanted| plan.role == wanted)
}

/// A role as the truth writes it.
pub fn role_name(role: Role) -> &'static str {
    match role {
        Role::Single => "single",
        Role::Pair => "pair",
        Role::Null => "null",
        Role::Unknown => "unknown",
        Role::Decoy => "decoy",
    }
}
