//! One circular path as seen by one measuring point: where it was, and how far from the nominal circle.
//!
//! The command's progress `p` is its own unwrapped angle from the start of the evaluated part,
//! positive in the direction of travel; the deviation is `hypot(x - cx, y - cy) - R` at the *actual*
//! point, drawn over the *actual* angle (ISO 230-4 looks at the path, not at the time).
//!
//! A sample that is not of its own cycle tells where the axis was earlier. Such rows stay in the columns,
//! so that cycles can be matched, but count as missing: whoever reads positions asks `is_fresh`.
//!
//! Invariant: every column has the length of the stretch; `measured` is not empty.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::ops::Range;

use super::{CircleError, MeasuringPoint, Quadrant, Run};
use crate::base::axis::AxisId;
use crate::base::motion::Circle;
use crate::offline::trace::AxisTrace;

/// A command within this distance of the nominal radius is on the circle, m.
const ON_CIRCLE_M: f64 = 1e-6;

/// The path of one measuring point during one motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// What was wanted.
    pub nominal: Circle,
    /// Time since the evaluated part began, s.
    pub time_s: Vec<f64>,
    /// Unwrapped angle of the command since the start of the evaluated part, rad, in travel direction.
    pub progress_rad: Vec<f64>,
    /// From the nominal centre, m.
    pub x_m: Vec<f64>,
    /// From the nominal centre, m.
    pub y_m: Vec<f64>,
    /// Radius minus nominal radius, m.
    pub deviation_m: Vec<f64>,
    /// Sign of the velocity of each motor: +1, 0 or -1.
    pub sign: [Vec<f64>; 2],
    /// Whether both axes were sampled in the row's own cycle; if not, the row's position is none.
    pub is_fresh: Vec<bool>,
    /// The evaluated rows.
    pub measured: Range<usize>,
    /// The evaluated rows and those around them in which the command was already, or still, on the circle.
    pub on_circle: Range<usize>,
}

/// Where the command of one axis turns around.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reversal {
    /// Which of the four.
    pub quadrant: Quadrant,
    /// Turn it belongs to, from 1.
    pub revolution: u32,
    /// When the command turned, s since the evaluated part began.
    pub time_s: f64,
}

/// How long before and after a command's reversal the path is left out of fitted arcs, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guard {
    /// Before the reversal.
    pub before_s: f64,
    /// After the reversal.
    pub after_s: f64,
    /// Whether it had to be shortened because the quadrants pass too fast.
    pub is_shortened: bool,
}

impl Guard {
    /// Full guard before a reversal: rest of the stick phase on axes that lead their command, s.
    const BEFORE_S: f64 = 0.2;
    /// Full guard after it: lag of the axis (0.12 s at a position gain of 8.6 1/s), stick phase
    /// (0.1 s), then eight time constants of the loop's slow pole (8 1/s).
    const AFTER_S: f64 = 1.2;
    /// At least this share of each quadrant stays for the arcs.
    const ARC_SHARE_MIN: f64 = 0.2;

    /// For one path: full if the quadrants last long enough, shortened in proportion if not.
    pub fn of(nominal: &Circle) -> Self {
        let quadrant_s = FRAC_PI_2 / nominal.angular_speed_rad_per_s();
        let room_s = (1.0 - Self::ARC_SHARE_MIN) * quadrant_s;
        let scale = (room_s / (Self::BEFORE_S + Self::AFTER_S)).min(1.0);
        Self { before_s: scale * Self::BEFORE_S, after_s: scale * Self::AFTER_S, is_shortened: scale < 1.0 }
    }
    /// Whether a time lies in the guard of a reversal.
    pub fn covers(&self, reversal: &Reversal, time_s: f64) -> bool {
        (-self.before_s..=self.after_s).contains(&(time_s - reversal.time_s))
    }
}

