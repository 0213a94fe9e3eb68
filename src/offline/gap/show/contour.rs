//! What runs are to a circular test: measured, and simulated from their commands before and after.
//!
//! ```text
//!   setpoints of X and Y ──► circle ──► motors and tables as measured, by the base, by what was named ──► ISO 230-4
//! ```
//!
//! A scale has its own zero: tables are drawn where the base has them on average.
//! Invariant: all three are judged over the same rows of the same circle.

use std::collections::BTreeSet;
use std::ops::Range;

use super::answer::AxisGap;
use crate::base::axis::AxisId;
use crate::base::motion::Circle;
use crate::base::units::Position;
use crate::offline::circle::{self, CircularTest, PointAnalysis};
use crate::offline::gap::measure::forward::Signals;
use crate::offline::gap::runs::circles::circles_of;
use crate::offline::gap::runs::{AxisRun, Run};
use crate::offline::trace::{AxisTrace, Trace};

/// Circles whose numbers differ by no more are one: m, and as a share of the feed.
const SAME: (f64, f64) = (2e-6, 2e-3);
/// Rows to either side over which the velocity of a motor is measured.
const SIDE_ROWS: usize = 5;

/// A circle of some runs.
#[derive(Debug)]
pub struct Contour {
    /// Its runs.
    pub runs: Vec<usize>,
    /// Whether no model was fitted to any of them.
    pub is_held: bool,
    /// As measured.
    pub measured: CircularTest,
    /// As the base makes it, and the named model.
    pub simulated: [CircularTest; 2],
    /// Radial deviation measured less simulated, rms, um, of both; and what noise makes of it.
    pub contour_um: [f64; 2],
    /// See `contour_um`.
    pub floor_um: f64,
}

/// Where a circular test is judged: at the table where a scale shows it, otherwise at the motors.
pub fn point(test: &CircularTest) -> &PointAnalysis {
    test.table.as_ref().unwrap_or(&test.motor)
}

