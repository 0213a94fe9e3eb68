//! A plan in the making: each experiment as long, as fast and as strong as travel and limits allow.
//!
//! Invariant: the place of each axis is known after each step, so that the next begins where this one ends.

use std::f64::consts::PI;

use super::{Plan, Planned, Purpose};
use crate::base::axis::{AXES_MAX, AxisId};
use crate::base::order::Excitation;
use crate::base::time::Span;
use crate::base::units::{Acceleration, Position, Velocity};
use crate::config::Machine;
use crate::config::machine::AXIS_NAMES;
use crate::rt::control::profile::line_duration_s;
use crate::rt::cycle::procedure::{Step, Way};

/// Speeds of steady runs, mm/s: below a millimetre per second the fall of friction, above it the sliding.
const LADDER_MM_PER_S: [f64; 19] = [
    0.02, 0.05, 0.08, 0.12, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 33.0, 60.0, 100.0, 200.0,
];
/// Of the velocity limit: faster is not run.
const SPEED_SHARE: f64 = 0.8;
/// Of a limit of acceleration, torque or velocity that an experiment may use.
const LIMIT_SHARE: f64 = 0.6;
/// Time constants of the position loop until a speed is steady.
const SETTLING: f64 = 6.0;
/// Measured after that: a turn of the screw, within these bounds, s.
const MEASURED_S: (f64, f64) = (1.5, 10.0);
/// Measured where a turn would take longer than that.
const CREEPING_S: f64 = 4.0;
/// Least that is worth a run.
const MEASURED_S_MIN: f64 = 0.3;
/// Break-away is tried at so many places, at this speed, for so long.
const BREAK_AWAY_PLACES: usize = 5;
const BREAK_AWAY_SPEED: Velocity = Velocity::mm_per_s(0.05);
const BREAK_AWAY_S: f64 = 3.0;
/// Rest before a creep, so that what swings has died away.
const REST_S: f64 = 0.3;
/// Runs to and fro for the inertia.
const INERTIA_RUNS: usize = 6;
const INERTIA_SPEED: Velocity = Velocity::mm_per_s(200.0);
const INERTIA_STEADY_S: f64 = 0.3;
/// Excitation: slow feed in mm/s, lowest and highest frequency in Hz, lines, repeats.
const EXCITED_FEED: Velocity = Velocity::mm_per_s(20.0);
const EXCITED_FEED_MIN: Velocity = Velocity::mm_per_s(2.0);
/// Periods that a way should have room for: evaluated, and to come and go.
const EXCITED_PERIODS: f64 = 10.0;
const EXCITED_HZ: (f64, f64) = (4.0, 400.0);
const EXCITED_LINES: u8 = 24;
const EXCITED_REPEATS: (u32, u32) = (3, 12);

/// A plan in the making, and where the axes are by then.
pub(in crate::offline) struct Draft<'m> {
    pub(super) machine: &'m Machine,
    pub(in crate::offline) plan: Plan,
    pub(super) place: [Position; AXES_MAX],
}

impl<'m> Draft<'m> {
    /// Nothing yet, with every axis where it stands.
    pub(in crate::offline) const fn new(machine: &'m Machine, gain_set: u8) -> Self {
        let plan = Plan { gain_set, steps: Vec::new(), left_out: Vec::new() };
        Self { machine, plan, place: [Position::ZERO; AXES_MAX] }
    }

    /// Ends of the travel that is used: the margin that the limits leave for braking stays free.
    fn room(&self, axis: AxisId) -> (Position, Position) {
        let limits = &self.machine.axes[axis].control.limits;
        let span = limits.travel_max - limits.travel_min;
        let free = Position::m(limits.travel_margin.as_m().max(0.01 * span.as_m()));
        (limits.travel_min + free, limits.travel_max - free)
    }

    pub(super) fn centre(&self, axis: AxisId) -> Position {
        let (low, high) = self.room(axis);
        low + (high - low) / 2.0
    }

    pub(super) fn width(&self, axis: AxisId) -> Position {
        let (low, high) = self.room(axis);
        high - low
    }

    pub(super) fn speed_max(&self, axis: AxisId) -> Velocity {
        self.machine.axes[axis].control.limits.velocity * SPEED_SHARE
    }

    fn kp_per_s(&self, axis: AxisId) -> f64 {
        self.machine.gains(axis, self.plan.gain_set).position.gain_per_s
    }

    /// How long an axis takes from the end of its setpoint until it stands.
    pub(super) fn rest_s(&self, axis: AxisId, speed: Velocity) -> f64 {
        let standstill = self.machine.axes[axis].control.limits.standstill;
        (speed / standstill).max(1.0).ln() / self.kp_per_s(axis)
    }

    fn way(&self, axis: AxisId, to: Position, feed: Velocity, acceleration: Acceleration) -> Way {
        let mut target = [None; AXES_MAX];
        target[axis.index()] = Some(to);
        Way { target, feed, acceleration }
    }

