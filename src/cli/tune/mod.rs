//! `quadrant tune`: gains with the least protrusion that keep the margins, or the paper's own problem; checked on
//! the whole simulated circle before and after.
//!
//! What was found is printed, drawn (`--report`) and written into a machine file (`--write`). A search that was
//! interrupted keeps the best so far and says so; nothing is written when constraints are broken.

mod printed;
mod request;

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
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

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(long, default_value = "reference", value_name = "FILE|NAME")]
    machine: String,
    /// What is to be made small: the paper's Eq. (8), or figures of the machine; several give a front
    #[arg(long, value_enum, value_delimiter = ',', default_value = "protrusion", value_name = "LIST")]
    objective: Vec<ObjectiveName>,
    /// Gain set that is tuned: what is not varied is as in it
    #[arg(long, default_value = "standard", value_name = "NAME")]
    from: String,
    /// Numbers varied beside V_p and V_i
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST")]
    vary: Vec<Vary>,
    /// Gain of the position loop [default: that of the gain set]
    #[arg(long, value_name = "N", conflicts_with = "kp_max_per_s")]
    kp_per_s: Option<f64>,
    /// Largest gain of the position loop, with `--vary kp` [default: 50]
    #[arg(long, value_name = "N")]
    kp_max_per_s: Option<f64>,
    /// Least V_p [default: 1 with the paper's objective, otherwise 10]
    #[arg(long, value_name = "N")]
    v_p_min: Option<f64>,
    /// Largest V_p [default: 100 with the paper's objective, otherwise 1000]
    #[arg(long, value_name = "N")]
    v_p_max: Option<f64>,
    /// Least V_i
    #[arg(long, default_value_t = 0.1, value_name = "N")]
    v_i_min: f64,
    /// Largest V_i
    #[arg(long, default_value_t = 10.0, value_name = "N")]
    v_i_max: f64,
    /// Least phase margin: by the printed formula with the paper's objective [default: 49], otherwise of both
    /// loops at their real delays [default: 40]
    #[arg(long, value_name = "DEG")]
    phase_margin_deg: Option<f64>,
    /// Least gain margin of both loops
    #[arg(long, default_value_t = 8.0, value_name = "DB")]
    gain_margin_db: f64,
    /// Largest sensitivity Ms of both loops
    #[arg(long, default_value_t = 2.0, value_name = "N")]
    ms: f64,
    /// Longest acceleration time of the paper's objective
    #[arg(long, default_value_t = 0.2, value_name = "S")]
    acceleration_time_s: f64,
    /// How far mass, friction and stiffness may be off; 0 for the axes as the file has them
    #[arg(long, default_value_t = 10.0, value_name = "N")]
    spread_percent: f64,
    /// Plants by chance within the spread [default: its eight corners]
    #[arg(long, value_name = "N")]
    plants: Option<usize>,
    /// How the plants count in the protrusion
    #[arg(long, value_enum, default_value_t = CountsName::Worst)]
    judge: CountsName,
    /// Radius of the circle
    #[arg(long, default_value_t = 150.0, value_name = "MM")]
    radius_mm: f64,
    /// Feed along the circle
    #[arg(long, default_value_t = 2000.0, value_name = "MM/MIN")]
    feed_mm_per_min: f64,
    /// Seed of everything random
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Most gains that are looked at
    #[arg(long, default_value_t = 2_000, value_name = "N")]
    evaluations: usize,
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ObjectiveName {
    /// Eq. (8) of the paper, as printed
    Paper,
    /// How far the axes leave their orbit at a reversal
    Protrusion,
    /// Ms of the velocity loop
    Sensitivity,
    /// Current that the encoder's counts make
    Noise,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Vary {
    Kp,
    Friction,
    Inertia,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum CountsName {
    Worst,
    Mean,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let machine = machine(&arguments.machine)?;
    let (request, set) = request::of(arguments, &machine)?;
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
        let source = printed.source(arguments.seed, is_cut_short);
        gain_set::write(file, &machine, &arguments.name, &tuned.best.choice, &source)?;
        eprintln!("written: gain set {} of {}", arguments.name, file.display());
    }
    Ok(if is_cut_short { Outcome::NotDone } else { Outcome::Done })
}

fn search(machine: &Machine, request: &Request, stop: &AtomicBool) -> Tuned {
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
