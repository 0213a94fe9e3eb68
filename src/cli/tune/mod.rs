//! `quadrant tune`: gains with the least protrusion that keep the margins, or the paper's own problem; checked on
//! the whole simulated circle before and after.
//!
//! What was found is printed, drawn (`--report`) and written into a machine file (`--write`). A search that was
//! interrupted keeps the best so far and says so; nothing is written when constraints are broken.

mod printed;
pub(super) mod request;

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use super::{Outcome, machine, print_json, print_text};
use crate::base::axis::PerAxis;
use crate::config::Machine;
use crate::config::machine::Gains;
use crate::offline::circle::CircularTest;
use crate::offline::report::tuning::{self, Shown};
use crate::offline::tune::gain_set;
use crate::offline::tune::whole::{WholeError, circular_test};
use crate::offline::tune::{Progress, Request, Tuned, Valuer, tune};
use crate::run;

use printed::Printed;
use request::{ACCELERATION_TIME_S, ObjectiveName, SearchArguments};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(long, default_value = "reference", value_name = "FILE|NAME")]
    machine: String,
    /// What is to be made small: the paper's Eq. (8), or figures of the machine; several give a front
    #[arg(long, value_enum, value_delimiter = ',', default_value = "protrusion", value_name = "LIST")]
    objective: Vec<ObjectiveName>,
    /// Longest acceleration time of the paper's objective
    #[arg(long, default_value_t = ACCELERATION_TIME_S, value_name = "S")]
    acceleration_time_s: f64,
    #[command(flatten)]
    search: SearchArguments,
    /// Name of the gain set that is written
    #[arg(long, default_value = "tuned", value_name = "NAME")]
    name: String,
    /// Write the gains as a set into this file: the machine file itself, or a new one
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// Write a page with the map of the objective, both circles and the loops into this folder
    #[arg(long, value_name = "FOLDER")]
    report: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let machine = machine(&arguments.machine)?;
    let (request, set) =
        request::of(&arguments.objective, arguments.acceleration_time_s, &arguments.search, &machine)?;
    let stop = run::stop_wish(true)?;
    let began = Instant::now();
    let tuned = search(&machine, &request, &stop);
    let seconds = began.elapsed().as_secs_f64();
    let is_cut_short = stop.swap(false, Ordering::Relaxed);
    if is_cut_short {
        eprintln!("interrupted: what follows is the best so far, after {} evaluations", tuned.evaluations);
    }
    let before = Valuer::new(&machine, &request).judged(request.space.fixed);
    let circles = circles(&machine, &request, set, &tuned, &stop)?;
    let printed = Printed::of(&machine, &request, &before, &tuned, &circles, seconds);
    if arguments.json {
        print_json(&printed)?;
    } else {
        print_text(&printed.text())?;
    }
    if let Some(folder) = &arguments.report {
        let shown =
            Shown { machine: &machine, request: &request, before: &before, tuned: &tuned, circles: &circles };
        let files = tuning::write(folder, &shown, &printed.rows(), &printed.sentences())?;
        eprintln!("report: {}", files.html.display());
    }
    if !tuned.broken.is_empty() {
        eprintln!("no gains within the bounds keep all constraints: {}", tuned.broken.join("; "));
        return Ok(Outcome::NotDone);
    }
    if let Some(file) = &arguments.write {
        let source = printed.source(arguments.search.seed, is_cut_short);
        gain_set::write(file, &machine, &arguments.name, &tuned.best.choice, &source)?;
        eprintln!("written: gain set {} of {}", arguments.name, file.display());
    }
    Ok(if is_cut_short { Outcome::NotDone } else { Outcome::Done })
}

/// The search, with its progress; setting `stop` ends it with the best so far.
pub(super) fn search(machine: &Machine, request: &Request, stop: &AtomicBool) -> Tuned {
    let bar = ProgressBar::new(request.evaluations_max as u64);
    if let Ok(style) = ProgressStyle::with_template("tune {wide_bar} {pos} of at most {len}  {msg}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    let tuned = tune(machine, request, |progress: &Progress| {
        bar.set_position(progress.evaluations as u64);
        if let Some(best) = progress.best {
            bar.set_message(format!("best {best:.4}"));
        }
        if stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    bar.finish_and_clear();
    tuned
}

/// The whole circle, with the gain set that was tuned and with what was found.
fn circles(
    machine: &Machine,
    request: &Request,
    set: u8,
    tuned: &Tuned,
    stop: &Arc<AtomicBool>,
) -> Result<[CircularTest; 2], WholeError> {
    let given: PerAxis<Gains> = machine.axes.map(|id, _| *machine.gains(id, set));
    let found: PerAxis<Gains> = machine.axes.map(|_, axis| tuned.best.choice.gains(axis));
    let test = |gains: &PerAxis<Gains>| circular_test(machine, gains, &request.path, request.seed, stop);
    Ok([test(&given)?, test(&found)?])
}
