//! How loud a signal is on the rows of a part, rms in its unit: its noise, and what a model leaves of it.
//!
//! Invariant: rows count as much as is not left to chance, the same for both.

use super::Model;
use super::data::Part;
use super::problem::{Problem, SIGNALS};

impl Problem<'_> {
    /// Noise of a signal on the rows of a part, rms in its unit: that of usual rows, or where the part is louder as much more. Rows count as
    /// much as is not left to chance.
    pub fn floor(&self, signal: usize, part: Part) -> Option<f64> {
        let noise = self.noises[signal].as_ref()?;
        let (mut sum, mut weights) = (0.0, 0.0);
        for (place, data) in self.data.iter().enumerate() {
            let rows = data.powers(signal).zip(self.told(place, signal)).zip(data.rows(part));
            for (([power, _], told), _) in rows.filter(|(_, counts)| **counts) {
                sum += told * power;
                weights += told;
            }
        }
        let louder = (sum / f64::max(weights, f64::MIN_POSITIVE)).sqrt() / noise.usual;
        Some(noise.rms * louder.max(1.0))
    }

    /// What a model leaves of each signal on the rows of a part, rms in its unit, where rows count as much.
    pub(in crate::offline::gap) fn rms_left(&self, model: &Model, part: Part) -> [f64; SIGNALS.len()] {
        let (mut sums, mut weights) = ([0.0; SIGNALS.len()], [0.0; SIGNALS.len()]);
        for place in self.places(part) {
            let simulated = self.simulated(place, model);
            for signal in 0..SIGNALS.len() {
                let left = self.left(place, &simulated, signal, part);
                for ((value, told), counts) in
                    left.iter().zip(self.told(place, signal)).zip(self.data[place].rows(part))
                {
                    if *counts {
                        sums[signal] += told * value * value;
                        weights[signal] += told;
                    }
                }
            }
        }
        std::array::from_fn(|signal| (sums[signal] / f64::max(weights[signal], f64::MIN_POSITIVE)).sqrt())
    }
}
