//! Filters without delay, for data that are all there: forwards and backwards through the same filter.
//!
//! A fit compares torque with velocity and acceleration; whatever one of them goes through, all must.
//! Columns are extended by their point reflection at both ends, so that a filter starts on what it will see.
//! Invariant: no phase at any frequency; a constant and a ramp stay what they are.

use biquad::{Biquad, Coefficients, DirectForm2Transposed, ToHertz, Type};

/// Quality factors of the two sections of a Butterworth filter of fourth order.
const BUTTERWORTH_4: [f64; 2] = [0.541_196_100_146_197, 1.306_562_964_876_377];
/// A filter has forgotten its start after so many periods of its cut-off.
const MEMORY_PERIODS: f64 = 8.0;

/// A low-pass of fourth order, passed twice.
#[derive(Clone, Copy, Debug)]
pub struct LowPass {
    sections: [Coefficients<f64>; 2],
    memory_rows: usize,
}

impl LowPass {
    /// Cut-off and rate of the rows, Hz. `None` unless the cut-off is above zero and below half the rate.
    pub fn new(cutoff_hz: f64, rate_hz: f64) -> Option<Self> {
        if !(cutoff_hz > 0.0 && 2.0 * cutoff_hz < rate_hz) {
            return None;
        }
        let section = |q| Coefficients::from_params(Type::LowPass, rate_hz.hz(), cutoff_hz.hz(), q).ok();
        let [first, second] = BUTTERWORTH_4.map(section);
        let memory_rows = (MEMORY_PERIODS * rate_hz / cutoff_hz).ceil() as usize;
        Some(Self { sections: [first?, second?], memory_rows })
    }

    /// Rows at either end in which the extension can be felt.
    pub const fn memory_rows(&self) -> usize {
        self.memory_rows
    }

    /// A column without what is above the cut-off; the same length.
    pub fn smooth(&self, column: &[f64]) -> Vec<f64> {
        let (Some(first), Some(last)) = (column.first(), column.last()) else { return Vec::new() };
        let ahead = self.memory_rows.min(column.len() - 1);
        let before = column[1..=ahead].iter().rev().map(|value| 2.0 * first - value);
        let after = column.iter().rev().skip(1).take(ahead).map(|value| 2.0 * last - value);
        let mut extended: Vec<f64> = before.chain(column.iter().copied()).chain(after).collect();
        for _ in 0..2 {
            self.pass(&mut extended);
            extended.reverse();
        }
        extended[ahead..ahead + column.len()].to_vec()
    }

    /// Once, in order, from rest at the first value.
    fn pass(&self, column: &mut [f64]) {
        let Some(&start) = column.first() else { return };
        let mut sections = self.sections.map(DirectForm2Transposed::<f64>::new);
        for value in column {
            let mut through = *value - start;
            for section in &mut sections {
                through = section.run(through);
            }
            *value = through + start;
        }
    }
}

/// Central differences over a step; one-sided at the ends.
pub fn derivative(column: &[f64], step: f64) -> Vec<f64> {
    let last = column.len().saturating_sub(1);
    (0..column.len())
        .map(|row| {
            let (low, high) = (row.saturating_sub(1), (row + 1).min(last));
            (column[high] - column[low]) / (step * (high - low).max(1) as f64)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    const RATE_HZ: f64 = 1_000.0;

    fn wave(hz: f64) -> Vec<f64> {
        (0..2_000).map(|row| (TAU * hz * f64::from(row) / RATE_HZ).sin()).collect()
    }

    #[test]
    fn what_passes_is_not_moved_and_what_does_not_is_gone() {
        let low_pass = LowPass::new(100.0, RATE_HZ).expect("possible");
        let inner = |column: &[f64]| column[200..1_800].to_vec();
        let largest = |column: &[f64]| column.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        let difference =
            |a: &[f64], b: &[f64]| largest(&a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<_>>());
        let slow = wave(20.0);
        let kept = difference(&inner(&low_pass.smooth(&slow)), &inner(&slow));
        assert!(kept < 1e-5, "20 Hz changed by {kept}");
        // 1/2 at the cut-off: 1/sqrt 2 each way.
        let halved = largest(&inner(&low_pass.smooth(&wave(100.0)))) / largest(&inner(&wave(100.0)));
        assert!((halved - 0.5).abs() < 0.01, "{halved} at the cut-off");
        let gone = largest(&inner(&low_pass.smooth(&wave(400.0))));
        assert!(gone < 1e-4, "{gone} left of 400 Hz");
    }

    #[test]
    fn a_ramp_stays_a_ramp_to_its_ends() {
        let low_pass = LowPass::new(40.0, RATE_HZ).expect("possible");
        let ramp: Vec<f64> = (0..1_000).map(|row| 5.0 + 0.01 * f64::from(row)).collect();
        for (row, (smooth, value)) in low_pass.smooth(&ramp).iter().zip(&ramp).enumerate() {
            assert!((smooth - value).abs() < 1e-6, "row {row}: {smooth} for {value}");
        }
        let slopes = derivative(&ramp, 1.0 / RATE_HZ);
        assert!(slopes.iter().all(|slope| (slope - 10.0).abs() < 1e-9));
    }

    #[test]
    fn a_cut_off_above_half_the_rate_is_none() {
        assert!(LowPass::new(500.0, RATE_HZ).is_none() && LowPass::new(0.0, RATE_HZ).is_none());
        assert!(LowPass::new(f64::NAN, RATE_HZ).is_none());
        assert!(LowPass::new(100.0, RATE_HZ).expect("possible").smooth(&[]).is_empty());
        assert_eq!(LowPass::new(100.0, RATE_HZ).expect("possible").smooth(&[3.0]), [3.0]);
    }
}
