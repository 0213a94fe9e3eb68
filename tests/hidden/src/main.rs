//! `hidden`: make machines with a hidden effect, let a program look for it, and score what it says.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Result;
use clap::{Parser, Subcommand};
use hidden::case::Bench;
use hidden::plan::{Choice, Plan, list};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;

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
}

fn main() -> Result<()> {
    match Arguments::parse().verb {
        Verb::Make { out, choice } => make(&out, &choice),
    }
}

fn make(out: &Path, choice: &Choice) -> Result<()> {
    let plans = list(choice);
    let bar = progress(plans.len());
    let start = Instant::now();
    let made = for_each_case(&plans, |bench, plan| {
        let truth = bench.make(plan, out)?;
        bar.set_message(plan.id.clone());
        bar.inc(1);
        Ok(truth.is_some())
    })?;
    bar.finish_and_clear();
    let (there, seconds) = (made.iter().filter(|is_made| **is_made).count(), start.elapsed().as_secs_f64());
    let each = seconds / made.len().max(1) as f64;
    eprintln!(
        "{there} cases in {}, {} not visible on their machine; {seconds:.0} s, {each:.2} s each",
        out.display(),
        made.len() - there
    );
    Ok(())
}

/// Cases machine by machine, so that one yardstick is in memory at a time, those of a machine side by side.
fn for_each_case<T: Send>(
    plans: &[Plan],
    work: impl Fn(&Bench, &Plan) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let mut by_machine: BTreeMap<u64, Vec<&Plan>> = BTreeMap::new();
    for plan in plans {
        by_machine.entry(plan.machine).or_default().push(plan);
    }
    let mut all = Vec::new();
    for (machine, plans) in by_machine {
        let bench = Bench::new(machine);
        let done: Result<Vec<T>> = plans.par_iter().map(|plan| work(&bench, plan)).collect();
        all.extend(done?);
    }
    Ok(all)
}

fn progress(count: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} {elapsed} {msg}");
    ProgressBar::new(count as u64).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
