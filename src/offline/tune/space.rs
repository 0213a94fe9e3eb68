//! What may be chosen: gains, their ranges, and how they become coordinates of a search.
//!
//! Gains whose useful values span decades are searched by their logarithm, shares as they are.
//! Invariant: a coordinate at an end of its range is the bound itself, to the bit.

use serde::Serialize;

use crate::config::Machine;
use crate::config::machine::{Axis, Gains};
use crate::rt::control::{compensation, position};

/// A number of a gain set that may be varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// `V_p`.
    VP,
    /// `V_i`.
    VI,
    /// `K_p`, 1/s.
    Kp,
    /// Share of the friction law that is fed forward.
    Friction,
    /// Share of the inertia that is fed forward.
    Inertia,
}

impl Quantity {
    /// Key in a gain set of the machine file.
    pub const fn key(self) -> &'static str {
        match self {
            Self::VP => "v-p",
            Self::VI => "v-i",
            Self::Kp => "kp-per-s",
            Self::Friction => "friction-feed-forward",
            Self::Inertia => "inertia-feed-forward",
        }
    }

    const fn is_by_logarithm(self) -> bool {
        matches!(self, Self::VP | Self::VI | Self::Kp)
    }
}

/// One set of numbers for all axes, as they stand in a gain set.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Choice {
    /// `V_p`.
    pub v_p: f64,
    /// `V_i`.
    pub v_i: f64,
    /// `K_p`, 1/s.
    pub kp_per_s: f64,
    /// Share of the setpoint's velocity that is fed forward.
    pub velocity_feed_forward: f64,
    /// Share of the friction law that is fed forward.
    pub friction_feed_forward: f64,
    /// Share of the inertia that is fed forward.
    pub inertia_feed_forward: f64,
}

impl Choice {
    /// The numbers of a gain set, on the first axis.
    pub fn of_set(machine: &Machine, set: u8) -> Self {
        let axis = &machine.axes.as_slice()[0];
        let gains = &axis.control.gain_sets[usize::from(set)];
        let [v_p, v_i] = axis.velocity_form.pair(&gains.velocity);
        Self {
            v_p,
            v_i,
            kp_per_s: gains.position.gain_per_s,
            velocity_feed_forward: gains.position.velocity_feed_forward,
            friction_feed_forward: gains.compensation.friction,
            inertia_feed_forward: gains.compensation.inertia,
        }
        .rounded()
    }

    /// The gains of an axis.
    pub fn gains(&self, axis: &Axis) -> Gains {
        Gains {
            position: position::Gains {
                gain_per_s: self.kp_per_s,
                velocity_feed_forward: self.velocity_feed_forward,
            },
            velocity: axis.velocity_form.gains(self.v_p, self.v_i),
            compensation: compensation::Gains {
                friction: self.friction_feed_forward,
                inertia: self.inertia_feed_forward,
            },
        }
    }

    /// Key and value of each number, in the order of the machine file.
    pub const fn entries(&self) -> [(&'static str, f64); 6] {
        [
            ("kp-per-s", self.kp_per_s),
            ("v-p", self.v_p),
            ("v-i", self.v_i),
            ("velocity-feed-forward", self.velocity_feed_forward),
            ("friction-feed-forward", self.friction_feed_forward),
            ("inertia-feed-forward", self.inertia_feed_forward),
        ]
    }

    fn number(&mut self, quantity: Quantity) -> &mut f64 {
        match quantity {
            Quantity::VP => &mut self.v_p,
            Quantity::VI => &mut self.v_i,
            Quantity::Kp => &mut self.kp_per_s,
            Quantity::Friction => &mut self.friction_feed_forward,
            Quantity::Inertia => &mut self.inertia_feed_forward,
        }
    }

    /// The numbers with as many digits as a person keeps, six.
    pub fn rounded(mut self) -> Self {
        for quantity in [Quantity::VP, Quantity::VI, Quantity::Kp, Quantity::Friction, Quantity::Inertia] {
            let value = self.number(quantity);
            *value = six_digits(*value);
        }
        self
    }
}

/// Six significant digits.
fn six_digits(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

/// What a number may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Which number.
    pub quantity: Quantity,
    /// Least.
    pub low: f64,
    /// Greatest.
    pub high: f64,
}

/// Where is searched.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// The numbers that are not varied.
    pub fixed: Choice,
    /// The others.
    pub ranges: Vec<Range>,
}

