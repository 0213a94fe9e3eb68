//! Motions made in the cycle: hold, a straight move, a circle. A motion runs along a path; its speed
//! rises and falls as a raised cosine, so the acceleration has no step; a stop at any moment brakes along
//! the same path, from the speed it has (a stop while the speed rises does step the acceleration).
//!
//! ```text
//!   speed   ───────┐            v(t) = V (1 - cos(π t / T)) / 2,   T = π V / (2 a),   way V T / 2
//!          ╱        ╲
//!   ──────╯          ╰──────    run-up, steady part, run-out
//! ```
//!
//! A circle's steady part is run-in, evaluated turns, run-out; its angle is a function of time alone,
//! so nothing accumulates. In the steady part of a line one axis may be excited ([`super::excitation`]); a stop
//! takes the excitation back as it takes the speed back. Angles in radians, counter-clockwise from +X.
//! Invariant: position, velocity and acceleration of a setpoint are those of one curve.

use std::f64::consts::PI;

use crate::base::axis::{AxisId, PerAxis};
pub use crate::base::order::{CircleMotion, ExcitedMotion, LineMotion};
use crate::base::setpoint::Setpoint;
use crate::base::time::{Moment, Span};
use crate::base::units::{Acceleration, Position, Velocity};

use super::excitation::Signal;

impl CircleMotion {
    fn radius_m(&self) -> f64 {
        self.circle.radius.as_m()
    }
    fn rise_s(&self) -> f64 {
        rise_s(self.circle.feed.as_m_per_s(), self.acceleration)
    }
    /// Way along the path before the evaluated part, m.
    fn lead_in_m(&self) -> f64 {
        self.circle.feed.as_m_per_s() * (self.run_in_s + 0.5 * self.rise_s())
    }
    fn angle_rad(&self, way_m: f64) -> f64 {
        let ahead_rad = (way_m - self.lead_in_m()) / self.radius_m();
        self.circle.start_angle_rad + self.circle.direction.sign() * ahead_rad
    }
    /// One coordinate `centre + R c(φ)` with `c` and its derivative `dc/dφ` at the present angle.
    fn coordinate(&self, centre: Position, c: f64, slope: f64, progress: &Progress) -> Setpoint {
        let radius_m = self.radius_m();
        let sign = self.circle.direction.sign();
        let omega = sign * progress.speed_m_per_s / radius_m;
        let alpha = sign * progress.acceleration_m_per_s2 / radius_m;
        Setpoint {
            position: centre + Position::m(radius_m * c),
            velocity: Velocity::m_per_s(radius_m * slope * omega),
            acceleration: Acceleration::m_per_s2(radius_m * (slope * alpha - c * omega * omega)),
        }
    }
    /// Where the motion begins: ahead of the evaluated part by run-up and run-in.
    pub fn start(&self) -> (Position, Position) {
        self.place(0.0)
    }
    /// Where the motion ends.
    pub fn end(&self) -> (Position, Position) {
        let steady_s = self.run_in_s + self.circle.duration_s() + self.run_out_s;
        let way_m = self.circle.feed.as_m_per_s() * (steady_s + self.rise_s());
        self.place(way_m)
    }
    fn place(&self, way_m: f64) -> (Position, Position) {
        let (sin, cos) = libm::sincos(self.angle_rad(way_m));
        (self.circle.centre_x + self.circle.radius * cos, self.circle.centre_y + self.circle.radius * sin)
    }
    /// From the start of the motion to the start of its evaluated part, s.
    pub fn lead_in_s(&self) -> f64 {
        self.rise_s() + self.run_in_s
    }
    /// The whole motion, s.
    pub fn duration_s(&self) -> f64 {
        2.0 * self.rise_s() + self.run_in_s + self.circle.duration_s() + self.run_out_s
    }
    /// Largest acceleration of an axis: towards the centre and along the path together.
    pub fn acceleration_max(&self) -> Acceleration {
        let feed = self.circle.feed.as_m_per_s();
        let inward = feed * feed / self.radius_m();
        Acceleration::m_per_s2(inward.hypot(self.acceleration.as_m_per_s2()))
    }
}

