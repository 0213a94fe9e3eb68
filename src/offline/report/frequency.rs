//! The frequency response of each axis: its numbers as a file, and the Bode plot for the page.
//!
//! Invariant: what is in the picture is in the numbers.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::{ReportError, put};
use crate::offline::draw::bode::{self, Point};
use crate::offline::identify::frequency::{AxisResponse, Line};

/// Writes `frequency-AXIS.json` for each axis into a folder, which is made if need be: the lines with their
/// deviations, and the margins.
///
/// # Errors
/// When the folder cannot be made or written to; no half-written file is left behind.
pub fn write(folder: &Path, axes: &BTreeMap<String, AxisResponse>) -> Result<(), ReportError> {
    fs::create_dir_all(folder).map_err(|cause| ReportError::Folder { folder: folder.to_owned(), cause })?;
    for (axis, response) in axes {
        // Numbers only, so this cannot fail; a value that is not one becomes null.
        let numbers = serde_json::to_string_pretty(response).unwrap_or_default();
        put(folder, &format!("frequency-{axis}.json"), numbers.as_bytes())?;
    }
    Ok(())
}

/// The measured loop of an axis beside the computed one.
pub(super) fn bode(axis: &str, response: &AxisResponse) -> String {
    let point = |line: &Line| Point {
        frequency_hz: line.frequency_hz,
        db: line.open_db,
        deg: line.open_deg,
        std: line.open_std,
    };
    let measured: Vec<Point> = response.lines.iter().map(point).collect();
    let title = format!("Open velocity loop of axis {axis}, gains {}", response.gains);
    bode::draw(&title, &measured, &response.curve)
}