    fn line(&mut self, axis: AxisId, to: Position, way: Way, step: Step, purpose: Purpose) {
        let distance = (to - self.place[axis.index()]).abs();
        let duration_s = line_duration_s(distance, way.feed, way.acceleration) + self.rest_s(axis, way.feed);
        self.place[axis.index()] = to;
        let axis = Some(axis);
        self.plan.steps.push(Planned { step, purpose, axis, way: distance, top_speed: way.feed, duration_s });
    }

    pub(super) fn run(
        &mut self,
        axis: AxisId,
        to: Position,
        feed: Velocity,
        steep: Acceleration,
        purpose: Purpose,
    ) {
        let way = self.way(axis, to, feed, steep);
        self.line(axis, to, way, Step::Line(way), purpose);
    }

    /// To a place, if the axis is not there.
    pub(in crate::offline) fn go(&mut self, axis: AxisId, to: Position) {
        if (to - self.place[axis.index()]).abs() > Position::um(1.0) {
            let motion = self.machine.motion;
            self.run(axis, to, motion.positioning_feed, motion.path_acceleration, Purpose::Positioning);
        }
    }

    fn rest(&mut self, axis: AxisId, purpose: Purpose) {
        let cycles = (REST_S / self.machine.cycle.period.as_s()).ceil() as u64;
        self.plan.steps.push(Planned {
            step: Step::Dwell { cycles },
            purpose,
            axis: Some(axis),
            way: Position::ZERO,
            top_speed: Velocity::ZERO,
            duration_s: REST_S,
        });
    }

    fn leave_out(&mut self, axis: AxisId, what: String) {
        self.plan.left_out.push(format!("axis {}: {what}", AXIS_NAMES[axis.index()]));
    }

    pub(super) fn of_axis(&mut self, axis: AxisId) {
        self.excited(axis);
        self.accelerate(axis, LIMIT_SHARE, INERTIA_RUNS);
        self.steady(axis, &LADDER_MM_PER_S);
        self.break_away(axis);
        self.go(axis, self.centre(axis));
    }

    /// A line each way under excitation, as strong and as long as limits and travel allow.
    fn excited(&mut self, axis: AxisId) {
        let (settings, period) = (self.machine.axes[axis].control, self.machine.cycle.period);
        let steep = self.machine.motion.path_acceleration;
        let second = period * (Span::ms(1_000) / period);
        let per_s = second.as_s();
        let width = self.width(axis);
        // Slower where the travel is short; whatever is excited must stay below the feed, so weaker too.
        let by_room = Velocity::m_per_s(width.as_m() / (per_s * EXCITED_PERIODS));
        let feed = EXCITED_FEED.clamp_abs(self.speed_max(axis) * 0.5).clamp_abs(by_room);
        let rate_hz = 1.0 / period.as_s();
        let mut excitation = Excitation {
            axis,
            amplitude: Velocity::mm_per_s(1.0),
            period: second,
            harmonic_min: (EXCITED_HZ.0 * per_s).round() as u32,
            harmonic_max: (EXCITED_HZ.1.min(0.2 * rate_hz) * per_s).round() as u32,
            lines: EXCITED_LINES,
            repeats: 1,
        };
        // Each bound for lines of 1 mm/s: so many mm/s of each line use it up. The table must go on sliding.
        let gains = self.machine.gains(axis, self.plan.gain_set).velocity;
        let mechanics = &settings.axis.mechanics;
        let push_nm = gains.proportional_nm_s_per_rad * excitation.velocity_max().as_m_per_s()
            / mechanics.travel_per_rad_m();
        let hold_nm = mechanics.torque_for_force(settings.axis.friction.breakaway).as_nm();
        let most_nm = settings.axis.actuator.torque(settings.limits.current).as_nm();
        let amplitude_mm_per_s = [
            settings.limits.acceleration / excitation.acceleration_max(),
            settings.limits.following_error / excitation.displacement_max(),
            (settings.limits.velocity - feed) / excitation.velocity_max(),
            feed / excitation.velocity_max(),
            (most_nm - hold_nm) / push_nm,
        ]
        .into_iter()
        .fold(f64::INFINITY, f64::min)
            * LIMIT_SHARE;
        // To the nearest that can be said in a log: thousandths.
        excitation.amplitude = Velocity::mm_per_s((amplitude_mm_per_s * 1e3).floor() * 1e-3);
        let ramps_m = PI * feed.as_m_per_s().powi(2) / (2.0 * steep.as_m_per_s2());
        let steady_s = (width.as_m() - ramps_m) / feed.as_m_per_s();
        let repeats = (steady_s / per_s).floor() - 3.0;
        if excitation.amplitude <= Velocity::ZERO
            || feed < EXCITED_FEED_MIN
            || repeats < f64::from(EXCITED_REPEATS.0)
        {
            let why = format!(
                "no frequency response: {} periods of {per_s} s at {} mm/s have room, {} are needed, with {} mm/s \
                 each line",
                repeats.max(0.0),
                feed.as_mm_per_s(),
                EXCITED_REPEATS.0,
                excitation.amplitude.as_mm_per_s()
            );
            return self.leave_out(axis, why);
        }
        excitation.repeats = (repeats as u32).min(EXCITED_REPEATS.1);
        // A thousandth more, so that the last tick of the steady part is no matter of rounding.
        let way_m = (excitation.duration().as_s() * feed.as_m_per_s()).mul_add(1.001, ramps_m);
        let start = self.centre(axis) - Position::m(0.5 * way_m);
        self.go(axis, start);
        for to in [start + Position::m(way_m), start] {
            let way = self.way(axis, to, feed, steep);
            self.line(axis, to, way, Step::Excited { way, excitation }, Purpose::FrequencyResponse);
        }
    }

