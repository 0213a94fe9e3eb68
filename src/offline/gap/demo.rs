//! A machine with an effect that its machine file does not know of, and the runs that show it.
//!
//! Mass, friction and stiffness of every axis are off too, as those of a machine file are: what is found must not be
//! one of them.
//! Invariant: the same seed gives the same machine.

use crate::base::axis::AxisId;
use crate::base::units::Current;
use crate::config::Machine;
use crate::offline::tune::spread::Spread;
use crate::plant::effects::{Entry, Values};

/// By how much of itself a base parameter is off, at most.
const OFF: f64 = 0.1;
/// Noise of the current sensors.
const NOISE: Current = Current::a(0.02);

/// What is hidden.
#[derive(Clone, Copy, Debug)]
pub struct Hidden {
    /// In which axis.
    pub axis: AxisId,
    /// Which effect.
    pub entry: &'static Entry,
    /// How much of it.
    pub values: Values,
    /// What else is off has this seed.
    pub seed: u64,
}

impl Hidden {
    /// The machine that stands behind the boards.
    pub fn machine(&self, known: &Machine) -> Machine {
        let mut machine = known.clone();
        for (seed, (id, axis)) in (self.seed..).zip(machine.axes.iter_mut()) {
            let others = Spread::Random { share: OFF, plants: 1, seed }.plants(&axis.plant);
            axis.plant = others.first().copied().unwrap_or(axis.plant);
            axis.current_noise = NOISE;
            if id == self.axis {
                axis.plant = axis.plant.with_effect(self.entry, self.values);
            }
        }
        machine
    }
}
