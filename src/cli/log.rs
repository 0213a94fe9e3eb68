//! `quadrant log FILE`: what is in a log; as CSV; as text of candump; or what is left of a damaged one.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use serde::Serialize;

use super::{Outcome, print_json, print_text, view};
use crate::log::{Header, LogError, Reader, Summary, csv, header::rfc3339, recover};
use crate::offline::traffic;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The log
    file: PathBuf,
    /// Write every record to this new CSV file (`-` for standard output)
    #[arg(long, value_name = "FILE", conflicts_with = "recover")]
    csv: Option<PathBuf>,
    /// Write the frames of the run to this new text, as `candump -L` would have (`-` for standard output)
    #[arg(long, value_name = "FILE", conflicts_with_all = ["recover", "csv"])]
    candump: Option<PathBuf>,
    /// Name of the CAN interface in that text
    #[arg(long, default_value = "can0", value_name = "NAME", requires = "candump", value_parser = interface)]
    interface: String,
    /// Write everything that is still readable into this new log
    #[arg(long, value_name = "FILE")]
    recover: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    if let Some(target) = &arguments.recover {
        return run_recover(arguments, target);
    }
    if let Some(target) = &arguments.csv {
        return export(&arguments.file, target);
    }
    if let Some(target) = &arguments.candump {
        return export_traffic(arguments, target);
    }
    summarise(arguments)
}

/// The name of an interface is one word.
fn interface(name: &str) -> Result<String, String> {
    let is_word = !name.is_empty() && !name.contains(char::is_whitespace);
    if is_word { Ok(name.to_owned()) } else { Err("a name without blanks is expected".to_owned()) }
}

fn run_recover(arguments: &Arguments, target: &Path) -> anyhow::Result<Outcome> {
    let recovery = recover(&arguments.file, target)?;
    if arguments.json {
        print_json(&recovery)?;
    } else {
        print_text(&format!(
            "{}: {} records\nmissing: {} records, {} bytes unusable\n",
            recovery.path.display(),
            recovery.records,
            recovery.records_lost,
            recovery.bytes_lost
        ))?;
    }
    if recovery.is_header_lost {
        eprintln!("warning: a part of the header was unreadable; see extra.recovered in the new log");
    }
    let is_whole = recovery.records_lost == 0 && recovery.bytes_lost == 0 && !recovery.is_header_lost;
    Ok(if is_whole { Outcome::Done } else { Outcome::Incomplete })
}

fn export(file: &Path, target: &Path) -> anyhow::Result<Outcome> {
    let mut log = Reader::open(file)?;
    let lines = csv::export(&mut log, created(target)?, target)?;
    eprintln!("{lines} records");
    Ok(if say_truncated(&log) { Outcome::Incomplete } else { Outcome::Done })
}

/// A new file, or standard output for `-`.
fn created(target: &Path) -> anyhow::Result<Box<dyn Write>> {
    if target == Path::new("-") {
        return Ok(Box::new(BufWriter::new(std::io::stdout().lock())));
    }
    let file = File::create_new(target)
        .with_context(|| format!("cannot create {}; nothing is overwritten", target.display()))?;
    Ok(Box::new(BufWriter::new(file)))
}

fn export_traffic(arguments: &Arguments, target: &Path) -> anyhow::Result<Outcome> {
    let mut log = Reader::open(&arguments.file)?;
    let exported = traffic::export::export(&mut log, &arguments.interface, created(target)?, target)?;
    let traffic::export::Exported { cycles, frames, cycles_missing, lost } = exported;
    if arguments.json && target != Path::new("-") {
        print_json(&exported)?;
    } else {
        eprintln!("{frames} frames of {cycles} cycles");
    }
    if cycles_missing > 0 || lost > 0 {
        eprintln!(
            "warning: the text lacks the frames of {cycles_missing} cycles; {lost} records and inputs were lost"
        );
    }
    let is_whole = !say_truncated(&log) && cycles_missing == 0 && lost == 0;
    Ok(if is_whole { Outcome::Done } else { Outcome::Incomplete })
}

/// Say on stderr when a log ends without its index.
fn say_truncated(log: &Reader) -> bool {
    if log.is_truncated() {
        eprintln!("warning: the log ends without its index, as after a kill; what was read is complete");
    }
    log.is_truncated()
}

/// What `--json` prints.
#[derive(Serialize)]
struct Printed<'a> {
    file: &'a Path,
    project_version: &'a str,
    commit: &'a str,
    machine: &'a str,
    seed: u64,
    pace: &'static str,
    started: String,
    period_us: f64,
    axes: &'a [String],
    gain_sets: &'a [String],
    motions: &'a std::collections::BTreeMap<u32, serde_json::Value>,
    extra: &'a std::collections::BTreeMap<String, String>,
    is_truncated: bool,
    #[serde(flatten)]
    summary: &'a Summary,
}

fn summarise(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let mut log = Reader::open(&arguments.file)?;
    let header: Header = log.header().clone();
    let summary: Result<Summary, LogError> = Summary::of(&header, &mut log);
    let summary = summary?;
    let printed = Printed {
        file: &arguments.file,
        project_version: &header.project_version,
        commit: &header.commit,
        machine: &header.machine_name,
        seed: header.seed,
        pace: header.pace.name(),
        started: rfc3339(header.wall_at_zero_ns),
        period_us: header.period.as_us(),
        axes: &header.axes,
        gain_sets: &header.gain_sets,
        motions: &header.motions,
        extra: &header.extra,
        is_truncated: log.is_truncated(),
        summary: &summary,
    };
    if arguments.json {
        print_json(&printed)?;
    } else {
        print_text(&(view::log_table(&printed.started, &header, &summary) + "\n"))?;
    }
    Ok(if say_truncated(&log) { Outcome::Incomplete } else { Outcome::Done })
}
