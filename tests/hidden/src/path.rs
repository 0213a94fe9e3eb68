//! The runs of a case as setpoints of two axes: circles both ways, sweeps, micro-reversals, an acceleration run.
//!
//! Every run repeats itself at least twice, so that what does not repeat can be told from what does. All begin and
//! end at rest.
//! Invariant: a run's setpoints are a function of its description alone, one for each period.

use std::f64::consts::{PI, TAU};

use crate::controller::{PERIOD, Setpoint};

/// Along circles, m/s^2.
const PATH_ACCELERATION: f64 = 0.5;
/// Rest at the end of each leg, s.
const DWELL: f64 = 0.1;
/// Way on a circle ahead of its laps and after them, rad.
const LEAD_IN: f64 = 0.3 * PI;

/// What a run does.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion {
    /// A circle around the origin: radius m, feed m/s, counter-clockwise or not, laps.
    Circle {
        /// m.
        radius: f64,
        /// m/s.
        feed: f64,
        /// Counter-clockwise.
        is_ccw: bool,
        /// Whole turns.
        laps: u32,
    },
    /// There and back at each speed; the second axis goes through them from the last to the first.
    Sweep {
        /// m/s.
        speeds: Vec<f64>,
        /// How often all of it.
        laps: u32,
    },
    /// `(1 - cos)` of each amplitude; the second axis from the last to the first.
    MicroReversals {
        /// m from one reversal to the next.
        amplitudes: Vec<f64>,
        /// How often all of it.
        laps: u32,
    },
    /// There and back as fast as it goes: distance m, acceleration m/s^2, for each leg.
    Acceleration {
        /// m.
        distances: [f64; 2],
        /// m/s^2.
        accelerations: [f64; 2],
        /// How often all of it.
        laps: u32,
    },
}

/// A run of a case.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Name of its file, without its end.
    pub name: String,
    /// What it does.
    pub motion: Motion,
    /// Not for fitting.
    pub is_held_out: bool,
}

impl Run {
    /// Its setpoints, both axes at each period.
    pub fn setpoints(&self) -> Vec<[Setpoint; 2]> {
        match &self.motion {
            Motion::Circle { radius, feed, is_ccw, laps } => circle(*radius, *feed, *is_ccw, *laps),
            Motion::Sweep { speeds, laps } => {
                let forward: Vec<f64> = speeds.clone();
                let backward: Vec<f64> = speeds.iter().rev().copied().collect();
                let leg = |speed: &f64| there_and_back(sweep_distance(*speed), 2.0, *speed);
                both(&forward, &backward, *laps, leg)
            }
            Motion::MicroReversals { amplitudes, laps } => {
                let forward: Vec<f64> = amplitudes.clone();
                let backward: Vec<f64> = amplitudes.iter().rev().copied().collect();
                both(&forward, &backward, *laps, |amplitude| micro_reversal(*amplitude))
            }
            Motion::Acceleration { distances, accelerations, laps } => {
                let legs: Vec<[f64; 2]> =
                    vec![[distances[0], accelerations[0]], [distances[1], accelerations[1]]];
                let backward: Vec<[f64; 2]> = legs.iter().rev().copied().collect();
                both(&legs, &backward, *laps, |[distance, acceleration]| {
                    there_and_back(*distance, *acceleration, f64::INFINITY)
                })
            }
        }
    }
}

/// How far a sweep goes at a speed: for about half a second, but no further than this.
fn sweep_distance(speed: f64) -> f64 {
    (0.55 * speed).clamp(0.4e-3, 40e-3)
}

fn circle(radius: f64, feed: f64, is_ccw: bool, laps: u32) -> Vec<[Setpoint; 2]> {
    let whole = radius * (f64::from(laps) * TAU + 2.0 * LEAD_IN);
    let turn = if is_ccw { 1.0 } else { -1.0 };
    // The laps begin at the angle zero.
    let points = trapezoid(whole, PATH_ACCELERATION, feed).into_iter().map(|way| {
        let (sin, cos) = (turn * (way.place / radius - LEAD_IN)).sin_cos();
        let speed = turn * way.speed;
        [
            Setpoint { place: radius * cos, speed: -speed * sin },
            Setpoint { place: radius * sin, speed: speed * cos },
        ]
    });
    points.collect()
}

