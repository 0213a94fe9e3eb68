//! A model that was fitted, with what it leaves and how sure its values are.
//!
//! Invariant: cost, total and covariance are of the model where it stands.

use nalgebra::DMatrix;

use crate::offline::gap::model::Model;
use crate::offline::gap::model::twin::BASE;
use crate::plant::effects::Parameter;

/// By what share of a size two formulations of the same effect differ, as a standard deviation: no size is surer than that,
/// however little noise there is.
const LAWS: f64 = 0.04;
/// Half a 95 % interval in standard deviations: a few runs tell them, so Student's quantile for six degrees of freedom.
const INTERVAL: f64 = 2.45;

/// A model with what it leaves.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The model.
    pub model: Model,
    /// Sum of `ρ` over the rows it was fitted to.
    pub cost: f64,
    /// The same with what is believed beforehand.
    pub total: f64,
    /// Covariance of the coordinates.
    pub covariance: DMatrix<f64>,
}

impl Fitted {
    /// How many of its standard deviations an amplitude is from zero, all others as they follow it but for those
    /// that say what it is an amplitude of; a base parameter follows as far as it reaches. None where that would turn its sign.
    pub fn deviations(&self, at: usize) -> f64 {
        let coordinates = self.model.coordinates();
        let mut known = self.covariance.clone();
        for of in self.model.shapes() {
            let variance = known[(of, of)];
            if of != at && variance > 0.0 {
                known -= known.column(of) * known.row(of) / variance;
            }
        }
        let covariance = |one: usize, other: usize| known[(one, other)];
        let (mut value, mut variance) = (coordinates[at], covariance(at, at));
        for (base, from) in self.model.base.iter().enumerate() {
            let wanted = from - coordinates[at] * covariance(base, at) / covariance(at, at);
            let held = BASE[base].within_reach(wanted);
            if held != wanted {
                let share = covariance(at, base) / covariance(base, base);
                value = coordinates[at] + share * (held - from);
                variance = covariance(at, at) - share * covariance(base, at);
            }
        }
        if value * coordinates[at] > 0.0 { value.abs() / variance.max(f64::MIN_POSITIVE).sqrt() } else { 0.0 }
    }

    /// Whether that is more than so many.
    pub fn is_surely_not_zero(&self, at: usize, deviations: f64) -> bool {
        self.deviations(at) > deviations
    }

    /// With the twin of its last effect in that one's place, if it has one, as far as its period is sure.
    pub(in crate::offline::gap) fn with_last_as_its_twin(&self) -> Option<Model> {
        let last = self.model.effects.len().checked_sub(1)?;
        let entry = self.model.effects[last].entry;
        let of = entry.parameters.iter().position(|parameter| parameter.key == "period-mm");
        let sigma_mm = of.map_or(0.0, |of| {
            let at = self.model.first_coordinate(last) + of;
            self.covariance[(at, at)].sqrt() * entry.parameters[of].prior
        });
        self.model.with_last_as_its_twin(INTERVAL * sigma_mm / (1e3 * self.model.nominal.mechanics.lead_m))
    }

    /// The same with its effects in another order: their places as they were.
    #[must_use]
    pub fn in_order(&self, places: &[usize]) -> Self {
        let effects = &self.model.effects;
        let of_effects = places.iter().flat_map(|place| {
            let first = self.model.first_coordinate(*place);
            first..first + effects[*place].entry.parameters.len()
        });
        let coordinates: Vec<usize> = (0..BASE.len()).chain(of_effects).collect();
        let covariance = self.covariance.select_rows(&coordinates).select_columns(&coordinates);
        let effects = places.iter().map(|place| effects[*place]).collect();
        Self { model: Model { effects, ..self.model.clone() }, covariance, ..*self }
    }

    /// Whether the effect of a place is at a bound, or so unsure of a size that its interval ends at the upper one.
    pub fn is_at_bound(&self, place: usize) -> bool {
        let intervals = self.effect(place);
        let mut sizes = intervals.iter().zip(self.model.effects[place].entry.parameters);
        let may_be_more = |((_, _, [_, high]), parameter): (&(_, _, [f64; 2]), &Parameter)| {
            parameter.is_size() && !parameter.is_open() && *high >= parameter.bounds[1]
        };
        self.model.is_at_bound(place) || sizes.any(may_be_more)
    }

    /// Key, value and 95 % interval of each parameter of the effect of a place in the list: of noise, and of what laws
    /// differ by.
    pub fn effect(&self, place: usize) -> Vec<(&'static str, f64, [f64; 2])> {
        let Some(tried) = self.model.effects.get(place) else { return Vec::new() };
        let first = self.model.first_coordinate(place);
        let of = |(place, (parameter, value)): (usize, (&Parameter, &f64))| {
            let of_laws = if parameter.is_size() { LAWS * value } else { 0.0 };
            let of_noise = self.covariance[(first + place, first + place)].sqrt() * parameter.prior;
            let sigma = of_noise.hypot(of_laws);
            let [low, high] = parameter.bounds;
            let interval = [value - INTERVAL * sigma, value + INTERVAL * sigma];
            (
                parameter.key,
                *value,
                interval.map(|end| if parameter.unit == "deg" { end } else { end.clamp(low, high) }),
            )
        };
        tried.entry.parameters.iter().zip(&tried.values).enumerate().map(of).collect()
    }
}
