//! The sampled controller of one axis: position P in every fourth period, velocity PI in all of them.
//!
//! `v_command = K_p (x_set - x) + share v_set`, held until the position loop acts again;
//! `T = K_vp e + I`, then `I += K_vi e T_v` (forward Euler), `e = (v_command - v) / r`; current `T / K_t` with the
//! torque constant that the controller was told. The velocity comes from the last two or three positions.
//! Invariant: the integral does not grow in the direction in which the current is held.

use crate::features::Loops;
use crate::plant::Control;

/// Period of the velocity loop, s.
pub const PERIOD: f64 = 5e-4;
/// The position loop acts in each so many periods.
pub const POSITION_EVERY: u64 = 4;

/// A place and a speed that are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint {
    /// m.
    pub place: f64,
    /// m/s.
    pub speed: f64,
}

/// Settings and memory of the loops of one axis.
#[derive(Clone, Debug)]
pub struct Controller {
    settings: Control,
    loops: Loops,
    rad_per_m: f64,
    torque_constant: f64,
    /// The last two positions, the later one first.
    before: Option<[f64; 2]>,
    velocity_command: f64,
    integral: f64,
    /// The last setpoint and what was made of it.
    filtered: Option<(Setpoint, Setpoint)>,
    /// What the mean over the setpoint goes over, in a ring.
    window: Vec<Setpoint>,
    /// Direction in which the setpoint went last, and periods since it turned.
    direction: f64,
    since_reversal: Option<u64>,
}

impl Controller {
    /// `torque_constant` and `travel_per_rad` are those that the controller was told.
    pub fn new(settings: &Control, loops: &Loops, torque_constant: f64, travel_per_rad: f64) -> Self {
        Self {
            settings: *settings,
            loops: *loops,
            rad_per_m: 1.0 / travel_per_rad,
            torque_constant,
            before: None,
            velocity_command: 0.0,
            integral: 0.0,
            filtered: None,
            window: Vec::new(),
            direction: 0.0,
            since_reversal: None,
        }
    }

    /// Current for a measured place, in the period of this number.
    pub fn step(&mut self, number: u64, setpoint: Setpoint, place: f64) -> f64 {
        let setpoint = self.filter(number, setpoint);
        let velocity = self.velocity(place);
        if number.is_multiple_of(POSITION_EVERY) {
            let gain = self.settings.position_gain * (1.0 + self.loops.position_gain);
            self.velocity_command =
                gain * (setpoint.place - place) + self.settings.velocity_feed_forward * setpoint.speed;
        }
        let error = (self.velocity_command - velocity) * self.rad_per_m;
        let share = 1.0 + self.loops.velocity_gain;
        let proportional = share * self.settings.proportional * error;
        let bound = self.settings.current_max * self.torque_constant;
        let torque = proportional + self.integral;
        let next = self.integral + share * self.settings.integral * PERIOD * error;
        let is_held = (proportional + next).abs() > bound && next.abs() > self.integral.abs();
        if !is_held {
            self.integral = next;
        }
        let current = torque / self.torque_constant + self.pulse(setpoint);
        current.clamp(-self.settings.current_max, self.settings.current_max)
    }

    fn velocity(&mut self, place: f64) -> f64 {
        let [last, earlier] = self.before.unwrap_or([place; 2]);
        self.before = Some([place, last]);
        if self.settings.is_second_order {
            (3.0 * place - 4.0 * last + earlier) / (2.0 * PERIOD)
        } else {
            (place - last) / PERIOD
        }
    }

    /// What becomes of the setpoint on its way to the loops.
    fn filter(&mut self, number: u64, setpoint: Setpoint) -> Setpoint {
        if self.loops.filter_time > 0.0 {
            // Exact for straight lines between the setpoints.
            let time = self.loops.filter_time;
            let keep = (-PERIOD / time).exp();
            let (before, held) = self.filtered.unwrap_or((setpoint, setpoint));
            let follow = |held: f64, old: f64, new: f64| {
                let lag = time * (new - old) / PERIOD;
                new - lag + keep * (held - old + lag)
            };
            let filtered = Setpoint {
                place: follow(held.place, before.place, setpoint.place),
                speed: follow(held.speed, before.speed, setpoint.speed),
            };
            self.filtered = Some((setpoint, filtered));
            return filtered;
        }
        if self.loops.mean_time > 0.0 {
            // The mean of the straight lines between the setpoints, back to a moment between two of them.
            let length = self.loops.mean_time / PERIOD;
            let count = length.ceil() as usize + 1;
            if self.window.is_empty() {
                self.window = vec![setpoint; count];
            }
            let newest = number as usize % count;
            self.window[newest] = setpoint;
            let mut sum = Setpoint::default();
            for age in 0..count - 1 {
                let [new, old] = [age, age + 1].map(|age| self.window[(newest + count - age) % count]);
                let part = (length - age as f64).min(1.0);
                let mean = |new: f64, old: f64| part * (new + 0.5 * part * (old - new)) / length;
                sum.place += mean(new.place, old.place);
                sum.speed += mean(new.speed, old.speed);
            }
            return sum;
        }
        setpoint
    }

    /// The undeclared compensation: a pulse of current from the setpoint's reversal on.
    fn pulse(&mut self, setpoint: Setpoint) -> f64 {
        if self.loops.pulse == 0.0 {
            return 0.0;
        }
        if setpoint.speed != 0.0 && setpoint.speed.signum() != self.direction {
            let is_reversal = self.direction != 0.0;
            self.direction = setpoint.speed.signum();
            self.since_reversal = is_reversal.then_some(0);
        }
        let Some(periods) = self.since_reversal else { return 0.0 };
        self.since_reversal = Some(periods + 1);
        let share = periods as f64 * PERIOD / self.loops.pulse_time;
        let height = if self.loops.pulse_is_flat {
            f64::from(u8::from(share < 1.0))
        } else if share < 20.0 {
            (-share).exp()
        } else {
            0.0
        };
        self.direction * height * self.loops.pulse
    }
}
