//! From options to what is asked of the tuner; what cannot be is refused with the option, value and bound.

use anyhow::{Context, bail, ensure};

use super::{Arguments, CountsName, ObjectiveName, Vary};
use crate::base::units::{Position, Velocity};
use crate::config::Machine;
use crate::offline::tune::judge::Requirements;
use crate::offline::tune::paper;
use crate::offline::tune::space::{Choice, Quantity, Range, Space};
use crate::offline::tune::spread::Spread;
use crate::offline::tune::window::Path;
use crate::offline::tune::{Counts, Goal, Objective, Request};

/// What is asked, and the number of the gain set that is tuned.
pub(super) fn of(arguments: &Arguments, machine: &Machine) -> anyhow::Result<(Request, u8)> {
    let set = machine.gain_set(&arguments.from).with_context(|| {
        format!(
            "gain set \"{}\" is not in the machine file; it has {}",
            arguments.from,
            machine.gain_sets.join(", ")
        )
    })?;
    let is_paper = arguments.objective.contains(&ObjectiveName::Paper);
    ensure!(
        !is_paper || (arguments.objective.len() == 1 && arguments.vary.is_empty()),
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
    let acceleration_time_s_max =
        within("--acceleration-time-s", arguments.acceleration_time_s, [1e-3, 100.0], "s")?;
    let goal = if is_paper {
        Goal::Paper(paper::Request { phase_margin_deg_min: margin_deg, acceleration_time_s_max })
    } else {
        goal(arguments)?
    };
    let (evaluations_max, seed) = (arguments.evaluations, arguments.seed);
    Ok((
        Request { goal, space: Space { fixed, ranges }, requirements, spread, path, evaluations_max, seed },
        set,
    ))
}

fn margin_deg(arguments: &Arguments, is_paper: bool) -> f64 {
    arguments.phase_margin_deg.unwrap_or(if is_paper { 49.0 } else { 40.0 })
}

fn goal(arguments: &Arguments) -> anyhow::Result<Goal> {
    let mut objectives = Vec::new();
    for name in &arguments.objective {
        let objective = match name {
            ObjectiveName::Paper => bail!("--objective paper stands alone"),
            ObjectiveName::Protrusion => Objective::Protrusion,
            ObjectiveName::Sensitivity => Objective::Sensitivity,
            ObjectiveName::Noise => Objective::Noise,
        };
        ensure!(!objectives.contains(&objective), "--objective names {name:?} twice");
        objectives.push(objective);
    }
    let counts = match arguments.judge {
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
