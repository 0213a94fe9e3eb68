//! What noise of the torque and counts of the encoder do to the mean of a run: a table that is held breaks away sooner where its motor
//! shakes, and a friction that falls is seen over all velocities that it is shaken through. A simulation without them does neither.
//!
//! ```text
//!   noise of passes ─► how much the torque shakes
//!   (f(θ, n, z) + f(θ, -n, z)) / 2 - f(θ), in the mean over some n and z ─► added to what a model makes of that run
//! ```
//!
//! `n` is noise with a memory; of what is linear in it nothing is left. `z` is where the counts of the encoder are, as the positions of the
//! run tell, or anywhere: the velocity loop answers to each count with a kick. Without noise a machine that sticks had a Stribeck friction
//! of 45 N, or a backlash of 0.1 um; without counts of 1 um, on bristles, a force of 18 N at 73 Hz, which shook it as they do.
//! Invariant: the same model and run are shaken the same way; a machine whose passes are all alike and whose encoder is fine is not shaken.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::Complex;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::Model;
use super::data::{AxisData, Part};
use super::problem::{Problem, SIGNALS};
use super::straight::bend;
use crate::base::units::Current;
use crate::config::machine::Axis;
use crate::offline::gap::measure::forward::{CURRENT, Signals, with_counts_of_motor};
use crate::offline::running_mean::running_mean;
use crate::plant::Parameters;

/// Pairs of draws.
const PAIRS: usize = 8;
/// For how long the torque remembers its noise, s. What moves the mean comes out alike for 10 to 80 ms where it is as loud in the following
/// error, for it is the loops that let it through.
const MEMORY_S: f64 = 0.03;
/// A torque that shakes by less than this share of the friction moves nothing.
const LEAST: f64 = 2e-3;
/// An axis that answers to a count with less than this share of the current of its friction is not shaken by it: it is over in a cycle.
const LEAST_PER_COUNT: f64 = 0.05;
/// Positions that stand alike beside counts have a mean of this length on the circle of one count.
const ALIKE: f64 = 0.9;

/// By how much noise moves the mean of each signal of a run.
#[derive(Debug, Default)]
pub(super) struct Moved {
    /// In the unit of the signal, row by row.
    pub(in crate::offline::gap) by: [Vec<f64>; SIGNALS.len()],
    /// Power of what chance leaves of that, whitened.
    pub(in crate::offline::gap) chance: [Vec<f64>; SIGNALS.len()],
}

