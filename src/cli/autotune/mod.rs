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

use super::identify::percent;
use super::tune::request::SearchArguments;
use super::{Outcome, PaceName, print_json, print_text};

use printed::Told;
use setup::Setup;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(long, default_value = "reference", value_name = "FILE|NAME")]
    machine: String,
    /// CAN interface of the machine: with --pace realtime a real or simulated one, in virtual time `hil-sim`;
    /// without, the machine is simulated in this process
    #[arg(long, value_name = "INTERFACE")]
    bus: Option<String>,
    /// As fast as the processor allows, or on the wall clock
    #[arg(long, value_enum, default_value_t = PaceName::Virtual)]
    pace: PaceName,
    /// Simulate the axes of this machine file behind the boards: what the machine file does not know of
    #[arg(long, value_name = "FILE|NAME", conflicts_with = "bus")]
    plant: Option<String>,
    /// Take every step without asking
    #[arg(long)]
    yes: bool,
    /// Drive a real machine from a computer that is not fit for real time: at a desk only
    #[arg(long)]
    allow_jitter: bool,
    /// How far the torque constant may be off, as half a 95 % interval
    #[arg(long, value_name = "PERCENT", default_value_t = 5.0, value_parser = percent,
          allow_negative_numbers = true)]
    torque_constant_tolerance_percent: f64,
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
