//! `quadrant identify`: experiments on a machine, and measured motion in, parameters of the axes with their
//! intervals out.

pub(super) mod experiments;
mod foreign;
mod logs;

use std::path::PathBuf;

use clap::Args;

use super::Outcome;
use super::stage::{ForceArguments, StageArguments};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    stage: StageArguments,
    #[command(flatten)]
    forces: ForceArguments,
    /// Gain set of the machine file during the experiments
    #[arg(long, default_value = "standard", value_name = "NAME")]
    gains: String,
    /// Axes to run the experiments on, as `x,y` [default: all]
    #[arg(long, value_delimiter = ',', value_name = "AXES")]
    axes: Vec<String>,
    /// Seed of everything random in the simulated machine
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Write the log of the experiments to this file [default: in a new folder under quadrant-out]
    #[arg(long, value_name = "FILE.mcap")]
    log_to: Option<PathBuf>,
    /// Move a real machine without asking
    #[arg(long)]
    yes: bool,
    /// Instead of experiments: logs of one machine (MCAP), any number of them
    #[arg(long, value_name = "FILE.mcap", num_args = 1.., conflicts_with = "data")]
    log: Vec<PathBuf>,
    /// Put what was found into this machine file, with interval and origin; it is checked before it is replaced
    #[arg(long, value_name = "FILE.toml", conflicts_with = "data")]
    write: Option<PathBuf>,
    /// Instead of experiments: measurements that are no log, a CSV file (`-` for standard input)
    #[arg(
        long,
        value_name = "FILE.csv",
        requires = "columns",
        conflicts_with = "torque_constant_tolerance_percent"
    )]
    data: Option<PathBuf>,
    /// What the columns of the CSV file are
    #[arg(long, value_name = "MAP.toml", requires = "data")]
    columns: Option<PathBuf>,
    /// Write a page with the friction curve of each axis into this folder
    #[arg(long, value_name = "FOLDER")]
    report: Option<PathBuf>,
    /// Print one JSON object: {axis: {parameter: {value, ci95, unit, source}}}
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match (&arguments.data, &arguments.columns) {
        (Some(data), Some(columns)) => foreign::run(arguments, data, columns),
        _ if !arguments.log.is_empty() => logs::run(arguments, &arguments.log),
        _ => experiments::run(arguments),
    }
}
