//! Data, looked at before they are believed.
//!
//! ```text
//!   MCAP ──► logged ─┐
//!   CSV ──► Raw ─────┴► time ──► gaps ──► numbers ──► units and signs ──► Runs, and what was repaired
//! ```
//!
//! Little that is wrong is repaired and said: a few rows that are missing, repeated or no numbers; a unit or a sign
//! that cannot be another. A long gap ends a run and begins another. All else is refused with what to do.
//! Invariant: nothing is repaired without a word.

use std::collections::BTreeMap;

use super::grid::Grid;
use super::parts::taken_apart;
use super::refused::{REPAIRED_SHARE_MAX, RunError};
use super::{AxisRun, Run, setpoints, span};
use crate::base::axis::AxisId;
use crate::base::setpoint::Setpoint;
use crate::base::units::Position;
use crate::config::Machine;
use crate::config::machine::Axis;
use crate::offline::identify::foreign::{Effort, ForeignAxis, Raw};
use crate::rt::control::position::{Gains, PositionLoop};

/// A channel that does not change for so long while the setpoint goes so far is frozen: a loop lags by less, and so
/// does an axis that sticks. m, s.
const FROZEN_WAY_M: f64 = 2e-3;
const FROZEN_S: f64 = 0.3;
/// Below this all of a run's setpoints count as standing, m.
const STANDING_M: f64 = 1e-6;
/// How near a factor between two columns must come to that of a unit, as a share.
const UNIT_TOLERANCE: f64 = 0.05;
/// A lag makes short fast ways shorter, so that only a factor beyond this is a unit.
const LAG_FACTOR: f64 = 3.0;

/// Runs of a file with what was repaired in it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Intake {
    /// The pieces that are whole, in order.
    pub runs: Vec<Run>,
    /// What was repaired, in words.
    pub repaired: Vec<String>,
}

impl Intake {
    /// Takes in those of another file.
    pub fn extend(&mut self, more: Self) {
        self.runs.extend(more.runs);
        self.repaired.extend(more.repaired);
    }

    /// With a run for each motion that comes again by itself.
    #[must_use]
    pub(super) fn taken_apart(self) -> Self {
        Self { runs: self.runs.into_iter().flat_map(taken_apart).collect(), ..self }
    }
}

/// The runs of measurements that are no log of ours.
///
/// # Errors
/// [`RunError`], where the data cannot be what they say they are.
pub fn of_raw(name: &str, raw: Raw, machine: &Machine) -> Result<Intake, RunError> {
    Ok(in_units(pieces(name, raw, machine)?, machine)?.taken_apart())
}

/// The runs between long gaps, in whatever unit they are.
pub(super) fn pieces(name: &str, raw: Raw, machine: &Machine) -> Result<Intake, RunError> {
    let mut repaired = Vec::new();
    let mut axes = BTreeMap::new();
    for (axis, columns) in raw.axes {
        let Some(id) = machine.axes.axes().find(|id| machine.axis_names()[id.index()] == axis) else {
            let known = machine.axis_names().join(", ");
            return Err(RunError::Axis { run: name.to_owned(), axis, known });
        };
        axes.insert(id, columns_of(name, &axis, columns, machine, id)?);
    }
    let grid = Grid::of(name, &raw.time_s, machine.cycle.period.as_s(), &mut repaired)?;
    let mut runs = Vec::new();
    for (number, piece) in grid.pieces.iter().enumerate() {
        let part =
            if grid.pieces.len() == 1 { name.to_owned() } else { format!("{name}, piece {}", number + 1) };
        runs.push(grid.piece(part, piece, &raw.time_s, &axes));
    }
    let runs = fill_all(name, runs, machine, &mut repaired)?;
    if !runs.iter().any(|run| run.axes.values().any(|axis| span(&axis.setpoint_m) > STANDING_M)) {
        return Err(RunError::Standing { run: name.to_owned() });
    }
    for run in &runs {
        for (id, axis) in run.axes.iter().filter(|(_, axis)| span(&axis.setpoint_m) >= FROZEN_WAY_M) {
            let name = &machine.axis_names()[id.index()];
            let table = axis.table_m.iter().map(|table_m| ("table position", table_m));
            for (channel, column) in
                [("position", &axis.position_m), ("current", &axis.current_a)].into_iter().chain(table)
            {
                not_frozen(&run.name, name, channel, column, &axis.setpoint_m, run.period_s)?;
            }
        }
    }
    Ok(Intake { runs, repaired })
}

