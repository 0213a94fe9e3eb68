//! The result of a circular test, of an [`identification`], of a [`tuning`] or of a [`gap`], as files a person opens: a page, a drawing, a
//! picture.
//!
//! Each file is written under a temporary name in the same folder and renamed when it is complete, so
//! a reader never sees half a report. Invariant: the page needs nothing beside itself: no script, no
//! network, no second file.

pub mod autotune;
pub mod frequency;
pub mod gap;
pub mod identification;
mod page;
pub mod tuning;

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::circle::{CircularTest, Run};
use super::draw;
use super::draw::png::PngError;

/// What the page says about the test beside its result.
#[derive(Clone, Debug, Default)]
pub struct TestSheet {
    /// Name of the machine.
    pub machine: String,
    /// Name of the gain set.
    pub gains: String,
    /// When, as it shall stand on the page.
    pub date: String,
    /// File name of the log; empty for none.
    pub log: String,
    /// Commit of the program.
    pub commit: String,
    /// How time ran, and the seed: `virtual time, seed 1`.
    pub pace: String,
    /// Cycles run.
    pub cycles: u64,
    /// Periods skipped because a cycle came late.
    pub overruns: u64,
    /// Records that never reached the log.
    pub lost_records: u64,
    /// What else the reader must know, one sentence each: truncated logs, warnings.
    pub notes: Vec<String>,
    /// What the numbers are held against.
    pub expectations: Vec<Expectation>,
}

/// A number with the number it should be.
#[derive(Clone, Debug, PartialEq)]
pub struct Expectation {
    /// What: `protrusion at the motor encoder`.
    pub quantity: String,
    /// As measured, um.
    pub measured_um: f64,
    /// As expected, um.
    pub expected_um: f64,
    /// How far off it may be, um.
    pub tolerance_um: f64,
    /// Who says so.
    pub source: String,
}

impl Expectation {
    /// Whether the measured number is within the tolerance.
    pub fn is_met(&self) -> bool {
        (self.measured_um - self.expected_um).abs() <= self.tolerance_um
    }
}

/// Where the files are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportFiles {
    /// The page.
    pub html: PathBuf,
    /// The polar plot.
    pub svg: PathBuf,
    /// The polar plot as a picture.
    pub png: PathBuf,
}

/// Why there is no report.
#[derive(Debug, Error)]
pub enum ReportError {
    /// The folder is not there and cannot be made.
    #[error("cannot create the report folder {}: {cause}", folder.display())]
    Folder {
        /// Which.
        folder: PathBuf,
        /// Why not.
        cause: io::Error,
    },
    /// A file cannot be written.
    #[error("cannot write {file} into the report folder {}: {cause}", folder.display())]
    File {
        /// Where.
        folder: PathBuf,
        /// Which.
        file: String,
        /// Why not.
        cause: io::Error,
    },
    /// The picture cannot be made.
    #[error("cannot make the picture of the polar plot: {0}")]
    Picture(#[from] PngError),
}

/// Pixels of the picture for each unit of the drawing: sharp on A4 at 200 dots per inch.
const PNG_SCALE: f32 = 2.0;

/// The page as text.
pub fn page(sheet: &TestSheet, test: &CircularTest, runs: &[Run<'_>]) -> String {
    page::render(sheet, test, runs)
}

/// Writes `circle.html`, `circle.svg` and `circle.png` into a folder, which is made if need be.
///
/// # Errors
/// When the folder cannot be made or written to; no half-written file is left behind.
pub fn write(
    folder: &Path,
    sheet: &TestSheet,
    test: &CircularTest,
    runs: &[Run<'_>],
) -> Result<ReportFiles, ReportError> {
    fs::create_dir_all(folder).map_err(|cause| ReportError::Folder { folder: folder.to_owned(), cause })?;
    let svg = draw::polar::draw(test, &page::title(sheet, test));
    let png = draw::png::render(&svg, PNG_SCALE)?;
    let html = page(sheet, test, runs);
    Ok(ReportFiles {
        svg: put(folder, "circle.svg", svg.as_bytes())?,
        png: put(folder, "circle.png", &png)?,
        html: put(folder, "circle.html", html.as_bytes())?,
    })
}

fn put(folder: &Path, file: &str, bytes: &[u8]) -> Result<PathBuf, ReportError> {
    let path = folder.join(file);
    // The number of the process keeps two reports into one folder apart.
    let draft = folder.join(format!(".{file}.{}.part", std::process::id()));
    let written = fs::File::create(&draft)
        .and_then(|mut out| out.write_all(bytes).and_then(|()| out.sync_all()))
        .and_then(|()| fs::rename(&draft, &path));
    written.map(|()| path).map_err(|cause| {
        // The cause of the failure matters more than a draft that may not even exist.
        let _ = fs::remove_file(&draft);
        ReportError::File { folder: folder.to_owned(), file: file.to_owned(), cause }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_appears_whole_and_replaces_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        put(folder.path(), "circle.svg", b"old").unwrap();
        let path = put(folder.path(), "circle.svg", b"new").unwrap();
        assert_eq!(fs::read(path).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no draft is left");
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_named_with_the_cause() {
        let folder = tempfile::tempdir().unwrap();
        // A folder in the file's place refuses the rename for every user, root included.
        fs::create_dir(folder.path().join("circle.svg")).unwrap();
        let refused = put(folder.path(), "circle.svg", b"new").unwrap_err().to_string();
        let expected =
            format!("cannot write circle.svg into the report folder {}: ", folder.path().display());
        assert!(refused.starts_with(&expected), "{refused}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no draft is left");
    }

    #[test]
    fn a_number_is_held_against_its_tolerance() {
        let expectation = |measured_um| Expectation {
            quantity: "protrusion".to_owned(),
            measured_um,
            expected_um: 25.0,
            tolerance_um: 0.1,
            source: "paper".to_owned(),
        };
        assert!(expectation(25.09).is_met());
        assert!(!expectation(24.8).is_met());
    }
}
