//! `quadrant gap demo`: hides an effect in a simulated machine, records the runs that show it, and finds it from the machine
//! file, which does not know of it.

use std::path::PathBuf;

use anyhow::ensure;
use clap::Args;

use super::super::live::{out_folder, stamp_now, stop_wish};
use super::super::{Outcome, axis_of, machine};
use super::record::{Recorder, listed};
use super::{Gap, read};
use crate::config::Machine;
use crate::log::Pace;
use crate::offline::gap::analysis::Request;
use crate::offline::gap::demo::Hidden;
use crate::offline::gap::name::named::NamedEffect;
use crate::offline::gap::plan::Recordings;
use crate::offline::gap::runs::intake::Intake;
use crate::offline::identify::plan;
use crate::plant::effects::{Entry, entry};
use crate::run::Place;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(long, default_value = "reference", value_name = "FILE|NAME")]
    machine: String,
    /// Effect that is hidden, one of docs/effects.md
    #[arg(long, default_value = "backlash", value_name = "NAME", value_parser = known)]
    effect: &'static Entry,
    /// How much of it: its first parameter, in the unit of its key [default: so much that it is plain to see]
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    amount: Option<f64>,
    /// Axis that has it
    #[arg(long, default_value = "x", value_name = "AXIS")]
    axis: String,
    /// Gain set of the runs
    #[arg(long, default_value = "standard", value_name = "NAME")]
    gains: String,
    /// Seed of noise, and of how far mass, friction and stiffness are off
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for logs and report [default: a new folder under quadrant-out]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

fn known(name: &str) -> Result<&'static Entry, String> {
    entry(name).ok_or_else(|| "no such effect; docs/effects.md has them all".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let machine = machine(&arguments.machine)?;
    let hidden = hidden(arguments, &machine)?;
    let plant = hidden.machine(&machine);
    let folder = out_folder(arguments.out.as_deref(), &format!("{}-gap-demo", stamp_now()))?;
    let place = Place { pace: Pace::Virtual, interface: None, seed: arguments.seed };
    let recorder = Recorder {
        machine: &machine,
        plant: &plant,
        place: &place,
        allow_jitter: false,
        stop_wish: stop_wish(&place)?,
        folder: &folder,
    };
    let wanted = plan::Request { gains: arguments.gains.clone(), axes: Vec::new() };
    let recordings = Recordings::of(&machine, &wanted, None)?.only(hidden.entry, hidden.axis);
    eprintln!("{}", listed(&recordings.runs));
    let mut intake = Intake::default();
    for run in &recordings.runs {
        let (log, outcome) = recorder.record(run, &wanted)?;
        if outcome != Outcome::Done {
            return Ok(outcome);
        }
        intake.extend(read(&log, None, &machine)?);
    }
    let request = Request { gains: Some(arguments.gains.clone()), axes: vec![hidden.axis] };
    let gap = Gap::of(&machine, intake, &request)?;
    gap.tell(Some(&folder), arguments.json)?;
    let (effect, first) = (hidden.entry, &hidden.entry.parameters[0]);
    eprintln!(
        "hidden was {} of axis {}, {} = {}; mass, friction and stiffness were up to 10 % off",
        effect.name, arguments.axis, first.key, hidden.values[0]
    );
    let found = gap.analysis.axes.iter().flat_map(|axis| &axis.named.effects);
    let is_found = found.flat_map(NamedEffect::members).any(|name| name == effect.name);
    Ok(if is_found { Outcome::Done } else { Outcome::Incomplete })
}

fn hidden(arguments: &Arguments, machine: &Machine) -> anyhow::Result<Hidden> {
    let entry = arguments.effect;
    ensure!(
        !entry.is_of_control(),
        "--effect: {} is of the control of a machine; a simulated machine moves under ours, which has none of it",
        entry.name
    );
    let mut values = entry.nominal();
    if let Some(amount) = arguments.amount {
        let first = &entry.parameters[0];
        let [low, high] = first.bounds;
        ensure!(
            (low..=high).contains(&amount),
            "--amount: {} = {amount} {} is outside the allowed range of {low} to {high} {}",
            first.key,
            first.unit,
            first.unit
        );
        values[0] = amount;
    }
    Ok(Hidden { axis: axis_of(machine, &arguments.axis)?, entry, values, seed: arguments.seed })
}