fn columns_of(
    run: &str,
    axis: &str,
    columns: ForeignAxis,
    machine: &Machine,
    id: AxisId,
) -> Result<AxisRun, RunError> {
    let plant = &machine.axes[id].plant;
    let per_n = 1.0 / (plant.mechanics.force_per_torque() * plant.actuator.torque_constant_nm_per_a);
    let Some(setpoint_m) = columns.setpoint_m else {
        return Err(RunError::NoSetpoint { run: run.to_owned(), axis: axis.to_owned() });
    };
    Ok(AxisRun {
        setpoint_m,
        position_m: columns.position_m,
        table_m: columns.table_m,
        current_a: match columns.effort {
            Effort::Current(current_a) => current_a,
            Effort::Force(force_n) => force_n.iter().map(|n| n * per_n).collect(),
        },
    })
}

/// Fills what is no number by straight lines and marks it.
fn fill_all(
    file: &str,
    mut runs: Vec<Run>,
    machine: &Machine,
    repaired: &mut Vec<String>,
) -> Result<Vec<Run>, RunError> {
    for run in &mut runs {
        let rows = run.len();
        for (id, axis) in &mut run.axes {
            let name = &machine.axis_names()[id.index()];
            let is_table_whole = |column: &Vec<f64>| {
                let bad = column.iter().filter(|value| !value.is_finite()).count();
                bad as f64 <= REPAIRED_SHARE_MAX * rows as f64
            };
            if axis.table_m.as_ref().is_some_and(|column| !is_table_whole(column)) {
                repaired.push(format!(
                    "{file}, axis {name}: the table position is left out, it is mostly no number"
                ));
                axis.table_m = None;
            }
            let columns = [Some(&mut axis.setpoint_m), Some(&mut axis.position_m), Some(&mut axis.current_a)];
            for column in columns.into_iter().chain([axis.table_m.as_mut()]).flatten() {
                let filled = fill(column, &mut run.is_sound);
                if filled as f64 > REPAIRED_SHARE_MAX * rows as f64 {
                    let what = "no numbers";
                    return Err(RunError::Broken { run: run.name.clone(), count: filled, rows, what });
                }
            }
        }
        let filled = run.is_sound.iter().filter(|is_sound| !**is_sound).count();
        if filled > 0 {
            repaired.push(format!(
                "{}: {filled} of {rows} rows take no part, something is missing in them",
                run.name
            ));
        }
    }
    Ok(runs)
}

/// How many values of a column were filled in.
fn fill(column: &mut [f64], is_sound: &mut [bool]) -> usize {
    let known: Vec<usize> = (0..column.len()).filter(|row| column[*row].is_finite()).collect();
    let (Some(&first), Some(&last)) = (known.first(), known.last()) else { return column.len() };
    for row in 0..column.len() {
        if column[row].is_finite() {
            continue;
        }
        is_sound[row] = false;
        column[row] = if row < first {
            column[first]
        } else if row > last {
            column[last]
        } else {
            let after = known.partition_point(|known| *known < row);
            let (low, high) = (known[after - 1], known[after]);
            column[low] + (column[high] - column[low]) * (row - low) as f64 / (high - low) as f64
        };
    }
    column.len() - known.len()
}

