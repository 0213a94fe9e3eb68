//! `quadrant gap plan`: says which runs show every effect of the catalogue on a machine, and records them.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use serde::Serialize;

use super::super::live::{out_folder, stamp_now, stop_wish};
use super::super::stage::{StageArguments, may_move, whereabouts};
use super::super::{Outcome, axes_of, print_json, view};
use super::record::{Recorder, listed};
use crate::config::Machine;
use crate::offline::gap::plan::Recordings;
use crate::offline::identify::plan::Request;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    stage: StageArguments,
    /// Gain set of the runs
    #[arg(long, default_value = "standard", value_name = "NAME")]
    gains: String,
    /// Axes to move, as `x,y` [default: all]
    #[arg(long, value_delimiter = ',', value_name = "AXES")]
    axes: Vec<String>,
    /// Repeat a circle for so many minutes too: what changes as the machine gets warm needs an hour
    #[arg(long, value_name = "MINUTES", value_parser = minutes)]
    repetition_minutes: Option<f64>,
    /// Say what would be recorded, and move nothing
    #[arg(long)]
    dry_run: bool,
    /// Seed of everything random in a simulated machine
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Move a real machine without asking
    #[arg(long)]
    yes: bool,
    /// Folder for the logs [default: a new folder under quadrant-out]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// A time that is a number from 1 to 600 minutes.
fn minutes(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (1.0..=600.0).contains(&value) => Ok(value),
        Ok(_) | Err(_) => Err("wanted is a number from 1 to 600 (minutes)".to_owned()),
    }
}

/// A run in JSON.
#[derive(Debug, Serialize)]
struct PrintedRun {
    name: String,
    shows: String,
    motions: usize,
    duration_s: f64,
    /// `None`: not recorded.
    log: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
struct Printed {
    machine: String,
    runs: Vec<PrintedRun>,
    duration_s: f64,
    left_out: Vec<String>,
    /// Effects that none of the runs shows.
    unseen: Vec<&'static str>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let [machine, plant] = arguments.stage.machines()?;
    let request = Request { gains: arguments.gains.clone(), axes: axes_of(&machine, &arguments.axes)? };
    let recordings = Recordings::of(&machine, &request, arguments.repetition_minutes)?;
    if recordings.runs.is_empty() {
        bail!("machine {}: no run is possible: {}", machine.name, recordings.left_out.join("; "));
    }
    let place = arguments.stage.place(arguments.seed);
    eprintln!("machine {}, {}", machine.name, whereabouts(&place));
    say(&machine, &recordings);
    let mut printed = Printed::new(&machine, &recordings);
    let mut outcome = Outcome::Done;
    if !arguments.dry_run {
        if !may_move(&place, arguments.yes)? {
            return Ok(Outcome::NotDone);
        }
        let folder =
            out_folder(arguments.out.as_deref(), &format!("{}-gap-plan-{}", stamp_now(), machine.name))?;
        let recorder = Recorder {
            machine: &machine,
            plant: &plant,
            place: &place,
            allow_jitter: arguments.stage.allow_jitter,
            stop_wish: stop_wish(&place)?,
            folder: &folder,
        };
        for (run, printed) in recordings.runs.iter().zip(&mut printed.runs) {
            let (log, ended) = recorder.record(run, &request)?;
            if ended != Outcome::Done {
                outcome = ended;
            }
            if ended == Outcome::NotDone {
                eprintln!("ended in {}; the logs so far are kept: {}", run.name, folder.display());
                break;
            }
            printed.log = Some(log);
        }
        if outcome != Outcome::NotDone {
            eprintln!(
                "recorded; next: quadrant gap --machine {} --gains {} --data {}/*.mcap",
                arguments.stage.machine,
                arguments.gains,
                folder.display()
            );
        }
    }
    if arguments.json {
        print_json(&printed)?;
    }
    Ok(outcome)
}

impl Printed {
    fn new(machine: &Machine, recordings: &Recordings) -> Self {
        let runs = recordings.runs.iter().map(|run| PrintedRun {
            name: run.name.clone(),
            shows: run.shows.to_string(),
            motions: run.plan.motions().len(),
            duration_s: run.plan.duration_s(),
            log: None,
        });
        Self {
            machine: machine.name.clone(),
            runs: runs.collect(),
            duration_s: recordings.duration_s(),
            left_out: recordings.left_out.clone(),
            unseen: recordings.unseen().iter().map(|entry| entry.name).collect(),
        }
    }
}

/// What moves, how far, how fast and how long, and what is not shown by it.
fn say(machine: &Machine, recordings: &Recordings) {
    let all = recordings.programme();
    eprint!("{}{}", view::reach(machine, &all), view::pace_of(&all, recordings.duration_s()));
    eprintln!("{}", listed(&recordings.runs));
    recordings.left_out.iter().for_each(|why| eprintln!("left out: {why}"));
    for (experiment, names) in recordings.unseen_by_experiment() {
        eprintln!("not shown by any of them: {}; needed: {experiment}", names.join(", "));
    }
    eprintln!("Ctrl-C brings the axes to rest along their path");
}