/// How long a straight move over a way takes, s.
pub fn line_duration_s(way: Position, feed: Velocity, acceleration: Acceleration) -> f64 {
    Pace::over(way.as_m(), feed.as_m_per_s(), acceleration).duration_s()
}

fn rise_s(feed_m_per_s: f64, acceleration: Acceleration) -> f64 {
    PI * feed_m_per_s / (2.0 * acceleration.as_m_per_s2())
}

/// Way, speed and acceleration along a path.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Progress {
    way_m: f64,
    speed_m_per_s: f64,
    acceleration_m_per_s2: f64,
}

/// Speed along a path: up, steady, down.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pace {
    feed_m_per_s: f64,
    rise_s: f64,
    steady_s: f64,
    /// Way and speed at the start: those of the pace that a stop interrupts.
    from_m: f64,
    /// A brake has no rise: it starts at full feed.
    is_brake: bool,
}

impl Pace {
    fn new(feed_m_per_s: f64, acceleration: Acceleration, steady_s: f64) -> Self {
        let rise_s = rise_s(feed_m_per_s, acceleration);
        Self { feed_m_per_s, rise_s, steady_s, from_m: 0.0, is_brake: false }
    }

    /// From rest to rest over a way; slower where the way is too short for the feed.
    fn over(way_m: f64, feed_m_per_s: f64, acceleration: Acceleration) -> Self {
        let reachable = (2.0 * acceleration.as_m_per_s2() * way_m / PI).sqrt();
        let feed = feed_m_per_s.min(reachable);
        if feed <= 0.0 {
            return Self { feed_m_per_s: 0.0, rise_s: 0.0, steady_s: 0.0, from_m: 0.0, is_brake: false };
        }
        let steady_s = (way_m / feed - rise_s(feed, acceleration)).max(0.0);
        Self::new(feed, acceleration, steady_s)
    }

    fn brake(from: Progress, acceleration: Acceleration) -> Self {
        let rise_s = rise_s(from.speed_m_per_s, acceleration);
        Self { feed_m_per_s: from.speed_m_per_s, rise_s, steady_s: 0.0, from_m: from.way_m, is_brake: true }
    }

    fn duration_s(&self) -> f64 {
        self.rise_s * if self.is_brake { 1.0 } else { 2.0 } + self.steady_s
    }

    /// Where along the path it comes to rest, m.
    fn end_m(&self) -> f64 {
        self.at(self.duration_s()).way_m
    }

    /// Whether it comes to rest at all: a feed or an acceleration may be zero, endless or no number.
    fn ends(&self) -> bool {
        let duration_s = self.duration_s();
        duration_s.is_finite() && self.rise_s >= 0.0 && self.steady_s >= 0.0
    }

    fn at(&self, time_s: f64) -> Progress {
        let feed = self.feed_m_per_s;
        let fall_from_s = if self.is_brake { 0.0 } else { self.rise_s + self.steady_s };
        let rise_way_m = if self.is_brake { 0.0 } else { 0.5 * feed * self.rise_s };
        if time_s < self.rise_s && !self.is_brake {
            let part = Self::risen(feed, self.rise_s, time_s);
            Progress { way_m: self.from_m + part.way_m, ..part }
        } else if time_s < fall_from_s {
            let way_m = self.from_m + rise_way_m + feed * (time_s - self.rise_s);
            Progress { way_m, speed_m_per_s: feed, acceleration_m_per_s2: 0.0 }
        } else {
            // A fall is a rise seen backwards from the end.
            let left_s = (fall_from_s + self.rise_s - time_s).max(0.0);
            let part = Self::risen(feed, self.rise_s, left_s);
            let way_m = self.from_m + rise_way_m + feed * (self.steady_s + 0.5 * self.rise_s) - part.way_m;
            Progress { way_m, acceleration_m_per_s2: -part.acceleration_m_per_s2, ..part }
        }
    }

    fn risen(feed: f64, rise_s: f64, time_s: f64) -> Progress {
        if rise_s == 0.0 {
            return Progress::default();
        }
        let (sin, cos) = libm::sincos(PI * time_s / rise_s);
        Progress {
            way_m: 0.5 * feed * (time_s - rise_s / PI * sin),
            speed_m_per_s: 0.5 * feed * (1.0 - cos),
            acceleration_m_per_s2: 0.5 * feed * PI / rise_s * sin,
        }
    }
}

