//! From values to places on the sheet, with ticks at round numbers (1, 2 or 5 times a power of ten).
//!
//! Invariant: a scale is never empty, and its ticks lie inside it.

/// A straight scale between values and places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    values: [f64; 2],
    places: [f64; 2],
}

impl Scale {
    /// From a range of values to a range of places; an empty range of values is widened to 1.
    pub fn new(values: [f64; 2], places: [f64; 2]) -> Self {
        let [low, high] = values;
        let values = if high > low { values } else { [low - 0.5, low + 0.5] };
        Self { values, places }
    }
    /// Where a value lies.
    pub fn place(&self, value: f64) -> f64 {
        let share = (value - self.values[0]) / (self.values[1] - self.values[0]);
        self.places[0] + share * (self.places[1] - self.places[0])
    }
    /// Places for one unit of value.
    pub fn places_per_unit(&self) -> f64 {
        (self.places[1] - self.places[0]) / (self.values[1] - self.values[0])
    }
    /// The values at its ends.
    pub const fn values(&self) -> [f64; 2] {
        self.values
    }
    /// The places at its ends.
    pub const fn places(&self) -> [f64; 2] {
        self.places
    }
    /// Round values inside the scale, about `count` of them.
    pub fn ticks(&self, count: usize) -> Ticks {
        let step = round_step((self.values[1] - self.values[0]) / count.max(1) as f64);
        let slack = 1e-9 * step;
        let (first, last) = ((self.values[0] - slack) / step, (self.values[1] + slack) / step);
        let values = (first.ceil() as i64..=last.floor() as i64).map(|tick| tick as f64 * step).collect();
        Ticks { step, values }
    }
}

/// Round values at an even distance.
#[derive(Clone, Debug, PartialEq)]
pub struct Ticks {
    /// Distance.
    pub step: f64,
    /// In rising order.
    pub values: Vec<f64>,
}

impl Ticks {
    /// A value with as many decimals as the step needs, and a real minus sign.
    pub fn label(&self, value: f64) -> String {
        let decimals = (-self.step.log10().floor()).max(0.0) as usize;
        signed(value, decimals)
    }
}

/// A number with a real minus sign, and no minus before zero.
pub fn signed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.chars().all(|digit| matches!(digit, '-' | '0' | '.'));
    if is_zero { text.replace('-', "") } else { text.replace('-', "−") }
}

/// The smallest round step that is not below `rough`.
pub fn round_step(rough: f64) -> f64 {
    let decade = 10_f64.powf(rough.log10().floor());
    let steps = [1.0, 2.0, 5.0].map(|digit| digit * decade);
    steps.into_iter().find(|step| *step >= rough * (1.0 - 1e-9)).unwrap_or(10.0 * decade)
}

/// Least and greatest finite value, with some air around; zero to one if there is none.
pub fn range(values: impl Iterator<Item = f64>, air: f64) -> [f64; 2] {
    let finite = values.filter(|value| value.is_finite());
    let [low, high] =
        finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
    if low > high {
        return [0.0, 1.0];
    }
    let margin = air * (high - low);
    [low - margin, high + margin]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let ticks = Scale::new([-31.0, 12.0], [0.0, 100.0]).ticks(5);
        assert_eq!(ticks.values, [-30.0, -20.0, -10.0, 0.0, 10.0]);
        assert_eq!(ticks.label(-30.0), "−30");
        let fine = Scale::new([0.0, 0.7], [0.0, 100.0]).ticks(4);
        assert_eq!(
            fine.values.iter().map(|tick| fine.label(*tick)).collect::<Vec<_>>(),
            ["0.0", "0.2", "0.4", "0.6"]
        );
    }

    #[test]
    fn a_constant_still_has_a_scale() {
        let scale = Scale::new([3.0, 3.0], [0.0, 10.0]);
        assert_eq!(scale.place(3.0), 5.0);
        assert_eq!(signed(-0.04, 1), "0.0");
    }
}
