//! `quadrant hil run SCENARIO...`: what the simulated machine is put through, and what the controller makes of
//! it, judged against what each scenario expects. It ends with 0 when every expectation is met, with 2 when
//! one is not.
//! `quadrant hil survey`: what becomes of every fault at many moments. It ends with 1 when a run went on with
//! data that were more wrong than may stay unseen.

use std::path::PathBuf;

use anyhow::Context;
use clap::builder::PossibleValuesParser;
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::{Outcome, machine, print_json, print_text};
use crate::config::scenario::load_scenario;
use crate::offline::hil::survey::{self, Line};
use crate::offline::hil::{Finding, run_in_memory};
use crate::sim::script::Kind;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Run scenarios in memory and judge them
    Run(Run),
    /// Let every kind of fault strike at many moments of a circle, and tell what became of each
    Survey(Survey),
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

#[derive(Debug, Args)]
struct Survey {
    /// Machine: `reference`, `paper`, `classic`, or a file
    #[arg(long, default_value = "reference", value_name = "NAME|FILE")]
    machine: String,
    /// Decides moments and chances
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Runs of each fault
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=1_000))]
    moments: u16,
    /// Only faults of this kind
    #[arg(long, value_name = "KIND", value_parser = PossibleValuesParser::new(Kind::ALL.map(Kind::name)))]
    fault: Option<String>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Write the page to a file instead of printing it
    #[arg(long, value_name = "FILE", conflicts_with_all = ["json", "fault"])]
    write: Option<PathBuf>,
}

/// A survey, for programs.
#[derive(Debug, Serialize)]
struct PrintedSurvey<'a> {
    machine: &'a str,
    seed: u64,
    moments: u16,
    carried_on: usize,
    lines: &'a [Line],
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
        Verb::Survey(arguments) => run_survey(arguments),
    }
}

fn run_scenarios(arguments: &Run) -> anyhow::Result<Outcome> {
    // All of them are read before the first is run.
    let scenarios = arguments.files.iter().map(|file| load_scenario(file)).collect::<Result<Vec<_>, _>>()?;
    let bar = progress(scenarios.len());
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

fn run_survey(arguments: &Survey) -> anyhow::Result<Outcome> {
    let machine = machine(&arguments.machine)?;
    let mut survey = survey::Survey::plan(&machine, arguments.seed, usize::from(arguments.moments))?;
    arguments.fault.iter().for_each(|fault| survey.retain(fault));
    let bar = progress(survey.runs());
    let lines = survey.run(&|| bar.inc(1));
    bar.finish_and_clear();
    let carried_on = lines.iter().map(|line| line.carried_on.len()).sum();
    if arguments.json {
        let Survey { seed, moments, .. } = *arguments;
        print_json(&PrintedSurvey { machine: &machine.name, seed, moments, carried_on, lines: &lines })?;
    } else if let Some(file) = &arguments.write {
        std::fs::write(file, survey::page(&survey, &lines))
            .with_context(|| format!("cannot write {}", file.display()))?;
        print_text(&format!(
            "{} runs, {carried_on} carried on with wrong data: {}\n",
            survey.runs(),
            file.display()
        ))?;
    } else {
        print_text(&survey::page(&survey, &lines))?;
    }
    if carried_on > 0 {
        eprintln!("{carried_on} runs carried on with data that were more wrong than may stay unseen");
    }
    Ok(if carried_on == 0 { Outcome::Done } else { Outcome::Incomplete })
}

fn progress(runs: usize) -> ProgressBar {
    let bar = ProgressBar::new(runs as u64);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos} of {len}  left {eta}") {
        bar.set_style(style);
    }
    bar
}

fn table(scenarios: &[Printed], unmet: usize) -> String {
    let mut text = String::new();
    for scenario in scenarios {
        text += &format!("{}  {}\n", if scenario.is_met { "met  " } else { "UNMET" }, scenario.name);
        scenario.findings.iter().for_each(|finding| text += &format!("       {finding}\n"));
    }
    text + &format!("\n{} scenarios, {unmet} unmet\n", scenarios.len())
}
