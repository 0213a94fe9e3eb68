//! From which amplitude an effect would have been seen.
//!
//! Invariant: beyond what such an effect may be there is no amplitude.

use nalgebra::DMatrix;

use crate::offline::gap::model::little::least_with_a_name;
use crate::offline::gap::model::usual::is_usual;
use crate::offline::gap::model::{Model, Tried};
use crate::plant::effects::{Entry, Parameter};

/// Standard deviations of noise that an effect must be, beyond what the base makes up for, to be seen: half of those that
/// were 8 to 15 of them were named.
const SEEN: f64 = 12.0;

/// The smallest amplitude of an effect that would have been seen, by its first parameter, its other values as usual; nothing
/// where it would be none of such an effect any more: these runs do not show it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smallest {
    /// Of which effect.
    pub name: &'static str,
    /// Its amplitude, with the unit.
    pub key: &'static str,
    /// How much.
    pub amplitude: Option<f64>,
}

impl Smallest {
    /// Where one standard deviation of the first parameter is so many of its priors.
    pub(in crate::offline::gap) fn of(entry: &'static Entry, deviation: f64) -> Self {
        let Parameter { key, prior, bounds: [low, high], .. } = entry.parameters[0];
        let amplitude = SEEN * deviation * prior;
        let may_be = amplitude <= high.max(-low);
        Self { name: entry.name, key, amplitude: may_be.then_some(amplitude) }
    }

    /// The same by so many times as many rows, and as much as has a name.
    pub(super) fn by_passes(self, passes: f64) -> Self {
        let of_all = |amplitude: f64| (amplitude / passes.sqrt()).max(least_with_a_name(self.name));
        Self { amplitude: self.amplitude.map(of_all), ..self }
    }
}

/// Of the effects that every model has: as far as all else tells them.
pub(super) fn of_usual(model: &Model, covariance: &DMatrix<f64>) -> Vec<Smallest> {
    let of = |(place, tried): (usize, &Tried)| {
        let at = model.first_coordinate(place);
        is_usual(tried.entry).then(|| Smallest::of(tried.entry, covariance[(at, at)].sqrt()))
    };
    model.effects.iter().enumerate().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::effects::entry;

    #[test]
    fn what_has_no_name_would_not_have_been_seen() {
        let seen = |name: &str, amplitude: f64| {
            let one = Smallest::of(entry(name).expect("an effect"), 1.0);
            Smallest { amplitude: Some(amplitude), ..one }.by_passes(4.0).amplitude.expect("an amplitude")
        };
        assert_eq!(seen("presliding", 0.004), 0.2);
        assert_eq!(seen("presliding", 4.0), 2.0);
        assert_eq!(seen("backlash", 0.004), 0.002);
    }
}
