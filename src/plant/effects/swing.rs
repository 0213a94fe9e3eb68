//! What swings along a way, with its divisions done.
//!
//! ```text
//!   A sin(2π x / p + φ)
//! ```
//!
//! Invariant: no formula of an effect; each says of what it is a swing, and along which way.

use std::f64::consts::TAU;

use super::hooks::{Pace, Reading};

/// A swing, in the unit of its amplitude.
#[derive(Debug)]
pub(super) struct Swing {
    amplitude: f64,
    rad_per_m: f64,
    phase_rad: f64,
}

impl Swing {
    /// That comes again after a way, of a phase in degrees where the way is zero.
    pub(super) fn new(amplitude: f64, period_m: f64, phase_deg: f64) -> Self {
        Self { amplitude, rad_per_m: TAU / period_m, phase_rad: phase_deg.to_radians() }
    }

    /// At a place.
    pub(super) fn at(&self, place_m: f64) -> f64 {
        self.amplitude * libm::sin(place_m * self.rad_per_m + self.phase_rad)
    }

    /// How fast it changes at a speed, as a force.
    pub(super) fn pace(&self, m_per_s: f64) -> Pace {
        Pace::of_force(self.rad_per_m * m_per_s.abs() / TAU)
    }
}

/// Of a sensor, m.
impl Reading for Swing {
    fn error_m(&self, place_m: f64, _time_s: f64) -> f64 {
        self.at(place_m)
    }
}
