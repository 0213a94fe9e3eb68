//! A machine with an effect that its machine file does not know of, and the circles that show it.
//!
//! Mass, friction and stiffness of every axis are off too, as those of a machine file are: what is found must not be
//! one of them.
//! Invariant: the same seed gives the same machine.

use crate::base::axis::AxisId;
use crate::base::motion::{Circle, Direction};
use crate::base::units::{Current, Position, Velocity};
use crate::config::Machine;
use crate::config::plan::CircleRequest;
use crate::offline::tune::spread::Spread;
use crate::plant::effects::{Entry, Values};

/// By how much of itself a base parameter is off, at most.
const OFF: f64 = 0.1;
/// Noise of the current sensors.
const NOISE: Current = Current::a(0.02);
/// Feeds, mm/min, with the names of their runs: that of the middle judges what the others were fitted to.
const FEEDS: [(&str, f64); 3] = [("slow", 1_000.0), ("heldout", 2_000.0), ("fast", 4_000.0)];
const RADIUS: Position = Position::mm(10.0);
/// The second shows how well the first repeats.
const TURNS: u32 = 2;

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

/// Circles both ways at three feeds, with the names of their runs.
pub fn circles(gains: &str) -> Vec<(&'static str, CircleRequest)> {
    let circle = |feed| Circle {
        centre_x: Position::ZERO,
        centre_y: Position::ZERO,
        radius: RADIUS,
        feed: Velocity::mm_per_min(feed),
        direction: Direction::Ccw,
        start_angle_rad: std::f64::consts::FRAC_PI_4,
        revolutions: TURNS,
    };
    let directions = vec![Direction::Ccw, Direction::Cw];
    FEEDS
        .map(|(name, feed)| {
            let request = CircleRequest {
                gains: gains.to_owned(),
                circle: circle(feed),
                directions: directions.clone(),
            };
            (name, request)
        })
        .to_vec()
}