#[derive(Clone, Copy, Debug)]
enum Path {
    Line { from: PerAxis<Position>, direction: PerAxis<f64> },
    Circle(CircleMotion),
}

/// The motion of the machine: at rest, or under way since a moment.
#[derive(Clone, Copy, Debug)]
pub struct Profile {
    setpoints: PerAxis<Setpoint>,
    run: Option<Run>,
    /// The excitation of the motion under way, and what it is now.
    excited: Option<Excited>,
    excitation: Velocity,
}

#[derive(Clone, Copy, Debug)]
struct Excited {
    signal: Signal,
    /// Begin of the motion, to which its phase is counted, and of its steady part.
    since: Moment,
    from: Moment,
    /// How much of it there was when a stop began.
    share_at_stop: f64,
}

#[derive(Clone, Copy, Debug)]
struct Run {
    path: Path,
    pace: Pace,
    since: Moment,
}

impl Profile {
    /// Holding every axis at zero.
    pub fn new(axes: usize) -> Self {
        Self {
            setpoints: PerAxis::filled(axes, Setpoint::default()),
            run: None,
            excited: None,
            excitation: Velocity::ZERO,
        }
    }

    /// What is wanted of each axis.
    pub fn setpoints(&self) -> &PerAxis<Setpoint> {
        &self.setpoints
    }

    /// Whether a motion is under way.
    pub fn is_running(&self) -> bool {
        self.run.is_some()
    }

    /// What is to be added to the velocity command of an axis.
    pub fn excitation(&self, axis: AxisId) -> Velocity {
        match &self.excited {
            Some(excited) if excited.signal.axis() == axis => self.excitation,
            Some(_) | None => Velocity::ZERO,
        }
    }

    /// Whether the evaluated part of a circle or of an excited line is under way.
    pub fn is_measured(&self, now: Moment) -> bool {
        match &self.run {
            Some(Run { pace, .. }) if pace.is_brake => false,
            Some(Run { path: Path::Circle(motion), since, .. }) => {
                let into_s = (now - *since).as_s() - motion.lead_in_s();
                into_s >= 0.0 && into_s < motion.circle.duration_s()
            }
            Some(Run { path: Path::Line { .. }, .. }) => {
                self.excited.as_ref().is_some_and(|excited| excited.signal.is_measured(now - excited.from))
            }
            None => false,
        }
    }

    /// Hold an axis that has no current where it stands.
    pub fn stand(&mut self, axis: AxisId, position: Position) {
        self.setpoints[axis] = Setpoint::at_rest(position);
    }

    /// Start a straight move from where the setpoints are. Refused (false) where it would never end, and
    /// with a target of another number of axes.
    pub fn start_line(&mut self, line: &LineMotion, now: Moment) -> bool {
        self.begin(self.line_run(line, now), None)
    }

    /// Start a straight move with an excitation. Refused (false) where the move would be, and where its steady
    /// part is too short for the excitation.
    pub fn start_excited(&mut self, motion: &ExcitedMotion, now: Moment) -> bool {
        let run = self.line_run(&motion.line, now);
        let fits = |run: &Run| run.pace.steady_s >= motion.excitation.duration().as_s();
        let Some(run) = run.filter(fits) else { return false };
        let from = now + Span::s(run.pace.rise_s);
        let signal = Signal::new(&motion.excitation);
        self.begin(Some(run), Some(Excited { signal, since: now, from, share_at_stop: 0.0 }))
    }

    fn begin(&mut self, run: Option<Run>, excited: Option<Excited>) -> bool {
        if run.is_some() {
            self.run = run;
            self.excited = excited;
            self.excitation = Velocity::ZERO;
        }
        run.is_some()
    }

    fn line_run(&self, line: &LineMotion, now: Moment) -> Option<Run> {
        if line.target.count() != self.setpoints.count() {
            return None;
        }
        let from = self.setpoints.map(|_, setpoint| setpoint.position);
        let way = from.map(|axis, position| (line.target[axis] - *position).as_m());
        let way_m = way.as_slice().iter().map(|part| part * part).sum::<f64>().sqrt();
        let direction = way.map(|_, part| if way_m > 0.0 { part / way_m } else { 0.0 });
        let pace = Pace::over(way_m, line.feed.as_m_per_s(), line.acceleration);
        let is_driven = line.feed > Velocity::ZERO && line.acceleration > Acceleration::ZERO;
        let is_possible = is_driven && way_m.is_finite() && pace.ends();
        is_possible.then_some(Run { path: Path::Line { from, direction }, pace, since: now })
    }

