//! `quadrant gap`: where simulation and measurement disagree, the effect that is missing, and how far the gap shrinks
//! with it.

mod printed;

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use super::live::stamp_now;
use super::{Outcome, machine, print_json, print_text};
use crate::config::edit::MachineFile;
use crate::config::{self, Machine};
use crate::log::Reader;
use crate::log::header::rfc3339;
use crate::offline::gap::analysis::{Analysis, Request, analyse};
use crate::offline::gap::intake;
use crate::offline::gap::runs::{Intake, Run};
use crate::offline::gap::write_back::{self, Origin};
use crate::offline::identify::foreign::Raw;
use crate::offline::report;
use crate::offline::trace::Trace;
use crate::run::{VERSION, wall_now_ns};

use printed::Printed;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Runs of one machine: logs (MCAP), and CSV files with the columns t_s, x.setpoint_mm, x.position_mm, x.table_mm,
    /// x.current_a
    #[arg(long, value_name = "FILE", num_args = 1.., required = true)]
    data: Vec<PathBuf>,
    /// Machine file, or an embedded machine, that the runs are held against [default: that of the first log, else
    /// paper]
    #[arg(long, value_name = "FILE|NAME")]
    machine: Option<String>,
    /// Gain set of the runs
    #[arg(long, default_value = "standard", value_name = "NAME")]
    gains: String,
    /// What the columns of the CSV files are, where they are named otherwise
    #[arg(long, value_name = "MAP.toml")]
    columns: Option<PathBuf>,
    /// Axes to look at, as `x,y` [default: all]
    #[arg(long, value_delimiter = ',', value_name = "AXES")]
    axes: Vec<String>,
    /// Write what was named into this file: the machine file itself, whose old text is kept beside it, or a new one
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// Write a page with the gap before and after, over the coordinates that it lives on, into this folder
    #[arg(long, value_name = "FOLDER")]
    report: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let map = match &arguments.columns {
        Some(path) => {
            Some(std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?)
        }
        None => None,
    };
    let machine = machine_of(arguments)?;
    let mut axes = Vec::new();
    for name in &arguments.axes {
        let known = machine.axis_names();
        let Some(id) = machine.axes.axes().find(|id| known[id.index()] == *name) else {
            bail!("no axis \"{name}\" in machine {}; it has {}", machine.name, known.join(", "));
        };
        axes.push(id);
    }
    let mut runs: Vec<Run> = Vec::new();
    let mut repaired = Vec::new();
    for path in &arguments.data {
        let Intake { runs: more, repaired: said } = read(path, map.as_deref(), &machine)?;
        runs.extend(more);
        repaired.extend(said);
    }
    for said in &repaired {
        eprintln!("repaired: {said}");
    }
    let bar = ProgressBar::new_spinner();
    bar.set_style(ProgressStyle::with_template("{spinner} {msg} ({elapsed})")?);
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    let request = Request { gains: arguments.gains.clone(), axes };
    let analysis = analyse(&machine, &runs, &request, &|what| bar.set_message(what.to_owned()));
    bar.finish_and_clear();
    let analysis = analysis?;
    let names: Vec<&str> = runs.iter().map(|run| run.name.as_str()).collect();
    let origin = Origin { runs: names.join(", "), date: rfc3339(wall_now_ns()), commit: VERSION.to_owned() };
    let mut after = MachineFile::create(Path::new("machine.toml"), &machine)?;
    let is_changed = write_back::put(&mut after, &machine, &analysis, &origin)?;
    if let Some(path) = &arguments.write {
        write(path, is_changed, &machine, &analysis, &origin)?;
    }
    let after = is_changed.then(|| after.text());
    let mut printed = Printed::new(&machine, &runs, &analysis, repaired, after);
    if let Some(folder) = &arguments.report {
        printed.report = Some(report::gap::write(folder, &machine, &analysis, &printed.rows())?);
    }
    if arguments.json {
        print_json(&printed)?;
    } else {
        print_text(&printed.text())?;
    }
    Ok(Outcome::Done)
}

/// Puts what was named into a file.
fn write(
    path: &Path,
    is_changed: bool,
    machine: &Machine,
    analysis: &Analysis<'_>,
    origin: &Origin,
) -> anyhow::Result<()> {
    if !is_changed {
        eprintln!("nothing was named; {} is not written", path.display());
        return Ok(());
    }
    let mut file = if path.exists() {
        let file = MachineFile::open(path)?;
        // What was named holds beside what these runs were held against, and nothing else.
        if file.text() != machine.text {
            bail!(
                "{} is not the machine file that the runs were held against; give that one with --machine, or a new file",
                path.display()
            );
        }
        file
    } else {
        MachineFile::create(path, machine)?
    };
    write_back::put(&mut file, machine, analysis, origin)?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let beside = path.with_file_name(format!("{stem}.before-{}.toml", stamp_now()));
    file.keep_old(&beside)?;
    file.replace()?;
    eprintln!("{} written", path.display());
    Ok(())
}

/// The machine of the option; without it that of the first log, which carries its own.
fn machine_of(arguments: &Arguments) -> anyhow::Result<Machine> {
    if let Some(name) = &arguments.machine {
        return machine(name);
    }
    let Some(log) = arguments.data.iter().find(|path| is_log(path)) else { return machine("paper") };
    let reader = Reader::open(log).with_context(|| log.display().to_string())?;
    let header = reader.header();
    Ok(config::from_texts(&log.display().to_string(), &header.machine_text, &header.sheets)
        .map_err(config::LoadError::Problems)?)
}

fn is_log(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mcap"))
}

fn read(path: &Path, map: Option<&str>, machine: &Machine) -> anyhow::Result<Intake> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if is_log(path) {
        let mut reader = Reader::open(path).with_context(|| path.display().to_string())?;
        let records: Vec<_> =
            reader.by_ref().collect::<Result<_, _>>().with_context(|| path.display().to_string())?;
        let trace = Trace::from_records(&records).with_context(|| path.display().to_string())?;
        return Ok(intake::of_trace(&name, &trace, machine)?);
    }
    let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    let raw = Raw::read(map, file).with_context(|| path.display().to_string())?;
    Ok(intake::of_raw(&name, raw, machine)?)
}
