//! `quadrant gap demo`: hides an effect in a simulated machine, records circles of it, and finds it from the machine
//! file, which does not know of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::ensure;
use clap::Args;

use super::super::circle::live::header;
use super::super::live::{Job, out_folder, outcome_of, stamp_now, stop_wish, with_losses};
use super::super::{Outcome, machine};
use super::{Gap, axis_of, read};
use crate::config::Machine;
use crate::config::plan::CircleRequest;
use crate::log::Pace;
use crate::offline::gap::analysis::Request;
use crate::offline::gap::demo::{Hidden, circles};
use crate::offline::gap::name::NamedEffect;
use crate::offline::gap::runs::Intake;
use crate::plant::effects::{Entry, entry};
use crate::rt::cycle::procedure::Programme;
use crate::run::{Origin, Place};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(long, default_value = "paper", value_name = "FILE|NAME")]
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
    let stop = stop_wish(&place)?;
    let mut intake = Intake::default();
    for (name, request) in circles(&arguments.gains) {
        let log = folder.join(format!("{name}.mcap"));
        let outcome = record([&machine, &plant], &request, name, &log, &place, &stop)?;
        if outcome != Outcome::Done {
            return Ok(outcome);
        }
        intake.extend(read(&log, None, &machine)?);
    }
    let request = Request { gains: arguments.gains.clone(), axes: vec![hidden.axis] };
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

/// Runs circles on a machine with what stands behind its boards, and keeps their log.
fn record(
    [machine, plant]: [&Machine; 2],
    request: &CircleRequest,
    title: &'static str,
    log: &Path,
    place: &Place<'_>,
    stop: &Arc<AtomicBool>,
) -> anyhow::Result<Outcome> {
    let test = machine.circle_test(request)?;
    let job = Job {
        machine,
        plant,
        programme: Programme::from(test),
        place,
        allow_jitter: false,
        stop_wish: Arc::clone(stop),
        log,
        title,
        duration_s: test.duration_s(),
    };
    let header = |origin: &Origin| header(machine, request, &test, origin, place);
    let (recorded, ()) = job.run(header, |_| (None, ()))?;
    Ok(with_losses(outcome_of(&recorded.ending), &recorded.log, recorded.lost_records))
}