    /// Start a circle. Refused (false) unless the setpoints stand at its start, for the axis never jumps,
    /// and where it would never end.
    pub fn start_circle(&mut self, motion: &CircleMotion, now: Moment) -> bool {
        let (x, y) = motion.start();
        let nearby = |axis: AxisId, place: Position| {
            (self.setpoints[axis].position - place).abs() < Position::um(1e-3)
        };
        if self.setpoints.count() < 2 || !nearby(AxisId::X, x) || !nearby(AxisId::Y, y) {
            return false;
        }
        let steady_s = motion.run_in_s + motion.circle.duration_s() + motion.run_out_s;
        let pace = Pace::new(motion.circle.feed.as_m_per_s(), motion.acceleration, steady_s);
        if !(motion.radius_m() > 0.0 && motion.circle.feed > Velocity::ZERO && pace.ends()) {
            return false;
        }
        self.begin(Some(Run { path: Path::Circle(*motion), pace, since: now }), None)
    }

    /// Leave the path where the setpoints are: nobody follows it any more.
    pub fn abandon(&mut self) {
        self.run = None;
        self.excited = None;
    }

    /// Brake along the path, from the speed it has now. A brake under way goes on, and so does a motion
    /// that comes to rest before the brake would.
    pub fn stop(&mut self, acceleration: Acceleration, now: Moment) {
        if let Some(run) = &mut self.run
            && !run.pace.is_brake
        {
            let progress = run.pace.at((now - run.since).as_s());
            let brake = Pace::brake(progress, acceleration);
            if brake.end_m() <= run.pace.end_m() {
                if let Some(excited) = &mut self.excited {
                    excited.share_at_stop = excited.signal.share(now - excited.from);
                }
                run.pace = brake;
                run.since = now;
            }
        }
    }

    /// Move the setpoints to `now`; a motion that has ended leaves them at rest.
    pub fn advance(&mut self, now: Moment) {
        let Some(run) = self.run else { return };
        let time_s = (now - run.since).as_s();
        let progress = run.pace.at(time_s.min(run.pace.duration_s()));
        run.path.place(&progress, &mut self.setpoints);
        if let Some(excited) = &self.excited {
            let share = if !run.pace.is_brake {
                excited.signal.share(now - excited.from)
            } else if run.pace.feed_m_per_s > 0.0 {
                excited.share_at_stop * (progress.speed_m_per_s / run.pace.feed_m_per_s)
            } else {
                0.0
            };
            self.excitation = excited.signal.at(now - excited.since) * share;
        }
        if time_s >= run.pace.duration_s() {
            for (_, setpoint) in self.setpoints.iter_mut() {
                *setpoint = Setpoint::at_rest(setpoint.position);
            }
            self.abandon();
        }
    }
}

impl Path {
    /// Set the axes that the path moves; others keep their setpoints.
    fn place(&self, progress: &Progress, setpoints: &mut PerAxis<Setpoint>) {
        match self {
            Self::Line { from, direction } => {
                for (axis, setpoint) in setpoints.iter_mut() {
                    let share = direction[axis];
                    *setpoint = Setpoint {
                        position: from[axis] + Position::m(share * progress.way_m),
                        velocity: Velocity::m_per_s(share * progress.speed_m_per_s),
                        acceleration: Acceleration::m_per_s2(share * progress.acceleration_m_per_s2),
                    };
                }
            }
            Self::Circle(motion) => {
                let (sin, cos) = libm::sincos(motion.angle_rad(progress.way_m));
                setpoints[AxisId::X] = motion.coordinate(motion.circle.centre_x, cos, -sin, progress);
                setpoints[AxisId::Y] = motion.coordinate(motion.circle.centre_y, sin, cos, progress);
            }
        }
    }
}

#[cfg(test)]
mod tests;
