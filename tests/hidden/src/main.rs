//! `hidden`: make machines with a hidden effect, let a program look for it, and score what it says.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clap::{Parser, Subcommand};
use hidden::case::{Bench, Truth};
use hidden::plan::{Choice, Plan, list};
use hidden::score;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use serde_json::{Value, json};

#[derive(Parser)]
#[command(about, version)]
struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Make cases: a folder each, with runs as CSV, machine.toml and truth.json
    Make {
        /// Folder of the cases
        #[arg(long)]
        out: PathBuf,
        #[command(flatten)]
        choice: Choice,
    },
    /// Hold answers against the truth
    Score {
        /// Folder of the cases
        #[arg(long)]
        cases: PathBuf,
        /// Folder of the answers, a JSON file for each case
        #[arg(long)]
        results: PathBuf,
        #[command(flatten)]
        wanted: Wanted,
    },
    /// Make cases, let a program answer each, and score it
    Run {
        /// The program
        #[arg(long)]
        quadrant: PathBuf,
        /// What it is called with, between spaces: {machine} is the machine file, {runs} all runs, {fit} those for
        /// fitting and {heldout} the others, {axes} the axes that lack something, or x where none does: half the time
        #[arg(long, default_value = "gap --json --machine {machine} --data {runs}")]
        arguments: String,
        /// Folder of cases and answers
        #[arg(long)]
        out: PathBuf,
        /// Keep the runs; otherwise they go once there is an answer, for they are 10 MB a case
        #[arg(long)]
        keep: bool,
        /// Cases side by side
        #[arg(long, default_value_t = 1)]
        jobs: usize,
        #[command(flatten)]
        choice: Choice,
        #[command(flatten)]
        wanted: Wanted,
    },
}

#[derive(clap::Args)]
struct Wanted {
    /// Fail if a sure name is wrong, if anything is named where nothing is missing, or if fewer than this share of single
    /// effects of medium and large severity get their name first
    #[arg(long, value_name = "SHARE")]
    hold: Option<f64>,
}

fn main() -> Result<()> {
    match Arguments::parse().verb {
        Verb::Make { out, choice } => make(&out, &choice),
        Verb::Score { cases, results, wanted } => print_score(&cases, &results, &wanted),
        Verb::Run { quadrant, arguments, out, keep, jobs, choice, wanted } => {
            let (cases, results) = (out.join("cases"), out.join("results"));
            fs::create_dir_all(&results).with_context(|| format!("cannot make {}", results.display()))?;
            let path =
                quadrant.canonicalize().with_context(|| format!("no program {}", quadrant.display()))?;
            let program = Program { path, arguments };
            work(&choice, jobs, |bench, plan| {
                let truth = bench.make(plan, &cases)?;
                if let Some(truth) = &truth {
                    let answer = program.answer(&cases.join(&plan.id), &axes(truth))?;
                    fs::write(
                        results.join(format!("{}.json", plan.id)),
                        serde_json::to_vec_pretty(&answer)?,
                    )?;
                    if !keep {
                        remove_runs(&cases.join(&plan.id))?;
                    }
                }
                Ok(truth.is_some())
            })?;
            print_score(&cases, &results, &wanted)
        }
    }
}

fn make(out: &Path, choice: &Choice) -> Result<()> {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    work(choice, processors, |bench, plan| Ok(bench.make(plan, out)?.is_some()))
}

fn print_score(cases: &Path, results: &Path, wanted: &Wanted) -> Result<()> {
    let judged = score::judged(cases, results)?;
    println!("{}\n{}", score::table(&judged), score::confusion(&judged));
    let faults = wanted.hold.map_or_else(Vec::new, |least_right| score::faults(&judged, least_right));
    ensure!(faults.is_empty(), "it does not hold:\n{}", faults.join("\n"));
    Ok(())
}

/// Cases machine by machine, so that one yardstick is in memory at a time, those of a machine side by side. The work
/// says whether there is a case.
fn work(choice: &Choice, jobs: usize, work: impl Fn(&Bench, &Plan) -> Result<bool> + Sync) -> Result<()> {
    let plans = list(choice);
    let bar = progress(plans.len());
    let start = Instant::now();
    let mut by_machine: BTreeMap<u64, Vec<&Plan>> = BTreeMap::new();
    for plan in &plans {
        by_machine.entry(plan.machine).or_default().push(plan);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).build()?;
    let mut made = 0;
    for (machine, plans) in by_machine {
        let bench = Bench::new(machine, choice.brief);
        let each = |plan: &&Plan| {
            bar.set_message(plan.id.clone());
            let is_made = work(&bench, plan)?;
            bar.inc(1);
            Ok(usize::from(is_made))
        };
        let counts: Result<Vec<usize>> = pool.install(|| plans.par_iter().map(each).collect());
        made += counts?.iter().sum::<usize>();
    }
    bar.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();
    let each = seconds / plans.len().max(1) as f64;
    let hidden = plans.len() - made;
    eprintln!("{made} cases, {hidden} more not visible on their machine; {seconds:.0} s, {each:.2} s each");
    Ok(())
}

/// The axes that lack something, as `x,y`; one where none does.
fn axes(truth: &Truth) -> String {
    let axes: BTreeSet<&str> = truth.effects.iter().map(|effect| effect.axis.as_str()).collect();
    if axes.is_empty() { "x".to_owned() } else { Vec::from_iter(axes).join(",") }
}

/// What is judged.
struct Program {
    path: PathBuf,
    arguments: String,
}

impl Program {
    /// What it says of a case. It is called in the case's folder, with names that tell nothing of the truth. Whatever
    /// is no JSON is a failure, with what it said of it.
    fn answer(&self, case: &Path, axes: &str) -> Result<Value> {
        let names: Vec<_> = runs(case)?.iter().filter_map(|run| Some(run.file_name()?.to_owned())).collect();
        let (held_out, fit): (Vec<_>, Vec<_>) =
            names.iter().partition(|name| name.to_string_lossy().starts_with("heldout"));
        let mut command = Command::new(&self.path);
        command.current_dir(case);
        for argument in self.arguments.split_whitespace() {
            match argument {
                "{machine}" => command.arg("machine.toml"),
                "{runs}" => command.args(&names),
                "{fit}" => command.args(&fit),
                "{heldout}" => command.args(&held_out),
                "{axes}" => command.arg(axes),
                plain => command.arg(plain),
            };
        }
        let start = Instant::now();
        let output = command.output().with_context(|| format!("cannot run {}", self.path.display()))?;
        let seconds = start.elapsed().as_secs_f64();
        let said = serde_json::from_slice(&output.stdout);
        let mut answer: Value = said.unwrap_or_else(|error| {
            let stderr = String::from_utf8_lossy(&output.stderr);
            json!({ "verdict": "failed", "error": format!("{}: {error}\n{stderr}", output.status) })
        });
        if let Some(answer) = answer.as_object_mut() {
            answer.entry("seconds").or_insert(json!(seconds));
        }
        Ok(answer)
    }
}

/// The runs of a case, in the order in which they were taken or at least in always the same one.
fn runs(case: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(case).with_context(|| format!("cannot read {}", case.display()))?;
    let mut runs: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    runs.retain(|path| path.extension().is_some_and(|end| end == "csv"));
    runs.sort();
    Ok(runs)
}

fn remove_runs(case: &Path) -> Result<()> {
    for run in runs(case)? {
        fs::remove_file(&run).with_context(|| format!("cannot remove {}", run.display()))?;
    }
    Ok(())
}

fn progress(count: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} {elapsed}, {eta} left  {msg}");
    ProgressBar::new(count as u64).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
