//! A run from its command alone: what the machine of the file, with a plant that is tried, would have logged.
//!
//! ```text
//!   setpoints of the run ──► loops and plant of each axis ──► following error, deflection, current
//! ```
//!
//! Where the data begin in the middle of a motion the axis is taken to slide there; what is wrong with that fades,
//! and the rows of the first `SETTLE_S` are compared with nothing.
//! Units: m, A, s. Invariant: nothing measured drives the model but the first row.

use crate::base::axis::AxisId;
use crate::base::setpoint::Setpoint;
use crate::base::time::Span;
use crate::base::units::{Current, Force, Position, Velocity};
use crate::config::Machine;
use crate::config::machine::Axis;
use crate::offline::closed_axis::{ClosedAxis, Start};
use crate::offline::gap::runs::sparse::{between, cycles};
use crate::offline::gap::runs::{AxisRun, Run, setpoints};
use crate::plant::Parameters;
use crate::plant::effects::Neighbour;
use crate::rt::wire::scaling::{AxisScale, ScaleSettings, Sense};

/// An axis is at rest where at the first rows its setpoint is slower than this, m/s, and its motor than that: a count of its
/// encoder in these rows is no motion.
const AT_REST_M_PER_S: (f64, f64) = (2e-5, 1e-3);
/// Counts of encoders that resolve everything.
const FINE_COUNTS_PER_REV: u32 = 1 << 30;
const FINE_COUNTS_PER_MM: u32 = 100_000_000;
/// Rows to either side over which acceleration and current of another axis are measured: the noise of single rows would
/// make the force weaker than it is.
const SWING_ROWS: usize = 20;
/// As few as these where noise is no more than a share of what accelerates a table, which slips within a few rows.
const SLIP_ROWS: [usize; 4] = [2, 5, 10, SWING_ROWS];
const NOISE_SHARE: f64 = 0.05;
/// The state at the start is the mean of so many rows, of an axis at rest as long as its setpoint stays within that of
/// the first row, m.
const START_ROWS: usize = 16;
const STILL_M: f64 = 1e-9;

/// Places among the signals of those that have a zero of their own.
pub(in crate::offline::gap) const FOLLOWING_ERROR: usize = 0;
pub(in crate::offline::gap) const DEFLECTION: usize = 1;
pub(in crate::offline::gap) const CURRENT: usize = 2;

/// What is compared, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Signals {
    /// Setpoint less motor position, m.
    pub following_error_m: Vec<f64>,
    /// Motor position less table position, m; empty without a scale at the table.
    pub deflection_m: Vec<f64>,
    /// Motor current, A.
    pub current_a: Vec<f64>,
}

impl Signals {
    /// As measured.
    pub fn measured(axis: &AxisRun) -> Self {
        let less = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect();
        Self {
            following_error_m: less(&axis.setpoint_m, &axis.position_m),
            deflection_m: axis
                .table_m
                .as_ref()
                .map_or_else(Vec::new, |table_m| less(&axis.position_m, table_m)),
            current_a: axis.current_a.clone(),
        }
    }
}

/// The command of one axis in a run, with its start: all that the model is given.
#[derive(Clone, Debug)]
pub struct Course {
    /// In each cycle.
    setpoints: Vec<Setpoint>,
    /// From row to row.
    cycles: usize,
    start: Start,
    /// First cycle in which the position loop acts.
    phase: usize,
    has_table: bool,
    /// What the next axis did, as measured.
    next: Vec<Neighbour>,
}

impl Course {
    /// Of a run of a session that began at `origin_s`; the position loop acts in the cycle `phase` first.
    pub fn new(run: &Run, machine: &Machine, id: AxisId, phase: usize, origin_s: f64) -> Option<Self> {
        let axis = run.axes.get(&id)?;
        let next = neighbours(run, machine, id);
        let cycles = cycles(run, machine);
        let setpoints = setpoints(&between(&axis.setpoint_m, cycles), run.period_s / cycles as f64);
        let first = START_ROWS.min(axis.setpoint_m.len());
        let moved =
            (axis.position_m[first - 1] - axis.position_m[0]) / ((first - 1).max(1) as f64 * run.period_s);
        let is_at_rest =
            setpoints[0].velocity.as_m_per_s().abs() < AT_REST_M_PER_S.0 && moved.abs() < AT_REST_M_PER_S.1;
        let held = if is_at_rest { resting(axis).min(first) } else { first };
        let mean = |column: &[f64]| column[..held].iter().sum::<f64>() / held as f64;
        let mean_a = mean(&axis.current_a);
        let start = Start {
            position: Position::m(if is_at_rest { mean(&axis.position_m) } else { axis.position_m[0] }),
            velocity: Velocity::m_per_s(if is_at_rest { 0.0 } else { moved }),
            current: Current::a(mean_a),
            time: Span::s(run.start_s - origin_s),
        };
        Some(Self { setpoints, cycles, start, phase, has_table: axis.table_m.is_some(), next })
    }

