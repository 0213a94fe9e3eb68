//! What base parameters that are of a sensor alone change of a run: they move nothing, and nothing is simulated anew.
//!
//! ```text
//!   r = W (measured - gain simulated - zero)     ∂r / ∂zero = -W 1     ∂r / ∂(ln gain) = -W gain simulated = r - W measured
//! ```
//!
//! Invariant: a column is what two simulations would differ by, to first order.

use super::data::Part;
use super::problem::{Problem, Residual, SIGNALS};
use crate::offline::gap::measure::forward::DEFLECTION;

impl Problem<'_> {
    /// What of a run changes where the zero of a signal is simulated so much higher; nothing where a zero of its own may make up for that,
    /// or for some of it.
    pub(in crate::offline::gap) fn shifted(
        &self,
        place: usize,
        (shifted, by): (usize, f64),
        part: Part,
    ) -> Option<Residual> {
        if shifted == DEFLECTION && self.zero_reach_m() > 0.0 {
            return None;
        }
        let data = &self.data[place];
        let by = if shifted == DEFLECTION { by } else { by * self.position_step_m };
        Some(self.in_noise(place, part, |signal| {
            let rows = SIGNALS[signal].2(&data.measured).len();
            vec![if signal == shifted { -by } else { 0.0 }; rows]
        }))
    }

    /// What of a run changes where a signal is simulated larger by so small a share; `residual` is what is left of it.
    pub(super) fn enlarged(
        &self,
        place: usize,
        (enlarged, by): (usize, f64),
        part: Part,
        residual: &Residual,
    ) -> Residual {
        let measured = |signal: usize| {
            if signal == enlarged {
                SIGNALS[signal].2(&self.data[place].measured).to_vec()
            } else {
                Vec::new()
            }
        };
        let of = |(measured, left): (Vec<f64>, &Vec<f64>)| {
            let less = |(left, measured)| by * (left - measured);
            if measured.is_empty() {
                vec![0.0; left.len()]
            } else {
                left.iter().zip(measured).map(less).collect()
            }
        };
        self.in_noise(place, part, measured).into_iter().zip(residual).map(of).collect()
    }
}

