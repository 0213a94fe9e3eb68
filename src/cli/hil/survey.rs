//! `quadrant hil survey`: what becomes of every kind of fault at many moments. It ends with 1 when a run went on
//! with data that were more wrong than may stay unseen.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use clap::builder::PossibleValuesParser;
use serde::Serialize;

use super::super::{Outcome, machine, print_json, print_text};
use super::progress;
use crate::offline::hil::survey::{Line, Survey, page};
use crate::sim::script::Kind;

#[derive(Debug, Args)]
pub(super) struct Arguments {
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
struct Printed<'a> {
    machine: &'a str,
    seed: u64,
    moments: u16,
    carried_on: usize,
    lines: &'a [Line],
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let machine = machine(&arguments.machine)?;
    let mut survey = Survey::plan(&machine, arguments.seed, usize::from(arguments.moments))?;
    arguments.fault.iter().for_each(|fault| survey.retain(fault));
    let bar = progress(survey.runs());
    let lines = survey.run(&|| bar.inc(1));
    bar.finish_and_clear();
    let carried_on = lines.iter().map(|line| line.carried_on.len()).sum();
    if arguments.json {
        let Arguments { seed, moments, .. } = *arguments;
        print_json(&Printed { machine: &machine.name, seed, moments, carried_on, lines: &lines })?;
    } else if let Some(file) = &arguments.write {
        std::fs::write(file, page(&survey, &lines))
            .with_context(|| format!("cannot write {}", file.display()))?;
        let runs = survey.runs();
        print_text(&format!("{runs} runs, {carried_on} carried on with wrong data: {}\n", file.display()))?;
    } else {
        print_text(&page(&survey, &lines))?;
    }
    if carried_on > 0 {
        eprintln!("{carried_on} runs carried on with data that were more wrong than may stay unseen");
    }
    Ok(if carried_on == 0 { Outcome::Done } else { Outcome::Incomplete })
}
