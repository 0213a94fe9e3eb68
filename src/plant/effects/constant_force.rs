//! Constant force on the table: weight, a counterweight that is not right, a pulling hose.
//!
//! Positive in the direction of the axis. The zero of a current measurement looks the same in the current, but
//! moves nothing when a drive without brake is let go.
//! Invariant: conservative.

use super::catalogue::{Coordinate, Entry, Experiment, Parameter};
use super::hooks::{Action, Force, Instant, Memory, Pace};

pub(super) const ENTRY: Entry = Entry {
    name: "constant-force",
    summary: "a force on the table that is always there",
    equation: "M v_t' = ... + F_0",
    parameters: &[Parameter::new("force-n", "N", [-20_000.0, 20_000.0], 50.0, 100.0)],
    coordinate: Coordinate::Direction,
    experiment: Experiment::Sweep,
    aliases: &["direction-asymmetry"],
    law_of: None,
    action: Action::Force(|values, _| Box::new(Constant { force_n: values[0] })),
};

#[derive(Debug)]
struct Constant {
    force_n: f64,
}

impl Force for Constant {
    fn on_table_n(&self, _at: &Instant, _memory: &Memory) -> f64 {
        self.force_n
    }
    fn pace(&self) -> Pace {
        Pace::Slow
    }
}
