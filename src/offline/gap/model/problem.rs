//! One axis with its runs: what a model leaves of them, as independent values of variance 1 where it is noise.
//!
//! ```text
//!   model ──► Course::run ──► Signals ──► measured less simulated ──► whitened ──► Residual, run by run
//! ```
//!
//! A table scale has a zero of its own, which is fitted: of the deflection only the change counts. Rows of the start, rows that were filled in and
//! what the filter remembers of them count nothing.
//! Invariant: what is compared is the same rows for every model.

use std::sync::Arc;

use super::Model;
use super::data::{AxisData, Part};
use super::straight::Counting;
use super::twin::BASE;
use super::zeros::{Zeros, about_zero, to_zero};
use crate::base::axis::AxisId;
use crate::base::time::Span;
use crate::base::units::Current;
use crate::config::Machine;
use crate::config::machine::Axis;
use crate::offline::gap::measure::floor::{Noise, Pick};
use crate::offline::gap::measure::forward::{DEFLECTION, Signals, without_counts};
use crate::offline::gap::runs::motions::tells;
use crate::offline::gap::runs::sparse::greatest_common_divisor;
use crate::offline::gap::runs::{Run, SETTLE_S};
use crate::plant::Parameters;
use crate::rt::drive::velocity::VelocityEstimate;

/// The signals of an axis, with their names and units.
pub const SIGNALS: [(&str, &str, Pick); 3] = [
    ("following error", "m", |signals| &signals.following_error_m),
    ("deflection", "m", |signals| &signals.deflection_m),
    ("current", "A", |signals| &signals.current_a),
];

/// Name of the signal of a place in [`SIGNALS`] as it is shown, how much more of its unit it is than in SI, and that unit.
pub fn shown(signal: usize) -> (&'static str, f64, &'static str) {
    let (name, unit, _) = SIGNALS[signal];
    if unit == "m" { (name, 1e6, "um") } else { (name, 1.0, unit) }
}

/// One axis with all its runs.
#[derive(Debug)]
pub struct Problem<'m> {
    /// The machine whose loops ran.
    pub machine: &'m Machine,
    /// Which axis.
    pub id: AxisId,
    /// That axis, with encoders that resolve everything.
    pub(in crate::offline::gap) axis: Axis,
    /// Which gains.
    pub gain_set: u8,
    /// Its runs.
    pub data: Arc<Vec<AxisData>>,
    /// By how much their rows count.
    counting: Arc<Vec<Counting>>,
    /// Noise of each signal; `None` where it was not measured.
    pub noises: [Option<Noise>; SIGNALS.len()],
    /// Base parameters that the rows say nothing of.
    untold: &'static [&'static str],
    /// Whether the force that is always there stays as it is.
    holds_force: bool,
    /// Where the zero of the table scale is.
    zeros: Zeros,
    /// Steps in which positions were written down, m; zero where they are no coarser than what the loops count.
    pub(super) position_step_m: f64,
    /// What encoders do not resolve of the deflection, m, as a standard deviation.
    pub(in crate::offline::gap) hidden_m: f64,
    /// How much the torque shakes, rms as a current.
    pub(in crate::offline::gap) shakes: Current,
}

/// What a model leaves of a run, whitened: signal by signal, row by row; zero where a row does not count.
pub type Residual = Vec<Vec<f64>>;

impl<'m> Problem<'m> {
    /// Of an axis.
    pub fn new(
        machine: &'m Machine,
        id: AxisId,
        gain_set: u8,
        data: Vec<AxisData>,
        noises: [Option<Noise>; SIGNALS.len()],
    ) -> Self {
        let axis = without_counts(&machine.axes[id]);
        let (data, zeros) = about_zero(data);
        let problem = Self {
            machine,
            id,
            axis,
            gain_set,
            data: Arc::default(),
            counting: Arc::default(),
            noises,
            untold: &[],
            holds_force: false,
            zeros,
            position_step_m: 0.0,
            hidden_m: 0.0,
            shakes: Current::ZERO,
        };
        problem.with_data(Arc::new(data))
    }

    /// The same with each command once: a second pass tells the same again, and takes as long to simulate. No rows of
    /// it judge.
    #[must_use]
    pub fn first_passes(&self) -> Self {
        let once = |data: &AxisData| {
            let rows = data.first_pass.min(data.fit.len());
            let first = |column: &Vec<f64>| column[..rows.min(column.len())].to_vec();
            let measured = Signals {
                following_error_m: first(&data.measured.following_error_m),
                deflection_m: first(&data.measured.deflection_m),
                current_a: first(&data.measured.current_a),
            };
            AxisData {
                run: data.run,
                from: data.from,
                course: data.course.first(rows),
                measured,
                loudness: data.loudness.each_ref().map(first),
                bend: data.bend.each_ref().map(first),
                moved: data.moved.each_ref().map(first),
                fit: data.fit[..rows].to_vec(),
                held: vec![false; rows],
                first_pass: rows,
                command: data.command,
            }
        };
        let tells = |data: &&AxisData| data.fit[..data.first_pass.min(data.fit.len())].contains(&true);
        let data = self.data.iter().filter(tells).map(once).collect();
        self.with_data(Arc::new(data))
    }

