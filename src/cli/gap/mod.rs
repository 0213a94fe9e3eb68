//! `quadrant gap`: where simulation and measurement disagree, the effect that is missing, and how far the gap shrinks
//! with it.

mod circles;
mod demo;
mod effect;
mod left;
mod plan;
mod printed;
mod record;

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, bail};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};

use super::live::{beside, stamp_now};
use super::{Outcome, axes_of, print_json, print_text};
use crate::config::edit::MachineFile;
use crate::config::{self, Machine, Purpose};
use crate::log::Reader;
use crate::log::header::rfc3339;
use crate::offline::gap::analysis::{Analysis, Request, analyse};
use crate::offline::gap::measure::limits;
use crate::offline::gap::runs::intake::Intake;
use crate::offline::gap::runs::{intake, logged};
use crate::offline::gap::shortlist::clocks;
use crate::offline::gap::write_back::{self, Origin};
use crate::offline::identify::foreign::Raw;
use crate::offline::report;
use crate::offline::trace::Trace;
use crate::run::{VERSION, wall_now_ns};

use printed::Printed;

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct Arguments {
    #[command(subcommand)]
    verb: Option<Verb>,
    /// Runs of one machine: logs (MCAP), and CSV files with the columns t_s, x.setpoint_mm, x.position_mm, x.table_mm,
    /// x.current_a
    #[arg(long, value_name = "FILE", num_args = 1.., required = true)]
    data: Vec<PathBuf>,
    /// Machine file, or an embedded machine, that the runs are held against [default: that of the first log, else
    /// paper]
    #[arg(long, value_name = "FILE|NAME")]
    machine: Option<String>,
    /// Gain set of the runs [default: the one whose loops explain the current]
    #[arg(long, value_name = "NAME")]
    gains: Option<String>,
    /// What the columns of the CSV files are, where they are named otherwise
    #[arg(long, value_name = "MAP.toml")]
    columns: Option<PathBuf>,
    /// Axes to look at, as `x,y` [default: all]
    #[arg(long, value_delimiter = ',', value_name = "AXES")]
    axes: Vec<String>,
    /// Write what was named into this file: the machine file itself, whose old text is kept beside it, or a new one
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// Put a page with the gap before and after, over the coordinates that it lives on, and all that --json prints into
    /// this folder
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Hide an effect in a simulated machine, record circles of it, and find it
    Demo(demo::Arguments),
    /// Record the runs of a machine that show every effect
    Plan(plan::Arguments),
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match &arguments.verb {
        Some(Verb::Demo(arguments)) => demo::run(arguments),
        Some(Verb::Plan(arguments)) => plan::run(arguments),
        None => of_data(arguments),
    }
}

fn of_data(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let map = match &arguments.columns {
        Some(path) => {
            Some(std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?)
        }
        None => None,
    };
    let mut machine = machine_of(arguments)?;
    let axes = axes_of(&machine, &arguments.axes)?;
    let mut all = Intake::default();
    for path in &arguments.data {
        all.extend(read(path, map.as_deref(), &machine)?);
    }
    let mut intake = all.at_one_rate(&machine);
    if !clocks::have_one(&intake.runs) {
        intake.repaired.push(
            "times of the files overlap: each is given a clock of its own, or what grows with time takes them as recorded one after the other, in the order in which they were given"
                .to_owned(),
        );
    }
    if let Some((without, said)) = limits::lifted(&machine, &intake.runs) {
        intake.repaired.extend(said);
        machine = without;
    }
    let gap = Gap::of(&machine, intake, &Request { gains: arguments.gains.clone(), axes })?;
    if let Some(path) = &arguments.write {
        gap.write(path)?;
    }
    gap.tell(arguments.out.as_deref(), arguments.json)?;
    Ok(Outcome::Done)
}

/// What is being done: axes are asked side by side, and each says what it is at.
#[derive(Default)]
struct Doing(Mutex<BTreeMap<String, String>>);

