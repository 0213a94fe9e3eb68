//! The page of a gap: what is missing, how far the gap shrinks with it, and where it lives, before and after.
//!
//! Invariant: everything drawn is of the analysis that is printed beside it.

use std::fs;
use std::path::{Path, PathBuf};

use maud::{PreEscaped, html};

use super::page::whole;
use super::{ReportError, put};
use crate::config::Machine;
use crate::offline::draw::{polar, residual};
use crate::offline::gap::analysis::Analysis;
use crate::offline::gap::locate::unit;
use crate::offline::gap::model::problem::shown;
use crate::offline::gap::show::answer::AxisGap;
use crate::offline::gap::show::contour::{Contour, point};

/// Coordinates of an axis that are drawn.
const DRAWN: usize = 3;

/// An effect that was named, as a page shows it.
#[derive(Debug)]
pub struct NamedRow {
    /// Axis, effect, values, confidence.
    pub cells: [String; 4],
    /// Why it is no other, and what would falsify it.
    pub sentences: Vec<String>,
}

/// Writes `gap.html` into a folder, which is made if need be.
///
/// # Errors
/// When the folder cannot be made or written to; no half-written file is left behind.
pub fn write(
    folder: &Path,
    machine: &Machine,
    analysis: &Analysis<'_>,
    rows: &[NamedRow],
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

fn page(machine: &Machine, analysis: &Analysis<'_>, rows: &[NamedRow]) -> String {
    let names = machine.axis_names();
    let body = html! {
        h1 { "The gap · " (machine.name) }
        p.sub { "simulation from the command alone against measurement" }
        @if rows.is_empty() { p { "No effect was named." } } @else {
            table {
                thead { tr { th { "axis" } th { "effect" } th { "values, 95 % intervals" } th { "confidence" } } }
                @for row in rows { tr { @for cell in &row.cells { td { (cell) } } } }
            }
            @for row in rows {
                @if !row.sentences.is_empty() {
                    p { "Axis " (row.cells[0]) ", " (row.cells[1]) ":" }
                    ul { @for sentence in &row.sentences { li { (sentence) } } }
                }
            }
        }
        @for axis in &analysis.axes {
            h2 { "Axis " (names[axis.id.index()]) ": " (axis.verdict) }
            @if let Some(rest) = &axis.rest { p { "Something real is left without a name: " (rest) "." } }
            (PreEscaped(shrunk(axis)))
            @if let Some(noise) = axis.problem.torque_noise() {
                p { "From pass to pass its torque shakes by " (format!("{:.3}", noise.as_a()))
                    " A rms. Where the axis sticks that moves the mean, and what is simulated with it." }
            }
            @for svg in drawn(axis, &names[axis.id.index()]) { figure { (PreEscaped(svg)) } }
            (PreEscaped(seen(axis)))
        }
        @for contour in &analysis.contours { (PreEscaped(circle(contour, !rows.is_empty()))) }
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
        let (signal, factor, in_unit) = shown(located.signal);
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

/// From which amplitude each other effect would have been seen.
fn seen(axis: &AxisGap<'_>) -> String {
    let smallest = || axis.named.smallest.iter();
    let hidden: Vec<&str> = smallest().filter(|one| one.amplitude.is_none()).map(|one| one.name).collect();
    let table = html! {
        @if !axis.named.smallest.is_empty() {
            details {
                summary { "What else these runs would have shown" }
                table {
                    thead { tr { th { "effect" } th { "from" } } }
                    @for one in smallest() {
                        @if let Some(amplitude) = one.amplitude {
                            tr { td { (one.name) } td { (one.key) " " (format!("{amplitude:.3e}")) } }
                        }
                    }
                }
                @if !hidden.is_empty() { p { "They do not show: " (hidden.join(", ")) "." } }
            }
        }
    };
    table.into_string()
}

/// A circle as measured and as simulated, side by side.
fn circle(contour: &Contour, is_anything_named: bool) -> String {
    let [before, after] = &contour.simulated;
    let mut tests = vec![("measured", &contour.measured), ("base fitted", before)];
    if is_anything_named {
        tests.push(("with what was named", after));
    }
    let panels: Vec<_> = tests.into_iter().map(|(name, test)| (name, test, point(test))).collect();
    let test = &contour.measured;
    let title = format!(
        "R {} mm · {:.0} mm/min · {}",
        test.radius_mm,
        test.feed_mm_per_min,
        point(test).point.name()
    );
    let apart = contour.contour_um.map(|um| format!("{um:.2}"));
    let part = html! {
        h2 { "Circle R " (test.radius_mm) " mm, " (format!("{:.0}", test.feed_mm_per_min)) " mm/min"
            @if contour.is_held { ", not fitted" } }
        p { "Radial deviation, measured less simulated: " (apart[0]) " um rms with the base fitted, " (apart[1])
            " um with what was named; noise " (format!("{:.2}", contour.floor_um)) " um." }
        figure { (PreEscaped(polar::compare(&panels, &title))) }
    };
    part.into_string()
}
