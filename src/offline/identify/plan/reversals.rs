//! Reversals: circles of two axes, lines to and fro of one, and small ones.
//!
//! Invariant: as large and as fast as there is room for; what has no room is said.

use std::f64::consts::PI;

use super::draft::Draft;
use super::{Planned, Purpose};
use crate::base::axis::AxisId;
use crate::base::motion::{Circle, Direction};
use crate::base::time::Span;
use crate::base::units::{Acceleration, Position, Velocity};
use crate::config::plan::CircleRequest;
use crate::rt::control::profile::CircleMotion;
use crate::rt::cycle::procedure::Step;

/// Circles: feed in mm/min, largest radius in mm.
const CIRCLES: [Round; 3] = [
    Round { feed_mm_per_min: 2000.0, radius_mm_max: 150.0, direction: Direction::Ccw, revolutions: 1 },
    Round { feed_mm_per_min: 2000.0, radius_mm_max: 150.0, direction: Direction::Cw, revolutions: 1 },
    Round { feed_mm_per_min: 500.0, radius_mm_max: 50.0, direction: Direction::Ccw, revolutions: 1 },
];
const RADIUS_MM_MIN: f64 = 2.0;

/// A circle that is wanted, as large as there is room for.
#[derive(Clone, Copy, Debug)]
pub(in crate::offline) struct Round {
    pub(in crate::offline) feed_mm_per_min: f64,
    pub(in crate::offline) radius_mm_max: f64,
    pub(in crate::offline) direction: Direction,
    pub(in crate::offline) revolutions: u32,
}

impl Draft<'_> {
    /// What the experiments have of circles.
    pub(super) fn circles(&mut self, gains: &str) {
        CIRCLES.iter().for_each(|round| self.round(gains, round));
    }

    /// A circle of the first two axes.
    pub(in crate::offline) fn round(&mut self, gains: &str, round: &Round) {
        let [x, y] = [AxisId::X, AxisId::Y];
        let half_mm =
            [x, y].map(|axis| 0.5 * self.width(axis).as_mm()).into_iter().fold(f64::INFINITY, f64::min);
        let feed_mm_per_min = round.feed_mm_per_min;
        let circle = Circle {
            centre_x: self.centre(x),
            centre_y: self.centre(y),
            radius: Position::mm(round.radius_mm_max.min(half_mm)),
            feed: Velocity::mm_per_min(feed_mm_per_min),
            direction: round.direction,
            start_angle_rad: std::f64::consts::FRAC_PI_4,
            revolutions: round.revolutions,
        };
        let request = CircleRequest { gains: gains.to_owned(), circle, directions: vec![round.direction] };
        let tested = self.machine.circle_test(&request).map(|test| test.circles[0]);
        match tested {
            Ok(Some(motion)) if circle.radius.as_mm() >= RADIUS_MM_MIN => self.circle(motion),
            Ok(_) => self.plan.left_out.push(format!(
                "no circle at {feed_mm_per_min} mm/min: the travel has room for a radius of {half_mm:.1} mm only"
            )),
            Err(why) => self.plan.left_out.push(format!("no circle at {feed_mm_per_min} mm/min: {why}")),
        }
    }

    fn circle(&mut self, motion: CircleMotion) {
        let (start, end) = (motion.start(), motion.end());
        // To the last digit: a circle is begun from its start only.
        let usual = self.machine.motion;
        for (axis, to) in [(AxisId::X, start.0), (AxisId::Y, start.1)] {
            let (feed, steep) = (usual.positioning_feed, usual.path_acceleration);
            self.run(axis, to, feed, steep, Purpose::Positioning);
        }
        let duration_s = motion.duration_s();
        self.plan.steps.push(Planned {
            step: Step::Circle(motion),
            purpose: Purpose::Reversal,
            axis: None,
            way: Position::m(motion.circle.feed.as_m_per_s() * duration_s),
            top_speed: motion.circle.feed,
            duration_s: duration_s + self.rest_s(AxisId::X, motion.circle.feed),
        });
        (self.place[0], self.place[1]) = end;
    }

    /// To and fro from the middle of the travel over each of these ways, each line taking so long.
    pub(in crate::offline) fn small_reversals(
        &mut self,
        axis: AxisId,
        ways_um: &[f64],
        swing: Span,
        times: usize,
    ) {
        let middle = self.centre(axis);
        self.go(axis, middle);
        for &way_um in ways_um {
            let way = Position::um(way_um);
            // Half of the time up and half down, nothing steady between.
            let feed = Velocity::m_per_s(2.0 * way.as_m() / swing.as_s());
            let steep = Acceleration::m_per_s2(PI * feed.as_m_per_s() / swing.as_s());
            for _ in 0..times {
                self.run(axis, middle + way, feed, steep, Purpose::Reversal);
                self.run(axis, middle, feed, steep, Purpose::Reversal);
            }
        }
    }

    /// What the experiments have of reversals of one axis.
    pub(super) fn swings(&mut self, axis: AxisId) {
        for round in CIRCLES.iter().filter(|round| round.direction == Direction::Ccw) {
            self.swing(axis, round, 3);
        }
    }

    /// So many lines of one axis to and fro that slow down as a circle does.
    pub(in crate::offline) fn swing(&mut self, axis: AxisId, round: &Round, lines: u32) {
        let feed = Velocity::mm_per_min(round.feed_mm_per_min).clamp_abs(self.speed_max(axis));
        let radius_m = (round.radius_mm_max * 1e-3).min(0.3 * self.width(axis).as_m());
        let slow = Acceleration::m_per_s2(feed.as_m_per_s().powi(2) / radius_m);
        let way = Position::m((PI * radius_m).min(self.width(axis).as_m()));
        let start = self.centre(axis) - way / 2.0;
        self.go(axis, start);
        for line in 0..lines {
            let to = if line % 2 == 0 { start + way } else { start };
            self.run(axis, to, feed, slow, Purpose::Reversal);
        }
    }
}