impl Problem<'_> {
    /// The same with a torque that shakes by as much as passes in motion differ by: by what each signal can be shaken at most, less what its
    /// sensors do not resolve, as standard deviations. Not at all where nothing tells the noise.
    #[must_use]
    pub(in crate::offline::gap) fn shaken(mut self, model: &Model, unresolved: [f64; SIGNALS.len()]) -> Self {
        let Some(moving) = self.is_noise_told().then(|| self.in_motion(model)).flatten() else { return self };
        let Some(noise) = &self.noises[CURRENT] else { return self };
        let (unit, plant) = (Current::a(noise.rms), model.twin().plant);
        let of = |place: usize| {
            let response = moving.response(place, &plant, unit, 0);
            let of_signal = |signal: usize| {
                let rows = response[signal].iter().zip(moving.data[place].rows(Part::Fit));
                rows.filter(|(_, counts)| **counts)
                    .fold([0.0; 2], |[sum, rows], (by, _)| [sum + by * by, rows + 1.0])
            };
            std::array::from_fn::<_, { SIGNALS.len() }, _>(of_signal)
        };
        let all: Vec<_> = (0..moving.data.len()).into_par_iter().map(of).collect();
        let at_most = |signal: usize| {
            let noise = self.noises[signal].as_ref()?;
            let [sum, rows] =
                all.iter().fold([0.0; 2], |[sum, rows], of| [sum + of[signal][0], rows + of[signal][1]]);
            let seen2 = (noise.rms.powi(2) - unresolved[signal].powi(2)).max(0.0);
            (sum > 0.0).then(|| (seen2 * rows / sum).sqrt())
        };
        let times = (0..SIGNALS.len()).filter_map(at_most).fold(f64::INFINITY, f64::min);
        let friction = plant.actuator.current(plant.mechanics.torque_for_force(plant.friction.sliding));
        let is_felt = times.is_finite() && times * unit.as_a() > LEAST * friction.as_a();
        self.shakes = if is_felt { unit * times } else { Current::ZERO };
        self
    }

    /// By how much passes show the torque to shake, rms as a current; nothing where it is at rest or nothing tells.
    pub fn torque_noise(&self) -> Option<Current> {
        (self.shakes > Current::ZERO).then_some(self.shakes)
    }

    /// The same where noise moves means as it does about a model.
    #[must_use]
    pub fn with_means_about(&self, model: &Model) -> Self {
        let of = |(place, data): (usize, &AxisData)| AxisData {
            moved: self.moved_by_noise(place, model).by,
            ..data.clone()
        };
        self.with_data(Arc::new(self.data.iter().enumerate().map(of).collect()))
    }

    /// The axis with the counts of its machine file, where its loops answer to them with kicks.
    fn counting_axis(&self) -> Option<Axis> {
        let Parameters { mechanics, friction, .. } = &self.axis.plant;
        let count = self.machine.axes[self.id].scale.motor_resolution();
        let count_rad = count.as_m() / mechanics.travel_per_rad_m();
        let velocity = &self.machine.gains(self.id, self.gain_set).velocity;
        let kick_nm = velocity.proportional_nm_s_per_rad * count_rad / self.machine.cycle.period.as_s();
        let holds_nm = mechanics.torque_for_force(friction.sliding).as_nm();
        (kick_nm > LEAST_PER_COUNT * holds_nm).then(|| with_counts_of_motor(&self.axis, count))
    }

    /// By how much the mean of a run is moved for a model.
    pub(super) fn moved_by_noise(&self, place: usize, model: &Model) -> Moved {
        let counting = self.counting_axis();
        if self.shakes == Current::ZERO && counting.is_none() {
            return Moved::default();
        }
        let axis = counting.unwrap_or(self.axis);
        // What was written down more coarsely says nothing of counts.
        let tells = counting.is_some() && self.position_step_m == 0.0;
        let beside = tells.then(|| self.data[place].beside_counts(axis.scale.motor_resolution().as_m()));
        let beside = beside.flatten();
        let plant = model.twin().plant;
        let here = self.shaken_as(place, &plant, || Current::ZERO);
        let draws = (0..PAIRS).into_par_iter().map(|draw| {
            let both = self.both_ways(place, (&axis, &plant, beside), self.shakes, draw);
            SIGNALS.map(|(.., pick)| bend(&here, &both, pick))
        });
        let draws: Vec<_> = draws.collect();
        let mut moved = Moved::default();
        for (signal, noise) in self.noises.iter().enumerate() {
            let Some(noise) = noise else { continue };
            let rows = draws[0][signal].len();
            let mut mean: Vec<f64> = (0..rows)
                .map(|row| draws.iter().map(|draw| draw[signal][row]).sum::<f64>() / PAIRS as f64)
                .collect();
            let mut chance = vec![0.0; rows];
            for draw in &draws {
                let apart: Vec<f64> = draw[signal].iter().zip(&mean).map(|(by, mean)| by - mean).collect();
                let of_mean =
                    noise.whitened(&apart).into_iter().map(|by| by * by / (PAIRS * (PAIRS - 1)) as f64);
                chance.iter_mut().zip(of_mean).for_each(|(sum, power)| *sum += power);
            }
            // Of what is no more than chance makes of so few draws nothing is believed.
            let power: Vec<f64> = noise.whitened(&mean).into_iter().map(|by| by * by).collect();
            let [power, of_chance] = [power, chance.clone()].map(|rows| running_mean(&rows, self.near()));
            for (row, (power, of_chance)) in power.into_iter().zip(of_chance).enumerate() {
                let share = if of_chance < power { 1.0 - of_chance / power } else { 0.0 };
                mean[row] *= share;
                chance[row] *= share;
            }
            (moved.by[signal], moved.chance[signal]) = (mean, chance);
        }
        moved
    }

    /// What a run answers to noise of this loudness, to first order.
    fn response(
        &self,
        place: usize,
        plant: &Parameters,
        rms: Current,
        draw: usize,
    ) -> [Vec<f64>; SIGNALS.len()] {
        let both = self.both_ways(place, (&self.axis, plant, None), rms, draw);
        SIGNALS.map(|(.., pick)| {
            let [up, down] = both.each_ref().map(pick);
            up.iter().zip(down).map(|(up, down)| 0.5 * (up - down)).collect()
        })
    }

    /// A run with noise, and with the same the other way; begun half a count on where nothing tells how far beside counts its positions stand.
    fn both_ways(
        &self,
        place: usize,
        (axis, plant, beside): (&Axis, &Parameters, Option<f64>),
        rms: Current,
        draw: usize,
    ) -> [Signals; 2] {
        let forgets = self.machine.cycle.period.as_s() / MEMORY_S;
        let loudness = ((2.0 - forgets) / forgets).sqrt();
        let (data, count) = (&self.data[place], axis.scale.motor_resolution());
        [(loudness, 0), (-loudness, PAIRS)].map(|(loudness, further)| {
            let mut random = Pcg64Mcg::seed_from_u64((data.run * PAIRS + draw) as u64);
            let mut noise = 0.0;
            let shake = || {
                let white: f64 = StandardNormal.sample(&mut random);
                noise += (white - noise) * forgets;
                rms * (loudness * noise)
            };
            let of_count = beside.map_or((draw + further) as f64 / (2 * PAIRS) as f64, |beside| -beside);
            let course = data.course.shifted(count * of_count);
            course.run_shaken(axis, self.machine.cycle.position_every, self.gain_set, plant, shake)
        })
    }
}

