//! `quadrant identify`: measured motion in, parameters of the axes with their intervals out.

mod foreign;
mod logs;

use std::path::PathBuf;

use clap::{ArgGroup, Args};

use super::Outcome;

#[derive(Debug, Args)]
#[command(group = ArgGroup::new("measured").required(true).args(["log", "data"]))]
pub(super) struct Arguments {
    /// Logs of one machine (MCAP), any number of them
    #[arg(long, value_name = "FILE.mcap", num_args = 1..)]
    log: Vec<PathBuf>,
    /// How far the torque constant may be off, as half a 95 % interval: a term of its own in every force
    #[arg(long, value_name = "PERCENT", default_value_t = 5.0, value_parser = percent,
          allow_negative_numbers = true, conflicts_with = "data")]
    torque_constant_tolerance_percent: f64,
    /// Put what was found into this machine file, with interval and origin; it is checked before it is replaced
    #[arg(long, value_name = "FILE.toml", conflicts_with = "data")]
    write: Option<PathBuf>,
    /// Measurements that are no log: a CSV file (`-` for standard input)
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
fn percent(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.0..=50.0).contains(&value) => Ok(value),
        Ok(_) | Err(_) => Err("wanted is a number from 0 to 50 (%)".to_owned()),
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match (&arguments.data, &arguments.columns) {
        (Some(data), Some(columns)) => foreign::run(arguments, data, columns),
        _ => logs::run(arguments),
    }
}
