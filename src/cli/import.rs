//! `quadrant import TEXT --machine FILE --log OUT`: a text of candump as a log. A verb of its own and no option
//! of `log`, whose argument is always a log.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use serde::Serialize;

use super::{Outcome, machine, print_json, print_text};
use crate::base::time::Moment;
use crate::log::header::IMPORTED;
use crate::log::{Pace, WriteOutcome, Writer};
use crate::offline::traffic::import::{Import, Imported, Wanted};
use crate::rt::door::record_ring;
use crate::run::{self, Origin, Place};
use crate::sim::closed_loop::Patient;

/// Records on their way to the disk.
const RING_RECORDS: usize = 4_096;
/// What the header of the log says.
const NOTE: &str =
    "from a text of candump: modes, faults, gain sets, setpoints and the terms of the control are not known";

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The text, as `candump -L` or `candump -l` writes it (`-` for standard input)
    text: PathBuf,
    /// Machine file of the machine on that bus, or an embedded machine: reference, paper, classic
    #[arg(long, value_name = "FILE|NAME")]
    machine: String,
    /// The new log
    #[arg(long, value_name = "FILE")]
    log: PathBuf,
    /// Interface, if the text has several
    #[arg(long, value_name = "NAME")]
    interface: Option<String>,
    /// Leave out lines that cannot be read, instead of ending at the first
    #[arg(long)]
    skip_damaged: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// What is printed for programs.
#[derive(Debug, Serialize)]
struct Printed<'a> {
    log: &'a Path,
    interface: &'a str,
    pace: &'static str,
    #[serde(flatten)]
    imported: &'a Imported,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let machine = machine(&arguments.machine)?;
    let name = arguments.text.display().to_string();
    let wanted = Wanted { interface: arguments.interface.clone(), skips_damaged: arguments.skip_damaged };
    let import = Import::begin(&machine, opened(&arguments.text)?, &wanted).with_context(|| name.clone())?;
    let interface = import.interface().to_owned();
    let pace = if import.is_lock_step() { Pace::Virtual } else { Pace::Realtime };

    let origin = Origin { monotonic: Moment::ZERO, wall_ns: import.wall_at_zero_ns() };
    let place = Place { pace, interface: Some(&interface), seed: 0 };
    let mut header = run::header(&machine, &place, &origin, "quadrant");
    header.extra.insert(IMPORTED.to_owned(), NOTE.to_owned());
    let (ring, drain) = record_ring(RING_RECORDS);
    let writer = Writer::start(&arguments.log, header, drain.ring, drain.inputs, drain.lost)?;
    let mut records = Patient(ring);
    let imported = import.run(&mut records);
    drop(records);
    let written = writer.join();
    let imported = imported
        .with_context(|| format!("{name}; the cycles before it are in {}", arguments.log.display()))?;
    if arguments.json {
        let (log, interface) = (&arguments.log, interface.as_str());
        print_json(&Printed { log, interface, pace: pace.name(), imported: &imported })?;
    } else {
        let Imported { cycles, frames, .. } = imported;
        print_text(&format!("{}: {cycles} cycles from {frames} frames\n", arguments.log.display()))?;
    }
    Ok(said(&imported, &written))
}

fn opened(text: &Path) -> anyhow::Result<Box<dyn Read>> {
    if text == Path::new("-") {
        return Ok(Box::new(std::io::stdin().lock()));
    }
    Ok(Box::new(File::open(text).with_context(|| format!("cannot open {}", text.display()))?))
}

/// Says what the log lacks.
fn said(imported: &Imported, written: &WriteOutcome) -> Outcome {
    let left_out = &imported.left_out;
    for (count, what) in [
        (imported.periods_skipped, "periods were skipped by the host"),
        (left_out.of_other_interfaces, "frames of other interfaces were left out"),
        (left_out.of_other_kinds, "frames of kinds that these boards do not speak were left out"),
    ] {
        if count > 0 {
            eprintln!("{count} {what}");
        }
    }
    for (count, what) in [
        (imported.cycles_missing, "cycles were run and are not in the text"),
        (imported.commands_missing, "commands are not in the text: not sent, or not seen"),
        (
            imported.syncs_aside,
            "SYNCs go back or too far ahead, as those of another host: they begin no cycle",
        ),
        (
            imported.commands_aside,
            "commands are of another cycle or a second one of theirs, as those of another host",
        ),
        (imported.sequence_breaks, "times the commands did not count on"),
        (left_out.damaged_lines, "lines cannot be read and were left out"),
        (left_out.dropped, "frames were lost by the listener, by its own account"),
        (left_out.times_back, "lines are earlier than the one above"),
    ] {
        if count > 0 {
            eprintln!("warning: {count} {what}");
        }
    }
    if let Some(line) = imported.another_run_at_line {
        eprintln!("warning: line {line}: another run begins, which is not in the log");
    }
    if let Some(damage) = &left_out.first_damage {
        eprintln!("warning: the first: {damage}");
    }
    if let Some(error) = &written.first_error {
        eprintln!("warning: {error}; {} records were not written", written.lost);
    }
    let is_whole = imported.is_whole() && written.lost == 0 && written.is_complete;
    if is_whole { Outcome::Done } else { Outcome::Incomplete }
}
