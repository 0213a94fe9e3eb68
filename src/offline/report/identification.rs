//! The page of an identification: parameters with their intervals, the friction curve of each axis, and of logs a
//! reversal beside its model.
//!
//! Invariant: what was not found stands on the page with what it needs.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use maud::{Markup, PreEscaped, html};

use super::frequency::bode;
use super::page::whole;
use super::{PNG_SCALE, ReportError, put};
use crate::base::units::Velocity;
use crate::offline::draw::friction::{self, Fitted};
use crate::offline::draw::scale::signed;
use crate::offline::draw::{png, reversal};
use crate::offline::identify::frequency::AxisResponse;
use crate::offline::identify::logged::LoggedAxis;
use crate::offline::identify::rigid::{RigidAxis, RigidFit, Shape};
use crate::offline::identify::{AxisFindings, Finding, Findings};
use crate::plant::friction::Law;

/// Where the files are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IdentificationFiles {
    /// The page.
    pub html: PathBuf,
    /// Each drawing of each axis, as drawing and as picture.
    pub curves: Vec<[PathBuf; 2]>,
}

/// What the page says of an axis beside its parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AxisPage {
    /// One line.
    pub summary: String,
    /// Drawings, by the beginning of their file name.
    pub drawings: Vec<(&'static str, String)>,
}

impl AxisPage {
    /// An axis without elasticity.
    pub fn of_rigid(name: &str, axis: &RigidAxis) -> Self {
        let points = |fit: &RigidFit| -> Vec<[f64; 2]> {
            fit.curve.iter().map(|point| [1e3 * point.velocity_m_per_s, point.measured]).collect()
        };
        let fits = [&axis.symmetric, &axis.asymmetric].map(fitted);
        let title = format!("Friction of axis {name}");
        let curve = friction::draw(&title, axis.symmetric.units()[2], &points(&axis.symmetric), &fits);
        Self { summary: axis.summary(), drawings: vec![("friction", curve)] }
    }

    /// An axis from its logs.
    pub fn of_logged(name: &str, axis: &LoggedAxis, response: Option<&AxisResponse>) -> Self {
        let points: Vec<[f64; 2]> =
            axis.points.iter().map(|point| [1e3 * point.velocity_m_per_s, point.force_n]).collect();
        let curve =
            friction::draw(&format!("Friction of axis {name}"), "N", &points, &[axis_law(axis, &points)]);
        let mut drawings = vec![("friction", curve)];
        if !axis.reversal.is_empty() {
            let title = format!("A reversal of axis {name}");
            drawings.push(("reversal", reversal::draw(&title, &axis.reversal)));
        }
        if let Some(response) = response {
            drawings.push(("frequency", bode(name, response)));
        }
        Self { summary: axis.summary.clone(), drawings }
    }
}

/// The law that was found, from the fastest backwards to the fastest forwards.
fn axis_law(axis: &LoggedAxis, points: &[[f64; 2]]) -> Fitted {
    const STEPS: usize = 400;
    let law = Law::new(axis.model.friction);
    let fastest = points.iter().map(|[speed, _]| speed.abs()).fold(2.0, f64::max);
    let piece = |way: f64| -> Vec<[f64; 2]> {
        // Fine where the force falls.
        let speed = |step: usize| way * fastest * (step as f64 / STEPS as f64).powi(3).max(1e-9);
        let mut points: Vec<[f64; 2]> = (0..=STEPS)
            .map(speed)
            .map(|mm_per_s| [mm_per_s, law.sliding(Velocity::mm_per_s(mm_per_s)).as_n() + axis.offset_n])
            .collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        points
    };
    Fitted { name: "identified".to_owned(), pieces: vec![piece(-1.0), piece(1.0)] }
}

/// Writes `identification.html`, and each drawing of each axis as `NAME-AXIS.svg` and `.png`, into a folder, which
/// is made if need be. `data` names what was measured.
///
/// # Errors
/// When the folder cannot be made or written to; no half-written file is left behind.
pub fn write(
    folder: &Path,
    data: &str,
    found: &Findings,
    axes: &BTreeMap<String, AxisPage>,
) -> Result<IdentificationFiles, ReportError> {
    fs::create_dir_all(folder).map_err(|cause| ReportError::Folder { folder: folder.to_owned(), cause })?;
    let mut curves = Vec::new();
    for (axis, AxisPage { drawings, .. }) in axes {
        for (drawing, svg) in drawings {
            let name = |ending: &str| format!("{drawing}-{axis}.{ending}");
            let picture = png::render(svg, PNG_SCALE)?;
            curves.push([put(folder, &name("svg"), svg.as_bytes())?, put(folder, &name("png"), &picture)?]);
        }
    }
    let page = page(data, found, axes);
    Ok(IdentificationFiles { html: put(folder, "identification.html", page.as_bytes())?, curves })
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

fn page(data: &str, found: &Findings, axes: &BTreeMap<String, AxisPage>) -> String {
    let body = html! {
        h1 { "Identification" }
        p.sub { "from " (data) }
        @for (name, findings) in found {
            h2 { "Axis " (name) }
            (table(findings))
            @if let Some(axis) = axes.get(name) {
                p { (axis.summary) }
                @for (_, svg) in &axis.drawings { figure { (PreEscaped(svg)) } }
            }
        }
    };
    whole(&format!("Identification · {data}"), &body)
}

/// Parameters with their intervals.
pub(super) fn table(findings: &AxisFindings) -> Markup {
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