    /// The same where all noise is so many times as loud.
    #[must_use]
    pub fn louder(&self, by: f64) -> Self {
        let mut louder = self.with_data(self.data.clone());
        for noise in louder.noises.iter_mut().flatten() {
            (noise.rms, noise.left) = (by * noise.rms, by * noise.left);
        }
        louder
    }

    /// The same where the clock of each run is set forward, s.
    #[must_use]
    pub fn with_clocks(&self, behind_s: &[f64]) -> Self {
        let set = |(data, behind_s): (&AxisData, &f64)| AxisData {
            course: data.course.later(Span::s(*behind_s)),
            ..data.clone()
        };
        self.with_data(Arc::new(self.data.iter().zip(behind_s).map(set).collect()))
    }

    /// The same with positions that were written down in steps, m.
    #[must_use]
    pub fn written_in(self, position_step_m: f64) -> Self {
        Self { position_step_m, ..self }
    }

    /// The same with encoders that hide so much of the deflection, m, as a standard deviation.
    #[must_use]
    pub fn hiding(self, hidden_m: f64) -> Self {
        Self { hidden_m, ..self }
    }

    /// The same with loops that see the velocity another way.
    #[must_use]
    pub fn seeing(mut self, velocity_estimate: VelocityEstimate) -> Self {
        self.axis.velocity_estimate = velocity_estimate;
        self
    }

    /// The same axis with other data.
    #[must_use]
    pub fn with_data(&self, data: Arc<Vec<AxisData>>) -> Self {
        let counting = if Arc::ptr_eq(&data, &self.data) {
            self.counting.clone()
        } else {
            Arc::new(Counting::of(&data, self.near()))
        };
        Self { data, counting, axis: self.axis, noises: self.noises.clone(), ..*self }
    }