impl Space {
    /// Ends of each coordinate.
    pub fn bounds(&self) -> Vec<[f64; 2]> {
        self.ranges.iter().map(|range| [range.coordinate(range.low), range.coordinate(range.high)]).collect()
    }

    /// The choice at a place.
    pub fn choice(&self, place: &[f64]) -> Choice {
        let mut choice = self.fixed;
        for (range, coordinate) in self.ranges.iter().zip(place) {
            *choice.number(range.quantity) = range.value(*coordinate);
        }
        choice
    }

    /// The place of a choice, or the nearest to it in the ranges.
    pub fn place(&self, mut choice: Choice) -> Vec<f64> {
        let place =
            |range: &Range| range.coordinate(choice.number(range.quantity).clamp(range.low, range.high));
        self.ranges.iter().map(place).collect()
    }

    /// The bounds that a choice is at, in words.
    pub fn active(&self, mut choice: Choice) -> Vec<String> {
        let mut words = Vec::new();
        for range in &self.ranges {
            let value = *choice.number(range.quantity);
            for (end, bound) in [("lower", range.low), ("upper", range.high)] {
                if (value - bound).abs() <= 1e-3 * bound.abs().max(1e-3) {
                    words.push(format!("{} at its {end} bound of {bound}", range.quantity.key()));
                }
            }
        }
        words
    }
}

impl Range {
    fn coordinate(&self, value: f64) -> f64 {
        if self.quantity.is_by_logarithm() { value.ln() } else { value }
    }

    fn value(&self, coordinate: f64) -> f64 {
        // The logarithm of a bound and back may be a bit beside it.
        if coordinate == self.coordinate(self.low) {
            self.low
        } else if coordinate == self.coordinate(self.high) {
            self.high
        } else if self.quantity.is_by_logarithm() {
            coordinate.exp().clamp(self.low, self.high)
        } else {
            coordinate
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;
    use crate::config;

    #[test]
    fn a_gain_set_becomes_a_choice_and_the_same_gains_again() {
        let machine = config::load("reference").unwrap();
        for set in 0..2 {
            let choice = Choice::of_set(&machine, set);
            let [given, again] = [*machine.gains(AxisId::X, set), choice.gains(&machine.axes[AxisId::X])];
            assert_eq!(given.position, again.position);
            let off = given.velocity.damping(0.0064) / again.velocity.damping(0.0064) - 1.0;
            assert!(off.abs() < 1e-12, "set {set}: damping off by {off}");
        }
        assert_eq!((Choice::of_set(&machine, 1).v_p, Choice::of_set(&machine, 1).v_i), (99.522, 2.596));
    }

    #[test]
    fn a_bound_is_met_to_the_bit_and_named() {
        let machine = config::load("reference").unwrap();
        let ranges = vec![
            Range { quantity: Quantity::VP, low: 3.0, high: 100.0 },
            Range { quantity: Quantity::Friction, low: 0.0, high: 1.2 },
        ];
        let space = Space { fixed: Choice::of_set(&machine, 0), ranges };
        let ends = |end: usize| space.bounds().iter().map(|bound| bound[end]).collect::<Vec<_>>();
        let [low, high] = [space.choice(&ends(0)), space.choice(&ends(1))];
        assert_eq!((low.v_p, low.friction_feed_forward), (3.0, 0.0));
        assert_eq!((high.v_p, high.friction_feed_forward, high.v_i), (100.0, 1.2, 1.14));
        assert_eq!(
            space.active(high),
            ["v-p at its upper bound of 100", "friction-feed-forward at its upper bound of 1.2"]
        );
        let inside = space.choice(&space.place(space.fixed));
        assert!((inside.v_p - 100.0).abs() < 1e-9, "101.121 is held at the bound: {inside:?}");
    }
}
