//! The effects by name: which numbers each sets, how large it typically is, and what a machine file would say of it.
//!
//! An effect is a kind, an axis, a shape (orders, phases, times, drawn once) and an amplitude of which 1 is a strong
//! case of its kind on this plant. The amplitude is what severity turns.
//! Invariant: an amplitude of zero is the axis without the effect.

mod catalogue;
mod strange;

use rand::RngExt;
use serde_json::{Map, Value};

use crate::features::Features;
use crate::machine::{Machine, Random};
use crate::plant::Plant;

pub use catalogue::{Kind, NAMES};
pub use strange::Strangeness;

/// What kind of effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// One that has a name.
    Named(Kind),
    /// One that no catalogue has.
    Strange(Strangeness),
}

/// What is drawn once for an effect, each number used by the kinds that need it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Evenly from 0 to 1, for whatever a kind has to choose.
    pub choices: [f64; 4],
    /// rad.
    pub phase: f64,
    /// 1 or -1, for what can have either sign.
    pub sign: f64,
}

impl Shape {
    /// One of a list, by the choice of this number.
    fn pick<T: Copy>(&self, number: usize, list: &[T]) -> T {
        list[((self.choices[number] * list.len() as f64) as usize).min(list.len() - 1)]
    }

    /// Between two bounds, as likely in each octave, by the choice of this number.
    fn between(&self, number: usize, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.choices[number])
    }
}

/// An effect on an axis of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effect {
    /// Its kind.
    pub what: What,
    /// 0 for x, 1 for y.
    pub axis: usize,
    /// Its shape.
    pub shape: Shape,
    /// 1 is a strong case.
    pub amplitude: f64,
}

impl Effect {
    /// One of a kind with a random shape on a random axis.
    pub fn drawn(what: What, source: &mut Random) -> Self {
        let shape = Shape {
            choices: std::array::from_fn(|_| source.random_range(0.0..1.0)),
            phase: source.random_range(0.0..std::f64::consts::TAU),
            sign: if source.random_bool(0.5) { 1.0 } else { -1.0 },
        };
        Self { what, axis: source.random_range(0..2), shape, amplitude: 0.3 }
    }

    /// Its name.
    pub fn name(&self) -> &'static str {
        match self.what {
            What::Named(kind) => kind.name(),
            What::Strange(strangeness) => strangeness.name(),
        }
    }

    /// The largest amplitude that could still be met.
    pub fn amplitude_max(&self) -> f64 {
        match self.what {
            What::Named(kind) => kind.amplitude_max(),
            What::Strange(_) => 5.0,
        }
    }

    /// Whether it shows at the table scale alone.
    pub fn needs_table(&self) -> bool {
        match self.what {
            What::Named(kind) => kind.needs_table(&self.shape),
            What::Strange(strangeness) => strangeness == Strangeness::LooseHead,
        }
    }

    /// Sets its numbers among those of both axes, and says them as a machine file would.
    pub fn set(&self, machine: &Machine, features: &mut [Features; 2]) -> Map<String, Value> {
        let plant = &machine.axes[self.axis].plant;
        let mut keys = Keys(Map::new());
        match self.what {
            What::Named(kind) => {
                let own = &mut features[self.axis];
                kind.set(self.amplitude, &self.shape, plant, own, &mut keys);
            }
            What::Strange(strangeness) => {
                strangeness.set(self.amplitude, &self.shape, self.axis, plant, features, &mut keys);
            }
        }
        keys.0
    }
}

/// Features of a machine with these effects.
pub fn features_of(effects: &[Effect], machine: &Machine) -> [Features; 2] {
    let mut features = [Features::default(); 2];
    for effect in effects {
        effect.set(machine, &mut features);
    }
    features
}

/// Parameters as a machine file would name them.
pub struct Keys(Map<String, Value>);

impl Keys {
    /// A number with the unit in its key.
    fn add(&mut self, key: &str, value: f64) {
        self.0.insert(key.to_owned(), Value::from(value));
    }

    /// A choice.
    fn choose(&mut self, key: &str, value: &str) {
        self.0.insert(key.to_owned(), Value::from(value));
    }
}

/// Torque that the sliding friction asks of the motor, N m: the measure of what disturbs it.
fn friction_torque(plant: &Plant) -> f64 {
    plant.sliding * plant.torque_per_force()
}