impl Doing {
    /// With what somebody says now, all on a line: what is of no axis follows on what was.
    fn with(&self, said: &str) -> String {
        let mut axes = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match said.split_once(": ") {
            Some((axis, what)) if axis.starts_with("axis ") => {
                axes.insert(axis.to_owned(), what.to_owned());
                let all: Vec<String> = axes.iter().map(|(axis, what)| format!("{axis}: {what}")).collect();
                all.join("; ")
            }
            _ => {
                axes.clear();
                said.to_owned()
            }
        }
    }
}

/// What runs say of a machine.
struct Gap<'m> {
    machine: &'m Machine,
    intake: Intake,
    analysis: Analysis<'m>,
    origin: Origin,
}

impl<'m> Gap<'m> {
    /// Analyses the runs; what is being done is shown meanwhile.
    fn of(machine: &'m Machine, intake: Intake, request: &Request) -> anyhow::Result<Self> {
        for said in &intake.repaired {
            eprintln!("repaired: {said}");
        }
        let bar = ProgressBar::new_spinner();
        bar.set_style(ProgressStyle::with_template("{spinner} {elapsed} {wide_msg}")?);
        bar.enable_steady_tick(std::time::Duration::from_millis(200));
        let doing = Doing::default();
        let analysis = analyse(machine, &intake.runs, request, &|what| bar.set_message(doing.with(what)));
        bar.finish_and_clear();
        let names: Vec<&str> = intake.runs.iter().map(|run| run.name.as_str()).collect();
        let origin =
            Origin { runs: names.join(", "), date: rfc3339(wall_now_ns()), commit: VERSION.to_owned() };
        Ok(Self { machine, analysis: analysis?, intake, origin })
    }

    /// Prints it, and puts it into a folder if there is one.
    fn tell(&self, out: Option<&Path>, json: bool) -> anyhow::Result<()> {
        let Self { machine, intake, analysis, origin } = self;
        let mut after = MachineFile::create(Path::new("machine.toml"), machine)?;
        let is_changed = write_back::put(&mut after, machine, analysis, origin)?;
        let after = is_changed.then(|| after.text());
        let mut printed = Printed::new(machine, &intake.runs, analysis, intake.repaired.clone(), after);
        if let Some(folder) = out {
            printed.report = Some(report::gap::write(folder, machine, analysis, &printed.rows())?);
            report::gap::write_json(folder, &serde_json::to_string_pretty(&printed)?)?;
        }
        if json { print_json(&printed) } else { print_text(&printed.text()) }
    }

    /// Puts what was named into a file.
    fn write(&self, path: &Path) -> anyhow::Result<()> {
        let Self { machine, analysis, origin, .. } = self;
        let exists = path.exists();
        let mut file = if exists { MachineFile::open(path)? } else { MachineFile::create(path, machine)? };
        // What was named holds beside what these runs were held against, and nothing else.
        if exists && file.text() != machine.text {
            bail!(
                "{} is not the machine file that the runs were held against; give that one with --machine, or a new file",
                path.display()
            );
        }
        if !write_back::put(&mut file, machine, analysis, origin)? {
            eprintln!("nothing was named; {} is not written", path.display());
            return Ok(());
        }
        file.keep_old(&beside(path, &stamp_now()))?;
        file.replace()?;
        eprintln!("{} written", path.display());
        Ok(())
    }
}

/// The machine of the option; without it that of the first log, which carries its own.
fn machine_of(arguments: &Arguments) -> anyhow::Result<Machine> {
    let machine = |name: &str| Ok(config::load_for(Purpose::Files, name)?);
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
        return Ok(logged::of_trace(&name, &trace, machine)?);
    }
    let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    let raw = Raw::read(map, file).with_context(|| path.display().to_string())?;
    Ok(intake::of_raw(&name, raw, machine)?)
}
