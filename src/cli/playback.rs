//! `quadrant replay FILE --bus INTERFACE`: the recorded boards to a live host, and its commands beside the
//! recorded ones.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use serde::Serialize;

use super::replay::{ended, spinner};
use super::{Outcome, print_json, print_text};
use crate::base::time::Moment;
use crate::config;
use crate::log::{Pace, Reader};
use crate::offline::playback::{Playback, Played, Timing, play};
use crate::offline::recorded::CyclesOf;
use crate::rt::bus::lockstep;
use crate::rt::clock::monotonic_now;
use crate::rt::thread::{self, Process, Thread};
use crate::run;

/// Below the cycle of a host on the same computer, above everything that is not real time.
const REAL_TIME: thread::Settings = thread::Settings { priority: 60, cpu: None };

/// What is printed for programs.
#[derive(Debug, Serialize)]
struct Printed<'a> {
    file: String,
    bus: &'a str,
    pace: &'static str,
    #[serde(flatten)]
    played: &'a Played,
    is_truncated: bool,
    wall_s: f64,
}

pub(super) fn run(file: &Path, interface: &str, pace: Pace, json: bool) -> anyhow::Result<Outcome> {
    let mut log = Reader::open(file)?;
    let header = log.header().clone();
    let machine = config::from_texts("machine.toml", &header.machine_text, &header.sheets)?;
    // Frames of virtual time all came at the end of their window, where a clock would find them late.
    let is_timed = (pace, header.pace) == (Pace::Realtime, Pace::Realtime);
    let timing = if is_timed { Timing::AsRecorded } else { Timing::AtOnce };
    let mut playback = Playback::new(&machine, CyclesOf(&mut log), timing)?;

    let _process = (pace == Pace::Realtime).then(Process::prepare);
    let mut bus = run::open(&machine, interface, &[lockstep::MARKER])?;
    bus.set_origin(Moment::ZERO);
    let is_stopped = run::stop_wish(true)?;
    eprintln!("the boards of {} on {interface}: waiting for a host", file.display());
    let bar = spinner("playback");
    let mut began = None;
    let progress = |cycles| {
        began.get_or_insert_with(Instant::now);
        bar.set_position(cycles);
    };
    let outcome = if pace == Pace::Realtime {
        // In a thread of its own: the one that calls is left to the signals.
        std::thread::scope(|scope| {
            let playing = scope.spawn(|| {
                if let Err(errno) = Thread::prepare(&REAL_TIME).fifo {
                    eprintln!("plays without real time ({errno}), so frames may be late");
                }
                play(&mut playback, &mut bus, monotonic_now, &is_stopped, progress)
            });
            playing.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    } else {
        play(&mut playback, &mut bus, monotonic_now, &is_stopped, progress)
    };
    bar.finish_and_clear();
    outcome?;
    let wall_s = began.map_or(0.0, |began| began.elapsed().as_secs_f64());
    let played = playback.into_played();
    let is_truncated = log.is_truncated();
    if json {
        let file = file.display().to_string();
        print_json(&Printed {
            file,
            bus: interface,
            pace: pace.name(),
            played: &played,
            is_truncated,
            wall_s,
        })?;
    } else {
        print_text(&summary(&played, wall_s))?;
    }
    Ok(said(&played, is_truncated, &is_stopped))
}

fn summary(played: &Played, wall_s: f64) -> String {
    let Played { cycles, commands, machine_s, .. } = played;
    format!(
        "{cycles} cycles ({machine_s:.1} s), every one of {commands} commands as recorded, bit for bit; {wall_s:.2} s\n"
    )
}

fn said(played: &Played, is_truncated: bool, is_stopped: &AtomicBool) -> Outcome {
    if played.reports_left_out > 0 {
        eprintln!(
            "{} reports of the recorded host's own controller were left out: nobody else can send them",
            played.reports_left_out
        );
    }
    if let Some(difference) = &played.difference {
        eprintln!(
            "cycle {}: {} of the command to axis {} is {}, recorded was {}",
            difference.cycle, difference.field, difference.axis, difference.live, difference.recorded
        );
        return Outcome::NotDone;
    }
    if is_stopped.load(Ordering::Relaxed) {
        eprintln!("interrupted behind {} cycles", played.cycles);
        return Outcome::NotDone;
    }
    ended(played.ended_early.as_deref(), is_truncated)
}
