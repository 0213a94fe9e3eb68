//! One number of an effect: its key in the machine file, its bounds, what is believed of it, and how far it may be moved at once.
//!
//! Values are in the unit of the key's last part. Invariant: a step that is small by [`Parameter::small_step`] leaves what swings in step.

/// One number of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// As in the machine file.
    pub key: &'static str,
    /// Of the value, as the key abbreviates it.
    pub unit: &'static str,
    /// Least value and greatest that make sense.
    pub bounds: [f64; 2],
    /// A usual value, with which the effect is plain to see.
    pub nominal: f64,
    /// Standard deviation among machines: what is believed before there are data.
    pub prior: f64,
    /// Whether the effect is there by this value alone, as it is by the first.
    pub is_amplitude: bool,
    /// Whether a parameter of the base model stands for it alone, so that it tells nothing of whether the effect is
    /// there.
    pub is_of_base: bool,
    /// Whether a machine has whole numbers of it only.
    pub is_whole: bool,
    /// What is less is how two models of the same machine differ, and no effect.
    pub least: f64,
    /// Over what the effect swings, where the value says how often.
    swings_over: Option<Swing>,
}

/// Over what something swings.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Swing {
    /// Time; the value is a frequency in Hz.
    Time,
    /// The angle of the motor; the value is a number of periods per turn.
    Angle,
    /// The way; the value is a period in this unit, m.
    Way(f64),
}

/// Share of a period by which a small step moves what swings, at the end of a usual session, s, travel in turns, or
/// travel, m.
const SMALL_STEP: f64 = 0.03;
const USUAL: (f64, f64, f64) = (100.0, 10.0, 0.1);
/// Share of a time constant or a width by which a small step moves it: these may be anything over decades.
const SMALL_SHARE: f64 = 0.1;

impl Parameter {
    /// Where on a period the axis starts.
    pub(super) const PHASE: Self = Self::new("phase-deg", "deg", [-360.0, 360.0], 0.0, 180.0);

    /// A parameter.
    pub(super) const fn new(
        key: &'static str,
        unit: &'static str,
        bounds: [f64; 2],
        nominal: f64,
        prior: f64,
    ) -> Self {
        Self {
            key,
            unit,
            bounds,
            nominal,
            prior,
            is_amplitude: false,
            is_of_base: false,
            is_whole: false,
            least: 0.0,
            swings_over: None,
        }
    }

    /// The same of what a parameter of the base model stands for.
    pub(super) const fn of_base(mut self) -> Self {
        self.is_of_base = true;
        self
    }

    /// The same of which less than that is no effect.
    pub(super) const fn at_least(mut self, least: f64) -> Self {
        self.least = least;
        self
    }

    /// The same of what comes in whole numbers only.
    pub(super) const fn whole(mut self) -> Self {
        self.is_whole = true;
        self
    }

    /// The same of a frequency.
    pub(super) const fn in_time(mut self) -> Self {
        self.swings_over = Some(Swing::Time);
        self
    }

    /// The same of periods per turn.
    pub(super) const fn per_turn(mut self) -> Self {
        self.swings_over = Some(Swing::Angle);
        self
    }

    /// The same of a period along the way, in this unit, m.
    pub(super) const fn along(mut self, unit_m: f64) -> Self {
        self.swings_over = Some(Swing::Way(unit_m));
        self
    }

    /// A step from a value that leaves what swings in step, and what cannot be nothing as large as it is, in its unit; any is small
    /// enough elsewhere.
    pub fn small_step(&self, value: f64) -> f64 {
        let (session_s, turns, travel_m) = USUAL;
        match self.swings_over {
            None if self.bounds[0] > 0.0 => SMALL_SHARE * value,
            None => f64::INFINITY,
            Some(Swing::Time) => SMALL_STEP / session_s,
            Some(Swing::Angle) => SMALL_STEP / turns,
            // From x / p.
            Some(Swing::Way(unit_m)) => SMALL_STEP * value * value * unit_m / travel_m,
        }
    }

    /// The same as an amplitude beside the first.
    pub(super) const fn amplitude(mut self) -> Self {
        self.is_amplitude = true;
        self
    }

    /// Whether its bounds are no limit: an angle goes on at its other end, and at that of an exponent a law has its limit.
    pub fn is_open(&self) -> bool {
        self.unit == "deg" || self.key == "exponent"
    }

    /// Whether it says how large or how long something is, and not what counting tells: where it is, or how often it comes.
    pub fn is_size(&self) -> bool {
        self.swings_over.is_none() && !["deg", "mm"].contains(&self.unit)
    }
}

#[cfg(test)]
mod tests {
    use super::super::entry;

    #[test]
    fn a_small_step_of_what_swings_leaves_it_in_step() {
        // Periods in a session, a travel in turns, a travel.
        type Periods = fn(f64) -> f64;
        let cases: [(&str, usize, f64, Periods); 4] = [
            ("torque-disturbance", 1, 49.0, |hz| 100.0 * hz),
            ("motor-cogging", 1, 24.0, |per_turn| 10.0 * per_turn),
            ("encoder-interpolation", 1, 4.9, |period_um| 1e5 / period_um),
            ("pitch-error", 1, 10.0, |period_mm| 1e2 / period_mm),
        ];
        for (name, place, value, periods) in cases {
            let parameter = entry(name).expect("an effect").parameters[place];
            let moved = (periods(value + parameter.small_step(value)) - periods(value)).abs();
            assert!((0.02..=0.03 + 1e-9).contains(&moved), "{name}: {moved} of a period");
        }
        let mass = entry("resonance").expect("an effect").parameters[0];
        assert!(mass.small_step(10.0).is_infinite());
    }

    #[test]
    fn a_small_step_of_a_time_constant_is_a_share_of_it() {
        let constant = entry("friction-warm-up").expect("an effect").parameters[1];
        assert_eq!(constant.small_step(40.0), 4.0);
        assert_eq!(constant.small_step(3600.0), 360.0);
    }
}