    /// The same with rows that say nothing of some base parameters.
    #[must_use]
    pub(super) fn not_telling(self, untold: &'static [&'static str]) -> Self {
        Self { untold, ..self }
    }

    /// The same where the force that is always there is known, and stays as it is, or where it is asked of the rows too.
    #[must_use]
    pub(in crate::offline::gap) fn holding_force(&self, holds_force: bool) -> Self {
        Self { holds_force, ..self.with_data(self.data.clone()) }
    }

    /// Where the zero of the table scale is.
    pub const fn zeros(&self) -> Zeros {
        self.zeros
    }

    /// The same with the zero of the table scale elsewhere.
    #[must_use]
    pub(in crate::offline::gap) fn with_zeros(&self, zeros: Zeros) -> Self {
        Self { zeros, ..self.with_data(self.data.clone()) }
    }

    /// Whether its table is seen.
    pub const fn has_table(&self) -> bool {
        self.noises[DEFLECTION].is_some()
    }

    /// Whether the rows say something of a coordinate of a model.
    pub(in crate::offline::gap) fn tells(&self, model: &Model, coordinate: usize) -> bool {
        match BASE.get(coordinate) {
            Some(base) if base.zero_of == Some(DEFLECTION) => self.has_table() && self.zeros == Zeros::OfAll,
            Some(base) if base.is_zero() => self.position_step_m > 0.0,
            Some(base) => !self.untold.contains(&base.name),
            None => !self.holds_force || model.constant_force() != Some(coordinate),
        }
    }

    /// Rows of a run that count: those after the start in which the machine does not rest, that are sound, as are those the
    /// filter remembers.
    pub fn counting(run: &Run, order: usize) -> Vec<bool> {
        let settled = (SETTLE_S / run.period_s) as usize;
        let tells = tells(run);
        let mut since_bad = 0;
        let of = |(row, is_sound): (usize, &bool)| {
            since_bad = if *is_sound { since_bad + 1 } else { 0 };
            row >= settled && since_bad > order && tells[row]
        };
        run.is_sound.iter().enumerate().map(of).collect()
    }

    /// What the model makes of a run, in the mean over what the torque shakes.
    pub fn simulated(&self, place: usize, model: &Model) -> Signals {
        let twin = model.twin();
        let position_zero_m = twin.position_zero_steps * self.position_step_m;
        let table_zero_m = twin.table_zero_m + twin.pushed_apart_m();
        let mut signals = self.shaken_as(place, &twin.plant, || Current::ZERO);
        self.data[place].add_moved(&mut signals);
        signals.current_a.iter_mut().for_each(|current_a| *current_a *= twin.current_gain);
        signals.deflection_m.iter_mut().for_each(|deflection_m| *deflection_m += table_zero_m);
        signals.following_error_m.iter_mut().for_each(|error_m| *error_m += position_zero_m);
        signals
    }

    /// What this plant makes of a run where the torque is that of so much more current from cycle to cycle.
    pub(super) fn shaken_as(
        &self,
        place: usize,
        plant: &Parameters,
        shake: impl FnMut() -> Current,
    ) -> Signals {
        let every = self.machine.cycle.position_every;
        self.data[place].course.run_shaken(&self.axis, every, self.gain_set, plant, shake)
    }

    /// Measured less simulated of the signal of a place in [`SIGNALS`], in its unit.
    pub fn left(&self, place: usize, simulated: &Signals, signal: usize, part: Part) -> Vec<f64> {
        let (data, (.., pick)) = (&self.data[place], SIGNALS[signal]);
        let less = |(measured, model)| measured - model;
        let mut left: Vec<f64> = pick(&data.measured).iter().zip(pick(simulated)).map(less).collect();
        if let (DEFLECTION, Some(noise)) = (signal, &self.noises[signal])
            && self.zero_reach_m() > 0.0
        {
            let Counting { deviations, weights, .. } = &self.counting[place];
            to_zero(&mut left, [deviations, &weights[part as usize]], [noise.rms, self.zero_reach_m()]);
        }
        left
    }

    /// What the model leaves of a part of a run.
    pub fn residual(&self, place: usize, model: &Model, part: Part) -> Residual {
        self.whitened(place, &self.simulated(place, model), part)
    }

    /// The same of what was simulated.
    pub fn whitened(&self, place: usize, simulated: &Signals, part: Part) -> Residual {
        self.in_noise(place, part, |signal| self.left(place, simulated, signal, part))
    }

    /// What is left of each signal of a run in the standard deviations of its noise; zero where a row does not count.
    pub(in crate::offline::gap) fn in_noise(
        &self,
        place: usize,
        part: Part,
        left: impl Fn(usize) -> Vec<f64>,
    ) -> Residual {
        let data = &self.data[place];
        let of = |(signal, noise): (usize, &Option<Noise>)| {
            let noise = noise.as_ref()?;
            let left = left(signal);
            if left.is_empty() {
                return Some(Vec::new());
            }
            let mut white = noise.whitened(&left);
            let rows = self.counting[place].scales[signal].iter().zip(data.rows(part));
            for (value, (scale, counts)) in white.iter_mut().zip(rows) {
                *value = if *counts { *value * scale } else { 0.0 };
            }
            Some(white)
        };
        self.noises.iter().enumerate().filter_map(of).collect()
    }

    /// Whether passes of the same command told the noise of all signals.
    pub fn is_noise_told(&self) -> bool {
        self.noises.iter().flatten().all(|noise| noise.is_from_repeats)
    }

    /// The runs that have rows of a part.
    pub fn places(&self, part: Part) -> Vec<usize> {
        (0..self.data.len()).filter(|place| self.data[*place].has(part)).collect()
    }

    /// When each run begins and ends, s.
    pub(in crate::offline::gap) fn spans_s(&self) -> Vec<[f64; 2]> {
        let period_s = self.period_s();
        let begins_s = self.data.iter().map(|data| data.course.begins().as_s());
        let lasts_s = self.data.iter().map(|data| data.fit.len() as f64 * period_s);
        begins_s.zip(lasts_s).map(|(begins_s, lasts_s)| [begins_s, begins_s + lasts_s]).collect()
    }

    /// Rows of a residual in so much time.
    pub fn rows_in(&self, time_s: f64) -> usize {
        ((time_s / self.period_s()) as usize).max(1)
    }
}

impl Problem<'_> {
    fn cycles(&self) -> usize {
        self.data.first().map_or(1, |data| data.course.cycles())
    }

    /// From row to row, s.
    pub(in crate::offline::gap) fn period_s(&self) -> f64 {
        self.machine.cycle.period.as_s() * self.cycles() as f64
    }

    /// After how many rows what the position loop does comes again.
    pub(in crate::offline::gap) fn rows_of_loop(&self) -> u32 {
        let every = self.machine.cycle.position_every;
        every / greatest_common_divisor(every as usize, self.cycles()) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::offline::gap::model::usual;

    #[test]
    fn a_force_that_is_known_is_asked_of_no_row_and_all_else_is() {
        let machine = config::load("paper").expect("a machine");
        let problem = Problem::new(&machine, AxisId::X, 0, Vec::new(), [None, None, None]);
        let model = usual::with(&Model::new(machine.axes[AxisId::X].plant));
        let force = model.constant_force().expect("it has one");
        // No table is seen, and so no zero of its scale.
        let is_machine = |coordinate: &usize| BASE.get(*coordinate).is_none_or(|base| !base.is_zero());
        let untold = |holds: bool| -> Vec<usize> {
            let problem = problem.holding_force(holds);
            let of_machine = (0..model.coordinate_count()).filter(is_machine);
            of_machine.filter(|coordinate| !problem.tells(&model, *coordinate)).collect()
        };
        assert_eq!(untold(true), [force]);
        assert!(untold(false).is_empty());
    }
}
