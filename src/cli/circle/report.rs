//! What a circular test gives to its user: the table or JSON on stdout, the page and pictures in the
//! folder.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};
use serde::Serialize;

use super::live::{self, Recording};
use crate::base::motion::{Circle, Direction};
use crate::base::units::{Position, Velocity};
use crate::cli::{Outcome, print_json, print_text, view};
use crate::config::plan::CircleRequest;
use crate::config::{self, EMBEDDED, Machine};
use crate::log::header::{IMPORTED, rfc3339};
use crate::log::{Header, Reader};
use crate::offline::circle::protrusion::QuadrantHeights;
use crate::offline::circle::{self, CircularTest, Run, paper};
use crate::offline::report::{self, ReportFiles, TestSheet};
use crate::offline::trace::Trace;

/// Said of a log that was cut off.
const TRUNCATED: &str = "the log ends without its index, as after a kill";

/// What `--json` prints.
#[derive(Serialize)]
struct Printed<'a> {
    machine: &'a str,
    gains: &'a str,
    direction: &'static str,
    radius_mm: f64,
    feed_mm_per_min: f64,
    revolutions: u32,
    pace: &'static str,
    seed: u64,
    cycles: u64,
    overruns: u64,
    lost_records: u64,
    missing_cycles: u64,
    stale_samples: u64,
    log: &'a Path,
    report: Option<&'a Path>,
    protrusion_um: Points<'a>,
    radius_decrease_um: f64,
    circular_deviation_um: f64,
    bidirectional_circular_deviation_um: Option<f64>,
    seconds: Option<f64>,
    times_real_time: Option<f64>,
    /// Everything else, by measuring point and direction.
    detail: &'a CircularTest,
}

#[derive(Serialize)]
struct Points<'a> {
    motor: &'a QuadrantHeights,
    table: Option<&'a QuadrantHeights>,
}

/// What there is to report, from a run or from a log.
struct Material<'a> {
    header: &'a Header,
    gains: &'a str,
    trace: &'a Trace,
    twin: Option<&'a Trace>,
    log: &'a Path,
    lost_records: u64,
    /// Seconds on the wall and on the machine's clock, of a run.
    seconds: Option<(f64, f64)>,
    notes: Vec<String>,
}

pub(super) fn of_recording(
    machine: &Machine,
    request: &CircleRequest,
    recording: &Recording,
    folder: &Path,
    as_json: bool,
) -> anyhow::Result<Outcome> {
    let mut notes = Vec::new();
    if recording.twin.is_none() {
        notes.push(format!("machine {}: the twin without friction did not complete the test", machine.name));
    }
    if let Some(error) = &recording.log.first_error {
        notes.push(format!("log: {error}"));
    }
    let material = Material {
        header: &recording.header,
        gains: &request.gains,
        trace: &recording.trace,
        twin: recording.twin.as_ref(),
        log: &recording.log.path,
        lost_records: recording.lost_records,
        seconds: Some((recording.wall_s, recording.machine_s)),
        notes,
    };
    show(&material, folder, as_json)
}

/// Judge the test in a log; the friction-free response is simulated from the machine in its header.
pub(super) fn of_log(log: &Path, folder: Option<&Path>, as_json: bool) -> anyhow::Result<Outcome> {
    let mut reader = Reader::open(log)?;
    let header = reader.header().clone();
    if let Some(note) = header.extra.get(IMPORTED) {
        anyhow::bail!("{}: imported {note}; there is no circle to measure against", log.display());
    }
    let mut damage = None;
    let records = std::iter::from_fn(|| match reader.next()? {
        Ok(record) => Some(record),
        Err(error) => {
            damage = Some(error);
            None
        }
    });
    let trace = Trace::from_records(records).with_context(|| format!("{}", log.display()))?;
    if let Some(error) = damage {
        return Err(error.into());
    }
    let shortfalls = shortfalls(reader.is_truncated(), &trace);
    for shortfall in &shortfalls {
        eprintln!("warning: {shortfall}");
    }
    let mut notes = Vec::new();
    if reader.is_truncated() {
        notes.push(TRUNCATED.to_owned());
    }
    let gains = header.extra.get("gains").cloned().unwrap_or_default();
    let twin = match twin_of(&header, &gains) {
        Ok(twin) => twin,
        Err(error) => {
            notes.push(format!("no friction-free response could be simulated: {error:#}"));
            None
        }
    };
    let material = Material {
        header: &header,
        gains: &gains,
        trace: &trace,
        twin: twin.as_ref(),
        log,
        lost_records: trace.lost_records,
        seconds: None,
        notes,
    };
    let beside = log.parent().unwrap_or(Path::new("."));
    let outcome = show(&material, folder.unwrap_or(beside), as_json)?;
    Ok(if outcome == Outcome::Done && !shortfalls.is_empty() { Outcome::Incomplete } else { outcome })
}

