//! The circular test of ISO 230-4: from the trace of a circular path to its numbers and curves.
//!
//! Per direction and measuring point (motor encoders, table scales): [`path`] turns columns into a
//! polar curve, [`deviation`] gives the quantities of the standard and what each axis does to them,
//! [`protrusion`] measures what is left of every reversal; [`fit`] holds the circles and arcs. [`motions`]
//! takes a whole test at once.
//!
//! Nominal means the commanded circle; deviations are outward positive. Angles count counter-clockwise
//! from +X in either direction of travel. Invariant: every number leaves here in the unit of its name.

pub mod deviation;
pub mod fit;
pub mod motions;
pub mod paper;
pub mod path;
pub mod protrusion;

use std::f64::consts::FRAC_PI_2;
use std::ops::Range;

use serde::Serialize;
use thiserror::Error;

use self::deviation::CircleValues;
use self::path::{Guard, Path};
use self::protrusion::{Protrusion, QuadrantHeights};
use super::trace::{AxisTrace, Trace};
use crate::base::axis::AxisId;
use crate::base::motion::{Circle, Direction};

/// Micrometres in a metre: results leave in micrometres.
pub(super) const UM: f64 = 1e6;

/// Where the path is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum MeasuringPoint {
    /// Motor encoders, in travel of the axis.
    Motor,
    /// Table scales.
    Table,
}

impl MeasuringPoint {
    /// Name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Motor => "motor encoder",
            Self::Table => "table scale",
        }
    }
}

/// The place on the circle where one axis turns around.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quadrant {
    /// 0°: X reverses at its upper end.
    XPlus,
    /// 90°: Y reverses at its upper end.
    YPlus,
    /// 180°: X reverses at its lower end.
    XMinus,
    /// 270°: Y reverses at its lower end.
    YMinus,
}

impl Quadrant {
    /// All four, counter-clockwise from +X.
    pub const ALL: [Self; 4] = [Self::XPlus, Self::YPlus, Self::XMinus, Self::YMinus];

    /// The one closest to an angle.
    pub fn nearest(angle_rad: f64) -> Self {
        Self::ALL[(angle_rad / FRAC_PI_2).round().rem_euclid(4.0) as usize % 4]
    }
    /// Place in [`Self::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }
    /// Where it lies, in degrees.
    pub const fn angle_deg(self) -> f64 {
        90.0 * self.index() as f64
    }
    /// Short name in drawings and tables.
    pub const fn label(self) -> &'static str {
        match self {
            Self::XPlus => "X+",
            Self::YPlus => "Y+",
            Self::XMinus => "X−",
            Self::YMinus => "Y−",
        }
    }
    /// The axis that turns around here.
    pub const fn axis(self) -> AxisId {
        path::reversing_axis(self)
    }
}

/// Why a trace cannot be judged as a circular path.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CircleError {
    /// Nothing to judge.
    #[error("no circular path was given")]
    NoRuns,
    /// A circle needs X and Y.
    #[error("{direction}: the log has {axes} axes, a circle needs 2")]
    TooFewAxes {
        /// Direction of the run.
        direction: Direction,
        /// Axes in the log.
        axes: usize,
    },
    /// No row is flagged as measured.
    #[error("{direction}: no cycle of the motion is in its measured part")]
    NothingMeasured {
        /// Direction of the run.
        direction: Direction,
    },
    /// The path broke off.
    #[error("{direction}: the measured part covers {got_deg:.1} degrees, expected {expected_deg:.0}")]
    Incomplete {
        /// Direction of the run.
        direction: Direction,
        /// Degrees found.
        got_deg: f64,
        /// Degrees wanted.
        expected_deg: f64,
    },
    /// The points do not determine what is fitted to them.
    #[error("{direction}: {samples} samples outside the reversals do not determine {what}")]
    Undetermined {
        /// Direction of the run.
        direction: Direction,
        /// What was to be fitted.
        what: &'static str,
        /// Samples at hand.
        samples: usize,
    },
    /// The friction-free response belongs to another run.
    #[error("{direction}: the friction-free response lacks cycle {cycle} of the measured part")]
    ReferenceMismatch {
        /// Direction of the run.
        direction: Direction,
        /// Cycle since the start of the measured part.
        cycle: u64,
    },
    /// Runs of different circles were put together.
    #[error("runs in one test must share centre, radius and feed; {direction} differs from the first")]
    DifferentCircles {
        /// Direction of the odd one.
        direction: Direction,
    },
}

