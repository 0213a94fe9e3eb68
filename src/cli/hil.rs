//! `quadrant hil run SCENARIO...`: what the simulated machine is put through, and what the controller makes of
//! it, judged against what each scenario expects. It ends with 0 when every expectation is met, with 2 when
//! one is not.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::{Outcome, print_json, print_text};
use crate::config::scenario::load_scenario;
use crate::offline::hil::{Finding, run_in_memory};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Run scenarios in memory and judge them
    Run(Run),
}

#[derive(Debug, Args)]
struct Run {
    /// Scenarios: machine, motion, timed faults, expectations (see tests/scenarios)
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
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
    }
}

fn run_scenarios(arguments: &Run) -> anyhow::Result<Outcome> {
    // All of them are read before the first is run.
    let scenarios = arguments.files.iter().map(|file| load_scenario(file)).collect::<Result<Vec<_>, _>>()?;
    let bar = ProgressBar::new(scenarios.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos} of {len}  left {eta}") {
        bar.set_style(style);
    }
    let mut printed = Vec::new();
    for (file, scenario) in arguments.files.iter().zip(&scenarios) {
        bar.set_message(scenario.name.clone());
        let outcome = run_in_memory(scenario);
        let (file, name, is_met) = (file.display().to_string(), scenario.name.clone(), outcome.is_met());
        printed.push(Printed { file, name, is_met, findings: outcome.findings });
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

fn table(scenarios: &[Printed], unmet: usize) -> String {
    let mut text = String::new();
    for scenario in scenarios {
        text += &format!("{}  {}\n", if scenario.is_met { "met  " } else { "UNMET" }, scenario.name);
        scenario.findings.iter().for_each(|finding| text += &format!("       {finding}\n"));
    }
    text + &format!("\n{} scenarios, {unmet} unmet\n", scenarios.len())
}