/// What a log lacks, one sentence each. Skipped periods have no records to lack: they are overruns.
fn shortfalls(is_truncated: bool, trace: &Trace) -> Vec<String> {
    let mut shortfalls = Vec::new();
    if is_truncated {
        shortfalls.push(TRUNCATED.to_owned());
    }
    if trace.lost_records > 0 {
        shortfalls.push(format!("{} records were lost on the way to the log", trace.lost_records));
    }
    let missing = trace.missing_cycles().saturating_sub(trace.overruns);
    if missing > 0 {
        shortfalls.push(format!("{missing} cycles are missing in the log"));
    }
    shortfalls
}

/// The circles in a log, by the number of their motion.
fn circles(header: &Header) -> Vec<(u32, Circle)> {
    let circle = |motion: &serde_json::Value| {
        let number = |key: &str| motion.get(key)?.as_f64();
        Some(Circle {
            centre_x: Position::mm(number("centre_x_mm")?),
            centre_y: Position::mm(number("centre_y_mm")?),
            radius: Position::mm(number("radius_mm")?),
            feed: Velocity::mm_per_min(number("feed_mm_per_min")?),
            direction: serde_json::from_value::<Direction>(motion.get("direction")?.clone()).ok()?,
            start_angle_rad: number("start_angle_deg")?.to_radians(),
            revolutions: motion.get("revolutions")?.as_u64()? as u32,
        })
    };
    header.motions.iter().filter_map(|(number, motion)| Some((*number, circle(motion)?))).collect()
}

fn twin_of(header: &Header, gains: &str) -> anyhow::Result<Option<Trace>> {
    let machine = config::from_texts(&header.machine_name, &header.machine_text, &header.sheets)?;
    let circles = circles(header);
    let Some((_, first)) = circles.first() else { bail!("the log names no circle") };
    let directions = circles.iter().map(|(_, circle)| circle.direction).collect();
    let request = CircleRequest { gains: gains.to_owned(), circle: *first, directions };
    let test = machine.circle_test(&request)?;
    live::twin(&machine.without_friction(), test, header.seed, &Arc::default())
}

/// Analyse, write the files, print.
fn show(material: &Material<'_>, folder: &Path, as_json: bool) -> anyhow::Result<Outcome> {
    let circles = circles(material.header);
    let stretches = |trace: &Trace| -> anyhow::Result<Vec<Trace>> {
        circles.iter().map(|(motion, _)| Ok(trace.stretch(*motion)?)).collect()
    };
    let paths = stretches(material.trace)?;
    let twins = material.twin.map(stretches).transpose()?;
    let runs: Vec<Run<'_>> = circles
        .iter()
        .enumerate()
        .map(|(index, (_, nominal))| Run {
            nominal: *nominal,
            trace: &paths[index],
            friction_free: twins.as_ref().map(|twins| &twins[index]),
        })
        .collect();
    let test = circle::analyse(&runs)?;
    let sheet = sheet(material, &test);
    let files = report::write(folder, &sheet, &test, &runs);
    let is_written = files.is_ok();
    if let Err(error) = &files {
        eprintln!("error: {error}");
    }
    print(material, &test, &sheet, files.ok().as_ref(), as_json)?;
    Ok(if is_written { Outcome::Done } else { Outcome::Incomplete })
}

