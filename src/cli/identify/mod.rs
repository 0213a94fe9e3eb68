//! `quadrant identify`: measured motion in, parameters of the axes with their intervals out.

mod foreign;

use std::path::PathBuf;

use clap::Args;

use super::Outcome;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Measurements that are no log: a CSV file (`-` for standard input)
    #[arg(long, value_name = "FILE.csv", requires = "columns")]
    data: PathBuf,
    /// What the columns of the CSV file are
    #[arg(long, value_name = "MAP.toml")]
    columns: PathBuf,
    /// Write a page with the friction curve of each axis into this folder
    #[arg(long, value_name = "FOLDER")]
    report: Option<PathBuf>,
    /// Print one JSON object: {axis: {parameter: {value, ci95, unit, source}}}
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    foreign::run(arguments)
}