impl AxisData {
    /// How far from whole counts its positions stand, in counts, if all stand as far.
    fn beside_counts(&self, count_m: f64) -> Option<f64> {
        let places_m = self.course.setpoints_m().zip(&self.measured.following_error_m);
        let none = (Complex::new(0.0, 0.0), 0.0);
        let (turns, rows) = places_m.fold(none, |(sum, rows), (setpoint_m, error_m)| {
            let turns = ((setpoint_m - error_m) / count_m).fract();
            (sum + Complex::from_polar(1.0, TAU * turns), rows + 1.0)
        });
        (turns.norm() > ALIKE * rows).then(|| turns.arg() / TAU)
    }

    /// Signals that a model makes without noise as they are in the mean.
    pub(super) fn add_moved(&self, signals: &mut Signals) {
        let each = [&mut signals.following_error_m, &mut signals.deflection_m, &mut signals.current_a];
        for (signal, moved) in each.into_iter().zip(&self.moved) {
            signal.iter_mut().zip(moved).for_each(|(row, by)| *row += by);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;
    use crate::base::units::Position;
    use crate::config::{self, Machine};
    use crate::offline::gap::measure::forward::{Course, FOLLOWING_ERROR};
    use crate::offline::gap::model::sensors::tests::problem_of;
    use crate::plant::effects::entry;
    use crate::rt::drive::velocity::VelocityEstimate;
    use crate::rt::wire::scaling::{AxisScale, ScaleSettings, Sense};

    /// Draws that no problem makes by itself.
    const OTHERS: std::ops::Range<usize> = 100..132;

    fn power(of: &[f64]) -> f64 {
        of.iter().map(|by| by * by).sum()
    }

    #[test]
    fn a_torque_shakes_by_what_passes_differ_by() {
        let machine = config::load("paper").expect("a machine");
        let place_m = |row: usize| 0.01 * (1.0 - (row as f64 * 5e-4 * 4.0).cos());
        let model = Model::new(machine.axes[AxisId::X].plant);
        let shakes = Current::a(0.02);
        let of = |loud: [f64; SIGNALS.len()]| problem_of(&machine, 12_000, place_m, loud);
        let probe = of([1.0; SIGNALS.len()]);
        let moving = probe.in_motion(&model).expect("it moves");
        let [response, ..] = moving.response(0, &model.twin().plant, shakes, OTHERS.start);
        let rows = response.iter().zip(&moving.data[0].fit).filter(|(_, counts)| **counts);
        let (sum, count) = rows.fold((0.0, 0.0), |(sum, count), (by, _)| (sum + by * by, count + 1.0));
        let seen_m = f64::sqrt(sum / count);
        let unresolved_m = 2.0 * seen_m;
        for (loud_m, unresolved_m) in [(seen_m, 0.0), (seen_m.hypot(unresolved_m), unresolved_m)] {
            // The others may be shaken by more, or by something else.
            let found = of([loud_m, 1.0, 1.0]).shaken(&model, [unresolved_m, 0.0, 0.0]).shakes.as_a();
            assert!((found / shakes.as_a() - 1.0).abs() < 0.2, "{found} A of {} A", shakes.as_a());
        }
        let mut untold = of([seen_m; SIGNALS.len()]);
        untold.noises[FOLLOWING_ERROR].as_mut().expect("a noise").is_from_repeats = false;
        assert_eq!(untold.shaken(&model, [0.0; SIGNALS.len()]).shakes, Current::ZERO);
    }

    #[test]
    fn noise_moves_the_mean_of_what_sticks_and_of_nothing_else() {
        let machine = config::load("paper").expect("a machine");
        let model = Model::new(machine.axes[AxisId::X].plant);
        let plant = model.twin().plant;
        let by_and_answer = |amplitude: Position, rad_per_s: f64| {
            let place_m = move |row: usize| amplitude.as_m() * (1.0 - (row as f64 * 5e-4 * rad_per_s).cos());
            let mut problem = problem_of(&machine, 6_000, place_m, [1e-7, 1e-7, 0.05]);
            problem.shakes = Current::a(0.1);
            let moved = problem.moved_by_noise(0, &model).by;
            let answer = problem.response(0, &plant, problem.shakes, 0);
            // As many other draws, one by one.
            let still = problem.shaken_as(0, &plant, || Current::ZERO);
            let all: Vec<[Signals; 2]> = OTHERS
                .map(|draw| problem.both_ways(0, (&problem.axis, &plant, None), problem.shakes, draw))
                .collect();
            let mean = |row: usize| {
                let sum: f64 = all.iter().flatten().map(|one| one.following_error_m[row]).sum();
                sum / (2 * all.len()) as f64 - still.following_error_m[row]
            };
            let others: Vec<f64> = (0..6_000).map(mean).collect();
            (moved[FOLLOWING_ERROR].clone(), answer[FOLLOWING_ERROR].clone(), others)
        };
        let (moved, answer, others) = by_and_answer(Position::um(20.0), 6.0);
        assert!(power(&moved) > 0.1 * power(&answer), "{} of {}", power(&moved), power(&answer));
        let apart: Vec<f64> = moved.iter().zip(&others).map(|(one, other)| one - other).collect();
        assert!(power(&apart) < 0.3 * power(&others), "{} of {}", power(&apart), power(&others));
        // From the first row on it slides.
        let (moved, answer, _) = by_and_answer(Position::mm(10.0), 1.0);
        let (moved, answer) = (&moved[1_000..5_000], &answer[1_000..5_000]);
        assert!(power(moved) < 1e-4 * power(answer), "{} of {}", power(moved), power(answer));
    }

    /// A machine on bristles that counts in micrometres.
    fn counting_um() -> Machine {
        let mut machine = config::load("paper").expect("a machine");
        let axis = &mut machine.axes[AxisId::X];
        axis.plant = axis.plant.with_effect(entry("presliding").expect("an effect"), [8.0, 0.0, 0.0]);
        axis.scale = AxisScale::new(&ScaleSettings {
            lead: Position::m(axis.plant.mechanics.lead_m),
            motor_counts_per_rev: 10_000,
            motor_sense: Sense::Along,
            table_counts_per_mm: None,
            table_sense: Sense::Along,
        });
        machine
    }

    /// A run there and back, slower than friction falls.
    fn creeping(machine: &Machine) -> Problem<'_> {
        let place_m = |row: usize| 1e-5 * (1.0 - (row as f64 * 5e-4 * 3.0).cos());
        problem_of(machine, 6_000, place_m, [1e-7, 1e-7, 0.05]).written_in(0.0)
    }

    #[test]
    fn counts_move_the_mean_of_what_creeps_and_fine_ones_nothing() {
        let machine = counting_um();
        let model = Model::new(machine.axes[AxisId::X].plant);
        let mut fine = machine.clone();
        fine.axes[AxisId::X].scale = config::load("paper").expect("a machine").axes[AxisId::X].scale;
        let [none, ..] = creeping(&fine).moved_by_noise(0, &model).by;
        assert!(none.is_empty(), "a count of it is no kick");
        let problem = creeping(&machine);
        let [moved, ..] = problem.moved_by_noise(0, &model).by;
        let seeing = |estimate| creeping(&machine).seeing(estimate).counting_axis().expect("it counts");
        for estimate in [VelocityEstimate::Difference, VelocityEstimate::SecondOrder] {
            assert_eq!(seeing(estimate).velocity_estimate, estimate, "as its loops were seen to do");
        }
        // Begun elsewhere within a count, with the counts of the machine.
        let (axis, plant, count) = (&machine.axes[AxisId::X], model.twin().plant, Position::um(1.0));
        let (every, course) = (machine.cycle.position_every, &problem.data[0].course);
        let error_m = |course: &Course, axis: &Axis| course.run(axis, every, 0, &plant).following_error_m;
        let still = error_m(course, &problem.axis);
        let all: Vec<Vec<f64>> = (0..64)
            .map(|part| error_m(&course.shifted(count * ((f64::from(part) + 0.5) / 64.0)), axis))
            .collect();
        let mean = |row: usize| all.iter().map(|one| one[row]).sum::<f64>() / 64.0 - still[row];
        let others: Vec<f64> = (0..6_000).map(mean).collect();
        assert!(power(&others) > 6_000.0 * 2e-7_f64.powi(2), "{} um", 1e6 * (power(&others) / 6e3).sqrt());
        let apart: Vec<f64> = moved.iter().zip(&others).map(|(one, other)| one - other).collect();
        assert!(power(&apart) < 0.3 * power(&others), "{} of {}", power(&apart), power(&others));
    }

    #[test]
    fn positions_tell_where_the_counts_of_a_run_are() {
        let machine = counting_um();
        let (axis, model) = (&machine.axes[AxisId::X], Model::new(machine.axes[AxisId::X].plant));
        let problem = creeping(&machine);
        for beside in [0.0, 0.3, -0.45] {
            let course = problem.data[0].course.shifted(Position::um(1.0) * -beside);
            let mut data = problem.data[0].clone();
            data.measured = course.run(axis, machine.cycle.position_every, 0, &model.twin().plant);
            let found = data.beside_counts(1e-6).expect("it was counted");
            assert!((found - beside).abs() < 1e-6, "{found} and not {beside} counts");
            let problem = problem.with_data(Arc::new(vec![data])).with_means_about(&model);
            let left = problem.left(0, &problem.simulated(0, &model), FOLLOWING_ERROR, Part::Fit);
            assert!(power(&left) < 6_000.0 * 1e-9_f64.powi(2), "{} um", 1e6 * (power(&left) / 6e3).sqrt());
        }
        assert_eq!(problem.data[0].beside_counts(1e-6), None, "of no encoder");
    }
}
