//! Identification: measured motion in, parameters of an axis with their intervals out.
//!
//! ```text
//!   log, CSV ──► columns of an axis ──► stretches ──► regressions and fits ──► Findings ──► machine file
//! ```
//!
//! [`plan`] is the list of motions that tell the most. [`foreign`] reads measurements that are no log of ours, by a map of their columns; [`rigid`] fits the axis
//! that has no elasticity to them; [`least_squares`] is what all regressions share.
//! Invariant: a value comes with its interval, its unit and the data behind it; what the data do not tell is
//! said with what would tell it, and never guessed.

use std::collections::BTreeMap;

use serde::Serialize;

pub mod foreign;
pub mod least_squares;
pub mod plan;
pub mod rigid;
pub mod smoothing;

/// A parameter as the data tell it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Most likely value.
    pub value: f64,
    /// Interval that contains the true value in 95 of 100 measurements.
    pub ci95: [f64; 2],
    /// Unit of both.
    pub unit: &'static str,
    /// The data behind it.
    pub source: String,
}

impl Estimate {
    /// A value with the half width of its 95 % interval.
    pub fn within(value: f64, half_width: f64, unit: &'static str, source: impl Into<String>) -> Self {
        Self { value, ci95: [value - half_width, value + half_width], unit, source: source.into() }
    }
}

/// What became of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Finding {
    /// The data tell it.
    Found(Estimate),
    /// They do not.
    Unknown {
        /// Always `None`: in JSON the same key as that of a value.
        value: Option<f64>,
        /// Why not, and which data would tell it.
        needs: String,
    },
}

impl Finding {
    /// The data do not tell it; `needs` says which would.
    pub fn unknown(needs: impl Into<String>) -> Self {
        Self::Unknown { value: None, needs: needs.into() }
    }

    /// The estimate, if there is one.
    pub const fn estimate(&self) -> Option<&Estimate> {
        match self {
            Self::Found(estimate) => Some(estimate),
            Self::Unknown { .. } => None,
        }
    }
}

impl From<Estimate> for Finding {
    fn from(estimate: Estimate) -> Self {
        Self::Found(estimate)
    }
}

/// The parameters of one axis, by name.
pub type AxisFindings = BTreeMap<String, Finding>;
/// Those of each axis, by its name.
pub type Findings = BTreeMap<String, AxisFindings>;