/// Each axis from a place to another, as soon as it can be there.
pub fn straight(from: [f64; 2], to: [f64; 2], [acceleration, speed]: [f64; 2]) -> Vec<[Setpoint; 2]> {
    let ways: [Vec<Setpoint>; 2] = std::array::from_fn(|axis| {
        let (way, turn) = ((to[axis] - from[axis]).abs(), (to[axis] - from[axis]).signum());
        if way == 0.0 {
            return Vec::new();
        }
        let place = |at: Setpoint| Setpoint { place: from[axis] + turn * at.place, speed: turn * at.speed };
        trapezoid(way, acceleration, speed).into_iter().map(place).collect()
    });
    let at = |axis: usize, n: usize| {
        ways[axis].get(n).copied().unwrap_or(Setpoint { place: to[axis], speed: 0.0 })
    };
    (0..ways[0].len().max(ways[1].len())).map(|n| [at(0, n), at(1, n)]).collect()
}

/// The legs of both axes, one axis after its own list, each padded with rest to the length of the other.
fn both<T>(first: &[T], second: &[T], laps: u32, leg: impl Fn(&T) -> Vec<Setpoint>) -> Vec<[Setpoint; 2]> {
    let mut lap = Vec::new();
    for (first, second) in first.iter().zip(second) {
        let (first, second) = (leg(first), leg(second));
        let count = first.len().max(second.len());
        let at = |leg: &[Setpoint], n: usize| {
            leg.get(n).copied().unwrap_or(Setpoint { speed: 0.0, ..leg[leg.len() - 1] })
        };
        lap.extend((0..count).map(|n| [at(&first, n), at(&second, n)]));
    }
    let count = lap.len() * laps as usize;
    lap.into_iter().cycle().take(count).collect()
}

/// Forward around the origin and back, each with a rest behind it.
fn there_and_back(distance: f64, acceleration: f64, speed: f64) -> Vec<Setpoint> {
    let forward = trapezoid(distance, acceleration, speed);
    let rest = (DWELL / PERIOD) as usize;
    let mut points = forward.clone();
    points.extend(std::iter::repeat_n(Setpoint { place: distance, speed: 0.0 }, rest));
    points.extend(forward.iter().map(|at| Setpoint { place: distance - at.place, speed: -at.speed }));
    points.extend(std::iter::repeat_n(Setpoint::default(), rest));
    points
}

/// One up and down of a cosine; the longer the amplitude the longer it takes.
fn micro_reversal(amplitude: f64) -> Vec<Setpoint> {
    let seconds = 0.4 + 0.6 * (amplitude / 1e-3).sqrt().min(1.0);
    let count = (seconds / PERIOD) as usize;
    let omega = TAU / (count as f64 * PERIOD);
    let point = |n: usize| {
        let (sin, cos) = (omega * n as f64 * PERIOD).sin_cos();
        Setpoint { place: 0.5 * amplitude * (1.0 - cos), speed: 0.5 * amplitude * omega * sin }
    };
    (0..count).map(point).collect()
}

/// A way from rest to rest with a constant acceleration and at most this speed.
fn trapezoid(way: f64, acceleration: f64, speed: f64) -> Vec<Setpoint> {
    let speed = speed.min((way * acceleration).sqrt());
    let ramp = speed / acceleration;
    let cruise = way / speed - ramp;
    let whole = 2.0 * ramp + cruise;
    let count = (whole / PERIOD).ceil() as usize;
    let point = |n: usize| {
        let t = (n as f64 * PERIOD).min(whole);
        if t < ramp {
            Setpoint { place: 0.5 * acceleration * t * t, speed: acceleration * t }
        } else if t < ramp + cruise {
            Setpoint { place: speed * (t - 0.5 * ramp), speed }
        } else {
            let left = whole - t;
            Setpoint { place: way - 0.5 * acceleration * left * left, speed: acceleration * left }
        }
    };
    (0..=count).map(point).collect()
}