/// One circular path in one direction.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// What was ordered.
    pub nominal: Circle,
    /// What happened: the whole motion, run-in and run-out included.
    pub trace: &'a Trace,
    /// The same cycles on the same machine without friction, where a simulation gives them.
    pub friction_free: Option<&'a Trace>,
}

impl Run<'_> {
    fn axes(&self) -> Result<[&AxisTrace; 2], CircleError> {
        match (self.trace.axis(AxisId::X), self.trace.axis(AxisId::Y)) {
            (Some(x), Some(y)) => Ok([x, y]),
            _ => {
                let (direction, axes) = (self.nominal.direction, self.trace.axes.len());
                Err(CircleError::TooFewAxes { direction, axes })
            }
        }
    }

    fn stale_samples(&self) -> Result<u64, CircleError> {
        Ok(self.axes()?.iter().map(|axis| axis.stale_samples() as u64).sum())
    }

    fn measured(&self) -> Result<Range<usize>, CircleError> {
        let rows = &self.trace.is_measured;
        let (first, last) = (rows.iter().position(|is| *is), rows.iter().rposition(|is| *is));
        let nothing = CircleError::NothingMeasured { direction: self.nominal.direction };
        first.zip(last).map(|(first, last)| first..last + 1).ok_or(nothing)
    }
}

/// Numbers and curves of one direction at one measuring point.
#[derive(Clone, Debug, Serialize)]
pub struct PathAnalysis {
    /// Sense of rotation.
    pub direction: Direction,
    /// Quantities of the path as a whole.
    #[serde(flatten)]
    pub values: CircleValues,
    /// Each reversal, in order.
    pub protrusions: Vec<Protrusion>,
    /// The guards around reversals had to be shortened: what is fitted outside them carries some of
    /// the reversals' tails.
    pub is_guard_shortened: bool,
    /// The path.
    #[serde(skip)]
    pub path: Path,
    /// The deviation the path would have without its reversals, m, row by row: the friction-free
    /// response where one was given, else the fitted arcs.
    #[serde(skip)]
    pub baseline_m: Vec<f64>,
    /// The friction-free response's own deviation, m, row by row.
    #[serde(skip)]
    pub friction_free_m: Option<Vec<f64>>,
}

/// Both directions at one measuring point.
#[derive(Clone, Debug, Serialize)]
pub struct PointAnalysis {
    /// Where.
    pub point: MeasuringPoint,
    /// Height of the protrusions, um: the highest of all directions and revolutions.
    pub protrusion_um: QuadrantHeights,
    /// Nominal radius minus the radius of the arcs between the reversals, um: mean of the directions.
    pub radius_decrease_um: f64,
    /// Circular deviation G, um: the larger of the directions.
    pub circular_deviation_um: f64,
    /// Bidirectional circular deviation G(b), um; `None` with one direction.
    pub bidirectional_circular_deviation_um: Option<f64>,
    /// Each direction, as ordered.
    pub directions: Vec<PathAnalysis>,
}

/// The result of a circular test.
#[derive(Clone, Debug, Serialize)]
pub struct CircularTest {
    /// Nominal radius, mm.
    pub radius_mm: f64,
    /// Feed along the path, mm/min.
    pub feed_mm_per_min: f64,
    /// Turns evaluated in each direction.
    pub revolutions: u32,
    /// Cycles missing between the rows of all directions.
    pub missing_cycles: u64,
    /// Samples of X and Y that were not of their own cycle. They are left out like missing cycles.
    pub stale_samples: u64,
    /// At the motor encoders.
    pub motor: PointAnalysis,
    /// At the table scales; `None` where the machine has none.
    pub table: Option<PointAnalysis>,
}

impl CircularTest {
    /// The measuring points at hand, motor first.
    pub fn points(&self) -> impl Iterator<Item = &PointAnalysis> {
        std::iter::once(&self.motor).chain(&self.table)
    }
}