/// Turns what can only be another unit or sense, and refuses what cannot be.
fn in_units(intake: Intake, machine: &Machine) -> Result<Intake, RunError> {
    let Intake { mut runs, mut repaired } = intake;
    for run in &mut runs {
        for (id, axis) in &mut run.axes {
            if span(&axis.setpoint_m) < FROZEN_WAY_M {
                continue;
            }
            let name = machine.axis_names()[id.index()].clone();
            let Axis { scale, control, .. } = &machine.axes[*id];
            let followed_m = followed(&axis.setpoint_m, run.period_s, &control.gain_sets[0].position);
            let motor_m = scale.motor_resolution().as_m();
            let columns =
                [("position", Some(&mut axis.position_m)), ("table position", axis.table_m.as_mut())];
            for (channel, column) in columns {
                let Some(column) = column else { continue };
                // Of a short way there and back a position loop leaves a quarter where it should have been, and all of it later.
                let slopes = [&axis.setpoint_m, &followed_m].map(|setpoint_m| slope(column, setpoint_m));
                let is_one = |sign: f64| {
                    slopes.iter().any(|slope| (1.0 / LAG_FACTOR..=LAG_FACTOR).contains(&(sign * slope)))
                };
                // In the trace format a count is read as a millimetre.
                let units =
                    [(1e3, "micrometres"), (1e-3, "metres"), (1e-3 / motor_m, "counts of the encoder")];
                if is_one(1.0) {
                    continue;
                }
                let is_in = |(factor, _): &&(f64, &str)| {
                    slopes.iter().any(|slope| (slope / factor - 1.0).abs() <= UNIT_TOLERANCE)
                };
                let Some((factor, unit)) = units.iter().find(is_in) else {
                    let slope = slopes[0];
                    let hint = if is_one(-1.0) {
                        "its sense is turned: give a column map with scale = -1"
                    } else {
                        "check its unit, or give a column map with unit and scale"
                    };
                    return Err(RunError::Unit { run: run.name.clone(), axis: name, channel, slope, hint });
                };
                repaired.push(format!("{}, axis {name}: {channel} is in {unit}, taken so", run.name));
                column.iter_mut().for_each(|value| *value /= factor);
            }
            if current_runs_against(axis) {
                repaired.push(format!(
                    "{}, axis {name}: the current pushes against the motion all the time: its sign is turned",
                    run.name
                ));
                axis.current_a.iter_mut().for_each(|value| *value = -*value);
            }
        }
    }
    Ok(Intake { runs, repaired })
}

/// A setpoint as a position loop follows it before a perfect velocity loop.
fn followed(setpoint_m: &[f64], period_s: f64, gains: &Gains) -> Vec<f64> {
    let mut response = PositionLoop::default();
    response.reset(Position::m(setpoint_m[0]));
    let of = |setpoint: Setpoint| {
        response.update(gains, &setpoint, response.expected_position(), period_s);
        response.coast(period_s);
        response.expected_position().as_m()
    };
    setpoints(setpoint_m, period_s).into_iter().map(of).collect()
}

/// Slope of a column over the setpoint by least squares.
fn slope(column: &[f64], setpoint_m: &[f64]) -> f64 {
    let rows = column.len() as f64;
    let [mean, middle] = [column, setpoint_m].map(|column| column.iter().sum::<f64>() / rows);
    let both = column.iter().zip(setpoint_m);
    let (over, under) = both.fold((0.0, 0.0), |(over, under), (value, setpoint)| {
        (over + (value - mean) * (setpoint - middle), under + (setpoint - middle).powi(2))
    });
    over / under
}

/// Friction takes a current along the motion, whatever the axis does.
fn current_runs_against(axis: &AxisRun) -> bool {
    let (mut along, mut all) = (0.0, 0.0);
    for (pair, current_a) in axis.setpoint_m.windows(2).zip(&axis.current_a) {
        let way_m = pair[1] - pair[0];
        along += way_m * current_a;
        all += (way_m * current_a).abs();
    }
    along < -0.3 * all
}

