//! The page of a gap: what is missing, how far the gap shrinks with it, and where it lives, before and after.
//!
//! Invariant: everything drawn is of the analysis that is printed beside it.

use std::fs;
use std::path::{Path, PathBuf};

use maud::{PreEscaped, html};

use super::page::whole;
use super::{ReportError, put};
use crate::config::Machine;
use crate::offline::draw::residual;
use crate::offline::gap::analysis::{Analysis, AxisGap};
use crate::offline::gap::locate::unit;
use crate::offline::gap::problem::SIGNALS;

/// Coordinates of an axis that are drawn.
const DRAWN: usize = 3;

/// Writes `gap.html` into a folder, which is made if need be. `rows` are axis, effect, values and confidence of what was
/// named.
///
/// # Errors
/// When the folder cannot be made or written to; no half-written file is left behind.
pub fn write(
    folder: &Path,
    machine: &Machine,
    analysis: &Analysis<'_>,
    rows: &[[String; 4]],
) -> Result<PathBuf, ReportError> {
    fs::create_dir_all(folder).map_err(|cause| ReportError::Folder { folder: folder.to_owned(), cause })?;
    put(folder, "gap.html", page(machine, analysis, rows).as_bytes())
}

/// Writes `gap.json` into a folder that is there.
///
/// # Errors
/// When it cannot be written; no half-written file is left behind.
pub fn write_json(folder: &Path, json: &str) -> Result<PathBuf, ReportError> {
    put(folder, "gap.json", format!("{json}\n").as_bytes())
}

fn page(machine: &Machine, analysis: &Analysis<'_>, rows: &[[String; 4]]) -> String {
    let names = machine.axis_names();
    let body = html! {
        h1 { "The gap · " (machine.name) }
        p.sub { "simulation from the command alone against measurement" }
        @if rows.is_empty() { p { "No effect was named." } } @else {
            table {
                thead { tr { th { "axis" } th { "effect" } th { "values, 95 % intervals" } th { "confidence" } } }
                @for row in rows { tr { @for cell in row { td { (cell) } } } }
            }
        }
        @for axis in &analysis.axes {
            h2 { "Axis " (names[axis.id.index()]) ": " (axis.verdict) }
            (PreEscaped(shrunk(axis)))
            @for svg in drawn(axis, &names[axis.id.index()]) { figure { (PreEscaped(svg)) } }
        }
    };
    whole(&format!("The gap · {}", machine.name), &body)
}

/// The gap on rows that were not fitted, rms.
fn shrunk(axis: &AxisGap<'_>) -> String {
    let table = html! {
        table {
            caption { "On rows that were not fitted, rms" }
            thead { tr { th { "" } th { "as filed" } th { "base fitted" } th { "with what was named" } th { "noise" } } }
            @for gap in &axis.gap {
                tr {
                    td { (gap.signal) " / " (gap.unit) }
                    @for value in [gap.file, gap.before, gap.after, gap.floor] { td { (format!("{value:.4}")) } }
                }
            }
        }
    };
    table.into_string()
}

/// Where it lives: the coordinates that explain the most.
fn drawn(axis: &AxisGap<'_>, name: &str) -> Vec<String> {
    let of = |located: &crate::offline::gap::locate::Located| {
        let (signal, si, _) = SIGNALS[located.signal];
        let (factor, in_unit) = if si == "m" { (1e6, "um") } else { (1.0, si) };
        let profile: Vec<[f64; 3]> =
            located.profile.iter().map(|[x, before, after]| [*x, factor * before, factor * after]).collect();
        let noise = axis.problem.noises[located.signal].as_ref().map_or(0.0, |noise| factor * noise.rms);
        let (coordinate, over) = (located.coordinate, unit(located.coordinate));
        let across = if over.is_empty() { coordinate.to_string() } else { format!("{coordinate} / {over}") };
        let title = format!(
            "Axis {name}: {signal} over {coordinate}, {:.0} % of what the base leaves",
            100.0 * located.share
        );
        residual::draw(&title, [&across, &format!("{signal} left / {in_unit}")], &profile, noise)
    };
    axis.located.iter().take(DRAWN).map(of).collect()
}
