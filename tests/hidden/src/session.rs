//! All runs of a machine one after the other, as somebody would take them in a quarter of an hour less the pauses: each
//! recorded from a machine that was just switched on, or all in one go, with ways to the next start between them.
//! Invariant: the clock of the session goes on, and what is recorded apart has noise of its own.

use std::ops::Range;

use crate::controller::{PERIOD, Setpoint};
use crate::features::Features;
use crate::machine::Machine;
use crate::path;
use crate::plant::Plant;
use crate::rig::{self, Bump, Conditions, Row};

/// Between two runs that are recorded apart, s.
const PAUSE: f64 = 5.0;
/// Rest before and after each run of a session in one go, s, and how fast the machine goes to the next: m/s^2, m/s.
const REST: f64 = 0.8;
const APPROACH: [f64; 2] = [0.5, 0.05];

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

    /// All rows of a session in one go, and which of them are those of each run: only the first begins without being
    /// wound up.
    pub fn in_one_go(&self) -> (Vec<Row>, Vec<Range<usize>>) {
        let rest = (REST / PERIOD) as usize;
        let mut setpoints: Vec<[Setpoint; 2]> = Vec::new();
        let mut spans = Vec::new();
        for run in &self.machine.runs {
            let own = run.setpoints();
            let first = own[0].map(|at| at.place);
            if let Some(last) = setpoints.last() {
                setpoints.extend(path::straight(last.map(|at| at.place), first, APPROACH));
            }
            setpoints.extend(std::iter::repeat_n(first.map(at_rest), rest));
            let from = setpoints.len();
            setpoints.extend(&own);
            spans.push(from..setpoints.len());
            let last = own[own.len() - 1].map(|at| at_rest(at.place));
            setpoints.extend(std::iter::repeat_n(last, rest));
        }
        let in_session = |(run, bump): (usize, Bump)| {
            let from = spans[run].start as f64 * PERIOD;
            Bump { span: bump.span.map(|at| from + at), ..bump }
        };
        let conditions = Conditions {
            noise: self.noise,
            start: 0.0,
            steps: self.steps,
            bump: self.bump.map(in_session),
            drift: self.drift,
        };
        (rig::run(self.machine, &self.told, &self.features, &setpoints, &conditions), spans)
    }

    /// When each run that is recorded apart begins, s.
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

fn at_rest(place: f64) -> Setpoint {
    Setpoint { place, speed: 0.0 }
}
