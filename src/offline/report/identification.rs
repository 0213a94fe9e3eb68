//! The page of an identification: parameters with their intervals, and the friction curve of each axis.
//!
//! Invariant: what was not found stands on the page with what it needs.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::page::STYLE;
use super::{PNG_SCALE, ReportError, put};
use crate::offline::draw::friction::{self, Fitted};
use crate::offline::draw::png;
use crate::offline::draw::scale::signed;
use crate::offline::identify::rigid::{RigidAxis, RigidFit, Shape};
use crate::offline::identify::{AxisFindings, Finding, Findings};

/// Where the files are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IdentificationFiles {
    /// The page.
    pub html: PathBuf,
    /// The friction curve of each axis, as drawing and as picture.
    pub curves: Vec<[PathBuf; 2]>,
}

/// Writes `identification.html`, and `friction-AXIS.svg` and `.png` for each axis, into a folder, which is made
/// if need be. `data` names what was measured.
///
/// # Errors
/// When the folder cannot be made or written to; no half-written file is left behind.
pub fn write(
    folder: &Path,
    data: &str,
    found: &Findings,
    axes: &BTreeMap<String, RigidAxis>,
) -> Result<IdentificationFiles, ReportError> {
    fs::create_dir_all(folder).map_err(|cause| ReportError::Folder { folder: folder.to_owned(), cause })?;
    let drawn: BTreeMap<&str, String> =
        axes.iter().map(|(name, axis)| (&**name, curve(name, axis))).collect();
    let mut curves = Vec::new();
    for (axis, svg) in &drawn {
        let name = |ending: &str| format!("friction-{axis}.{ending}");
        let picture = png::render(svg, PNG_SCALE)?;
        curves.push([put(folder, &name("svg"), svg.as_bytes())?, put(folder, &name("png"), &picture)?]);
    }
    let page = page(data, found, axes, &drawn).into_string();
    Ok(IdentificationFiles { html: put(folder, "identification.html", page.as_bytes())?, curves })
}

/// The friction curve of an axis.
fn curve(name: &str, axis: &RigidAxis) -> String {
    let points = |fit: &RigidFit| -> Vec<[f64; 2]> {
        fit.curve.iter().map(|point| [1e3 * point.velocity_m_per_s, point.measured]).collect()
    };
    let fits = [&axis.symmetric, &axis.asymmetric].map(fitted);
    friction::draw(
        &format!("Friction of axis {name}"),
        axis.symmetric.units()[2],
        &points(&axis.symmetric),
        &fits,
    )
}

/// Each direction is one piece: between them the force steps.
fn fitted(fit: &RigidFit) -> Fitted {
    let speeds = || fit.curve.iter().map(|point| point.velocity_m_per_s);
    let [least, most] = [speeds().fold(0.0, f64::min), speeds().fold(0.0, f64::max)];
    let piece = |ends: [f64; 2]| ends.map(|v| [1e3 * v, fit.axis.force_n(v, 0.0)]).to_vec();
    let name = match fit.shape {
        Shape::Symmetric => "symmetric",
        Shape::Asymmetric => "by direction",
    };
    Fitted {
        name: name.to_owned(),
        pieces: vec![piece([least, -f64::MIN_POSITIVE]), piece([f64::MIN_POSITIVE, most])],
    }
}

fn page(
    data: &str,
    found: &Findings,
    axes: &BTreeMap<String, RigidAxis>,
    drawn: &BTreeMap<&str, String>,
) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "Identification · " (data) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { "Identification" }
                p.sub { "from " (data) }
                @for (name, findings) in found {
                    h2 { "Axis " (name) }
                    (table(findings))
                    @if let Some(axis) = axes.get(name) { p { (axis.summary()) } }
                    @if let Some(svg) = drawn.get(&**name) { figure { (PreEscaped(svg)) } }
                }
            }
        }
    }
}

fn table(findings: &AxisFindings) -> Markup {
    html! {
        table {
            thead { tr { th { "parameter" } th { "value" } th { "95 % interval" } th { "unit" } th { "from" } } }
            @for (name, finding) in findings {
                tr {
                    td { (name.replace('_', " ")) }
                    @match finding {
                        Finding::Found(estimate) => {
                            td { (signed(estimate.value, 3)) }
                            td { (signed(estimate.ci95[0], 3)) " to " (signed(estimate.ci95[1], 3)) }
                            td { (estimate.unit) }
                            td { (estimate.source) }
                        }
                        Finding::Unknown { needs, .. } => { td { "not known" } td colspan="3" { (needs) } }
                    }
                }
            }
        }
    }
}