fn not_frozen(
    run: &str,
    axis: &str,
    channel: &'static str,
    column: &[f64],
    setpoint_m: &[f64],
    period_s: f64,
) -> Result<(), RunError> {
    let mut from = 0;
    for row in 1..=column.len() {
        if row < column.len() && column[row] == column[from] {
            continue;
        }
        let way_m = span(&setpoint_m[from..row]);
        if way_m > FROZEN_WAY_M && (row - from) as f64 * period_s > FROZEN_S {
            return Err(RunError::Frozen {
                run: run.to_owned(),
                axis: axis.to_owned(),
                channel,
                from_s: from as f64 * period_s,
                to_s: (row - 1) as f64 * period_s,
                way_mm: 1e3 * way_m,
            });
        }
        from = row;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;

    const ROWS: usize = 5_000;

    /// Both axes to and fro, with a lag of 50 rows and friction.
    fn raw() -> Raw {
        let time_s: Vec<f64> = (0..ROWS).map(|row| row as f64 * 5e-4).collect();
        let place = |row: f64| 0.01 * (row * 0.003).sin();
        let axis = || ForeignAxis {
            setpoint_m: Some((0..ROWS).map(|row| place(row as f64)).collect()),
            position_m: (0..ROWS).map(|row| place(row as f64 - 50.0)).collect(),
            table_m: Some((0..ROWS).map(|row| place(row as f64 - 50.5)).collect()),
            effort: Effort::Current(
                (0..ROWS).map(|row| (row as f64 * 0.003).cos().signum() + 1e-4 * row as f64).collect(),
            ),
            controller: None,
        };
        Raw { time_s, axes: [("x".to_owned(), axis()), ("y".to_owned(), axis())].into() }
    }

    fn taken(change: impl FnOnce(&mut Raw)) -> Result<Intake, RunError> {
        let mut raw = raw();
        change(&mut raw);
        of_raw("run", raw, &config::load("paper").expect("a machine"))
    }

    fn x(raw: &mut Raw) -> &mut ForeignAxis {
        raw.axes.get_mut("x").expect("it has one")
    }

    #[test]
    fn a_short_way_there_and_back_that_a_loop_leaves_to_a_quarter_is_no_other_unit() {
        let machine = config::load("paper").expect("a machine");
        let gains = machine.axes[AxisId::X].control.gain_sets[0].position;
        let setpoint_m: Vec<f64> =
            (0..ROWS).map(|row| 0.01 * (2.0 * gains.gain_per_s * row as f64 * 5e-4).sin()).collect();
        let position_m = followed(&setpoint_m, 5e-4, &gains);
        assert!(slope(&position_m, &setpoint_m) < 0.25);
        let taken_by = |factor: f64| {
            taken(|raw| {
                for axis in raw.axes.values_mut() {
                    axis.setpoint_m = Some(setpoint_m.clone());
                    axis.position_m = position_m.iter().map(|position_m| factor * position_m).collect();
                    axis.table_m = None;
                    let ways_m = setpoint_m.windows(2).map(|pair| pair[1] - pair[0]);
                    axis.effort = Effort::Current(ways_m.chain([0.0]).map(|way_m| 1e5 * way_m).collect());
                }
            })
        };
        assert!(taken_by(1.0).expect("sound").repaired.is_empty());
        assert!(taken_by(1e3).expect("another unit").repaired[0].contains("in micrometres"));
        assert!(taken_by(-1.0).expect_err("turned").to_string().contains("its sense is turned"));
    }

    #[test]
    fn sound_data_are_taken_as_they_are() {
        let intake = taken(|_| ()).expect("sound");
        assert!(intake.repaired.is_empty(), "{:?}", intake.repaired);
        assert_eq!(intake.runs.len(), 1);
        assert_eq!(intake.runs[0].axes[&AxisId::X].position_m, raw().axes["x"].position_m);
        assert!(intake.runs[0].is_sound.iter().all(|is_sound| *is_sound));
    }

    #[test]
    fn a_little_that_is_wrong_is_repaired_and_takes_no_part() {
        let intake = taken(|raw| {
            x(raw).position_m[100] = f64::NAN;
            raw.time_s.remove(200);
            for axis in raw.axes.values_mut() {
                let Effort::Current(current_a) = &mut axis.effort else { unreachable!("it is a current") };
                for column in [
                    &mut axis.position_m,
                    current_a,
                    axis.setpoint_m.as_mut().expect("one"),
                    axis.table_m.as_mut().expect("one"),
                ] {
                    column.remove(200);
                }
            }
            raw.time_s.swap(300, 301);
            raw.time_s[400] = raw.time_s[399];
        })
        .expect("repaired");
        let run = &intake.runs[0];
        assert_eq!(run.len(), ROWS);
        let bad: Vec<usize> = (0..ROWS).filter(|row| !run.is_sound[*row]).collect();
        // A row of its own for each; the repeated time leaves its place empty.
        assert!(bad.contains(&100) && bad.contains(&200) && bad.len() <= 4, "{bad:?}");
        let axis = &run.axes[&AxisId::X];
        assert!((axis.position_m[100] - 0.5 * (axis.position_m[99] + axis.position_m[101])).abs() < 1e-12);
        let said = intake.repaired.join("\n");
        for word in ["repeated", "missing", "out of order", "take no part"] {
            assert!(said.contains(word), "{word} is not in\n{said}");
        }
    }

    #[test]
    fn a_long_gap_ends_a_run() {
        let intake = taken(|raw| raw.time_s.iter_mut().skip(2_500).for_each(|time_s| *time_s += 3.0));
        let intake = intake.expect("two pieces");
        assert_eq!(intake.runs.iter().map(Run::len).collect::<Vec<_>>(), [2_500, 2_500]);
        assert!(intake.repaired[0].contains("taken as two"), "{:?}", intake.repaired);
    }

    #[test]
    fn a_jittering_clock_is_no_gap() {
        let intake = taken(|raw| {
            for (row, time_s) in raw.time_s.iter_mut().enumerate() {
                *time_s += 1e-4 * (row as f64 * 1.7).sin();
            }
        });
        assert_eq!(intake.expect("sound").runs[0].len(), ROWS);
    }

    #[test]
    fn units_and_senses_that_can_only_be_others_are_turned() {
        let intake = taken(|raw| {
            x(raw).position_m.iter_mut().for_each(|value| *value *= 1e3);
            let Effort::Current(current_a) = &mut x(raw).effort else { unreachable!("it is a current") };
            current_a.iter_mut().for_each(|value| *value = -*value);
        })
        .expect("turned");
        assert!(intake.repaired[0].contains("position is in micrometres"), "{:?}", intake.repaired);
        assert!(intake.repaired[1].contains("its sign is turned"), "{:?}", intake.repaired);
        let (was, is) = (&raw().axes["x"].position_m, &intake.runs[0].axes[&AxisId::X].position_m);
        assert!(was.iter().zip(is).all(|(was, is)| (was - is).abs() < 1e-12));
    }

    #[test]
    fn of_a_log_that_is_faster_than_the_loops_the_row_is_taken_in_which_they_begin() {
        let intake = taken(|raw| {
            raw.time_s.iter_mut().for_each(|time_s| *time_s /= 2.0);
            for axis in raw.axes.values_mut() {
                let [setpoint_m, table_m] = [&mut axis.setpoint_m, &mut axis.table_m].map(Option::as_mut);
                for column in [setpoint_m, table_m, Some(&mut axis.position_m)].into_iter().flatten() {
                    *column = (0..ROWS).map(|row| column[row.div_ceil(2)]).collect();
                }
            }
        })
        .expect("taken");
        assert!(intake.repaired.join("\n").contains("2 in a cycle of the loops"), "{:?}", intake.repaired);
        assert_eq!((intake.runs[0].len(), intake.runs[0].period_s), (ROWS / 2, 5e-4));
        // Setpoints change in the rows 1, 3, 5 and so on.
        assert_eq!(intake.runs[0].axes[&AxisId::X].position_m[..4], raw().axes["x"].position_m[1..5]);
    }

    #[test]
    fn of_a_log_that_has_every_second_cycle_rows_stay_as_they_are_and_it_is_said() {
        let intake = taken(|raw| raw.time_s.iter_mut().for_each(|time_s| *time_s *= 2.0)).expect("taken");
        assert!(intake.repaired.join("\n").contains("2 cycles of the loops"), "{:?}", intake.repaired);
        assert_eq!((intake.runs[0].len(), intake.runs[0].period_s), (ROWS, 1e-3));
    }

    #[test]
    fn what_cannot_be_is_refused_with_its_place() {
        let said = |change: fn(&mut Raw)| taken(change).expect_err("it is refused").to_string();
        assert!(
            said(|raw| raw.time_s.iter_mut().for_each(|time_s| *time_s *= 1.5))
                .contains("rows are 750.0 us apart")
        );
        assert!(
            said(|raw| raw.time_s.iter_mut().for_each(|time_s| *time_s *= 5.0))
                .contains("rows are 2500.0 us apart")
        );
        assert!(
            said(|raw| x(raw).position_m[1_000..3_000].fill(0.005))
                .contains("axis x: position stands still from 0.500 s")
        );
        assert!(
            said(|raw| x(raw).position_m.iter_mut().for_each(|value| *value = -*value))
                .contains("its sense is turned")
        );
        assert!(
            said(|raw| x(raw).position_m.iter_mut().for_each(|value| *value *= 7.0))
                .contains("check its unit")
        );
        assert!(
            said(|raw| x(raw).position_m[..900].fill(f64::NAN)).contains("900 of 5000 rows are no numbers")
        );
        assert!(said(|raw| raw.time_s.truncate(1_000)).contains("0.50 s in one piece"));
        assert!(said(|raw| x(raw).setpoint_m = None).contains("no setpoint"));
        assert!(
            said(|raw| {
                let axis = raw.axes["x"].clone();
                raw.axes.insert("w".to_owned(), axis);
            })
            .contains("axis w is none of the machine's (x, y)")
        );
        let standing =
            |raw: &mut Raw| raw.axes.values_mut().for_each(|axis| axis.setpoint_m = Some(vec![0.0; ROWS]));
        assert!(taken(standing).expect_err("it stands").to_string().contains("no axis was asked to move"));
    }
}
