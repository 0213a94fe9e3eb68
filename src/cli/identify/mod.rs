//! `quadrant identify`: experiments on a machine, and measured motion in, parameters of the axes with their
//! intervals out.

pub(super) mod experiments;
mod foreign;
mod logs;

use std::path::PathBuf;

use clap::Args;

use super::{Outcome, PaceName};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Machine file, or an embedded machine, to run the experiments on
    #[arg(long, default_value = "reference", value_name = "FILE|NAME")]
    machine: String,
    /// Gain set of the machine file during the experiments
    #[arg(long, default_value = "standard", value_name = "NAME")]
    gains: String,
    /// Axes to run the experiments on, as `x,y` [default: all]
    #[arg(long, value_delimiter = ',', value_name = "AXES")]
    axes: Vec<String>,
    /// CAN interface of the machine: with --pace realtime a real or simulated one, in virtual time `hil-sim`;
    /// without, the machine is simulated in this process
    #[arg(long, value_name = "INTERFACE")]
    bus: Option<String>,
    /// As fast as the processor allows, or on the wall clock
    #[arg(long, value_enum, default_value_t = PaceName::Virtual)]
    pace: PaceName,
    /// Seed of everything random in the simulated machine
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Simulate the axes of this machine file behind the boards: what the machine file does not know of
    #[arg(long, value_name = "FILE|NAME", conflicts_with = "bus")]
    plant: Option<String>,
    /// Write the log of the experiments to this file [default: in a new folder under quadrant-out]
    #[arg(long, value_name = "FILE.mcap")]
    log_to: Option<PathBuf>,
    /// Move a real machine without asking
    #[arg(long)]
    yes: bool,
    /// Drive a real machine from a computer that is not fit for real time: at a desk only
    #[arg(long)]
    allow_jitter: bool,
    /// Instead of experiments: logs of one machine (MCAP), any number of them
    #[arg(long, value_name = "FILE.mcap", num_args = 1.., conflicts_with = "data")]
    log: Vec<PathBuf>,
    /// How far the torque constant may be off, as half a 95 % interval: a term of its own in every force
    #[arg(long, value_name = "PERCENT", default_value_t = 5.0, value_parser = percent,
          allow_negative_numbers = true, conflicts_with = "data")]
    torque_constant_tolerance_percent: f64,
    /// Put what was found into this machine file, with interval and origin; it is checked before it is replaced
    #[arg(long, value_name = "FILE.toml", conflicts_with = "data")]
    write: Option<PathBuf>,
    /// Instead of experiments: measurements that are no log, a CSV file (`-` for standard input)
    #[arg(long, value_name = "FILE.csv", requires = "columns")]
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

/// A share that is a number from 0 to 50 %.
pub(super) fn percent(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.0..=50.0).contains(&value) => Ok(value),
        Ok(_) | Err(_) => Err("wanted is a number from 0 to 50 (%)".to_owned()),
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match (&arguments.data, &arguments.columns) {
        (Some(data), Some(columns)) => foreign::run(arguments, data, columns),
        _ if !arguments.log.is_empty() => logs::run(arguments, &arguments.log),
        _ => experiments::run(arguments),
    }
}