/// The circles among the runs of X and Y, those of the same circle together.
pub fn contours(runs: &[Run], axes: &[AxisGap<'_>]) -> Vec<Contour> {
    let of = |id: AxisId| axes.iter().find(|axis| axis.id == id);
    let (Some(x), Some(y)) = (of(AxisId::X), of(AxisId::Y)) else { return Vec::new() };
    let mut groups: Vec<Vec<Traced>> = Vec::new();
    for traced in (0..runs.len()).filter_map(|run| Traced::all(run, &runs[run], [x, y])).flatten() {
        match groups.iter_mut().find(|group| is_same(&group[0].nominal, &traced.nominal)) {
            Some(group) => {
                let Circle { direction, start_angle_rad, .. } = traced.nominal;
                let nominal = Circle { direction, start_angle_rad, ..group[0].nominal };
                group.push(Traced { nominal, ..traced });
            }
            None => groups.push(vec![traced]),
        }
    }
    groups.iter().filter_map(|group| Contour::of(group, [x, y])).collect()
}

fn is_same(one: &Circle, other: &Circle) -> bool {
    let near = |a: Position, b: Position| (a - b).as_m().abs() <= SAME.0;
    near(one.centre_x, other.centre_x)
        && near(one.centre_y, other.centre_y)
        && near(one.radius, other.radius)
        && one.revolutions == other.revolutions
        && (one.feed.as_m_per_s() / other.feed.as_m_per_s() - 1.0).abs() <= SAME.1
}

/// A run along a circle.
struct Traced {
    run: usize,
    nominal: Circle,
    is_held: bool,
    /// As measured, by the base, by the named model.
    traces: [Trace; 3],
}

impl Traced {
    /// The circles of a run.
    fn all(number: usize, run: &Run, axes: [&AxisGap<'_>; 2]) -> Option<Vec<Self>> {
        let measured = [run.axes.get(&AxisId::X)?, run.axes.get(&AxisId::Y)?];
        let circles = circles_of(run.period_s, measured.map(|axis| axis.setpoint_m.as_slice()));
        let place = |axis: &AxisGap<'_>| axis.problem.data.iter().position(|data| data.run == number);
        let places = [place(axes[0])?, place(axes[1])?];
        if circles.is_empty() {
            return None;
        }
        let simulated = |which: usize| {
            [0, 1].map(|axis: usize| {
                let AxisGap { problem, named, .. } = axes[axis];
                let model = [&named.base.model, &named.model.model][which];
                let from = problem.data[places[axis]].from;
                Columns::simulated(measured[axis], from, &problem.simulated(places[axis], model))
            })
        };
        let all = [measured.map(Columns::measured), simulated(0), simulated(1)];
        let is_held = axes.iter().zip(places).all(|(axis, place)| {
            let data = &axis.problem.data[place];
            !data.fit.contains(&true) && data.held.contains(&true)
        });
        let of = |(nominal, rows): (Circle, Range<usize>)| {
            let mut all = all.clone();
            for axis in 0..2 {
                let [measured, base, named] = &mut all;
                measured[axis].shift_table(&base[axis], &rows);
                named[axis].shift_table(&base[axis], &rows);
            }
            Self { run: number, nominal, is_held, traces: all.map(|columns| trace(run, &rows, columns)) }
        };
        Some(circles.into_iter().map(of).collect())
    }
}

/// What a trace has of an axis.
#[derive(Clone)]
struct Columns {
    setpoint_m: Vec<f64>,
    motor_m: Vec<f64>,
    table_m: Option<Vec<f64>>,
}

impl Columns {
    fn measured(axis: &AxisRun) -> Self {
        Self {
            setpoint_m: axis.setpoint_m.clone(),
            motor_m: axis.position_m.clone(),
            table_m: axis.table_m.clone(),
        }
    }

    /// As measured in the rows that were not simulated, before the one in which that begins and after its last.
    fn simulated(axis: &AxisRun, from: usize, signals: &Signals) -> Self {
        let mut all = Self::measured(axis);
        for (row, error_m) in signals.following_error_m.iter().enumerate() {
            all.motor_m[from + row] = all.setpoint_m[from + row] - error_m;
        }
        for (row, deflection_m) in signals.deflection_m.iter().enumerate() {
            if let Some(table_m) = &mut all.table_m {
                table_m[from + row] = all.motor_m[from + row] - deflection_m;
            }
        }
        all
    }

    /// The table is moved so that it is as far from the motor on average as that of another.
    fn shift_table(&mut self, other: &Self, rows: &Range<usize>) {
        let mean = |columns: &Self| {
            let table_m = columns.table_m.as_ref()?;
            let apart = rows.clone().map(|row| columns.motor_m[row] - table_m[row]).sum::<f64>();
            Some(apart / rows.len() as f64)
        };
        let Some((own, wanted)) = mean(self).zip(mean(other)) else { return };
        self.table_m.iter_mut().flatten().for_each(|table| *table += own - wanted);
    }
}

fn trace(run: &Run, measured: &Range<usize>, axes: [Columns; 2]) -> Trace {
    let rows = run.len();
    let slope = |column: &[f64], row: usize| {
        let (low, high) = (row.saturating_sub(SIDE_ROWS), (row + SIDE_ROWS).min(rows - 1));
        (column[high] - column[low]) / ((high - low) as f64 * run.period_s)
    };
    let axis = |columns: Columns| AxisTrace {
        setpoint_velocity_m_per_s: (0..rows).map(|row| slope(&columns.setpoint_m, row)).collect(),
        velocity_m_per_s: (0..rows).map(|row| slope(&columns.motor_m, row)).collect(),
        setpoint_position_m: columns.setpoint_m,
        motor_position_m: columns.motor_m,
        table_position_m: columns.table_m,
        is_fresh: run.is_sound.clone(),
        ..AxisTrace::default()
    };
    Trace {
        period_s: run.period_s,
        cycle: (0..rows as u64).collect(),
        time_s: (0..rows).map(|row| row as f64 * run.period_s).collect(),
        motion: vec![1; rows],
        is_measured: (0..rows).map(|row| measured.contains(&row)).collect(),
        axes: axes.map(axis).into(),
        gaps: Vec::new(),
        overruns: 0,
        lost_records: 0,
    }
}

impl Contour {
    /// Nothing where a path cannot be judged.
    fn of(group: &[Traced], axes: [&AxisGap<'_>; 2]) -> Option<Self> {
        let test = |which: usize| {
            let run = |traced| {
                let Traced { nominal, traces, .. }: &Traced = traced;
                circle::Run { nominal: *nominal, trace: &traces[which], friction_free: None }
            };
            let all: Vec<circle::Run<'_>> = group.iter().map(run).collect();
            circle::analyse(&all).ok()
        };
        let (measured, simulated) = (test(0)?, [test(1)?, test(2)?]);
        let contour_um = simulated.each_ref().map(|simulated| apart_um(point(&measured), point(simulated)));
        let of_axis = |axis: &AxisGap<'_>| -> f64 {
            let signals = if measured.table.is_some() { 0..2 } else { 0..1 };
            signals.filter_map(|signal| Some(axis.problem.noises[signal].as_ref()?.rms.powi(2))).sum()
        };
        // What of each axis is radial: half of its power.
        let floor_um = 1e6 * (0.5 * axes.map(of_axis).iter().sum::<f64>()).sqrt();
        Some(Self {
            runs: group.iter().map(|traced| traced.run).collect::<BTreeSet<usize>>().into_iter().collect(),
            is_held: group.iter().all(|traced| traced.is_held),
            measured,
            simulated,
            contour_um,
            floor_um,
        })
    }
}

/// Radial deviation of one less that of the other, rms, um.
fn apart_um(one: &PointAnalysis, other: &PointAnalysis) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for (one, other) in one.directions.iter().zip(&other.directions) {
        for row in one.path.measured_rows() {
            sum += (one.path.deviation_m[row] - other.path.deviation_m[row]).powi(2);
            count += 1;
        }
    }
    1e6 * (sum / count.max(1) as f64).sqrt()
}
