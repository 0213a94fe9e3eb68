//! Sample in, command out, for one axis: position loop, velocity loop, feed-forward, limits.
//!
//! ```text
//!   setpoint ─► travel ─► position P ─► velocity, acceleration ─► + ─► velocity PI ─► + ─► current ─► command
//!                            ▲                                    ▲        ▲          ▲
//!                         position                           excitation velocity  friction, inertia
//! ```
//!
//! The position loop acts every `position_every` ticks, the velocity loop at each. Settings are
//! immutable while a cycle runs; gain sets are chosen by number and swapped without a bump.
//! Invariant: knows no frame and no bus, so it can be tested, replayed and tuned without either.

pub mod compensation;
pub mod excitation;
pub mod limits;
pub mod momentum;
pub mod position;
pub mod profile;
pub mod stillness;
pub mod velocity_pi;

use crate::base::command::{Limits as Acted, Terms};
use crate::base::fault::Fault;
use crate::base::order::ExcitedMotion;
use crate::base::sample::Sample;
use crate::base::setpoint::Setpoint;
use crate::base::time::Span;
use crate::base::units::{Acceleration, Current, Position, Torque, Velocity};
use crate::plant::Parameters;

use limits::{ACCELERATION_FACTOR, Limits};
use momentum::Momentum;
use position::PositionLoop;
use stillness::Stillness;
use velocity_pi::VelocityLoop;

/// Most gain sets of an axis.
pub const GAIN_SETS_MAX: usize = 8;

/// One named set of gains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// Position loop.
    pub position: position::Gains,
    /// Velocity loop.
    pub velocity: velocity_pi::Gains,
    /// Feed-forwards.
    pub compensation: compensation::Gains,
}

/// Everything that sets the control of one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Period of the cycle.
    pub tick: Span,
    /// The position loop acts in each so many cycles.
    pub position_every: u32,
    /// The control's own idea of the axis.
    pub axis: Parameters,
    /// Travel for one count of its motor encoder.
    pub resolution: Position,
    /// Bounds.
    pub limits: Limits,
    /// Gain sets, by number.
    pub gain_sets: [Gains; GAIN_SETS_MAX],
    /// How many of them there are.
    pub gain_set_count: u8,
}

impl Settings {
    /// Acceleration above which a motion is none of this axis: its encoder jumped.
    pub fn acceleration_bound(&self) -> Acceleration {
        self.axis.motor_acceleration_max() * ACCELERATION_FACTOR
    }

    /// Largest jump between two ticks that may pass for a motion: all that the bound allows, against all that
    /// the motor does meanwhile.
    pub fn unseen_jump(&self) -> Position {
        let acceleration = self.acceleration_bound() + self.axis.motor_acceleration_max();
        let tick_s = self.tick.as_s();
        Position::m(acceleration.as_m_per_s2() * tick_s * tick_s)
    }
}

/// What the loops answer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Answer {
    /// Current for the drive.
    pub current: Current,
    /// How it came about.
    pub terms: Terms,
    /// Which limits acted.
    pub limits: Acted,
    /// The loops came to something that is not a number; the current is zero instead, and the terms tell
    /// where it came from.
    pub is_not_a_number: bool,
}

/// The loops of one axis.
#[derive(Clone, Debug)]
pub struct AxisLoop {
    settings: Settings,
    model: compensation::Model,
    position: PositionLoop,
    velocity: VelocityLoop,
    momentum: Momentum,
    stillness: Stillness,
    velocity_command: Velocity,
    excitation_wanted: Velocity,
    velocity_error_rad_per_s: f64,
    held_velocity: Acted,
    /// Ticks since the position loop acted, and whether one of its own was missed meanwhile.
    periods_since_position: u32,
    is_position_due: bool,
    /// Ticks since the loops acted.
    periods_since_step: u32,
    reach: (Position, Position),
    gain_set: u8,
    rad_per_m: f64,
    torque_bound: Torque,
    acceleration_bound: Acceleration,
}

impl AxisLoop {
    /// Loops with the first gain set, at rest.
    pub fn new(settings: &Settings) -> Self {
        let gains = &settings.gain_sets[0];
        Self {
            settings: *settings,
            model: compensation::Model::new(&settings.axis),
            position: PositionLoop::default(),
            velocity: VelocityLoop::new(&gains.velocity, settings.tick),
            momentum: Momentum::new(&settings.axis, &settings.limits),
            stillness: Stillness::new(&settings.axis, &settings.limits, settings.resolution, settings.tick),
            velocity_command: Velocity::ZERO,
            excitation_wanted: Velocity::ZERO,
            velocity_error_rad_per_s: 0.0,
            held_velocity: Acted::NONE,
            periods_since_position: settings.position_every,
            is_position_due: false,
            periods_since_step: 0,
            reach: settings.limits.reach_from(Position::ZERO),
            gain_set: 0,
            rad_per_m: 1.0 / settings.axis.mechanics.travel_per_rad_m(),
            torque_bound: settings.axis.actuator.torque(settings.limits.current),
            acceleration_bound: settings.acceleration_bound(),
        }
    }

