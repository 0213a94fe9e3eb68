//! What is known of an effect before any data: its name, its parameters with their bounds, where to look for
//! it; and which effects an axis has.
//!
//! Keys are those of the machine file, with the unit in their last part; values are in that unit. The first
//! parameter is the amplitude: zero is an effect that is not there.
//! Invariant: names and keys are unique, and a value outside its bounds never gets past `config`.

use std::fmt;

use super::CATALOGUE;
use super::control::Otherwise;
use super::hooks::Action;
use super::parameter::Parameter;

/// Most parameters of an effect.
pub const VALUES_MAX: usize = 3;
/// Values of an effect in the order of its parameters; what is beyond them is zero.
pub type Values = [f64; VALUES_MAX];

/// What an effect depends on: the coordinate over which what it leaves unexplained has a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coordinate {
    /// Velocity.
    Velocity,
    /// Direction of the velocity.
    Direction,
    /// Position along the travel.
    Position,
    /// Angle of screw and motor.
    Angle,
    /// Position within a period of an encoder's signal.
    SignalPeriod,
    /// Way since the last reversal.
    WaySinceReversal,
    /// Time since the last reversal.
    TimeSinceReversal,
    /// Force of the screw.
    ScrewForce,
    /// Magnitude of the current.
    Current,
    /// Acceleration.
    Acceleration,
    /// Time since the start.
    Time,
    /// Frequency.
    Frequency,
    /// Position or force of another axis.
    OtherAxis,
}

impl fmt::Display for Coordinate {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Velocity => "velocity",
            Self::Direction => "direction",
            Self::Position => "position",
            Self::Angle => "angle of the screw",
            Self::SignalPeriod => "period of the encoder's signal",
            Self::WaySinceReversal => "way since the reversal",
            Self::TimeSinceReversal => "time since the reversal",
            Self::ScrewForce => "force of the screw",
            Self::Current => "current",
            Self::Acceleration => "acceleration",
            Self::Time => "time",
            Self::Frequency => "frequency",
            Self::OtherAxis => "the other axis",
        })
    }
}

/// What an axis must do for an effect to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Experiment {
    /// Circles both ways at two feeds or more.
    Circles,
    /// Constant velocities both ways, slow to fast.
    Sweep,
    /// Reversals after ways from micrometres to millimetres.
    SmallReversals,
    /// Strong accelerations.
    Accelerations,
    /// An excitation of many frequencies.
    Excitation,
    /// The same motion again and again, for an hour.
    Repetition,
}

impl fmt::Display for Experiment {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Circles => "circles both ways at two feeds",
            Self::Sweep => "constant velocities both ways",
            Self::SmallReversals => "small reversals",
            Self::Accelerations => "accelerations",
            Self::Excitation => "excitation",
            Self::Repetition => "repetition for an hour",
        })
    }
}

/// An effect as the catalogue has it.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// As in the machine file.
    pub name: &'static str,
    /// What it is, in a line.
    pub summary: &'static str,
    /// Its equation.
    pub equation: &'static str,
    /// Its numbers; the first is the amplitude.
    pub parameters: &'static [Parameter],
    /// Where what it leaves unexplained has a shape.
    pub coordinate: Coordinate,
    /// What shows it.
    pub experiment: Experiment,
    /// Effects that no data of ours tell from it.
    pub aliases: &'static [&'static str],
    /// The effect of which it is another law, and as which it is told.
    pub law_of: Option<&'static str>,
    /// How it takes part.
    pub(in crate::plant) action: Action,
}

