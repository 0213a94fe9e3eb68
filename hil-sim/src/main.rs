//! The machine without metal, at the CAN frame: on a CAN interface, or as a filter of candump lines.
//!
//! ```text
//!   hil-sim --bus vcan0 --pace virtual
//!   hil-sim --bus vcan0 --scenario lost-sync.toml --truth truth.csv
//!   hil-sim --machine reference < host.log > boards.log
//! ```
//!
//! In virtual pace time is that of the SYNCs: with the one of cycle `k` the simulated axes move on to cycle
//! `k`, so a session replayed twice gives the same frames to the bit. In realtime pace it is the wall clock's.
//! Invariant: boards, drives and plant are those of `quadrant::sim`; this program only moves frames.

mod filter;
mod live;
mod served;
mod simulated;
mod truth;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, ValueEnum};

use crate::served::Service;
use crate::simulated::Simulated;
use crate::truth::TruthFile;

/// Boards, drives and axes of a machine on a CAN interface; without one, as a filter: reads the host's frames
/// as candump lines from standard input, writes the boards' frames as candump lines to standard output.
#[derive(Debug, Parser)]
#[command(name = "hil-sim", version, about, max_term_width = 100)]
struct Arguments {
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(long, default_value = "reference", value_name = "FILE|NAME")]
    machine: String,
    /// Seed of everything random: encoder counters at power-on, noise
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Scenario to play: its machine, its seed, and what goes wrong with it
    #[arg(long, value_name = "FILE", conflicts_with_all = ["machine", "seed"])]
    scenario: Option<PathBuf>,
    /// CAN interface to serve, until SIGINT or SIGTERM
    #[arg(long, value_name = "INTERFACE")]
    bus: Option<String>,
    /// How time passes on the interface
    #[arg(long, value_enum, default_value_t = Pace::Virtual, requires = "bus")]
    pace: Pace,
    /// Where to tell what the axes really do, a row for each SYNC; `-` for standard output
    #[arg(long, value_name = "FILE", requires = "bus")]
    truth: Option<PathBuf>,
    /// End with the process of this number, which has started this one
    #[arg(long, value_name = "PID", requires = "bus")]
    parent: Option<i32>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Pace {
    /// With the SYNCs of the host, in lock step with it
    Virtual,
    /// With the wall clock, whether or not a host speaks
    Realtime,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let simulated = match &arguments.scenario {
        Some(scenario) => Simulated::of_scenario(scenario)?,
        None => Simulated::of_machine(&arguments.machine, arguments.seed)?,
    };
    let Some(interface) = &arguments.bus else { return filter::run(&simulated) };
    let truth = match &arguments.truth {
        Some(file) => TruthFile::open(file, &simulated.machine.axis_names())?,
        None => TruthFile::nowhere(),
    };
    let is_live = arguments.pace == Pace::Realtime;
    served::run(&simulated, Service { interface, is_live, truth, parent: arguments.parent })
}
