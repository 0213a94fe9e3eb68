//! A circular path of known shape: what an axis pair with lag, friction spikes and wind-up leaves in
//! its records, written down as a formula instead of simulated.
//!
//! Every axis follows its command with a lag and a smaller amplitude. After each of its own reversals
//! a pulse pushes it outward (rise over the stick phase, then a fast and a slow decay), and at the table
//! the wind-up changes sign meanwhile. Shape and size are those of the reference machine at 2000 mm/min.

use std::f64::consts::{FRAC_PI_2, TAU};

use quadrant::base::axis::AxisId;
use quadrant::base::motion::{Circle, Direction};
use quadrant::base::record::{CycleRecord, ModeTag, Stage};
use quadrant::base::sample::Freshness;
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Current, Position, Velocity};

/// One machine of known faults; lengths in um, times in s.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Model {
    pub(crate) radius_decrease_um: f64,
    /// Lag of X and Y.
    pub(crate) lag_s: [f64; 2],
    /// Height of the pulse in X+, Y+, X-, Y-.
    pub(crate) pulse_um: [f64; 4],
    /// From the axis' own reversal to the peak.
    pub(crate) stick_s: f64,
    /// Half of the lost motion of X and Y, at the table.
    pub(crate) wind_up_um: [f64; 2],
    /// Centre of the path from the nominal centre.
    pub(crate) centre_um: [f64; 2],
    /// X is longer and Y shorter than nominal by half of this each.
    pub(crate) scale_mismatch_um: f64,
    /// Smallest step of the encoders; 0 for none.
    pub(crate) quantum_um: f64,
    /// Greatest amount of noise on every sample; 0 for none.
    pub(crate) noise_um: f64,
    /// How long the command moves on the circle before and after the measured part.
    pub(crate) run_in_s: f64,
}

pub(crate) const PERIOD_S: f64 = 0.0005;

/// The reference machine with its standard gains, in round figures.
pub(crate) const REFERENCE: Model = Model {
    radius_decrease_um: 50.0,
    lag_s: [0.1165; 2],
    pulse_um: [25.0; 4],
    stick_s: 0.11,
    wind_up_um: [6.3; 2],
    centre_um: [0.0; 2],
    scale_mismatch_um: 0.0,
    quantum_um: 0.0,
    noise_um: 0.0,
    run_in_s: 1.5,
};

pub(crate) fn circle(feed_mm_per_min: f64, direction: Direction, revolutions: u32) -> Circle {
    Circle {
        centre_x: Position::mm(-150.0),
        centre_y: Position::mm(20.0),
        radius: Position::mm(150.0),
        feed: Velocity::mm_per_min(feed_mm_per_min),
        direction,
        start_angle_rad: 0.0,
        revolutions,
    }
}

impl Model {
    /// The same machine without friction.
    pub(crate) fn friction_free(self) -> Self {
        Self { pulse_um: [0.0; 4], wind_up_um: [0.0; 2], ..self }
    }

    /// Height of the pulse over the stick phase `u_s` since the axis' own reversal: 0 to 1.
    pub(crate) fn pulse(&self, u_s: f64) -> f64 {
        let v_s = u_s - self.stick_s;
        match (u_s < 0.0, v_s < 0.0) {
            (true, _) => 0.0,
            (_, true) => (u_s / self.stick_s).powi(2),
            // Half of the height is left 75 ms after the peak; 8 1/s is the slow pole of the loop.
            _ => 0.2 * (-16.0 * v_s).exp() + 0.8 * (-8.0 * v_s).exp(),
        }
    }

    /// All cycles of the motion.
    pub(crate) fn records(&self, circle: &Circle) -> Vec<CycleRecord> {
        let measured = (circle.duration_s() / PERIOD_S).round() as i64;
        let run_in = (self.run_in_s / PERIOD_S).round() as i64;
        let mut noise = Noise(7);
        (0..measured + 2 * run_in)
            .map(|row| {
                let at = row - run_in;
                let mut record = CycleRecord::empty(2);
                record.cycle = 100 + row as u64;
                record.timing.scheduled = Moment::ZERO + Span::us(500) * (100 + row);
                record.stage = Stage { motion: 1, is_measured: (0..measured).contains(&at) };
                for axis in [AxisId::X, AxisId::Y] {
                    self.fill(&mut record, axis, circle, at as f64 * PERIOD_S, &mut noise);
                }
                record
            })
            .collect()
    }

