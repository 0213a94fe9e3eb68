//! One reversal of one axis on a circle, as the shipped loops and the plant make it: what tuning asks for
//! thousands of times.
//!
//! ```text
//!   settled circle ──► swap to the gains ──► settle ──► 0.35 s before ─ reversal ─ 0.35 s after
//! ```
//!
//! The run ([`ClosedAxis`]) begins on the orbit of the loop without friction ([`Loops::response`]). The other axis,
//! which runs at full feed, is left out.
//!
//! Height and dip are those of [`super::super::circle::protrusion`] in the direction of the radius, against the
//! orbit without friction in closed form. Times in seconds, places in metres, zero time at the reversal.
//! Invariant: pure function of machine, axis and gains; no formula of control or plant is repeated here.

use crate::base::command::Limits as Acted;
use crate::base::fault::Fault;
use crate::base::setpoint::Setpoint;
use crate::base::units::{Acceleration, Current, Position, Velocity};
use crate::config::Machine;
use crate::config::machine::{Axis, Gains};
use crate::offline::closed_axis::ClosedAxis;
use crate::offline::loops::Loops;
use crate::plant::{Plant, steady_force};

/// Looked at before and after the reversal; less where the quadrants pass faster.
const HALF_S: f64 = 0.35;
/// Before that, for what is left of the beginning to fade.
const SETTLE_S: f64 = 0.25;

/// What is asked of the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Path {
    /// Radius of the circle.
    pub radius: Position,
    /// Feed along it.
    pub feed: Velocity,
}

impl Path {
    /// Angular speed, rad/s.
    pub fn speed_rad_per_s(&self) -> f64 {
        self.feed.as_m_per_s() / self.radius.as_m()
    }

    /// The same circle at a share of the feed.
    pub fn at(&self, share: f64) -> Self {
        Self { feed: self.feed * share, ..*self }
    }
}

/// What became of a reversal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reversal {
    /// Farthest outside the orbit without friction, um.
    pub height_um: f64,
    /// Farthest inside it, um, negative.
    pub dip_um: f64,
    /// Largest current asked of the drive.
    pub current_max: Current,
    /// Limits that acted.
    pub limits: Acted,
    /// Why the cycle would have stopped the axis.
    pub fault: Option<Fault>,
}

impl Reversal {
    /// How far the axis leaves its orbit, on either side, um.
    pub fn deviation_um(&self) -> f64 {
        self.height_um.max(-self.dip_um)
    }
}

/// A reversal that is about to be run, with any gains.
#[derive(Clone, Debug)]
pub struct Window<'m> {
    machine: &'m Machine,
    axis: Axis,
    path: Path,
    /// The axis at the first of `turns`.
    sliding: Plant,
    /// Cosine and sine of the angle from the reversal, tick by tick.
    turns: Vec<[f64; 2]>,
    /// The first tick that is looked at.
    seen_from: usize,
}

impl<'m> Window<'m> {
    /// The reversal of an axis, whose plant need not be what its control believes, a share of a period of the
    /// position loop after one of its ticks.
    pub fn new(machine: &'m Machine, axis: &Axis, path: Path, phase: f64) -> Self {
        let (tick_s, speed) = (machine.cycle.period.as_s(), path.speed_rad_per_s());
        let quadrant_s = std::f64::consts::FRAC_PI_2 / speed;
        let half = (HALF_S.min(0.45 * quadrant_s) / tick_s).round() as usize;
        let settle = (SETTLE_S.min(0.45 * quadrant_s) / tick_s).round() as usize;
        let begin = phase * f64::from(machine.cycle.position_every) - (half + settle) as f64;
        let turn = |tick: usize| {
            let (sin, cos) = (speed * tick_s * (begin + tick as f64)).sin_cos();
            [cos, sin]
        };
        let turns: Vec<[f64; 2]> = (0..=2 * half + settle).map(turn).collect();
        // The orbit is smaller than the circle, by far less than matters for how the axis slides.
        let velocity = path.feed * -turns[0][1];
        let place = path.radius * turns[0][0];
        let sliding = Plant::sliding(&axis.plant, machine.cycle.period, velocity, place);
        Self { machine, axis: *axis, path, sliding, turns, seen_from: settle }
    }