    /// The gain set that acts.
    pub fn gain_set(&self) -> u8 {
        self.gain_set
    }

    /// Its limits.
    pub fn limits(&self) -> &Limits {
        &self.settings.limits
    }

    /// Whether a fresh sample is no motion of the axis, with or without current; `acceleration` is the least
    /// that leads to it.
    pub fn is_jump(&self, sample: &Sample, acceleration: Acceleration) -> bool {
        self.settings.limits.is_jump(sample) || acceleration > self.acceleration_bound
    }

    /// What is wrong with a fresh sample of an axis that these loops move, the worst first.
    pub fn violation(&self, sample: &Sample) -> Option<Fault> {
        let limits = &self.settings.limits;
        match limits.violation(sample, self.position.expected_position(), self.reach) {
            // Travel is ramped out under control, which an axis that does not answer has not; and that it does
            // not is the cause of its following error.
            None | Some(Fault::Travel | Fault::FollowingError) if self.is_unanswered() => {
                Some(Fault::NoResponse)
            }
            found => found,
        }
    }

    /// Whether the encoder does not show what the current does.
    const fn is_unanswered(&self) -> bool {
        self.momentum.is_unanswered() || self.stillness.is_unanswered()
    }

    /// Where the axis should be by now, whatever disturbs it.
    pub fn expected(&self) -> &PositionLoop {
        &self.position
    }

    /// The axis has no current: stand where it stands and move as it moves, so that enabling neither
    /// moves an axis at rest nor jerks one that is still coasting.
    pub fn follow(&mut self, sample: &Sample) {
        self.position.reset(sample.position);
        self.velocity.reset();
        self.momentum.reset();
        self.stillness.reset();
        self.reach = self.settings.limits.reach_from(sample.position);
        self.velocity_command = sample.velocity.clamp_abs(self.settings.limits.velocity);
        self.excitation_wanted = Velocity::ZERO;
        self.velocity_error_rad_per_s = 0.0;
        self.held_velocity = Acted::NONE;
        self.periods_since_position = self.settings.position_every;
        self.is_position_due = false;
        self.periods_since_step = 0;
    }

    /// Take over an axis in the middle of its motion, whose motor gives `torque`: the integral holds what no
    /// feed-forward gives, if the loop has one. For analysis, which begins where its data do; an axis with a drive is
    /// enabled at rest.
    pub fn take_over(&mut self, setpoint: &Setpoint, sample: &Sample, torque: Torque) {
        self.follow(sample);
        let gains = self.settings.gain_sets[usize::from(self.gain_set)];
        let (setpoint, _) = Limits::hold_setpoint(self.reach, setpoint);
        self.position_tick(&gains.position, &setpoint, sample);
        let fed = self.model.feed_forward(&gains.compensation, &self.position);
        let error_rad_per_s = (self.velocity_command - sample.velocity).as_m_per_s() * self.rad_per_m;
        if gains.velocity.has_integral() {
            self.velocity.hold(error_rad_per_s, torque - fed.friction - fed.inertia);
        }
    }

    /// Time passes, with or without a cycle and fresh feedback: the expected response moves on, as the
    /// axis does.
    pub fn pass(&mut self, periods: u64) {
        let periods = u32::try_from(periods).unwrap_or(u32::MAX);
        self.position.coast(self.settings.tick.as_s() * f64::from(periods));
        self.periods_since_position = self.periods_since_position.saturating_add(periods);
        self.periods_since_step = self.periods_since_step.saturating_add(periods);
    }

    /// A cycle without fresh feedback: nothing is computed, and a tick of the position loop is made up
    /// for at the next sample.
    pub fn miss(&mut self, is_position_tick: bool) {
        self.is_position_due |= is_position_tick;
    }

    /// Whether a motion with an excitation of this axis stays within the limits, with the gains that act.
    pub fn admits(&self, motion: &ExcitedMotion) -> bool {
        let ExcitedMotion { line, excitation } = motion;
        let Settings { tick, limits, axis, .. } = &self.settings;
        let gains = &self.settings.gain_sets[usize::from(self.gain_set)].velocity;
        let push_nm =
            gains.proportional_nm_s_per_rad * excitation.velocity_max().as_m_per_s() * self.rad_per_m;
        let torque = Torque::nm(push_nm) + axis.mechanics.torque_for_force(axis.friction.breakaway);
        excitation.is_sound(*tick)
            && line.feed + excitation.velocity_max() <= limits.velocity
            && excitation.acceleration_max() <= limits.acceleration
            && excitation.displacement_max() <= limits.following_error
            && torque <= self.torque_bound
    }

    /// What to add to the velocity command in the steps from now on.
    pub fn excite(&mut self, wanted: Velocity) {
        self.excitation_wanted = wanted;
    }

