//! `quadrant autotune`: check, circle before, identify, tune, circle at reduced and at full feed, compare, write.
//!
//! Each step that moves the machine or changes a file says first what it does, and asks. The gains of a step live as
//! long as its cycle: whatever ends the sequence before the last step leaves the machine file, and with it the gains
//! of every later run, as they were. The steps are in `steps.rs`, what can be refused before them in `setup.rs`.

mod consent;
mod printed;
mod setup;
mod steps;

use std::path::PathBuf;

use clap::Args;

use super::stage::{ForceArguments, StageArguments};
use super::tune::request::SearchArguments;
use super::{Outcome, print_json, print_text};

use printed::Told;
use setup::Setup;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    stage: StageArguments,
    #[command(flatten)]
    forces: ForceArguments,
    /// Take every step without asking
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    search: SearchArguments,
    /// Name of the gain set that is written
    #[arg(long, default_value = "tuned", value_name = "NAME")]
    name: String,
    /// Write the result into this file [default: the machine file itself; of an embedded machine a new file in the
    /// folder]
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// Folder for logs and report [default: a new folder under quadrant-out]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let (setup, file) = Setup::of(arguments)?;
    let mut told = Told::new(&setup, file.path());
    let ended = steps::run(&setup, file, &mut told);
    told.end(ended.err());
    told.write_report(&setup.folder);
    if arguments.json {
        eprintln!("{}", told.verdict_in_words());
        print_json(&told)?;
    } else {
        print_text(&told.text())?;
    }
    Ok(told.outcome())
}
