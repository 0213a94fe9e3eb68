//! An effect with the values that it is tried with, and those that change much the same.
//!
//! Invariant: values lie within the bounds of the catalogue.

use crate::plant::effects::{Entry, Parameter, Values, entry};

/// What swings with the table is damped by no more where it is begun once more, %.
pub(super) const LIGHT: f64 = 3.0;
/// An effect, another that changes much the same, or the same elsewhere, and the values of that one.
type Alike = (&'static str, &'static str, fn(&Values) -> Values);
const ALIKE: [Alike; 12] = [
    ("actuator-delay", "current-loop-lag", |values| [values[0], 0.0, 0.0]),
    // Short beside the lag of the loop itself, a filter before it is nearer to a delay than a loop that is slower.
    ("actuator-delay", "current-loop-lag-filter", |values| [values[0], 0.0, 0.0]),
    ("current-loop-lag", "actuator-delay", |values| [values[0], 0.0, 0.0]),
    ("current-loop-lag-filter", "actuator-delay", |values| [values[0], 0.0, 0.0]),
    // Half of what holds it is there after the same way.
    ("presliding", "presliding-with-memory", |values| [4.0 * values[0], 1.5, 0.0]),
    ("presliding-with-memory", "presliding", |values| [values[0] / 4.0, 0.0, 0.0]),
    // A zone that is all soft is play, from one of its ends to the other.
    ("soft-zone", "backlash", |values| [2e-2 * values[0] * values[1], 0.0, 0.0]),
    // As much play, in a zone as soft as usual.
    ("backlash", "soft-zone", |values| [60.0, values[0] / 1.2, 0.0]),
    // What has grown before anybody looks is a scale.
    ("thermal-growth", "scale-error", |values| [values[0], 0.0, 0.0]),
    // Which one a control has is told at the bottom alone.
    ("command-filter", "command-filter-by-rows", |values| *values),
    ("command-filter-by-rows", "command-filter", |values| *values),
    // It is looked for so damped that it reaches half way to the next frequency, and a few steps do not lead to how damped it is.
    ("resonance", "resonance", |[percent, hz, damping]| [*percent, *hz, damping.min(LIGHT)]),
];

/// An effect with the values it is tried with.
#[derive(Clone, Copy, Debug)]
pub struct Tried {
    /// Of the catalogue.
    pub entry: &'static Entry,
    /// Its values.
    pub values: Values,
}

impl Tried {
    /// Each effect that changes much the same, as large as it may be.
    pub(super) fn alike(&self) -> impl Iterator<Item = Self> {
        let Self { entry: Entry { name: of, .. }, values: own } = *self;
        ALIKE.iter().filter(move |(name, ..)| name == of).filter_map(move |(_, other, to)| {
            let (entry, mut values) = (entry(other)?, to(&own));
            for (value, Parameter { bounds: [low, high], .. }) in values.iter_mut().zip(entry.parameters) {
                *value = value.clamp(*low, *high);
            }
            let is_there = entry.name == *of && values == own;
            (!is_there).then_some(Self { entry, values })
        })
    }

    /// Half of it.
    pub(super) fn half(mut self) -> Self {
        self.entry.amplitudes().for_each(|place| self.values[place] *= 0.5);
        self
    }
}
