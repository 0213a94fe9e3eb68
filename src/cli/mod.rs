//! The verbs of the tool, one file each. Results go to stdout, talk to stderr.
//!
//! Exit codes: 0 done; 1 done, but something is missing (records lost, report not written, a log cut
//! off) or was found (a survey); 2 not done (bad input, a fault, interrupted).
//! Invariant: no arithmetic here; what is printed was computed below.

mod autotune;
mod check;
mod circle;
mod gap;
mod hil;
mod identify;
mod import;
mod latency;
mod live;
mod log;
mod playback;
mod replay;
mod stage;
mod tune;
mod view;

use std::io::{ErrorKind, IsTerminal, Write};
use std::process::ExitCode;

use anyhow::Context;
use clap::{Parser, Subcommand, ValueEnum};

use crate::base::axis::AxisId;
use crate::config::{self, LoadError, Machine};
use crate::log::{Pace, size_limit};
use crate::run::VERSION;

/// Circular tests, checks and logs of ball-screw axes.
#[derive(Debug, Parser)]
#[command(name = "quadrant", version = VERSION, about, max_term_width = 100)]
#[command(after_help = "Exit codes: 0 done; 1 done, but something is missing (records lost, report not \
written, log cut off) or was found (a survey); 2 not done (bad input, a fault, interrupted).")]
struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Run a circular test (ISO 230-4) and show the circle, or judge one from its log
    Circle(circle::Arguments),
    /// Find the parameters of axes, with their intervals, from measured motion
    Identify(identify::Arguments),
    /// Find gains with the least protrusion that keep the margins, or solve the problem of the paper
    Tune(tune::Arguments),
    /// Identify a machine, tune it, and keep the gains if its circle is better
    Autotune(autotune::Arguments),
    /// Find where simulation and measurement disagree, and name the effect that is missing
    Gap(gap::Arguments),
    /// Check a machine file and print what it implies
    Check(check::Arguments),
    /// Summarise, export or recover a log
    Log(log::Arguments),
    /// Make a log of the traffic of a bus, from a text of candump
    Import(import::Arguments),
    /// Put the simulated machine through scenarios of faults, and judge what the controller makes of them
    Hil(hil::Arguments),
    /// Show where the time of the periods went, in a log or measured here and now
    Latency(latency::Arguments),
    /// Run the recorded inputs of a log through today's code, or play its boards to a live host on a bus: the
    /// same must come out, bit for bit
    Replay(replay::Arguments),
}

/// How time passes in a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PaceName {
    Virtual,
    Realtime,
}

impl PaceName {
    const fn pace(self) -> Pace {
        match self {
            Self::Virtual => Pace::Virtual,
            Self::Realtime => Pace::Realtime,
        }
    }
}

/// How a verb ended, unless by an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// As asked.
    Done,
    /// Something is missing, or was found; it was said on stderr.
    Incomplete,
    /// Not as asked; it was said on stderr.
    NotDone,
}

/// Entry point of `quadrant`.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    // What a run says before it moves something: what is missing for real time.
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_unset| tracing_subscriber::EnvFilter::new("warn"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .init();
    if let Err(errno) = size_limit::is_an_error() {
        eprintln!("a log that reaches the size limit of files would end the tool: {errno}");
    }
    let outcome = match arguments.verb {
        Verb::Circle(arguments) => circle::run(&arguments),
        Verb::Identify(arguments) => identify::run(&arguments),
        Verb::Tune(arguments) => tune::run(&arguments),
        Verb::Autotune(arguments) => autotune::run(&arguments),
        Verb::Gap(arguments) => gap::run(&arguments),
        Verb::Check(arguments) => check::run(&arguments),
        Verb::Log(arguments) => log::run(&arguments),
        Verb::Import(arguments) => import::run(&arguments),
        Verb::Hil(arguments) => hil::run(&arguments),
        Verb::Latency(arguments) => latency::run(&arguments),
        Verb::Replay(arguments) => replay::run(&arguments),
    };
    match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Incomplete) => ExitCode::from(1),
        Ok(Outcome::NotDone) => ExitCode::from(2),
        Err(error) => {
            eprintln!("{}", complaint(&error));
            ExitCode::from(2)
        }
    }
}

/// An error for the terminal: problems of a file as a compiler shows them, others in one line.
fn complaint(error: &anyhow::Error) -> String {
    match error.downcast_ref::<LoadError>() {
        Some(LoadError::Problems(problems)) => {
            let count = problems.problems.len();
            let plural = if count == 1 { "problem" } else { "problems" };
            let rendered = problems.render(std::io::stderr().is_terminal());
            format!("{rendered}\n{}: {count} {plural}, so there is no machine", problems.file)
        }
        Some(LoadError::Unreadable { .. } | LoadError::NoScenario { .. }) | None => {
            format!("error: {error:#}")
        }
    }
}

/// The machine of `--machine`.
fn machine(name_or_path: &str) -> anyhow::Result<Machine> {
    Ok(config::load(name_or_path)?)
}

/// The axis of a name.
fn axis_of(machine: &Machine, name: &str) -> anyhow::Result<AxisId> {
    let known = machine.axis_names();
    machine.axes.axes().find(|id| known[id.index()] == name).with_context(|| {
        format!("no axis \"{name}\" in machine {}; it has {}", machine.name, known.join(", "))
    })
}

/// The axes of names; empty: all.
fn axes_of(machine: &Machine, names: &[String]) -> anyhow::Result<Vec<AxisId>> {
    names.iter().map(|name| axis_of(machine, name)).collect()
}

/// Print a text. A closed pipe (`| head`) is no error of ours; a full disk is.
fn print_text(text: &str) -> anyhow::Result<()> {
    let mut output = std::io::stdout().lock();
    // Flushed here, because what is left at the exit is flushed without a word.
    match output.write_all(text.as_bytes()).and_then(|()| output.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(error).context("cannot write to standard output")
        }
        _ => Ok(()),
    }
}

/// Print a value as one JSON object.
fn print_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    print_text(&(serde_json::to_string_pretty(value)? + "\n"))
}
