//! The same seed gives the same records, to the bit: a run can be repeated, and a change that must not
//! change behaviour can be held to it.

use quadrant::base::record::CycleRecord;
use quadrant::base::units::{Position, Velocity};
use quadrant::config::{self, Machine};
use quadrant::rt::control::profile::CircleMotion;

use crate::circle_run::{self, Kept, paper_circle};

/// A circle small enough to reverse eight times in a few seconds.
fn small_circle() -> CircleMotion {
    let mut motion = paper_circle(2);
    motion.circle.radius = Position::mm(5.0);
    motion.circle.feed = Velocity::mm_per_min(1500.0);
    motion
}

fn records(machine: &Machine, seed: u64) -> Vec<CycleRecord> {
    let mut kept = Kept::default();
    circle_run::run(machine, "standard", small_circle(), seed, &mut kept);
    kept.0
}

/// Every number to its last bit, and what is not a number too.
fn text(record: &CycleRecord) -> String {
    format!("{record:?}")
}

#[test]
fn the_same_seed_gives_the_same_records_to_the_bit() {
    let machine = config::load("reference").expect("the embedded machine is right");
    let (one, other) = (records(&machine, 7), records(&machine, 7));
    assert_eq!(one.len(), other.len(), "cycles of two runs");
    assert!(one.len() > 5_000, "{} cycles are too few to tell", one.len());
    for (a, b) in one.iter().zip(&other) {
        assert_eq!(text(a), text(b));
    }
}

#[test]
fn another_seed_gives_other_noise() {
    let machine = config::load("reference").expect("the embedded machine is right");
    let (one, other) = (records(&machine, 7), records(&machine, 8));
    let same = one.iter().zip(&other).filter(|(a, b)| text(a) == text(b)).count();
    assert!(same * 100 < one.len(), "{same} of {} cycles are the same under another seed", one.len());
}