impl Path {
    /// Of one run at one measuring point; `None` where the machine has no such point.
    pub(super) fn of(run: &Run<'_>, point: MeasuringPoint) -> Result<Option<Self>, CircleError> {
        let [x, y] = run.axes()?;
        let (Some(x_m), Some(y_m)) = (column(x, point), column(y, point)) else { return Ok(None) };
        let measured = run.measured()?;
        let (nominal, circle) = (run.nominal, Centred::of(&run.nominal));
        let progress_rad = progress(x, y, &circle, measured.start);
        let start_s =
            run.trace.time_s[measured.start] - progress_rad[measured.start] / circle.speed_rad_per_s;
        let on_circle = on_circle(x, y, &circle, &measured);
        let x_m: Vec<f64> = x_m.iter().map(|x| x - circle.x_m).collect();
        let y_m: Vec<f64> = y_m.iter().map(|y| y - circle.y_m).collect();
        let deviation_m = x_m.iter().zip(&y_m).map(|(x, y)| x.hypot(*y) - circle.radius_m).collect();
        let sign = |axis: &AxisTrace| {
            axis.velocity_m_per_s.iter().map(|v| if *v == 0.0 { 0.0 } else { v.signum() }).collect()
        };
        Ok(Some(Self {
            nominal,
            time_s: run.trace.time_s.iter().map(|s| s - start_s).collect(),
            progress_rad,
            sign: [sign(x), sign(y)],
            x_m,
            y_m,
            deviation_m,
            is_fresh: x.is_fresh.iter().zip(&y.is_fresh).map(|(x, y)| *x && *y).collect(),
            measured,
            on_circle,
        }))
    }

    /// The evaluated rows that have a position.
    pub fn measured_rows(&self) -> impl Iterator<Item = usize> {
        self.measured.clone().filter(|row| self.is_fresh[*row])
    }

    /// Actual angle of a row, counter-clockwise from +X, in `0..2π`.
    pub fn angle_rad(&self, row: usize) -> f64 {
        self.y_m[row].atan2(self.x_m[row]).rem_euclid(TAU)
    }

    /// Angle of the command of a row, counter-clockwise from +X, unwrapped.
    pub fn command_angle_rad(&self, row: usize) -> f64 {
        self.nominal.start_angle_rad + self.nominal.direction.sign() * self.progress_rad[row]
    }

    /// The command's reversals in the evaluated part, in order: four for each turn.
    ///
    /// A reversal at the very start counts there if the command came in along the circle; if it did
    /// not, the axis started from rest, and the one at the very end is taken instead.
    pub fn reversals(&self) -> Vec<Reversal> {
        let first_rad = self.first_crossing_rad();
        let guard_s = Guard::of(&self.nominal).before_s;
        let has_run_in = self.time_s[self.on_circle.start] <= -guard_s;
        let offset = usize::from(first_rad == 0.0 && !has_run_in);
        let count = 4 * self.nominal.revolutions as usize;
        (0..count).map(|turn| self.reversal(first_rad, (turn + offset) as f64, turn as u32 / 4 + 1)).collect()
    }

    /// Those of [`Self::reversals`] and the neighbours whose tails reach into the evaluated part.
    pub fn disturbances(&self) -> Vec<Reversal> {
        let first_rad = self.first_crossing_rad();
        let count = 4 * i64::from(self.nominal.revolutions);
        (-1..=count).map(|turn| self.reversal(first_rad, turn as f64, 0)).collect()
    }

    fn first_crossing_rad(&self) -> f64 {
        let forward_rad = -self.nominal.direction.sign() * self.nominal.start_angle_rad;
        let first_rad = forward_rad.rem_euclid(FRAC_PI_2);
        // A start on an axis may come out as just short of a quadrant by rounding.
        if first_rad < 1e-6 || FRAC_PI_2 - first_rad < 1e-6 { 0.0 } else { first_rad }
    }

    fn reversal(&self, first_rad: f64, turn: f64, revolution: u32) -> Reversal {
        let progress_rad = first_rad + turn * FRAC_PI_2;
        let angle_rad = self.nominal.start_angle_rad + self.nominal.direction.sign() * progress_rad;
        Reversal { quadrant: Quadrant::nearest(angle_rad), revolution, time_s: self.time_at_s(progress_rad) }
    }