fn sheet(material: &Material<'_>, test: &CircularTest) -> TestSheet {
    let header = material.header;
    let is_paper = EMBEDDED.iter().any(|(name, text)| *name == "paper" && *text == header.machine_text);
    TestSheet {
        machine: header.machine_name.clone(),
        gains: material.gains.to_owned(),
        date: rfc3339(header.wall_at_zero_ns),
        log: material.log.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned()),
        commit: header.commit.clone(),
        pace: format!("{} time, seed {}", header.pace.name(), header.seed),
        cycles: material.trace.len() as u64,
        overruns: material.trace.overruns,
        lost_records: material.lost_records,
        notes: material.notes.clone(),
        expectations: if is_paper { paper::expectations(material.gains, test) } else { Vec::new() },
    }
}

fn print(
    material: &Material<'_>,
    test: &CircularTest,
    sheet: &TestSheet,
    files: Option<&ReportFiles>,
    as_json: bool,
) -> anyhow::Result<()> {
    let directions = &test.motor.directions;
    let printed = Printed {
        machine: &sheet.machine,
        gains: &sheet.gains,
        direction: if directions.len() > 1 { "both" } else { directions[0].direction.name() },
        radius_mm: test.radius_mm,
        feed_mm_per_min: test.feed_mm_per_min,
        revolutions: test.revolutions,
        pace: material.header.pace.name(),
        seed: material.header.seed,
        cycles: sheet.cycles,
        overruns: sheet.overruns,
        lost_records: sheet.lost_records,
        missing_cycles: test.missing_cycles,
        stale_samples: test.stale_samples,
        log: material.log,
        report: files.map(|files| files.html.as_path()),
        protrusion_um: Points {
            motor: &test.motor.protrusion_um,
            table: test.table.as_ref().map(|table| &table.protrusion_um),
        },
        radius_decrease_um: test.motor.radius_decrease_um,
        circular_deviation_um: test.motor.circular_deviation_um,
        bidirectional_circular_deviation_um: test.motor.bidirectional_circular_deviation_um,
        seconds: material.seconds.map(|(wall_s, _)| wall_s),
        times_real_time: material.seconds.map(|(wall_s, machine_s)| machine_s / wall_s),
        detail: test,
    };
    if as_json {
        return print_json(&printed);
    }
    let mut lines = view::circle_table(sheet, test);
    if let (Some(seconds), Some(times)) = (printed.seconds, printed.times_real_time) {
        lines += &format!("\n{seconds:.2} s, {times:.0} times real time\n");
    }
    lines += &format!("\nlog     {}\n", material.log.display());
    if let Some(ReportFiles { html, svg, png }) = files {
        let names = [html, svg, png].map(|path: &PathBuf| path.display().to_string());
        lines += &format!("report  {}\n        {}\n        {}\n", names[0], names[1], names[2]);
    }
    print_text(&lines)
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::base::record::CycleRecord;
    use crate::base::time::{Moment, Span};

    /// Cycles of a log, with what the last one counts.
    fn trace(cycles: &[u64], overruns: u64, lost_records: u64) -> Trace {
        let records = cycles.iter().map(|&cycle| {
            let mut record = CycleRecord::empty(2);
            record.cycle = cycle;
            record.timing.scheduled = Moment::ZERO + Span::us(500) * cycle as i64;
            if cycle > cycles[0] {
                (record.overruns, record.lost_records) = (overruns, lost_records);
            }
            record
        });
        Trace::from_records(records).unwrap()
    }

    #[test]
    fn what_a_log_lacks_is_said_and_a_skipped_period_is_no_lack() {
        assert!(shortfalls(false, &trace(&[1, 2, 3], 0, 0)).is_empty());
        assert!(shortfalls(false, &trace(&[1, 2, 5], 2, 0)).is_empty(), "two periods were skipped");
        assert_eq!(shortfalls(false, &trace(&[1, 2, 6], 2, 0)), ["1 cycles are missing in the log"]);
        assert_eq!(shortfalls(false, &trace(&[1, 2], 0, 4)), ["4 records were lost on the way to the log"]);
        assert_eq!(shortfalls(true, &trace(&[1, 2], 0, 0)), [TRUNCATED]);
    }
}
