//! All runs of a machine one after the other, as somebody would take them in a quarter of an hour less the pauses.
//! Invariant: the seed of the noise is another one in each run, and the clock of the session goes on.

use crate::controller::PERIOD;
use crate::features::Features;
use crate::machine::Machine;
use crate::plant::Plant;
use crate::rig::{self, Bump, Conditions, Row};

/// Between two runs, s.
const PAUSE: f64 = 5.0;

/// What a session is made with.
#[derive(Clone, Debug)]
pub struct Session<'a> {
    /// The machine as it is.
    pub machine: &'a Machine,
    /// Its axes as its controllers believe them to be.
    pub told: [Plant; 2],
    /// What it has that its file does not know.
    pub features: [Features; 2],
    /// Seed of the noise; `None`: no noise, and sensors without counts.
    pub noise: Option<u64>,
    /// Steps of the integration in a period.
    pub steps: usize,
    /// Something that happens once: in which run, and what.
    pub bump: Option<(usize, Bump)>,
    /// Wander of current and scale: A/s and m/s, by axis.
    pub drift: [[f64; 2]; 2],
}

impl<'a> Session<'a> {
    /// Without noise, with controllers that know their axes.
    pub fn quiet(machine: &'a Machine, features: [Features; 2], steps: usize) -> Self {
        let told = machine.axes.map(|axis| axis.plant);
        Self { machine, told, features, noise: None, steps, bump: None, drift: [[0.0; 2]; 2] }
    }

    /// The rows of each run.
    pub fn run(&self) -> Vec<Vec<Row>> {
        let mut start = 0.0;
        let mut all = Vec::with_capacity(self.machine.runs.len());
        for (number, run) in self.machine.runs.iter().enumerate() {
            let setpoints = run.setpoints();
            let conditions = Conditions {
                noise: self.noise.map(|seed| seed.wrapping_add(number as u64).wrapping_mul(2_654_435_761)),
                start,
                steps: self.steps,
                bump: self.bump.filter(|(run, _)| *run == number).map(|(_, bump)| bump),
                drift: self.drift,
            };
            all.push(rig::run(self.machine, &self.told, &self.features, &setpoints, &conditions));
            start += setpoints.len() as f64 * PERIOD + PAUSE;
        }
        all
    }

    /// When each run begins, s.
    pub fn starts(machine: &Machine) -> Vec<f64> {
        let mut start = 0.0;
        let begin = |run: &crate::path::Run| {
            let begin = start;
            start += run.setpoints().len() as f64 * PERIOD + PAUSE;
            begin
        };
        machine.runs.iter().map(begin).collect()
    }
}
