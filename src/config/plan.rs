//! From what a person asks of a circular test to the motion, checked against the machine.
//!
//! The run-in at full feed lasts until the position loop's lag has settled to a nanometre, so that the
//! evaluated turns begin in the steady state; the run-out lets the last reversal show its tail.
//! Invariant: a test that leaves the travel or passes a limit is refused before anything moves, with
//! axis, key, value, bound and unit.

use super::Machine;
use super::machine::AXIS_NAMES;
use crate::base::axis::AxisId;
use crate::base::motion::{Circle, Direction};
use crate::base::units::Position;
use crate::rt::control::profile::CircleMotion;
use crate::rt::cycle::procedure::{CIRCLES_MAX, CircleTest};

/// Most turns of one test.
pub const REVOLUTIONS_MAX: u32 = 1_000;
/// Longest test: its cycles and those of its twin are kept in memory, 3 MB for a second.
const DURATION_S_MAX: f64 = 1_800.0;
/// What the lag has to settle to before the evaluated turns.
const SETTLED: Position = Position::um(1e-3);
/// Shortest run-in and length of the run-out, s.
const RUN_IN_S_MIN: f64 = 0.2;
const RUN_OUT_S: f64 = 0.5;

/// What a person asks for.
#[derive(Clone, Debug, PartialEq)]
pub struct CircleRequest {
    /// Name of the gain set.
    pub gains: String,
    /// The circle; its direction is that of the first of `directions`.
    pub circle: Circle,
    /// Senses of rotation, in order.
    pub directions: Vec<Direction>,
}

/// Why a test cannot be made on a machine.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// No such gain set.
    #[error("gain set \"{wanted}\" is not in the machine file; it has {known}")]
    NoGainSet {
        /// Asked for.
        wanted: String,
        /// There are.
        known: String,
    },
    /// A circle needs two axes.
    #[error("machine {machine} has {axes} axis; a circle needs axes x and y")]
    TooFewAxes {
        /// The machine.
        machine: String,
        /// How many it has.
        axes: usize,
    },
    /// A quantity is outside its bounds.
    #[error("{what} = {value} {unit} is outside the allowed range of {low} to {high} {unit} ({why})")]
    OutOfRange {
        /// Option or quantity.
        what: String,
        /// Asked for.
        value: f64,
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
        /// Unit of all three.
        unit: &'static str,
        /// Where the bound comes from.
        why: String,
    },
}

fn within(
    what: impl Into<String>,
    value: f64,
    (low, high): (f64, f64),
    unit: &'static str,
    why: impl Into<String>,
) -> Result<(), PlanError> {
    if value >= low && value <= high {
        return Ok(());
    }
    // Rounded for the reader; the comparison was exact.
    let [value, low, high] = [value, low, high].map(|number| (number * 1e6).round() * 1e-6);
    Err(PlanError::OutOfRange { what: what.into(), value, low, high, unit, why: why.into() })
}

impl Machine {
    /// Number of the gain set of a plan.
    ///
    /// # Errors
    /// When there is no such gain set.
    pub fn planned_gain_set(&self, name: &str) -> Result<u8, PlanError> {
        self.gain_set(name)
            .ok_or_else(|| PlanError::NoGainSet { wanted: name.to_owned(), known: self.gain_sets.join(", ") })
    }

    /// The circular test that was asked for.
    pub fn circle_test(&self, request: &CircleRequest) -> Result<CircleTest, PlanError> {
        let gain_set = self.planned_gain_set(&request.gains)?;
        if self.axes.count() < 2 {
            return Err(PlanError::TooFewAxes { machine: self.name.clone(), axes: self.axes.count() });
        }
        self.check_circle(&request.circle)?;
        let mut circles = [None; CIRCLES_MAX];
        for (slot, direction) in circles.iter_mut().zip(&request.directions) {
            let motion = self.circle_motion(gain_set, Circle { direction: *direction, ..request.circle });
            self.check_acceleration(&motion)?;
            *slot = Some(motion);
        }
        let duration_s: f64 = circles.iter().flatten().map(CircleMotion::duration_s).sum();
        within(
            "duration of the test",
            duration_s,
            (0.0, DURATION_S_MAX),
            "s",
            "all of it is kept in memory",
        )?;
        Ok(CircleTest { gain_set, circles, positioning_feed: self.motion.positioning_feed })
    }

