//! One reversal of one axis on a circle, as the shipped loops and the plant make it: what tuning asks for
//! thousands of times.
//!
//! ```text
//!   settled circle ──► swap to the gains ──► settle ──► 0.35 s before ─ reversal ─ 0.35 s after
//! ```
//!
//! The run begins on the orbit of the loop without friction ([`Loops::response`]), wound up and sliding, with
//! the torque of friction already in the integral: a friction feed-forward holds it for a tick, and the swap to
//! the gains in question gives it to the integral, as a swap of gains does in a real run. What is left of the
//! beginning fades while the axis settles. Encoder counts, rounding of the current, and when a command acts are
//! those of the board (`sim/board`); frames, logs and the other axis, which runs at full feed, are left out.
//!
//! Height and dip are those of [`super::super::circle::protrusion`] in the direction of the radius, against the
//! orbit without friction in closed form. Times in seconds, places in metres, zero time at the reversal.
//! Invariant: pure function of machine, axis and gains; no formula of control or plant is repeated here.

use crate::base::command::Limits as Acted;
use crate::base::fault::Fault;
use crate::base::sample::{Freshness, Sample};
use crate::base::setpoint::Setpoint;
use crate::base::time::Span;
use crate::base::units::{Acceleration, Current, Position, Velocity};
use crate::config::Machine;
use crate::config::machine::{Axis, Gains};
use crate::offline::loops::Loops;
use crate::plant::encoder::{Knot, Latch};
use crate::plant::friction::Law;
use crate::plant::{Plant, steady_force};
use crate::rt::control::{AxisLoop, Settings};
use crate::rt::drive::sheet::CommandApplies;
use crate::rt::drive::velocity::VelocityEstimator;

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
            seen.limits = seen.limits.with(run.limits);
            if run.asked.abs() > seen.current_max {
                seen.current_max = run.asked.abs();
            }
            seen.fault = seen.fault.or(run.fault);
            see(sin.atan2(cos) / self.path.speed_rad_per_s(), deviation_m);
            if seen.fault.is_some() {
                break;
            }
        }
        seen
    }
}

/// The axis on its way.
struct Run<'w> {
    window: &'w Window<'w>,
    axis: &'w Axis,
    loops: AxisLoop,
    plant: Plant,
    encoder: Latch,
    estimator: VelocityEstimator,
    /// Where the motor was at the first tick.
    start: Position,
    every: usize,
    /// Radius of the orbit without friction, and cosine and sine of how far it is behind the setpoint.
    orbit_m: f64,
    ahead: [f64; 2],
    setpoint: Setpoint,
    /// In force, and about to be with the next SYNC.
    acting: Current,
    waiting: Current,
    asked: Current,
    limits: Acted,
    fault: Option<Fault>,
}

/// Gain sets of a run: that of the beginning, and the one in question.
const BEGIN: u8 = 0;
const ASKED: u8 = 1;

impl<'w> Run<'w> {
    fn begin(window: &'w Window<'w>, gains: &Gains) -> Self {
        let Window { machine, axis, path, .. } = window;
        let period = machine.cycle.period;
        let response = Loops::with_gains(machine, axis, gains).response(path.speed_rad_per_s());
        let orbit_m = response.norm() * path.radius.as_m();
        let [cos, sin] = window.turns[0];
        let velocity = Velocity::m_per_s(-orbit_m * path.speed_rad_per_s() * sin);
        let real = steady_force(&axis.plant, velocity, path.radius * cos);
        let torque = axis.plant.mechanics.torque_for_force(real);

        // Without a true integrator a torque takes a speed error, and that a distance from the orbit.
        let kept_nm = torque.as_nm() * (1.0 - gains.compensation.friction);
        let droop_m_per_s =
            kept_nm / gains.velocity.gain_at_rest_nm_s_per_rad() * axis.plant.mechanics.travel_per_rad_m();
        let start = Position::m(orbit_m * cos - droop_m_per_s / gains.position.gain_per_s);

        let mut begin = *gains;
        let believed = Law::new(axis.control.axis.friction).sliding(velocity).as_n();
        begin.compensation.friction = if believed == 0.0 { 0.0 } else { real.as_n() / believed };
        let mut settings = Settings { gain_set_count: 2, ..axis.control };
        settings.gain_sets[usize::from(BEGIN)] = begin;
        settings.gain_sets[usize::from(ASKED)] = *gains;

        let mut estimator = VelocityEstimator::new(axis.velocity_estimate, period);
        let mut encoder = Latch::new(axis.feedback_latency, period);
        for back in (1..=3).rev() {
            let position = Position::m(velocity.as_m_per_s() * period.as_s() * -f64::from(back));
            encoder.feed(Knot { position, velocity });
            estimator.advance(start + position, 1);
        }
        encoder.feed(Knot { position: Position::ZERO, velocity });
        let current = axis.plant.actuator.current(torque);
        Self {
            window,
            axis,
            loops: AxisLoop::new(&settings),
            plant: window.sliding.clone().placed(start),
            encoder,
            estimator,
            start,
            every: machine.cycle.position_every as usize,
            orbit_m,
            ahead: [response.re / response.norm(), -response.im / response.norm()],
            setpoint: Setpoint::default(),
            acting: current,
            waiting: current,
            asked: current,
            limits: Acted::NONE,
            fault: None,
        }
    }

    /// One period; where the motor is at its SYNC.
    fn tick(&mut self, tick: usize) -> Position {
        if tick > 0 {
            self.plant.step(self.acting);
            let state = self.plant.state();
            self.encoder.feed(Knot { position: state.motor_position, velocity: state.motor_velocity });
            self.loops.pass(1);
        }
        if self.axis.sheet.command_applies == CommandApplies::OnNextSync {
            self.acting = self.waiting;
        }
        let sample = self.sample();
        let is_position_tick = tick.is_multiple_of(self.every);
        if is_position_tick {
            self.setpoint = self.setpoint(tick);
        }
        match tick {
            // The loops take over an axis that is on its way.
            0 => self.loops.follow(&sample),
            1 => self.loops.use_gains(ASKED, &self.setpoint, &sample),
            _ => self.fault = self.loops.violation(&sample),
        }
        let answer = self.loops.step(&self.setpoint, &sample, is_position_tick);
        let counts = self.axis.scale.current_counts(answer.current);
        self.asked = self.axis.scale.current(counts);
        self.limits = answer.limits;
        if answer.is_not_a_number {
            self.fault = Some(Fault::NotANumber);
        }
        match self.axis.sheet.command_applies {
            CommandApplies::OnReceipt => self.acting = self.asked,
            CommandApplies::OnNextSync => self.waiting = self.asked,
        }
        sample.position
    }

    fn sample(&mut self) -> Sample {
        let scale = &self.axis.scale;
        let place = self.encoder.position(Span::ZERO);
        let [shown, _] = self.plant.shown(place, place);
        let latched = scale.motor_counts(self.start + shown);
        let position = scale.motor_position(latched);
        Sample {
            freshness: Freshness::Fresh,
            position,
            velocity: self.estimator.advance(position, 1),
            current: scale.current(scale.current_counts(self.plant.state().current)),
            ..Sample::default()
        }
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