    /// Run it.
    pub fn run(&self, gains: &Gains) -> Reversal {
        self.follow(gains, |_, _| ())
    }

    /// Run it; `see` is shown the time from the reversal, s, and the deviation from the orbit without friction
    /// in the direction of the radius, m, of each tick that is looked at.
    pub fn follow(&self, gains: &Gains, mut see: impl FnMut(f64, f64)) -> Reversal {
        let mut run = Run::begin(self, gains);
        let mut seen = Reversal {
            height_um: f64::NEG_INFINITY,
            dip_um: f64::INFINITY,
            current_max: Current::ZERO,
            limits: Acted::NONE,
            fault: None,
        };
        for tick in 0..self.turns.len() {
            let position = run.tick(tick);
            if tick < self.seen_from {
                continue;
            }
            let [cos, sin] = self.turns[tick];
            let deviation_m = (position.as_m() - run.orbit_m * cos) * cos;
            seen.height_um = seen.height_um.max(1e6 * deviation_m);
            seen.dip_um = seen.dip_um.min(1e6 * deviation_m);
            seen.limits = seen.limits.with(run.axis.limits());
            if run.axis.asked().abs() > seen.current_max {
                seen.current_max = run.axis.asked().abs();
            }
            seen.fault = seen.fault.or(run.axis.fault());
            see(sin.atan2(cos) / self.path.speed_rad_per_s(), deviation_m);
            if seen.fault.is_some() {
                break;
            }
        }
        seen
    }
}

/// The axis on its way round.
struct Run<'w> {
    window: &'w Window<'w>,
    axis: ClosedAxis<'w>,
    every: usize,
    /// Radius of the orbit without friction, and cosine and sine of how far it is behind the setpoint.
    orbit_m: f64,
    ahead: [f64; 2],
    setpoint: Setpoint,
}

impl<'w> Run<'w> {
    fn begin(window: &'w Window<'w>, gains: &Gains) -> Self {
        let Window { machine, axis, path, .. } = window;
        let response = Loops::with_gains(machine, axis, gains).response(path.speed_rad_per_s());
        let orbit_m = response.norm() * path.radius.as_m();
        let [cos, sin] = window.turns[0];
        let velocity = Velocity::m_per_s(-orbit_m * path.speed_rad_per_s() * sin);
        let real = steady_force(&axis.plant, velocity, path.radius * cos);

        // Without a true integrator a torque takes a speed error, and that a distance from the orbit.
        let torque = axis.plant.mechanics.torque_for_force(real);
        let kept_nm = torque.as_nm() * (1.0 - gains.compensation.friction);
        let droop_m_per_s =
            kept_nm / gains.velocity.gain_at_rest_nm_s_per_rad() * axis.plant.mechanics.travel_per_rad_m();
        let start = Position::m(orbit_m * cos - droop_m_per_s / gains.position.gain_per_s);
        Self {
            window,
            axis: ClosedAxis::sliding(axis, window.sliding.clone(), start, velocity, gains),
            every: machine.cycle.position_every as usize,
            orbit_m,
            ahead: [response.re / response.norm(), -response.im / response.norm()],
            setpoint: Setpoint::default(),
        }
    }

    /// One period; where the motor is at its SYNC.
    fn tick(&mut self, tick: usize) -> Position {
        let is_position_tick = tick.is_multiple_of(self.every);
        if is_position_tick {
            self.setpoint = self.setpoint(tick);
        }
        if tick > 0 {
            self.axis.pass();
        }
        self.axis.row(&self.setpoint, is_position_tick, None).position
    }

    fn setpoint(&self, tick: usize) -> Setpoint {
        let ([cos, sin], [ahead_cos, ahead_sin]) = (self.window.turns[tick], self.ahead);
        let (radius_m, speed) = (self.window.path.radius.as_m(), self.window.path.speed_rad_per_s());
        let across_m = radius_m * (cos * ahead_cos - sin * ahead_sin);
        let along_m = radius_m * (sin * ahead_cos + cos * ahead_sin);
        Setpoint {
            position: Position::m(across_m),
            velocity: Velocity::m_per_s(-along_m * speed),
            acceleration: Acceleration::m_per_s2(-across_m * speed * speed),
        }
    }
}