    fn check_circle(&self, circle: &Circle) -> Result<(), PlanError> {
        let angle_deg = circle.start_angle_rad.to_degrees();
        within("start angle", angle_deg, (-360.0, 360.0), "deg", "one turn")?;
        let radius_mm = circle.radius.as_mm();
        within("radius", radius_mm, (0.01, 1e5), "mm", "a circle")?;
        within("revolutions", circle.revolutions.into(), (1.0, REVOLUTIONS_MAX.into()), "turns", "one test")?;
        for (axis, centre) in [(AxisId::X, circle.centre_x), (AxisId::Y, circle.centre_y)] {
            let name = AXIS_NAMES[axis.index()];
            let limits = &self.axes[axis].control.limits;
            let travel = (limits.travel_min.as_mm(), limits.travel_max.as_mm());
            let why = format!("axis {name}: travel-min-mm and travel-max-mm");
            within(format!("centre {name}"), centre.as_mm(), travel, "mm", why)?;
            let room = (limits.travel_max - centre).as_mm().min((centre - limits.travel_min).as_mm());
            let why = format!("axis {name}: travel-min-mm and travel-max-mm around the centre");
            within("radius", radius_mm, (0.01, room.max(0.01)), "mm", why)?;
            let fastest = limits.velocity.as_mm_per_min();
            let why = format!("axis {name}: velocity-mm-per-s");
            within("feed", circle.feed.as_mm_per_min(), (1.0, fastest), "mm/min", why)?;
        }
        Ok(())
    }

    fn check_acceleration(&self, motion: &CircleMotion) -> Result<(), PlanError> {
        for axis in [AxisId::X, AxisId::Y] {
            let bound = self.axes[axis].control.limits.acceleration.as_m_per_s2();
            let why = format!(
                "axis {}: acceleration-m-per-s2; v^2/R and the path acceleration together",
                AXIS_NAMES[axis.index()]
            );
            let needed = motion.acceleration_max().as_m_per_s2();
            within("acceleration on the circle", needed, (0.0, bound), "m/s^2", why)?;
        }
        Ok(())
    }

    fn circle_motion(&self, gain_set: u8, circle: Circle) -> CircleMotion {
        let slowest_per_s = [AxisId::X, AxisId::Y]
            .map(|axis| self.gains(axis, gain_set).position.gain_per_s)
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        let lag_m = circle.feed.as_m_per_s() / slowest_per_s;
        let settle_s = (lag_m / SETTLED.as_m()).ln() / slowest_per_s;
        CircleMotion {
            circle,
            run_in_s: settle_s.max(RUN_IN_S_MIN),
            run_out_s: RUN_OUT_S,
            acceleration: self.motion.path_acceleration,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::units::Velocity;

    fn refused(change: impl Fn(&mut Circle)) -> String {
        let machine = crate::config::load("reference").unwrap();
        let mut circle = Circle {
            centre_x: Position::ZERO,
            centre_y: Position::ZERO,
            radius: Position::mm(150.0),
            feed: Velocity::mm_per_min(2000.0),
            direction: Direction::Cw,
            start_angle_rad: 0.0,
            revolutions: 1,
        };
        change(&mut circle);
        let request = CircleRequest { gains: "standard".to_owned(), circle, directions: vec![Direction::Cw] };
        machine.circle_test(&request).err().map_or("accepted".to_owned(), |error| error.to_string())
    }

    #[test]
    fn a_circle_is_judged_by_each_of_its_parts() {
        assert_eq!(refused(|_| ()), "accepted");
        for (change, words) in [
            ((|c| c.centre_x = Position::mm(300.0)) as fn(&mut Circle), "centre x = 300 mm"),
            (
                |c| c.centre_y = Position::mm(101.0),
                "radius = 150 mm is outside the allowed range of 0.01 to 149 mm",
            ),
            (|c| c.start_angle_rad = f64::NAN, "start angle = NaN deg"),
            (|c| c.feed = Velocity::mm_per_min(-1.0), "feed = -1 mm/min"),
            (|c| c.revolutions = 1_000, "duration of the test"),
        ] {
            let said = refused(change);
            assert!(said.contains(words), "`{words}` is not in `{said}`");
        }
    }
}
