//! What was found of an axis, parameter by parameter, in the words of the report.
//!
//! Units: those of the machine file. Invariant: nothing is found here; what is not known stands with what would tell it.

use super::super::fall::Falls;
use super::super::fall::search::{Search, Told};
use super::super::steady::Sliding;
use super::super::stretches::Stretches;
use super::super::{Estimate, Finding};
use super::{VALUES_MIN, Work, scatter, sizes};
use crate::plant::friction::Variant;

impl Work<'_> {
    /// The break-away force, and that of each way.
    pub(super) fn breakaway_findings(
        &self,
        values: &[f64],
        reversals: usize,
        fall: Option<&Search>,
        put: &mut impl FnMut(&str, Finding),
    ) {
        let is_of_ramps = self.stretches.ramps.len() >= VALUES_MIN;
        let (count, what) = if is_of_ramps { (values.len(), "ramps") } else { (reversals, "reversals") };
        // What all of the evidence tells beside the ramps, and what it leaves unsure of what is common to all of them.
        let all = scatter(&sizes(values)).map(|(mean, half)| match fall.and_then(Search::breakaway_n) {
            Some(Told { value, ci95: [low, high] }) => [value, 0.5 * (high - low), value - mean],
            None => [mean, half.hypot(self.coarse_n()), 0.0],
        });
        let needs = || Finding::unknown("at least 3 slow ramps from rest, or reversals in motion");
        let both = all.map(|[value, half_n, _]| {
            let source = match fall {
                Some(_) => format!("{count} {what}, and as the loops make them"),
                None => format!("{count} {what}"),
            };
            self.of_force(Estimate::within(value, half_n, "N", source)).into()
        });
        put("breakaway", both.unwrap_or_else(needs));
        let finding = |values: &[f64], offset_n: f64, source: String| {
            let ((mean, half), [_, common_n, more_n]) = (scatter(values)?, all?);
            let value = mean + more_n + offset_n;
            Some(self.of_force(Estimate::within(value, half.hypot(common_n), "N", source)).into())
        };
        for (name, way) in [("breakaway_forward", 1.0), ("breakaway_backward", -1.0)] {
            let of_way: Vec<f64> =
                values.iter().map(|value| value * way).filter(|value| is_of_ramps && *value > 0.0).collect();
            let source = format!("{} ramps, with the constant force of this way", of_way.len());
            let needs = || Finding::unknown("at least 3 slow ramps of this way from rest");
            put(name, finding(&of_way, way * self.offset_n, source).unwrap_or_else(needs));
        }
    }

    /// Sliding friction, that of each way, and what is constant.
    pub(super) fn sliding_findings(
        &self,
        sliding: Option<&Sliding>,
        fall: Option<&Search>,
        put: &mut impl FnMut(&str, Finding),
    ) {
        let Some(Sliding { at_rest_n, viscous_n_s_per_m, offset_n, of_way_n, count }) = sliding else {
            let needs = "runs at constant speeds of 1 mm/s and more, both ways, at least 4";
            for name in ["sliding", "sliding_forward", "sliding_backward", "viscous", "constant_force"] {
                put(name, Finding::unknown(needs));
            }
            return;
        };
        let source = || format!("{count} runs at constant speed");
        let sliding_n = self.model.friction.sliding.as_n();
        // The line goes through the end of the fall, which is not known to the last digit either.
        let end_m_per_s = match fall.and_then(Search::end_mm_per_s) {
            Some(Told { ci95: [low, high], .. }) => 0.5e-3 * (high - low),
            None => self.model.friction.fall_end.as_m_per_s(),
        };
        let rise_n = viscous_n_s_per_m[0] * end_m_per_s;
        put(
            "sliding",
            self.of_force(Estimate::within(sliding_n, at_rest_n[1].hypot(rise_n), "N", source())).into(),
        );
        for (name, [value, half]) in ["sliding_forward", "sliding_backward"].into_iter().zip(*of_way_n) {
            let value = sliding_n + value - at_rest_n[0];
            let source = format!("{}, with the constant force of this way", source());
            put(name, self.of_force(Estimate::within(value, half.hypot(rise_n), "N", source)).into());
        }
        let [m, half] = viscous_n_s_per_m.map(|value| 1e-3 * value);
        put("viscous", self.of_force(Estimate::within(m, half, "N s/mm", source())).into());
        let offset = format!("{}; a constant force, or friction that differs by direction", source());
        put("constant_force", self.of_force(Estimate::within(offset_n[0], offset_n[1], "N", offset)).into());
    }

    /// What was found of what, in one line.
    pub(super) fn summary(&self, falls: Option<&Falls>) -> String {
        let Stretches { steady, ramps, reversals, accelerations } = &self.stretches;
        let mut text = format!(
            "{} steady stretches, {} ramps, {} reversals, {} accelerations; {} rows left out",
            steady.len(),
            ramps.len(),
            reversals.len(),
            accelerations.len(),
            self.measured.left_out_rows
        );
        if let Some(falls) = falls {
            let best = falls.best();
            text += &format!(
                "; the model leaves {:.1} N of the mean forces in a reversal, {:.1} of what its uncertainty makes, and ",
                best.left_n(),
                best.misfit().sqrt(),
            );
            text += &match falls.odds() {
                Some(odds) => format!(
                    "reversals it has not seen are e^{odds:.0} times as probable with the nonlinear variant as with the \
                     linear one"
                ),
                None => "friction does not drop where it begins to fall".to_owned(),
            };
        }
        text
    }
}

/// What these methods do not tell.
pub(super) fn rest_findings(put: &mut impl FnMut(&str, Finding)) {
    let apart = "the same log with a second load of known mass: only their sum moves";
    put("mass", Finding::unknown(apart));
    put("motor_inertia", Finding::unknown(apart));
    put("damping", Finding::unknown("a frequency response around the resonance"));
}

/// The falling part.
pub(super) fn fall_findings(fall: Option<&Search>, reversals: usize, put: &mut impl FnMut(&str, Finding)) {
    let needs = match fall {
        None => {
            "at least 2 reversals in motion (500 mm/min), and runs and ramps that tell sliding and break-away force"
        }
        Some(fall) if !fall.is_explained() => {
            "reversals that friction of this law explains: these it does not"
        }
        Some(fall) if fall.is_of(Variant::Linear) => {
            "friction that falls as a parabola: this drops, and where it begins is where it ends"
        }
        Some(_) => {
            "reversals and ramps with less noise, or a finer encoder: with these many values are likely"
        }
    };
    let told = [
        ("fall_end", fall.and_then(Search::end_mm_per_s)),
        ("fall_start", fall.and_then(Search::start_mm_per_s)),
    ];
    for (name, told) in told {
        let source = format!("{reversals} reversals, simulated with what else was found");
        let finding = told.map_or_else(
            || Finding::unknown(needs),
            |Told { value, ci95 }| Estimate { value, ci95, unit: "mm/s", source }.into(),
        );
        put(name, finding);
    }
}