    /// The same with another current at its start, A, if it begins at rest.
    #[must_use]
    pub fn resting_at(mut self, current_a: Option<f64>) -> Self {
        if self.start.velocity == Velocity::ZERO {
            self.start.current = current_a.map_or(self.start.current, Current::a);
        }
        self
    }

    /// Its first rows.
    #[must_use]
    pub fn first(&self, rows: usize) -> Self {
        let mut first = self.clone();
        first.setpoints.truncate(rows * self.cycles);
        first.next.truncate(rows);
        first
    }

    /// When it begins, on the clock of the session.
    pub const fn begins(&self) -> Span {
        self.start.time
    }

    /// The same begun so much later.
    #[must_use]
    pub fn later(&self, by: Span) -> Self {
        let mut later = self.clone();
        later.start.time = later.start.time + by;
        later
    }

    /// The same so far away.
    #[must_use]
    pub(in crate::offline::gap) fn shifted(&self, by: Position) -> Self {
        let mut shifted = self.clone();
        shifted.setpoints.iter_mut().for_each(|setpoint| setpoint.position += by);
        shifted.start.position += by;
        shifted
    }

    /// What the axis is asked for, row by row.
    pub fn setpoints(&self) -> impl Iterator<Item = &Setpoint> {
        self.setpoints.iter().step_by(self.cycles)
    }

    /// Cycles of the loops from row to row.
    pub const fn cycles(&self) -> usize {
        self.cycles
    }

    /// Where it should be, m, row by row.
    pub fn setpoints_m(&self) -> impl Iterator<Item = f64> {
        self.setpoints().map(|setpoint| setpoint.position.as_m())
    }

    /// The run with this plant behind the loops of an axis, whose position loop acts every so many cycles.
    pub fn run(&self, axis: &Axis, every: u32, gain_set: u8, plant: &Parameters) -> Signals {
        self.run_shaken(axis, every, gain_set, plant, || Current::ZERO)
    }

    /// The same where the torque is that of so much more current from cycle to cycle.
    pub fn run_shaken(
        &self,
        axis: &Axis,
        every: u32,
        gain_set: u8,
        plant: &Parameters,
        mut shake: impl FnMut() -> Current,
    ) -> Signals {
        let every = every as usize;
        let rows = self.setpoints.len() / self.cycles;
        let closed = ClosedAxis::taken_over(axis, gain_set, plant, &self.start);
        let mut closed = if self.has_table { closed.with_table() } else { closed };
        let mut signals = Signals {
            following_error_m: Vec::with_capacity(rows),
            deflection_m: Vec::with_capacity(if self.has_table { rows } else { 0 }),
            current_a: Vec::with_capacity(rows),
        };
        for (cycle, setpoint) in self.setpoints.iter().enumerate() {
            let next = self.next.get(cycle / self.cycles);
            let logged = closed.row(setpoint, cycle % every == self.phase, next);
            if cycle.is_multiple_of(self.cycles) {
                signals.following_error_m.push((setpoint.position - logged.position).as_m());
                signals
                    .deflection_m
                    .extend(logged.table_position.map(|table| (logged.position - table).as_m()));
                signals.current_a.push(logged.current.as_a());
            }
            closed.pass_shaken(shake());
        }
        signals
    }
}

/// Rows at the start of a run in which the setpoint of an axis stands.
pub fn resting(axis: &AxisRun) -> usize {
    axis.setpoint_m
        .iter()
        .take_while(|setpoint_m| (**setpoint_m - axis.setpoint_m[0]).abs() <= STILL_M)
        .count()
}

/// What the next axis did, row by row; nothing where it was not measured.
fn neighbours(run: &Run, machine: &Machine, id: AxisId) -> Vec<Neighbour> {
    let next = AxisId::new((id.index() + 1) % machine.axes.count());
    let (true, Some(axis)) = (next != id, run.axes.get(&next)) else { return Vec::new() };
    let plant = &machine.axes[next].plant;
    let table_m = axis.table_m.as_ref().unwrap_or(&axis.position_m);
    let last = table_m.len() - 1;
    let slip_rows = slip_rows(table_m, run.period_s);
    let mut sums_a = vec![0.0];
    for current_a in &axis.current_a {
        sums_a.push(sums_a[sums_a.len() - 1] + current_a);
    }
    let of = |row: usize| {
        let [from, to] = [row.saturating_sub(SWING_ROWS), (row + SWING_ROWS).min(last)];
        let of_motor_m_per_s2 = acceleration_m_per_s2(&axis.position_m, run.period_s, row, SWING_ROWS);
        let of_table_m_per_s2 = acceleration_m_per_s2(table_m, run.period_s, row, slip_rows);
        let mean_a = (sums_a[to + 1] - sums_a[from]) / (to + 1 - from) as f64;
        let motor = plant.mechanics.force_of_torque(plant.actuator.torque(Current::a(mean_a)));
        Neighbour {
            table: Position::m(table_m[row]),
            // What its motor needs for itself is no force of its screw.
            force: motor - Force::n(plant.mechanics.motor_mass_kg() * of_motor_m_per_s2),
            accelerating: Force::n(plant.mechanics.mass_kg * of_table_m_per_s2),
        }
    };
    (0..=last).map(of).collect()
}