    /// The excitation of this tick: it may change no faster and the sum be no larger than a command may.
    fn hold_excitation(&mut self, since_s: f64) -> Acted {
        let limits = &self.settings.limits;
        let before = self.position.excitation();
        if self.excitation_wanted == Velocity::ZERO && before == Velocity::ZERO {
            return Acted::NONE;
        }
        let reach = Velocity::m_per_s(limits.acceleration.as_m_per_s2() * since_s);
        let change = self.excitation_wanted - before;
        let is_steep = change.abs() > reach;
        let near = if is_steep { before + change.clamp_abs(reach) } else { self.excitation_wanted };
        let sum = self.velocity_command + near;
        let is_fast = sum.abs() > limits.velocity;
        let held = if is_fast { sum.clamp_abs(limits.velocity) - self.velocity_command } else { near };
        self.position.excite(held);
        Acted::when(is_fast, Acted::VELOCITY).with(Acted::when(is_steep, Acted::ACCELERATION))
    }

    /// Use another gain set from now on, without a bump. Numbers past the last set are ignored.
    pub fn use_gains(&mut self, set: u8, setpoint: &Setpoint, sample: &Sample) {
        if set >= self.settings.gain_set_count || set == self.gain_set {
            return;
        }
        let [from, to] = [self.gain_set, set].map(|n| self.settings.gain_sets[usize::from(n)]);
        let (setpoint, _) = Limits::hold_setpoint(self.reach, setpoint);
        self.position.swap(&from.position, &to.position, &setpoint, sample.position);
        let [fed_before, fed] = [from, to].map(|gains| {
            let fed = self.model.feed_forward(&gains.compensation, &self.position);
            fed.friction + fed.inertia
        });
        self.velocity.swap(&to.velocity, self.settings.tick, self.velocity_error_rad_per_s, fed - fed_before);
        self.gain_set = set;
    }

    /// One tick. `is_position_tick` says whether the position loop acts in it.
    pub fn step(&mut self, setpoint: &Setpoint, sample: &Sample, is_position_tick: bool) -> Answer {
        let gains = self.settings.gain_sets[usize::from(self.gain_set)];
        let (setpoint, was_outside) = Limits::hold_setpoint(self.reach, setpoint);
        let since_s = self.settings.tick.as_s() * f64::from(self.periods_since_step);
        self.weigh(sample, since_s);
        if is_position_tick || self.is_position_due {
            self.position_tick(&gains.position, &setpoint, sample);
        }
        let feed_forward = self.model.feed_forward(&gains.compensation, &self.position);

        let held_excitation = self.hold_excitation(since_s);
        let excitation = self.position.excitation();
        let error = self.velocity_command + excitation - sample.velocity;
        self.velocity_error_rad_per_s = error.as_m_per_s() * self.rad_per_m;
        let fed = feed_forward.friction + feed_forward.inertia;
        let parts = self.velocity.step(self.velocity_error_rad_per_s, fed, self.torque_bound);
        let wanted = self.settings.axis.actuator.current(parts.proportional + parts.integral + fed);
        let held = wanted.clamp_abs(self.settings.limits.current);
        let is_not_a_number = !held.is_finite();
        let current = if is_not_a_number { Current::ZERO } else { held };

        let terms = Terms {
            following_error: setpoint.position - sample.position,
            expected_position: self.position.expected_position(),
            expected_velocity: self.position.expected_velocity(),
            velocity_command: self.velocity_command,
            excitation,
            proportional: parts.proportional,
            integral: parts.integral,
            friction: feed_forward.friction,
            inertia: feed_forward.inertia,
        };
        let limits = self
            .held_velocity
            .with(held_excitation)
            .with(Acted::when(was_outside, Acted::TRAVEL))
            .with(Acted::when(held != wanted && !is_not_a_number, Acted::CURRENT));
        Answer { current, terms, limits, is_not_a_number }
    }

    /// Holds what the motor did since the last step against its current.
    fn weigh(&mut self, sample: &Sample, since_s: f64) {
        self.periods_since_step = 0;
        let torque = self.settings.axis.actuator.torque(sample.current);
        let expected = self.position.expected_velocity() + self.position.excitation();
        self.momentum.step(sample, torque, expected, since_s);
        self.stillness.step(sample);
    }

    fn position_tick(&mut self, gains: &position::Gains, setpoint: &Setpoint, sample: &Sample) {
        // A late tick may not take a larger step than one in time.
        let periods = self.periods_since_position.clamp(1, self.settings.position_every);
        let since_s = self.settings.tick.as_s() * f64::from(periods);
        self.periods_since_position = 0;
        self.is_position_due = false;
        self.position.update(gains, setpoint, sample.position, since_s);
        let limits = &self.settings.limits;
        let (held, by_velocity, by_acceleration) =
            limits.hold_velocity(self.position.command(), self.velocity_command, since_s);
        self.velocity_command = held;
        self.held_velocity =
            Acted::when(by_velocity, Acted::VELOCITY).with(Acted::when(by_acceleration, Acted::ACCELERATION));
    }
}