    /// So many lines to and fro, as steep as this share of the limits of current and acceleration allows.
    pub(in crate::offline) fn accelerate(&mut self, axis: AxisId, share: f64, runs: usize) {
        let settings = self.machine.axes[axis].control;
        let (mechanics, limits) = (&settings.axis.mechanics, &settings.limits);
        let hold = mechanics.torque_for_force(settings.axis.friction.breakaway);
        let torque = settings.axis.actuator.torque(limits.current) * share - hold;
        let by_torque = mechanics.acceleration_by_torque(torque);
        let by_limit = limits.acceleration * share;
        let steep = if by_torque < by_limit { by_torque } else { by_limit };
        let feed = INERTIA_SPEED.clamp_abs(self.speed_max(axis));
        let steep_m_per_s2 = steep.as_m_per_s2();
        if steep_m_per_s2 <= 0.0 {
            let what =
                "no runs for the inertia: the current limit leaves no torque beside break-away".to_owned();
            return self.leave_out(axis, what);
        }
        // Ramps, a steady part, and no more than there is room for.
        let speed = feed.as_m_per_s();
        let wanted_m = PI * speed * speed / (2.0 * steep_m_per_s2) + speed * INERTIA_STEADY_S;
        let way = Position::m(wanted_m.min(self.width(axis).as_m()));
        let start = self.centre(axis) - way / 2.0;
        self.go(axis, start);
        for run in 0..runs {
            let to = if run % 2 == 0 { start + way } else { start };
            self.run(axis, to, feed, steep, Purpose::Inertia);
        }
    }

    /// To and fro at each speed of a ladder.
    pub(in crate::offline) fn steady(&mut self, axis: AxisId, ladder_mm_per_s: &[f64]) {
        let lead_m = self.machine.axes[axis].plant.mechanics.lead_m;
        let steep = self.machine.motion.path_acceleration;
        let width_m = self.width(axis).as_m();
        let fastest = self.speed_max(axis);
        for &mm_per_s in ladder_mm_per_s {
            let feed = Velocity::mm_per_s(mm_per_s);
            if feed > fastest {
                continue;
            }
            let speed = feed.as_m_per_s();
            let turn_s = lead_m / speed;
            let measured_s =
                if turn_s > MEASURED_S.1 { CREEPING_S } else { turn_s.clamp(MEASURED_S.0, MEASURED_S.1) };
            let settling_s = SETTLING / self.kp_per_s(axis);
            let ramps_m = PI * speed * speed / (2.0 * steep.as_m_per_s2());
            let room_s = (width_m - ramps_m) / speed - settling_s;
            if room_s < MEASURED_S_MIN {
                self.leave_out(
                    axis,
                    format!("no steady run at {mm_per_s} mm/s: the travel has no room for it"),
                );
                continue;
            }
            let way = Position::m(ramps_m + speed * (settling_s + measured_s.min(room_s)));
            let start = self.centre(axis) - way / 2.0;
            self.go(axis, start);
            self.run(axis, start + way, feed, steep, Purpose::SteadyFriction);
            self.run(axis, start, feed, steep, Purpose::SteadyFriction);
        }
    }

    /// Creep both ways, from rest, along the travel.
    fn break_away(&mut self, axis: AxisId) {
        let steep = self.machine.motion.path_acceleration;
        let (low, _) = self.room(axis);
        for place in 0..BREAK_AWAY_PLACES {
            let share = (place as f64 + 0.5) / BREAK_AWAY_PLACES as f64;
            let here = low + self.width(axis) * share;
            self.go(axis, here);
            let creep = Position::m(BREAK_AWAY_SPEED.as_m_per_s() * BREAK_AWAY_S);
            for to in [here + creep, here] {
                self.rest(axis, Purpose::BreakAway);
                self.run(axis, to, BREAK_AWAY_SPEED, steep, Purpose::BreakAway);
            }
        }
    }
}
