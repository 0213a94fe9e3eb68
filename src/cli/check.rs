//! `quadrant check FILE`: is the machine file right, and what does it imply?

use clap::Args;

use super::{Outcome, machine, print_json, print_text, view};
use crate::offline::check::MachineReport;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(default_value = "reference", value_name = "FILE|NAME")]
    machine: String,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let machine = machine(&arguments.machine)?;
    let report = MachineReport::of(&machine);
    if arguments.json {
        print_json(&report)?;
    } else {
        print_text(&view::machine_tables(&report))?;
    }
    Ok(Outcome::Done)
}