    /// When the command had turned by `progress_rad`: between rows, and past the evaluated part at the
    /// feed, because there the command may already slow down.
    fn time_at_s(&self, progress_rad: f64) -> f64 {
        let rows = self.measured.clone();
        let speed_rad_per_s = self.nominal.angular_speed_rad_per_s();
        let inside = &self.progress_rad[rows.clone()];
        let next = inside.partition_point(|p| *p < progress_rad);
        let (near, far) = match next {
            0 => return progress_rad / speed_rad_per_s,
            n if n == inside.len() => (rows.end - 1, None),
            n => (rows.start + n - 1, Some(rows.start + n)),
        };
        let left_rad = progress_rad - self.progress_rad[near];
        let step_s = far.map_or(left_rad / speed_rad_per_s, |far| {
            let step_rad = self.progress_rad[far] - self.progress_rad[near];
            (self.time_s[far] - self.time_s[near]) * left_rad / step_rad
        });
        self.time_s[near] + step_s
    }
}

/// The nominal circle in plain numbers.
struct Centred {
    x_m: f64,
    y_m: f64,
    radius_m: f64,
    start_rad: f64,
    direction: f64,
    speed_rad_per_s: f64,
}

impl Centred {
    fn of(nominal: &Circle) -> Self {
        Self {
            x_m: nominal.centre_x.as_m(),
            y_m: nominal.centre_y.as_m(),
            radius_m: nominal.radius.as_m(),
            start_rad: nominal.start_angle_rad,
            direction: nominal.direction.sign(),
            speed_rad_per_s: nominal.angular_speed_rad_per_s(),
        }
    }
}

fn column(axis: &AxisTrace, point: MeasuringPoint) -> Option<&[f64]> {
    match point {
        MeasuringPoint::Motor => Some(&axis.motor_position_m),
        MeasuringPoint::Table => axis.table_position_m.as_deref(),
    }
}

/// An angle from half a turn back to half a turn on.
pub fn wrapped(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

/// The command's angle, unwrapped both ways from the first evaluated row.
fn progress(x: &AxisTrace, y: &AxisTrace, circle: &Centred, start: usize) -> Vec<f64> {
    let raw: Vec<f64> = (x.setpoint_position_m.iter().zip(&y.setpoint_position_m))
        .map(|(x_m, y_m)| {
            let angle_rad = (y_m - circle.y_m).atan2(x_m - circle.x_m);
            circle.direction * (angle_rad - circle.start_rad)
        })
        .collect();
    let mut unwrapped = raw.clone();
    unwrapped[start] = wrapped(raw[start]);
    for row in start + 1..raw.len() {
        unwrapped[row] = unwrapped[row - 1] + wrapped(raw[row] - raw[row - 1]);
    }
    for row in (0..start).rev() {
        unwrapped[row] = unwrapped[row + 1] - wrapped(raw[row + 1] - raw[row]);
    }
    unwrapped
}

fn on_circle(x: &AxisTrace, y: &AxisTrace, circle: &Centred, measured: &Range<usize>) -> Range<usize> {
    let is_on = |row: &usize| {
        let (x_m, y_m) = (x.setpoint_position_m[*row] - circle.x_m, y.setpoint_position_m[*row] - circle.y_m);
        (x_m.hypot(y_m) - circle.radius_m).abs() < ON_CIRCLE_M
    };
    let before = (0..measured.start).rev().take_while(is_on).count();
    let after = (measured.end..x.setpoint_position_m.len()).take_while(is_on).count();
    measured.start - before..measured.end + after
}

/// The direction of the axis that turns around in a quadrant.
pub(super) const fn reversing_axis(quadrant: Quadrant) -> AxisId {
    match quadrant {
        Quadrant::XPlus | Quadrant::XMinus => AxisId::X,
        Quadrant::YPlus | Quadrant::YMinus => AxisId::Y,
    }
}
