//! Logs to be identified: a small list of motions through the shipped cycle, on machines whose parameters are known.

use std::collections::VecDeque;

use quadrant::base::axis::PerAxis;
use quadrant::base::motion::{Circle, Direction};
use quadrant::base::record::ModeTag;
use quadrant::base::units::{Acceleration, Position, Velocity};
use quadrant::config::Machine;
use quadrant::offline::trace::Trace;
use quadrant::rt::control::profile::{CircleMotion, LineMotion};
use quadrant::rt::door::Order;

use crate::common::Rig;

/// Periods of rest before each motion, so that it starts from rest.
const REST_CYCLES: u32 = 400;
/// Of the path.
const ACCELERATION: Acceleration = Acceleration::m_per_s2(1.0);

/// What a log holds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motions {
    pub(crate) ramps: usize,
    pub(crate) steady: bool,
    pub(crate) revolutions: u32,
}

pub(crate) const ALL: Motions = Motions { ramps: 8, steady: true, revolutions: 5 };

impl Motions {
    fn orders(self) -> VecDeque<Order> {
        // Both axes along the diagonal, so that each has this speed.
        let line = |place_mm: f64, mm_per_s: f64| {
            Order::Line(LineMotion {
                target: PerAxis::filled(2, Position::mm(place_mm)),
                feed: Velocity::mm_per_s(mm_per_s * std::f64::consts::SQRT_2),
                acceleration: ACCELERATION,
            })
        };
        let mut orders = VecDeque::new();
        for ramp in 0..self.ramps {
            // Forwards and backwards, each at another angle of the screw.
            let (place_mm, way_mm) = (1.3 * ramp as f64, if ramp % 2 == 0 { 0.12 } else { -0.12 });
            orders.extend([line(place_mm, 5.0), line(place_mm + way_mm, 0.05)]);
        }
        if self.steady {
            orders.push_back(line(-10.0, 5.0));
            for mm_per_s in [0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8] {
                orders.extend([line(-10.0 + 3.0 * mm_per_s, mm_per_s), line(-10.0, mm_per_s)]);
            }
            orders.push_back(line(-60.0, 50.0));
            for (mm_per_s, way_mm) in [
                (1.0, 12.0),
                (2.0, 12.0),
                (5.0, 22.0),
                (10.0, 32.0),
                (20.0, 44.0),
                (50.0, 80.0),
                (100.0, 130.0),
            ] {
                orders.extend([line(-60.0 + way_mm, mm_per_s), line(-60.0, mm_per_s)]);
            }
        }
        if self.revolutions > 0 {
            let motion = CircleMotion {
                circle: Circle {
                    centre_x: Position::ZERO,
                    centre_y: Position::ZERO,
                    radius: Position::mm(10.0),
                    feed: Velocity::mm_per_min(500.0),
                    direction: Direction::Ccw,
                    start_angle_rad: std::f64::consts::FRAC_PI_4,
                    revolutions: self.revolutions,
                },
                run_in_s: 0.5,
                run_out_s: 0.3,
                acceleration: ACCELERATION,
            };
            let (x, y) = motion.start();
            let mut target = PerAxis::filled(2, x);
            target.as_mut_slice()[1] = y;
            let feed = Velocity::mm_per_s(50.0);
            orders.push_back(Order::Line(LineMotion { target, feed, acceleration: ACCELERATION }));
            orders.push_back(Order::Circle(motion));
        }
        orders
    }
}

/// Runs motions and keeps every record as columns.
pub(crate) fn log(machine: &Machine, motions: Motions, seed: u64) -> Trace {
    let mut rig = Rig::new(machine.clone(), seed);
    rig.enable();
    let mut orders = motions.orders();
    let mut resting = 0;
    let mut is_over = false;
    let records = std::iter::from_fn(move || {
        if is_over {
            return None;
        }
        let is_ready = rig.last.axes.as_slice().iter().all(|axis| axis.mode == ModeTag::Ready);
        resting = if is_ready { resting + 1 } else { 0 };
        if resting >= REST_CYCLES {
            resting = 0;
            match orders.pop_front() {
                Some(order) => rig.order(order),
                None => is_over = true,
            }
        }
        let record = *rig.step();
        let faulted = record.axes.as_slice().iter().find_map(|axis| axis.fault);
        assert_eq!(faulted, None, "at cycle {}", record.cycle);
        Some(record)
    });
    Trace::from_records(records).expect("a trace")
}
