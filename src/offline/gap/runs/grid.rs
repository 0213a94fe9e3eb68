//! Where each row of a file stands in time: on an even grid, whatever its clock did.
//!
//! Invariant: no row is used twice, and a place without a row is no number.

use std::collections::BTreeMap;

use super::refused::{REPAIRED_SHARE_MAX, RunError, SHORTEST_S};
use super::{AxisRun, Run};
use crate::base::axis::AxisId;
use crate::offline::median::median;

/// A log has a row in each so many cycles at most, or so many rows in a cycle.
const SPARSEST: f64 = 4.0;
const DENSEST: f64 = 16.0;
/// Share of the changes of a setpoint that come with the first of the rows of a cycle, where it is held for the others.
const TOGETHER: f64 = 0.9;
/// Rows missing in a row that are filled in.
const FILLED_MAX: usize = 20;

/// Where each row of a file stands in time.
pub(super) struct Grid {
    /// From row to row of the file, s; so many of these are one of a run.
    period_s: f64,
    rows: usize,
    /// Rows of the file that stand one period apart or miss a few, each with its place.
    pub(super) pieces: Vec<Vec<(usize, usize)>>,
}

impl Grid {
    pub(in crate::offline::gap) fn of(
        run: &str,
        time_s: &[f64],
        wanted_s: f64,
        repaired: &mut Vec<String>,
    ) -> Result<Self, RunError> {
        let rows = time_s.len();
        let broken = |count: usize, what| {
            let is_much = count as f64 > REPAIRED_SHARE_MAX * rows as f64;
            if is_much { Err(RunError::Broken { run: run.to_owned(), count, rows, what }) } else { Ok(count) }
        };
        let mut order: Vec<usize> = (0..rows).filter(|row| time_s[*row].is_finite()).collect();
        let untimed = broken(rows - order.len(), "without a time")?;
        let disordered = broken(
            order.windows(2).filter(|pair| time_s[pair[1]] < time_s[pair[0]]).count(),
            "out of order",
        )?;
        order.sort_by(|a, b| time_s[*a].total_cmp(&time_s[*b]));
        let mut steps: Vec<f64> = order.windows(2).map(|pair| time_s[pair[1]] - time_s[pair[0]]).collect();
        let Some(found_s) = median(&mut steps) else {
            return Err(RunError::TooShort { run: run.to_owned(), length_s: 0.0 });
        };
        // A jittering clock moves single rows; the middle of all steps stays.
        let [cycles, of_cycle] = [found_s / wanted_s, wanted_s / found_s].map(|share| share.max(1.0).round());
        let step_s = cycles * wanted_s / of_cycle;
        if (found_s / step_s - 1.0).abs() > 0.1 || cycles > SPARSEST || of_cycle > DENSEST {
            let (found_us, wanted_us) = (1e6 * found_s, 1e6 * wanted_s);
            return Err(RunError::Period { run: run.to_owned(), found_us, wanted_us });
        }
        let us = 1e6 * step_s;
        if cycles > 1.0 {
            repaired.push(format!("{run}: rows are {us:.0} us apart, {cycles} cycles of the loops; between them setpoints are filled in"));
        } else if of_cycle > 1.0 {
            repaired.push(format!("{run}: rows are {us:.0} us apart, {of_cycle} in a cycle of the loops; one of each cycle is taken"));
        }
        let (mut pieces, mut repeated, mut missing) = (vec![Vec::new()], 0, 0);
        let mut last: Option<(usize, f64)> = None;
        for row in order {
            let place = match last {
                None => 0,
                Some((place, at_s)) => {
                    let steps = ((time_s[row] - at_s) / step_s).round();
                    if (time_s[row] - at_s) < 0.2 * step_s {
                        repeated += 1;
                        continue;
                    }
                    let steps = steps.max(1.0) as usize;
                    if steps > FILLED_MAX + 1 {
                        repaired.push(format!(
                            "{run}: nothing from {at_s:.4} s to {:.4} s, the run is taken as two",
                            time_s[row]
                        ));
                        pieces.push(Vec::new());
                        0
                    } else {
                        missing += steps - 1;
                        place + steps
                    }
                }
            };
            last = Some((place, time_s[row]));
            if let Some(piece) = pieces.last_mut() {
                piece.push((row, place));
            }
        }
        let said = [
            (untimed, "rows without a time left out"),
            (disordered, "rows out of order put in order"),
            (broken(repeated, "repeated")?, "repeated rows left out"),
            (broken(missing, "missing")?, "missing rows filled in"),
        ];
        let of = |(count, what): (usize, &str)| (count > 0).then(|| format!("{run}: {count} {what}"));
        repaired.extend(said.into_iter().filter_map(of));
        let length_s =
            |piece: &Vec<(usize, usize)>| piece.last().map_or(0.0, |(_, place)| *place as f64) * step_s;
        let longest_s = pieces.iter().map(length_s).fold(0.0, f64::max);
        pieces.retain(|piece| length_s(piece) >= SHORTEST_S);
        if pieces.is_empty() {
            return Err(RunError::TooShort { run: run.to_owned(), length_s: longest_s });
        }
        Ok(Self { period_s: step_s, rows: of_cycle as usize, pieces })
    }

    /// The rows of a piece at their places; the others are not a number.
    pub(super) fn piece(
        &self,
        name: String,
        piece: &[(usize, usize)],
        time_s: &[f64],
        axes: &BTreeMap<AxisId, AxisRun>,
    ) -> Run {
        let rows = piece.last().map_or(0, |(_, place)| place + 1);
        let placed = |column: &[f64]| {
            let mut even = vec![f64::NAN; rows];
            for (row, place) in piece {
                even[*place] = column[*row];
            }
            even
        };
        let run = Run {
            name,
            start_s: piece.first().map_or(0.0, |(row, _)| time_s[*row]),
            period_s: self.period_s,
            axes: axes.iter().map(|(id, axis)| (*id, axis.by_columns(placed))).collect(),
            is_sound: vec![true; rows],
        };
        if self.rows == 1 {
            return run;
        }
        let first = first_of_cycle(&run, self.rows);
        run.thinned(first, self.rows)
    }
}

/// In which of so many rows a cycle begins: in that in which setpoints change, where they are held for the others.
fn first_of_cycle(run: &Run, rows: usize) -> usize {
    let mut changes = vec![0_usize; rows];
    for axis in run.axes.values() {
        let pairs = axis.setpoint_m.windows(2).enumerate();
        for (row, _) in pairs.filter(|(_, pair)| pair[0] != pair[1] && !pair[0].is_nan() && !pair[1].is_nan())
        {
            changes[(row + 1) % rows] += 1;
        }
    }
    let all: usize = changes.iter().sum();
    (0..rows).find(|row| all > 0 && changes[*row] as f64 >= TOGETHER * all as f64).unwrap_or(0)
}
