//! `quadrant check FILE`: is the machine file right, and what does it imply?

use clap::Args;

use super::{Outcome, machine};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Machine file, or an embedded machine: reference, paper
    #[arg(default_value = "reference", value_name = "FILE|NAME")]
    machine: String,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let machine = machine(&arguments.machine)?;
    println!("{} {}", machine.name, arguments.json);
    Ok(Outcome::Done)
}