    fn fill(&self, record: &mut CycleRecord, axis: AxisId, circle: &Circle, t_s: f64, noise: &mut Noise) {
        let place = axis.index();
        let centre_m = [circle.centre_x, circle.centre_y][place].as_m() + 1e-6 * self.centre_um[place];
        let (wanted_m, wanted_m_per_s) = wanted(circle, axis, t_s);
        let lagged_s = t_s - self.lag_s[place];
        let mismatch_um = 0.5 * self.scale_mismatch_um * [1.0, -1.0][place];
        let shrink = 1.0 + 1e-6 * (mismatch_um - self.radius_decrease_um) / circle.radius.as_m();
        let (response_m, response_m_per_s) = wanted(circle, axis, lagged_s);
        let (side, since_s) = last_reversal(circle, axis, lagged_s);
        let outward = [1.0, 1.0, -1.0, -1.0][side];
        let pulse_um = outward * self.pulse_um[side] * self.pulse(since_s);
        // While the axis sticks, the screw unwinds and winds up the other way.
        let unwound = (since_s / self.stick_s).min(1.0);
        let wind_up_um = outward * self.wind_up_um[place] * (2.0 * unwound - 1.0);
        let quantise = |m: f64| {
            if self.quantum_um > 0.0 {
                (m / self.quantum_um * 1e6).round() * self.quantum_um * 1e-6
            } else {
                m
            }
        };
        let motor_m = centre_m + shrink * response_m + 1e-6 * (pulse_um + self.noise_um * noise.next());
        let slot = &mut record.axes[axis];
        slot.mode = ModeTag::Moving;
        slot.setpoint.position = Position::m([circle.centre_x, circle.centre_y][place].as_m() + wanted_m);
        slot.setpoint.velocity = Velocity::m_per_s(wanted_m_per_s);
        slot.sample.freshness = Freshness::Fresh;
        slot.sample.position = Position::m(quantise(motor_m));
        slot.sample.table_position = Position::m(quantise(motor_m + 1e-6 * wind_up_um));
        slot.sample.velocity = Velocity::m_per_s(response_m_per_s);
        // Friction of 1.68 N m against the motion, at 1 N m/A.
        slot.sample.current = Current::a(-1.68 * outward * (2.0 * unwound - 1.0));
    }
}

/// Position about the centre and velocity of one axis of the nominal path.
fn wanted(circle: &Circle, axis: AxisId, t_s: f64) -> (f64, f64) {
    let speed_rad_per_s = circle.direction.sign() * circle.angular_speed_rad_per_s();
    let (sin, cos) = (circle.start_angle_rad + speed_rad_per_s * t_s).sin_cos();
    let radius_m = circle.radius.as_m();
    if axis == AxisId::X {
        (radius_m * cos, -radius_m * speed_rad_per_s * sin)
    } else {
        (radius_m * sin, radius_m * speed_rad_per_s * cos)
    }
}

/// Which quadrant point the axis passed last (0 to 3 from X+), and how long ago.
fn last_reversal(circle: &Circle, axis: AxisId, t_s: f64) -> (usize, f64) {
    let speed_rad_per_s = circle.angular_speed_rad_per_s();
    let direction = circle.direction.sign();
    let own_rad = if axis == AxisId::X { 0.0 } else { FRAC_PI_2 };
    // Progress since the axis' upper end, in direction of travel.
    let turned_rad = (direction * (circle.start_angle_rad - own_rad) + speed_rad_per_s * t_s).rem_euclid(TAU);
    let is_upper = turned_rad < TAU / 2.0;
    let since_s = (if is_upper { turned_rad } else { turned_rad - TAU / 2.0 }) / speed_rad_per_s;
    (if is_upper { axis.index() } else { axis.index() + 2 }, since_s)
}

/// Numbers between -1 and 1 from a seed (a linear congruential generator; its high bits are good).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}