/// Judges one or more runs of the same circle.
///
/// # Errors
/// When a run is incomplete, has no X and Y, or does not belong to the others.
pub fn analyse(runs: &[Run<'_>]) -> Result<CircularTest, CircleError> {
    let first = runs.first().ok_or(CircleError::NoRuns)?.nominal;
    for run in runs {
        let same =
            Circle { direction: first.direction, start_angle_rad: first.start_angle_rad, ..run.nominal };
        if same != first {
            return Err(CircleError::DifferentCircles { direction: run.nominal.direction });
        }
    }
    let motor = analyse_point(runs, MeasuringPoint::Motor)?.ok_or(CircleError::NoRuns)?;
    Ok(CircularTest {
        radius_mm: first.radius.as_mm(),
        feed_mm_per_min: first.feed.as_mm_per_min(),
        revolutions: first.revolutions,
        missing_cycles: runs.iter().map(|run| run.trace.missing_cycles()).sum(),
        stale_samples: runs.iter().map(Run::stale_samples).sum::<Result<u64, _>>()?,
        motor,
        table: analyse_point(runs, MeasuringPoint::Table)?,
    })
}

fn analyse_point(runs: &[Run<'_>], point: MeasuringPoint) -> Result<Option<PointAnalysis>, CircleError> {
    let mut directions = Vec::with_capacity(runs.len());
    for run in runs {
        let Some(path) = Path::of(run, point)? else { return Ok(None) };
        directions.push(analyse_path(run, path, point)?);
    }
    let mean_um =
        |value: fn(&PathAnalysis) -> f64| directions.iter().map(value).sum::<f64>() / runs.len() as f64;
    let both_senses = [Direction::Cw, Direction::Ccw]
        .into_iter()
        .all(|sense| directions.iter().any(|analysis| analysis.direction == sense));
    Ok(Some(PointAnalysis {
        point,
        protrusion_um: QuadrantHeights::of(directions.iter().flat_map(|analysis| &analysis.protrusions)),
        radius_decrease_um: mean_um(|analysis| analysis.values.radius_decrease_um),
        circular_deviation_um: directions
            .iter()
            .map(|analysis| analysis.values.circular_deviation_um)
            .fold(f64::NEG_INFINITY, f64::max),
        bidirectional_circular_deviation_um: both_senses
            .then(|| deviation::bidirectional_um(directions.iter().map(|analysis| &analysis.path)))
            .flatten(),
        directions,
    }))
}

fn analyse_path(run: &Run<'_>, path: Path, point: MeasuringPoint) -> Result<PathAnalysis, CircleError> {
    deviation::check_complete(&path)?;
    let arcs = deviation::fit_arcs(&path)?;
    let values = CircleValues::of(&path, &arcs)?;
    let arc_m: Vec<f64> = (0..path.time_s.len()).map(|row| arcs.deviation_m(path.angle_rad(row))).collect();
    let friction_free_m =
        run.friction_free.map(|twin| friction_free(run, twin, &path, point)).transpose()?.flatten();
    let protrusions = protrusion::measure(&path, &arc_m, friction_free_m.as_deref());
    Ok(PathAnalysis {
        direction: path.nominal.direction,
        values,
        protrusions,
        is_guard_shortened: Guard::of(&path.nominal).is_shortened,
        baseline_m: friction_free_m.clone().unwrap_or(arc_m),
        friction_free_m,
        path,
    })
}

/// Radial deviation of the friction-free twin, row by row of the run: cycles are matched by their
/// distance from the start of the measured part, so missing cycles in a log do no harm.
fn friction_free(
    run: &Run<'_>,
    twin: &Trace,
    path: &Path,
    point: MeasuringPoint,
) -> Result<Option<Vec<f64>>, CircleError> {
    let twin_run = Run { nominal: run.nominal, trace: twin, friction_free: None };
    let Some(twin_path) = Path::of(&twin_run, point)? else { return Ok(None) };
    let (start, twin_start) = (path.measured.start, twin_path.measured.start);
    let deviation_m = (0..run.trace.len()).map(|row| {
        let cycle =
            twin.cycle[twin_start] as i64 + run.trace.cycle[row] as i64 - run.trace.cycle[start] as i64;
        let found = u64::try_from(cycle).ok().and_then(|cycle| twin.cycle.binary_search(&cycle).ok());
        match found {
            Some(at) => Ok(if twin_path.is_fresh[at] { twin_path.deviation_m[at] } else { f64::NAN }),
            // Outside the evaluated part the twin may be shorter: on the wall clock the run comes to rest
            // later than its twin does.
            None if !path.measured.contains(&row) => Ok(f64::NAN),
            None => Err(CircleError::ReferenceMismatch {
                direction: run.nominal.direction,
                cycle: run.trace.cycle[row].saturating_sub(run.trace.cycle[start]),
            }),
        }
    });
    deviation_m.collect::<Result<Vec<f64>, _>>().map(Some)
}