impl Entry {
    /// As what it is told: laws of one effect are one.
    pub const fn effect(&self) -> &'static str {
        match self.law_of {
            Some(effect) => effect,
            None => self.name,
        }
    }

    /// Its usual values.
    pub fn nominal(&self) -> Values {
        let mut values = [0.0; VALUES_MAX];
        for (value, parameter) in values.iter_mut().zip(self.parameters) {
            *value = parameter.nominal;
        }
        values
    }

    /// Which of its parameters are amplitudes: where all of them are zero it is absent.
    pub fn amplitudes(&self) -> impl Iterator<Item = usize> {
        (0..self.parameters.len()).filter(|place| self.is_amplitude(*place))
    }

    /// How many of its parameters say something that no base parameters stand for.
    pub fn numbers(&self) -> usize {
        self.parameters.iter().filter(|parameter| !parameter.is_of_base).count()
    }

    /// Whether a parameter is one.
    pub const fn is_amplitude(&self, place: usize) -> bool {
        place == 0 || self.parameters[place].is_amplitude
    }

    /// Whether it does anything with these values.
    pub fn is_present(&self, values: &Values) -> bool {
        self.amplitudes().any(|place| values[place] != 0.0)
    }

    /// Whether it is of the control that moves the axis, and no matter of its plant.
    pub const fn is_of_control(&self) -> bool {
        matches!(self.action, Action::Control(_))
    }

    /// Whether it is of gains of the loops alone, whose equation no machine departs from.
    pub fn is_of_gains(&self) -> bool {
        let Action::Control(set) = self.action else { return false };
        let mut otherwise = Otherwise::NOTHING;
        set(&self.nominal(), &mut otherwise);
        let Otherwise { position_gain, velocity_gain, .. } = otherwise;
        otherwise == Otherwise { position_gain, velocity_gain, ..Otherwise::NOTHING }
    }

    /// Whether the scale at the table alone shows it.
    pub const fn is_of_table_scale(&self) -> bool {
        matches!(self.action, Action::TableScale(_))
    }

    /// Whether it is no more than another value of a parameter of the base model.
    pub const fn is_parameter(&self) -> bool {
        matches!(self.action, Action::Parameter(_))
    }

    /// Whether a step of the base model has room for it.
    pub(in crate::plant) const fn is_of_base(&self) -> bool {
        matches!(self.action, Action::Parameter(_) | Action::Push(_))
    }
}

/// The effect of a name.
pub fn entry(name: &str) -> Option<&'static Entry> {
    CATALOGUE.iter().find(|entry| entry.name == name)
}

/// The effects of an axis: the values of each entry of the catalogue, zeros where it is absent.
#[derive(Clone, Copy, PartialEq)]
pub struct Effects {
    values: [Values; CATALOGUE.len()],
}

impl Effects {
    /// An axis as the base model has it.
    pub const NONE: Self = Self { values: [[0.0; VALUES_MAX]; CATALOGUE.len()] };

    /// The effects that are there, with their values.
    pub fn present(&self) -> impl Iterator<Item = (&'static Entry, &Values)> {
        CATALOGUE.iter().zip(&self.values).filter(|(entry, values)| entry.is_present(values))
    }

    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        self.present().next().is_none()
    }

    /// The values of an effect; its first is zero where it is absent.
    pub fn of(&self, entry: &Entry) -> Values {
        let place = CATALOGUE.iter().position(|own| own.name == entry.name);
        place.map_or([0.0; VALUES_MAX], |place| self.values[place])
    }

    /// What the control that moves the axis does otherwise.
    pub(in crate::plant) fn otherwise(&self) -> Otherwise {
        let mut otherwise = Otherwise::NOTHING;
        for (entry, values) in self.present() {
            if let Action::Control(set) = entry.action {
                set(values, &mut otherwise);
            }
        }
        otherwise
    }

    /// Force on the table that is always the same, N.
    pub fn push_n(&self) -> f64 {
        let of = |(entry, values): (&Entry, &Values)| match entry.action {
            Action::Push(push_n) => push_n(values),
            _ => 0.0,
        };
        self.present().map(of).sum()
    }

    /// The same with other values of one effect, without what that is in the place of.
    #[must_use]
    pub(in crate::plant) fn with(mut self, entry: &Entry, values: Values) -> Self {
        for (own, kept) in CATALOGUE.iter().zip(&mut self.values) {
            if own.name == entry.name {
                *kept = values;
            } else if entry.is_present(&values) && entry.is_in_the_place_of(own) {
                *kept = [0.0; VALUES_MAX];
            }
        }
        self
    }

    /// The same without what rubs.
    #[must_use]
    pub(in crate::plant) fn without_friction(mut self) -> Self {
        for (entry, values) in CATALOGUE.iter().zip(&mut self.values) {
            if matches!(entry.action, Action::Friction(_) | Action::Bristles(_)) {
                *values = [0.0; VALUES_MAX];
            }
        }
        self
    }
}

impl fmt::Debug for Effects {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_map().entries(self.present().map(|(entry, values)| (entry.name, values))).finish()
    }
}