#[cfg(test)]
pub(in crate::offline::gap) mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use super::*;
    use crate::base::axis::AxisId;
    use crate::config::{self, Machine};
    use crate::offline::gap::measure::floor::Noise;
    use crate::offline::gap::measure::forward::{Course, Signals};
    use crate::offline::gap::model::data::AxisData;
    use crate::offline::gap::model::twin::BASE;
    use crate::offline::gap::model::{Model, Tried};
    use crate::offline::gap::runs::{AxisRun, Run};
    use crate::plant::effects::entry;

    /// The same problem where that model was measured, without noise.
    pub(in crate::offline::gap) fn showing<'m>(problem: &Problem<'m>, truth: &Model) -> Problem<'m> {
        let mut data = problem.data[0].clone();
        data.measured = problem.simulated(0, truth);
        problem.with_data(Arc::new(vec![data]))
    }

    /// An axis that swings by so much to either side for three seconds, with the noise of a good one.
    pub(in crate::offline::gap) fn swinging(machine: &Machine, by_m: f64) -> Problem<'_> {
        let place_m = |row: usize| by_m * (1.0 - (row as f64 * 5e-4 * 6.0).cos());
        problem_of(machine, 6_000, place_m, [1e-7, 1e-7, 0.05])
    }

    /// Axis x of a machine that goes where it is told, hardly as it would; noise of each signal is so loud.
    pub(in crate::offline::gap) fn problem_of<'m>(
        machine: &'m Machine,
        rows: usize,
        place_m: impl Fn(usize) -> f64,
        loud: [f64; SIGNALS.len()],
    ) -> Problem<'m> {
        let period_s = machine.cycle.period.as_s();
        let axis = AxisRun {
            setpoint_m: (0..rows).map(&place_m).collect(),
            position_m: (0..rows).map(|row| place_m(row.saturating_sub(200))).collect(),
            table_m: Some((0..rows).map(|row| place_m(row.saturating_sub(201))).collect()),
            current_a: (0..rows).map(|row| 8.0 * (row as f64 * period_s * 4.0).sin()).collect(),
        };
        let measured = Signals::measured(&axis);
        let axes = BTreeMap::from([(AxisId::X, axis)]);
        let run = Run { name: "swing".to_owned(), start_s: 0.0, period_s, axes, is_sound: vec![true; rows] };
        let data = AxisData {
            run: 0,
            from: 0,
            course: Course::new(&run, machine, AxisId::X, 0, 0.0).expect("an axis"),
            measured,
            loudness: Default::default(),
            bend: Default::default(),
            moved: Default::default(),
            fit: (0..rows).map(|row| row >= 800).collect(),
            held: vec![false; rows],
            first_pass: rows,
            command: 0,
        };
        let noise = |left: f64| {
            let memory = vec![0.6, 0.1];
            Some(Noise {
                rms: left,
                is_from_repeats: true,
                memory,
                left,
                usual: 1.0,
                lines: Vec::new(),
                hides: 0.0,
                hidden: 0.0,
            })
        };
        Problem::new(machine, AxisId::X, 0, vec![data], loud.map(noise)).written_in(1e-6)
    }

    /// There and back.
    fn problem(machine: &Machine) -> Problem<'_> {
        let place_m = |row: usize| 0.01 * (1.0 - (row as f64 * 5e-4 * 4.0).cos());
        problem_of(machine, 3_000, place_m, [2e-7, 1e-7, 0.05])
    }

    #[test]
    fn what_a_sensor_shows_otherwise_is_what_two_simulations_differ_by() {
        let machine = config::load("paper").expect("a machine");
        let problem = problem(&machine);
        let model = Model::new(machine.axes[AxisId::X].plant);
        let here = problem.residual(0, &model, Part::Fit);
        for (coordinate, base) in BASE.iter().enumerate() {
            let column = match (base.zero_of, base.scale_of) {
                (Some(of), _) => problem.shifted(0, (of, base.prior), Part::Fit).expect("one zero"),
                (None, Some(of)) => problem.enlarged(0, (of, base.prior), Part::Fit, &here),
                (None, None) => continue,
            };
            const STEP: f64 = 1e-5;
            let mut at = model.coordinates();
            at[coordinate] += STEP;
            let there = problem.residual(0, &model.at(&at), Part::Fit);
            let largest = column.iter().flatten().fold(0.0, |most: f64, value| most.max(value.abs()));
            assert!(largest > 0.01, "{} moves nothing", base.name);
            for ((column, here), there) in
                column.iter().flatten().zip(here.iter().flatten()).zip(there.iter().flatten())
            {
                let differs = (there - here) / STEP;
                assert!((column - differs).abs() < 1e-4 * largest, "{}: {column} for {differs}", base.name);
            }
        }
    }

    #[test]
    fn a_force_that_is_always_there_moves_no_zero() {
        let machine = config::load("paper").expect("a machine");
        let problem = problem(&machine);
        let model = Model::new(machine.axes[AxisId::X].plant);
        let tried = Tried { entry: entry("constant-force").expect("an effect"), values: [60.0, 0.0, 0.0] };
        let [without, pushed] = [&model, &model.with(tried)].map(|model| problem.simulated(0, model));
        // 60 N are 0.4 um of a screw of 151 N/um, on the way there and on the way back.
        for rows in [1_000..1_300, 2_000..2_300] {
            let apart = |row: usize| pushed.deflection_m[row] - without.deflection_m[row];
            let mean_um = 1e6 * rows.clone().map(apart).sum::<f64>() / rows.len() as f64;
            assert!(mean_um.abs() < 0.02, "{mean_um} um at rows {rows:?}");
            let more = |row: usize| pushed.current_a[row] - without.current_a[row];
            let mean_a = rows.clone().map(more).sum::<f64>() / rows.len() as f64;
            assert!((-0.2..-0.05).contains(&mean_a), "{mean_a} A at rows {rows:?}");
        }
    }
}
