//! From options to what is asked of the tuner; what cannot be is refused with the option, value and bound.

use anyhow::{Context, bail, ensure};
use clap::{Args, ValueEnum};

use crate::base::units::{Position, Velocity};
use crate::config::Machine;
use crate::offline::tune::judge::Requirements;
use crate::offline::tune::paper;
use crate::offline::tune::space::{Choice, Quantity, Range, Space};
use crate::offline::tune::spread::Spread;
use crate::offline::tune::window::Path;
use crate::offline::tune::{Counts, Goal, Objective, Request};

/// What may be varied and what must be kept: the same for every verb that tunes.
#[derive(Debug, Args)]
pub(in crate::cli) struct SearchArguments {
    /// Gain set that is tuned: what is not varied is as in it
    #[arg(long, default_value = "standard", value_name = "NAME")]
    pub(in crate::cli) from: String,
    /// Numbers varied beside V_p and V_i
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST")]
    pub(in crate::cli) vary: Vec<Vary>,
    /// Gain of the position loop [default: that of the gain set]
    #[arg(long, value_name = "N", conflicts_with = "kp_max_per_s")]
    pub(in crate::cli) kp_per_s: Option<f64>,
    /// Largest gain of the position loop, with `--vary kp` [default: 50]
    #[arg(long, value_name = "N")]
    pub(in crate::cli) kp_max_per_s: Option<f64>,
    /// Least V_p [default: 1 with the paper's objective, otherwise 10]
    #[arg(long, value_name = "N")]
    pub(in crate::cli) v_p_min: Option<f64>,
    /// Largest V_p [default: 100 with the paper's objective, otherwise 1000]
    #[arg(long, value_name = "N")]
    pub(in crate::cli) v_p_max: Option<f64>,
    /// Least V_i
    #[arg(long, default_value_t = 0.1, value_name = "N")]
    pub(in crate::cli) v_i_min: f64,
    /// Largest V_i
    #[arg(long, default_value_t = 10.0, value_name = "N")]
    pub(in crate::cli) v_i_max: f64,
    /// Least phase margin: by the printed formula with the paper's objective [default: 49], otherwise of both
    /// loops at their real delays [default: 40]
    #[arg(long, value_name = "DEG")]
    pub(in crate::cli) phase_margin_deg: Option<f64>,
    /// Least gain margin of both loops
    #[arg(long, default_value_t = 8.0, value_name = "DB")]
    pub(in crate::cli) gain_margin_db: f64,
    /// Largest sensitivity Ms of both loops
    #[arg(long, default_value_t = 2.0, value_name = "N")]
    pub(in crate::cli) ms: f64,
    /// How far mass, friction and stiffness may be off; 0 for the axes as the file has them
    #[arg(long, default_value_t = 10.0, value_name = "N")]
    pub(in crate::cli) spread_percent: f64,
    /// Plants by chance within the spread [default: its eight corners]
    #[arg(long, value_name = "N")]
    pub(in crate::cli) plants: Option<usize>,
    /// How the plants count in the protrusion
    #[arg(long, value_enum, default_value_t = CountsName::Worst)]
    pub(in crate::cli) judge: CountsName,
    /// Radius of the circle
    #[arg(long, default_value_t = 150.0, value_name = "MM")]
    pub(in crate::cli) radius_mm: f64,
    /// Feed along the circle
    #[arg(long, default_value_t = 2000.0, value_name = "MM/MIN")]
    pub(in crate::cli) feed_mm_per_min: f64,
    /// Seed of everything random
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub(in crate::cli) seed: u64,
    /// Most gains that are looked at
    #[arg(long, default_value_t = 2_000, value_name = "N")]
    pub(in crate::cli) evaluations: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum ObjectiveName {
    /// Eq. (8) of the paper, as printed
    Paper,
    /// How far the axes leave their orbit at a reversal
    Protrusion,
    /// Ms of the velocity loop
    Sensitivity,
    /// Current that the encoder's counts make
    Noise,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Vary {
    Kp,
    Friction,
    Inertia,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum CountsName {
    Worst,
    Mean,
}

/// Longest acceleration time of the paper's problem, s.
pub(in crate::cli) const ACCELERATION_TIME_S: f64 = 0.2;

/// The least protrusion of a machine, and the number of the gain set that is tuned.
pub(in crate::cli) fn least_protrusion(
    arguments: &SearchArguments,
    machine: &Machine,
) -> anyhow::Result<(Request, u8)> {
    of(&[ObjectiveName::Protrusion], ACCELERATION_TIME_S, arguments, machine)
}

/// What is asked, and the number of the gain set that is tuned.
pub(in crate::cli) fn of(
    objective: &[ObjectiveName],
    acceleration_time_s: f64,
    arguments: &SearchArguments,
    machine: &Machine,
) -> anyhow::Result<(Request, u8)> {
    let set = machine.gain_set(&arguments.from).with_context(|| {
        format!(
            "gain set \"{}\" is not in the machine file; it has {}",
            arguments.from,
            machine.gain_sets.join(", ")
        )
    })?;
    let is_paper = objective.contains(&ObjectiveName::Paper);
    ensure!(
        !is_paper || (objective.len() == 1 && arguments.vary.is_empty()),
        "--objective paper stands alone: Eq. (8) knows V_p and V_i only"
    );
    let mut fixed = Choice::of_set(machine, set);
    ensure!(
        fixed.v_i.is_finite() && fixed.v_i > 0.0,
        "gain set {} has no integral part to begin with",
        arguments.from
    );
    // As the machine file is held to: half of this still rings.
    let position_s = machine.cycle.period.as_s() * f64::from(machine.cycle.position_every);
    let kp = |option: &str, value: f64| within(option, value, [0.1, (1.0 / position_s).min(1_000.0)], "1/s");
    if let Some(value) = arguments.kp_per_s {
        fixed.kp_per_s = kp("--kp-per-s", value)?;
    }
    let [low, high] = if is_paper { [1.0, 100.0] } else { [10.0, 1_000.0] };
    let v_p = [arguments.v_p_min.unwrap_or(low), arguments.v_p_max.unwrap_or(high)];
    let mut ranges = vec![
        range(Quantity::VP, v_p, "--v-p-min", "--v-p-max")?,
        range(Quantity::VI, [arguments.v_i_min, arguments.v_i_max], "--v-i-min", "--v-i-max")?,
    ];
    for vary in &arguments.vary {
        ranges.push(match vary {
            Vary::Kp => {
                let high = kp("--kp-max-per-s", arguments.kp_max_per_s.unwrap_or(50.0))?;
                Range { quantity: Quantity::Kp, low: high.min(1.0), high }
            }
            Vary::Friction => Range { quantity: Quantity::Friction, low: 0.0, high: 1.5 },
            Vary::Inertia => Range { quantity: Quantity::Inertia, low: 0.0, high: 1.5 },
        });
    }
    ensure!(
        arguments.kp_max_per_s.is_none() || arguments.vary.contains(&Vary::Kp),
        "--kp-max-per-s bounds what --vary kp varies"
    );
    let share = within("--spread-percent", arguments.spread_percent, [0.0, 50.0], "%")? / 100.0;
    let spread = match arguments.plants {
        _ if share == 0.0 => Spread::Nominal,
        None => Spread::Corners { share },
        Some(plants) => Spread::Random { share, plants, seed: arguments.seed },
    };
    let path = Path {
        radius: Position::mm(within("--radius-mm", arguments.radius_mm, [1.0, 10_000.0], "mm")?),
        feed: Velocity::mm_per_min(within(
            "--feed-mm-per-min",
            arguments.feed_mm_per_min,
            [1.0, 100_000.0],
            "mm/min",
        )?),
    };
    let margin_deg = within("--phase-margin-deg", margin_deg(arguments, is_paper), [0.0, 90.0], "deg")?;
    let requirements = Requirements {
        phase_margin_deg_min: if is_paper { 0.0 } else { margin_deg },
        gain_margin_db_min: within("--gain-margin-db", arguments.gain_margin_db, [0.0, 60.0], "dB")?,
        sensitivity_max: within("--ms", arguments.ms, [1.0, 10.0], "")?,
    };
    let acceleration_time_s_max = within("--acceleration-time-s", acceleration_time_s, [1e-3, 100.0], "s")?;
    let goal = if is_paper {
        Goal::Paper(paper::Request { phase_margin_deg_min: margin_deg, acceleration_time_s_max })
    } else {
        goal(objective, arguments.judge)?
    };
    let (evaluations_max, seed) = (arguments.evaluations, arguments.seed);
    Ok((
        Request { goal, space: Space { fixed, ranges }, requirements, spread, path, evaluations_max, seed },
        set,
    ))
}

fn margin_deg(arguments: &SearchArguments, is_paper: bool) -> f64 {
    arguments.phase_margin_deg.unwrap_or(if is_paper { 49.0 } else { 40.0 })
}

fn goal(names: &[ObjectiveName], judge: CountsName) -> anyhow::Result<Goal> {
    let mut objectives = Vec::new();
    for name in names {
        let objective = match name {
            ObjectiveName::Paper => bail!("--objective paper stands alone"),
            ObjectiveName::Protrusion => Objective::Protrusion,
            ObjectiveName::Sensitivity => Objective::Sensitivity,
            ObjectiveName::Noise => Objective::Noise,
        };
        ensure!(!objectives.contains(&objective), "--objective names {name:?} twice");
        objectives.push(objective);
    }
    let counts = match judge {
        CountsName::Worst => Counts::Worst,
        CountsName::Mean => Counts::Mean,
    };
    Ok(Goal::Machine { objectives, counts })
}

fn range(quantity: Quantity, [low, high]: [f64; 2], least: &str, most: &str) -> anyhow::Result<Range> {
    within(least, low, [1e-6, 1e6], "")?;
    within(most, high, [low, 1e6], "")?;
    Ok(Range { quantity, low, high })
}

fn within(option: &str, value: f64, [low, high]: [f64; 2], unit: &str) -> anyhow::Result<f64> {
    ensure!(
        value >= low && value <= high,
        "{option} {value} is outside the allowed range of {low} to {high} {unit}"
    );
    Ok(value)
}
