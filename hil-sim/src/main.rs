//! The machine without metal, at the CAN frame: what the host sends comes in as candump lines, what the
//! boards answer goes out as candump lines.
//!
//! ```text
//!   hil-sim --machine reference < host.log > boards.log
//! ```
//!
//! Time is that of the SYNCs: with the one of cycle `k` the simulated axes move on to cycle `k`, so a
//! session replayed twice gives the same frames to the bit.
//! Invariant: boards, drives and plant are those of `quadrant::sim`; this file only moves text.

mod dump;

use std::io::{self, BufWriter, Write};
use std::process::ExitCode;

use anyhow::Context;
use clap::Parser;
use quadrant::base::time::Moment;
use quadrant::config;
use quadrant::rt::bus::{Bus, memory};

/// Frames that cross between text and boards at once.
const BUS_FRAMES: usize = 256;

/// Boards, drives and axes of a machine: reads the host's frames as candump lines from standard input,
/// writes the boards' frames as candump lines to standard output.
#[derive(Debug, Parser)]
#[command(name = "hil-sim", version, about, max_term_width = 100)]
struct Arguments {
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(long, default_value = "reference", value_name = "FILE|NAME")]
    machine: String,
    /// Seed of everything random: encoder counters at power-on, noise
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
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
    let machine = config::load(&arguments.machine)?;
    let mut rack = machine.rack(arguments.seed);
    let (mut host, mut boards) = memory::pair(BUS_FRAMES);
    let mut lines = dump::Lines::new(io::stdin().lock());
    let mut out = BufWriter::new(io::stdout().lock());
    while let Some(line) = lines.next_frame()? {
        host.send(&line.frame).context("the bus to the boards")?;
        rack.serve(&mut boards);
        while let Some(answer) = host.receive(Moment::ZERO) {
            // A reader that has gone away ends the session.
            match dump::write(&mut out, line.time_us, &line.interface, &answer.frame) {
                Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(()),
                written => written.context("standard output")?,
            }
        }
    }
    out.flush().context("standard output")
}
