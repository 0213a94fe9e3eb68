//! A circular test in memory, without log and report: what benchmarks and tests of whole runs share.

use std::f64::consts::FRAC_PI_4;
use std::sync::Arc;

use quadrant::base::input::Inputs;
use quadrant::base::motion::{Circle, Direction};
use quadrant::base::record::CycleRecord;
use quadrant::base::units::{Acceleration, Position, Velocity};
use quadrant::config::Machine;
use quadrant::rt::control::profile::CircleMotion;
use quadrant::rt::cycle::pace::Virtual;
use quadrant::rt::cycle::procedure::{CircleTest, Ending, Procedure};
use quadrant::rt::cycle::{Cycle, conduct};
use quadrant::rt::door::Records;
use quadrant::sim::closed_loop::Wired;

/// Seed where it does not matter.
pub(crate) const SEED: u64 = 7;

/// The paper's circle: 150 mm at 2000 mm/min, counter-clockwise from 45 degrees.
pub(crate) fn paper_circle(revolutions: u32) -> CircleMotion {
    CircleMotion {
        circle: Circle {
            centre_x: Position::ZERO,
            centre_y: Position::ZERO,
            radius: Position::mm(150.0),
            feed: Velocity::mm_per_min(2000.0),
            direction: Direction::Ccw,
            start_angle_rad: FRAC_PI_4,
            revolutions,
        },
        run_in_s: 1.5,
        run_out_s: 0.3,
        acceleration: Acceleration::m_per_s2(0.5),
    }
}

/// The orders of a test with one circle.
pub(crate) fn procedure(machine: &Machine, gains: &str, motion: CircleMotion) -> Procedure {
    let test = CircleTest {
        gain_set: machine.gain_set(gains).expect("the machine has these gains"),
        circles: [Some(motion), None],
        positioning_feed: machine.motion.positioning_feed,
    };
    Procedure::new(test, Arc::default())
}

/// The machine's boards on a bus, and its cycle over commissioned drives.
pub(crate) fn wired(machine: &Machine, seed: u64) -> (Wired, Cycle) {
    let mut bus = Wired::new(machine.rack(seed));
    let drives = bus.commission(machine.drives().expect("each axis has its own node"));
    let drives = drives.expect("a simulated board says what its sheet says");
    (bus, Cycle::new(machine.cycle_settings(), drives, &machine.control_settings()))
}

/// Runs the whole test and gives each cycle to `records`.
pub(crate) fn run(
    machine: &Machine,
    gains: &str,
    motion: CircleMotion,
    seed: u64,
    records: &mut impl Records,
) {
    let (mut bus, mut cycle) = wired(machine, seed);
    let mut orders = procedure(machine, gains, motion);
    let mut grid = Virtual::new(machine.cycle.period);
    let last = conduct(&mut cycle, &mut bus, &mut grid, &mut orders, records);
    assert_eq!(orders.ending(&last), Ending::Complete, "the circle was not run to its end");
}

/// Records kept in memory.
#[derive(Default)]
pub(crate) struct Kept(pub(crate) Vec<CycleRecord>);

impl Records for Kept {
    fn put(&mut self, record: &CycleRecord, _inputs: &Inputs) {
        self.0.push(*record);
    }
    fn lost(&self) -> u64 {
        0
    }
}
