//! The frequency response of each axis as files: a Bode plot as drawing and as picture, and the numbers.
//!
//! Invariant: what is in the picture is in the numbers.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::{PNG_SCALE, ReportError, put};
use crate::offline::draw::bode::{self, Point};
use crate::offline::draw::png;
use crate::offline::identify::frequency::{AxisResponse, Line};

/// Writes `frequency-AXIS.svg`, `.png` and `.json` for each axis into a folder, which is made if need be; where
/// the drawings are.
///
/// # Errors
/// When the folder cannot be made or written to; no half-written file is left behind.
pub fn write(folder: &Path, axes: &BTreeMap<String, AxisResponse>) -> Result<Vec<PathBuf>, ReportError> {
    fs::create_dir_all(folder).map_err(|cause| ReportError::Folder { folder: folder.to_owned(), cause })?;
    let mut drawings = Vec::new();
    for (axis, response) in axes {
        let name = |ending: &str| format!("frequency-{axis}.{ending}");
        let svg = bode(axis, response);
        let picture = png::render(&svg, PNG_SCALE)?;
        // Numbers only, so this cannot fail; a value that is not one becomes null.
        let numbers = serde_json::to_string_pretty(response).unwrap_or_default();
        drawings.push(put(folder, &name("svg"), svg.as_bytes())?);
        put(folder, &name("png"), &picture)?;
        put(folder, &name("json"), numbers.as_bytes())?;
    }
    Ok(drawings)
}

fn bode(axis: &str, response: &AxisResponse) -> String {
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
