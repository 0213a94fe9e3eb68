//! `quadrant replay FILE`: the recorded inputs of a run through today's code, or with `--bus` its boards' frames
//! to a live host. It ends with 0 when every cycle came out as recorded, with 1 when the log ends early or has
//! gaps, and with 2 when something differs.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::{Outcome, PaceName, playback, print_json, print_text};
use crate::log::Reader;
use crate::offline::replay::{Replay, replay};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The log
    file: PathBuf,
    /// Play what its boards said on this CAN interface, to a host that is started behind it; nothing else may
    /// be there
    #[arg(long, value_name = "INTERFACE")]
    bus: Option<String>,
    /// In lock step with a host in virtual time, or on the wall clock
    #[arg(long, value_enum, default_value_t = PaceName::Virtual, requires = "bus")]
    pace: PaceName,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// What is printed for programs.
#[derive(Debug, Serialize)]
struct Printed<'a> {
    file: String,
    #[serde(flatten)]
    replay: &'a Replay,
    is_truncated: bool,
    wall_s: f64,
    times_real_time: f64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    if let Some(interface) = &arguments.bus {
        return playback::run(&arguments.file, interface, arguments.pace.pace(), arguments.json);
    }
    let mut log = Reader::open(&arguments.file)?;
    let bar = spinner("replay");
    let began = Instant::now();
    let replay = replay(&mut log, |cycles| bar.set_position(cycles))?;
    let wall_s = began.elapsed().as_secs_f64();
    bar.finish_and_clear();

    let is_truncated = log.is_truncated();
    let times_real_time = replay.machine_s / wall_s;
    let file = arguments.file.display().to_string();
    if arguments.json {
        let printed = Printed { file, replay: &replay, is_truncated, wall_s, times_real_time };
        print_json(&printed)?;
    } else {
        print_text(&format!(
            "{} cycles ({:.1} s) came out as recorded, bit for bit; {wall_s:.2} s, {times_real_time:.0} times real time\n",
            replay.cycles, replay.machine_s,
        ))?;
    }
    Ok(said(&replay, is_truncated))
}

/// Counts cycles on the terminal.
pub(super) fn spinner(message: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {pos} cycles  {per_sec}") {
        bar.set_style(style);
    }
    bar.set_message(message);
    bar
}

/// Says what ended a replay, if not the end of a whole log.
pub(super) fn ended(ended_early: Option<&str>, is_truncated: bool) -> Outcome {
    if let Some(why) = ended_early {
        eprintln!("{why}\nthe state behind it is not known, so the replay ends there");
        return Outcome::Incomplete;
    }
    if is_truncated {
        eprintln!("the log ends without its index, as after a kill: its last moments are not in it");
        return Outcome::Incomplete;
    }
    Outcome::Done
}

fn said(replay: &Replay, is_truncated: bool) -> Outcome {
    if let Some(difference) = &replay.difference {
        eprintln!(
            "cycle {}: {} is {} now, recorded was {}",
            difference.cycle, difference.field, difference.replayed, difference.recorded
        );
        return Outcome::NotDone;
    }
    ended(replay.ended_early.as_deref(), is_truncated)
}