/// Of a column of places about a row, over so many rows to either side.
fn acceleration_m_per_s2(column: &[f64], period_s: f64, row: usize, rows: usize) -> f64 {
    let [from, to] = [row.saturating_sub(rows), (row + rows).min(column.len() - 1)];
    let side_s = 0.5 * (to - from).max(1) as f64 * period_s;
    let [before, here, after] = [from, usize::midpoint(from, to), to].map(|row| column[row]);
    (before - 2.0 * here + after) / (side_s * side_s)
}

/// Rows to either side over which the acceleration of a table is measured: the fewest in which noise of its scale is little of it.
fn slip_rows(column: &[f64], period_s: f64) -> usize {
    let mut third: Vec<f64> =
        column.windows(4).map(|four| (four[3] - 3.0 * four[2] + 3.0 * four[1] - four[0]).abs()).collect();
    let ninth = third.len() * 9 / 10;
    if ninth == third.len() {
        return SWING_ROWS;
    }
    // Of normal noise nine tenths are within 1.645 deviations, and a third difference has 20 times its variance; one in ten rows may slip.
    let noise_m = *third.select_nth_unstable_by(ninth, f64::total_cmp).1 / (1.645 * 20.0_f64.sqrt());
    let all = (0..column.len()).map(|row| acceleration_m_per_s2(column, period_s, row, SWING_ROWS).powi(2));
    let moves_m_per_s2 = (all.sum::<f64>() / column.len() as f64).sqrt();
    let is_little = |rows: &usize| {
        let side_s = *rows as f64 * period_s;
        6.0_f64.sqrt() * noise_m / (side_s * side_s) < NOISE_SHARE * moves_m_per_s2
    };
    SLIP_ROWS.into_iter().find(is_little).unwrap_or(SWING_ROWS)
}

/// An axis whose encoders resolve everything. Counts of the simulation are no more those of the measurement than its
/// noise would be: they would be noise twice.
pub fn without_counts(axis: &Axis) -> Axis {
    counting(axis, FINE_COUNTS_PER_REV)
}

/// The same axis with counts of its motor, which its loops answer to, and a table scale that resolves everything.
pub(in crate::offline::gap) fn with_counts_of_motor(axis: &Axis, count: Position) -> Axis {
    counting(axis, (axis.plant.mechanics.lead_m / count.as_m()).round() as u32)
}

fn counting(axis: &Axis, motor_counts_per_rev: u32) -> Axis {
    let scale = AxisScale::new(&ScaleSettings {
        lead: Position::m(axis.plant.mechanics.lead_m),
        motor_counts_per_rev,
        motor_sense: Sense::Along,
        table_counts_per_mm: Some(FINE_COUNTS_PER_MM),
        table_sense: Sense::Along,
    });
    Axis { scale, ..*axis }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::config;

    #[test]
    fn a_count_of_the_encoder_is_no_motion() {
        let machine = config::load("paper").expect("a machine");
        let rows = 400;
        let count_m = 2e-7;
        let axis = AxisRun {
            setpoint_m: vec![0.0; rows],
            // From one count to the next in the first rows.
            position_m: (0..rows).map(|row| if row < 8 { 0.0 } else { count_m }).collect(),
            table_m: None,
            current_a: vec![0.0; rows],
        };
        let run = Run {
            name: "standing".to_owned(),
            start_s: 0.0,
            period_s: 5e-4,
            axes: BTreeMap::from([(AxisId::X, axis)]),
            is_sound: vec![true; rows],
        };
        let course = Course::new(&run, &machine, AxisId::X, 0, 0.0).expect("an axis");
        let x = &machine.axes[AxisId::X];
        let made = course.run(&without_counts(x), machine.cycle.position_every, 0, &x.plant);
        let furthest = made.following_error_m.iter().fold(0.0, |far: f64, error| far.max(error.abs()));
        assert!(furthest < count_m, "it is taken to slide, and jumps by {} um", 1e6 * furthest);
    }

    #[test]
    fn a_slip_is_seen_where_noise_lets_it() {
        // 0.4 m/s^2 in a circle, and a slip of 20 ms in which a table makes up for 2 um, by encoders of 1 nm, 0.5 and 2 um.
        let place = |row: usize, count_m: f64| {
            let t = row as f64 * 5e-4;
            let circle_m = 0.01 * (1.0 - (6.3 * t).cos());
            ((circle_m + 2e-6 * ((t - 1.0) / 0.02).clamp(0.0, 1.0)) / count_m).round() * count_m
        };
        let rows = |count_m: f64| {
            let column: Vec<f64> = (0..4_000).map(|row| place(row, count_m)).collect();
            slip_rows(&column, 5e-4)
        };
        assert_eq!([1e-9, 5e-7, 2e-6].map(rows), [2, 10, 20]);
        assert_eq!(slip_rows(&[0.0; 3], 5e-4), SWING_ROWS);
    }
}
