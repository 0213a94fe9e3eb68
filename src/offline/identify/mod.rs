//! Identification: measured motion in, parameters of an axis with their intervals out.
//!
//! ```text
//!   log, CSV ──► columns of an axis ──► stretches ──► regressions and fits ──► Findings ──► machine file
//! ```
//!
//! [`plan`] is the list of motions that tell the most. [`logs`] opens logs and [`logged`] identifies an axis of
//! them, from what [`stretches`] finds in the [`measured`] columns, [`frequency`] from what was excited; [`axis`] has
//! what both tell, and [`write_back`] puts it into a machine file. [`foreign`] reads measurements that are no log of ours, by a map of
//! their columns; [`rigid`] fits the axis that has no elasticity to them. [`least_squares`] is what all
//! regressions share.
//! Invariant: a value comes with its interval, its unit and the data behind it; what the data do not tell is
//! said with what would tell it, and never guessed.

use std::collections::BTreeMap;

use serde::Serialize;

pub mod axis;
pub mod breakaway;
pub mod comparison;
pub mod current_loop;
pub mod fall;
pub mod foreign;
pub mod frequency;
pub mod inertia;
pub mod least_squares;
pub mod logged;
pub mod logs;
pub mod measured;
pub mod plan;
pub mod rigid;
pub mod ripple;
pub mod smoothing;
pub mod steady;
pub mod stiffness;
pub mod stretches;
pub mod write_back;

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

    /// The same with the uncertainty of a factor that all of it was multiplied by: half its 95 % interval in per
    /// cent, and its name for the source.
    #[must_use]
    pub fn with_scale(mut self, percent: f64, factor: &str) -> Self {
        let scale = 0.01 * percent * self.value.abs();
        if scale > 0.0 {
            let [low, high] = self.ci95.map(|end| (end - self.value).abs());
            self.ci95 = [self.value - low.hypot(scale), self.value + high.hypot(scale)];
            self.source += &format!("; ± {percent} % of it by the {factor}");
        }
        self
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

/// What two ways tell of the same axis: of a parameter that both tell, the narrower interval; of one that neither
/// tells, what the first needs.
pub fn joined(first: &AxisFindings, second: Option<&AxisFindings>) -> AxisFindings {
    let mut all = first.clone();
    let width = |finding: &Finding| finding.estimate().map(|e| e.ci95[1] - e.ci95[0]);
    for (name, other) in second.into_iter().flatten() {
        let is_better = match (all.get(name), width(other)) {
            (None, _) => true,
            (Some(_), None) => false,
            (Some(kept), Some(narrow)) => width(kept).is_none_or(|wide| narrow < wide),
        };
        if is_better {
            all.insert(name.clone(), other.clone());
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_findings_the_surer_one_is_kept() {
        let some = |half: f64| Finding::from(Estimate::within(5.0, half, "kg", "a test"));
        let findings = |list: [(&str, Finding); 3]| -> AxisFindings {
            list.into_iter().map(|(name, finding)| (name.to_owned(), finding)).collect()
        };
        let first = findings([("a", some(1.0)), ("b", Finding::unknown("x")), ("c", Finding::unknown("x"))]);
        let second = findings([("a", some(0.5)), ("b", some(2.0)), ("c", Finding::unknown("y"))]);
        let all = findings([("a", some(0.5)), ("b", some(2.0)), ("c", Finding::unknown("x"))]);
        assert_eq!(joined(&first, Some(&second)), all);
        assert_eq!(joined(&second, Some(&first))["a"], some(0.5));
        assert_eq!(joined(&first, None), first);
    }
}
