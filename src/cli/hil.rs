//! `quadrant hil run SCENARIO...`: what the simulated machine is put through, and what the controller makes of
//! it, judged against what each scenario expects. It ends with 0 when every expectation is met, with 2 when
//! one is not. The machine is in this process, or in one of its own at the other end of a CAN interface.

mod logs;
mod on_bus;
mod peer;
mod realtime;
mod survey;

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::{Outcome, PaceName, print_json, print_text};
use crate::config::scenario::{Scenario, load_scenario};
use crate::log::Pace;
use crate::offline::hil::{self, Finding, in_memory};
use crate::run::Place;

use self::logs::Log;
use self::on_bus::OnBus;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Run scenarios, in memory or over a CAN interface, and judge them
    Run(Run),
    /// Let every kind of fault strike at many moments of a circle, and tell what became of each
    Survey(survey::Arguments),
}

#[derive(Debug, Args)]
struct Run {
    /// Scenarios: machine, motion, timed faults, expectations (see tests/scenarios)
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Virtual CAN interface to run them over: `hil-sim` is started at its other end, one for each scenario
    #[arg(long, value_name = "INTERFACE")]
    bus: Option<String>,
    /// With --bus: as fast as the processor allows and in lock step, or on the wall clock
    #[arg(long, value_enum, default_value_t = PaceName::Virtual, requires = "bus")]
    pace: PaceName,
    /// With --bus: the `hil-sim` that plays the one scenario runs already; what only it knows stays unjudged
    #[arg(long, requires = "bus")]
    attach: bool,
    /// Keep the log of each run in this folder
    #[arg(long, value_name = "FOLDER")]
    logs: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// One scenario, for programs.
#[derive(Debug, Serialize)]
struct Printed {
    file: String,
    name: String,
    is_met: bool,
    findings: Vec<Finding>,
    /// Expectations that only the truth could tell, where nobody told it.
    unjudged: Vec<&'static str>,
}

/// All of them, for programs.
#[derive(Debug, Serialize)]
struct PrintedAll<'a> {
    scenarios: &'a [Printed],
    unmet: usize,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match &arguments.verb {
        Verb::Run(arguments) => run_scenarios(arguments),
        Verb::Survey(arguments) => survey::run(arguments),
    }
}

fn run_scenarios(arguments: &Run) -> anyhow::Result<Outcome> {
    ensure!(
        !arguments.attach || arguments.files.len() == 1,
        "--attach takes one scenario, the one that hil-sim plays; {} are given",
        arguments.files.len()
    );
    // All of them are read before the first is run.
    let scenarios = arguments.files.iter().map(|file| load_scenario(file)).collect::<Result<Vec<_>, _>>()?;
    let bar = progress(scenarios.len());
    let mut printed = Vec::new();
    for (file, scenario) in arguments.files.iter().zip(&scenarios) {
        bar.set_message(scenario.name.clone());
        let outcome = run_one(arguments, file, scenario).with_context(|| file.display().to_string())?;
        let (file, name, is_met) = (file.display().to_string(), scenario.name.clone(), outcome.is_met());
        let hil::Outcome { findings, unjudged, .. } = outcome;
        printed.push(Printed { file, name, is_met, findings, unjudged });
        bar.inc(1);
    }
    bar.finish_and_clear();
    let unmet = printed.iter().filter(|scenario| !scenario.is_met).count();
    if arguments.json {
        print_json(&PrintedAll { scenarios: &printed, unmet })?;
    } else {
        print_text(&table(&printed, unmet))?;
    }
    Ok(if unmet == 0 { Outcome::Done } else { Outcome::NotDone })
}

fn progress(runs: usize) -> ProgressBar {
    let bar = ProgressBar::new(runs as u64);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos} of {len}  left {eta}") {
        bar.set_style(style);
    }
    bar
}

fn run_one(arguments: &Run, file: &Path, scenario: &Scenario) -> anyhow::Result<hil::Outcome> {
    let place = Place {
        pace: arguments.pace.pace(),
        interface: arguments.bus.as_deref(),
        seed: scenario.script.seed,
    };
    let mut log = Log::start(arguments.logs.as_deref(), file, scenario, &place)?;
    let outcome = match place.interface {
        None => in_memory(scenario, |record, inputs| log.put(record, inputs)),
        Some(interface) => {
            let on_bus = OnBus { interface, is_attached: arguments.attach, file, scenario };
            match place.pace {
                Pace::Virtual => on_bus.in_lock_step(&mut log)?,
                Pace::Realtime => on_bus.on_the_clock(&mut log)?,
            }
        }
    };
    log.finish()?;
    Ok(outcome)
}

fn table(scenarios: &[Printed], unmet: usize) -> String {
    let mut text = String::new();
    for scenario in scenarios {
        text += &format!("{}  {}\n", if scenario.is_met { "met  " } else { "UNMET" }, scenario.name);
        scenario.findings.iter().for_each(|finding| text += &format!("       {finding}\n"));
        scenario
            .unjudged
            .iter()
            .for_each(|expectation| text += &format!("       {expectation}: not judged\n"));
    }
    text + &format!("\n{} scenarios, {unmet} unmet\n", scenarios.len())
}
