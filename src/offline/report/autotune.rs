//! The page of an automatic tuning: the verdict, figures before and after, both circles on one scale, what the machine
//! was found to be.
//!
//! Invariant: without a second circle the page shows the first, and says so by its verdict.

use std::fs;
use std::path::{Path, PathBuf};

use maud::{PreEscaped, html};

use super::identification::table;
use super::page::whole;
use super::{ReportError, put};
use crate::offline::circle::CircularTest;
use crate::offline::draw::polar;
use crate::offline::identify::Findings;

/// What the page shows.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// Name of the machine.
    pub machine: &'a str,
    /// One sentence.
    pub verdict: &'a str,
    /// Whether the new gains are in the file.
    pub is_written: bool,
    /// Steps that were begun.
    pub steps: &'a [&'static str],
    /// Name, before and after of each figure.
    pub rows: &'a [[String; 3]],
    /// The circle with the old gains.
    pub before: &'a CircularTest,
    /// The circle with the new ones, if it came to that.
    pub after: Option<&'a CircularTest>,
    /// What the machine was found to be.
    pub identified: &'a Findings,
    /// Keys of the machine file that nothing told.
    pub kept_values: &'a [String],
    /// The logs behind it.
    pub logs: &'a [PathBuf],
}

/// Writes `autotune.html` into a folder, which is made if need be.
///
/// # Errors
/// When the folder cannot be made or written to; no half-written file is left behind.
pub fn write(folder: &Path, shown: &Shown<'_>) -> Result<PathBuf, ReportError> {
    fs::create_dir_all(folder).map_err(|cause| ReportError::Folder { folder: folder.to_owned(), cause })?;
    put(folder, "autotune.html", page(shown).as_bytes())
}

/// The page as text.
pub fn page(shown: &Shown<'_>) -> String {
    let Shown { before, after, .. } = shown;
    let of_circle = format!("R {} mm · {:.0} mm/min", before.radius_mm, before.feed_mm_per_min);
    let circles = match after {
        Some(after) => {
            let both = [("before", *before, &before.motor), ("after", *after, &after.motor)];
            polar::compare(&both, &format!("Motor encoder · {of_circle}"))
        }
        None => polar::draw(before, &format!("Circle before · {of_circle}")),
    };
    let body = html! {
        h1 { "Automatic tuning · " (shown.machine) }
        p.sub { (of_circle) " · steps: " (shown.steps.join(", ")) }
        p.(if shown.is_written { "yes" } else { "no" }) { (shown.verdict) }
        table {
            thead { tr { th { "" } th { "before" } th { "after" } } }
            @for [name, before, after] in shown.rows { tr { td { (name) } td { (before) } td { (after) } } }
        }
        h2 { "Circles" }
        figure { (PreEscaped(circles)) }
        @for (axis, findings) in shown.identified {
            h2 { "Axis " (axis) ", as identified" }
            (table(findings))
        }
        @if !shown.kept_values.is_empty() {
            h2 { "Not told, so the value of the machine file stays" }
            ul { @for key in shown.kept_values { li { (key) } } }
        }
        h2 { "Logs" }
        ul { @for log in shown.logs { li { (log.display()) } } }
    };
    whole(&format!("Automatic tuning · {}", shown.machine), &body)
}
