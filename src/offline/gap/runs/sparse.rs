//! Logs that have a row in every second cycle of the loops or in fewer, as scopes of drives write them: the loops act in each cycle
//! all the same, and so they do in simulation. What they were given between two rows is filled in; nothing is compared there.
//!
//! ```text
//!   setpoints of a log ──► one in each cycle ──► loops and plant ──► what they make of the cycles that have rows
//! ```
//!
//! Invariant: a row is a whole number of cycles, the same of all runs that are looked at together.

use super::Run;
use super::intake::Intake;
use crate::config::Machine;

/// What differs by less bends evenly, m or A.
const EVEN: f64 = 1e-9;

/// How many cycles of a machine lie between two rows of a run.
pub(in crate::offline::gap) fn cycles(run: &Run, machine: &Machine) -> usize {
    ((run.period_s / machine.cycle.period.as_s()).round() as usize).max(1)
}

/// A column in each cycle: between two rows the parabola that bends as the rows about them do, on that side more on which it does so
/// evenly: where a command begins to accelerate, a row knows nothing of the other side.
pub(in crate::offline::gap) fn between(column: &[f64], cycles: usize) -> Vec<f64> {
    if cycles == 1 {
        return column.to_vec();
    }
    let last = column.len().saturating_sub(1);
    let bends = |row: usize| {
        let row = row.clamp(1, last.max(2) - 1);
        if last < 2 { 0.0 } else { column[row - 1] - 2.0 * column[row] + column[row + 1] }
    };
    let of = |row: usize| {
        let (before, after) = (bends(row), bends(row + 1));
        let uneven = |here: f64, next: f64| 1.0 / (EVEN + (here - next).abs());
        let [of_before, of_after] =
            [uneven(before, bends(row.saturating_sub(1))), uneven(after, bends(row + 2))];
        let bend = (of_before * before + of_after * after) / (of_before + of_after);
        // Beyond the last row it goes on as it came.
        let rise = if row < last {
            column[row + 1] - column[row]
        } else {
            column[last] - column[row.saturating_sub(1)]
        };
        (0..cycles).map(move |cycle| {
            let at = cycle as f64 / cycles as f64;
            column[row] + at * rise - 0.5 * at * (1.0 - at) * bend
        })
    };
    (0..column.len()).flat_map(of).collect()
}

impl Run {
    /// One of so many of its rows, from one on.
    pub(super) fn thinned(&self, first: usize, every: usize) -> Self {
        let of = |column: &[f64]| column.iter().copied().skip(first).step_by(every).collect();
        Self {
            name: self.name.clone(),
            start_s: self.start_s + first as f64 * self.period_s,
            period_s: self.period_s * every as f64,
            axes: self.axes.iter().map(|(id, axis)| (*id, axis.by_columns(of))).collect(),
            is_sound: self.is_sound.iter().copied().skip(first).step_by(every).collect(),
        }
    }
}

impl Intake {
    /// With rows as far apart in all runs as in that in which they are furthest; what is left out is said.
    #[must_use]
    pub fn at_one_rate(mut self, machine: &Machine) -> Self {
        let rates: Vec<usize> = self.runs.iter().map(|run| cycles(run, machine)).collect();
        let all = rates.iter().copied().fold(1, lowest_common_multiple);
        for (run, own) in self.runs.iter_mut().zip(rates).filter(|(_, own)| *own < all) {
            let every = all / own;
            self.repaired.push(format!(
                "{}: one row of {every} is taken, for other runs have a row in every {all} cycles alone",
                run.name
            ));
            *run = run.thinned(0, every);
        }
        self
    }
}

fn lowest_common_multiple(a: usize, b: usize) -> usize {
    a / greatest_common_divisor(a, b) * b
}

pub(in crate::offline::gap) fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::axis::AxisId;
    use crate::config;

    #[test]
    fn a_parabola_is_what_it_is_between_its_rows_and_rows_stay() {
        let at = |row: f64| 3.0 - 0.4 * row + 0.05 * row * row;
        let rows: Vec<f64> = (0..40).map(|row| at(f64::from(row))).collect();
        for cycles in [1, 2, 4] {
            let all = between(&rows, cycles);
            assert_eq!(all.len(), 40 * cycles);
            for (cycle, value) in all.iter().enumerate().take(39 * cycles) {
                let wanted = at(cycle as f64 / cycles as f64);
                assert!((value - wanted).abs() < 1e-9, "{cycles}, {cycle}: {value}, {wanted}");
            }
            assert!(all.iter().step_by(cycles).zip(&rows).all(|(cycle, row)| cycle == row));
        }
        assert_eq!(between(&[1.0, 3.0], 2), [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(between(&[1.0], 2), [1.0, 1.0]);
        assert!(between(&[], 2).is_empty());
    }

    #[test]
    fn a_command_that_begins_to_accelerate_stands_until_then() {
        // At rest until row 10, in mm.
        let at = |row: f64| 0.5 * (row - 10.0).max(0.0).powi(2);
        let rows: Vec<f64> = (0..20).map(|row| at(f64::from(row))).collect();
        let all = between(&rows, 2);
        for (cycle, value) in all.iter().enumerate().take(38) {
            assert!((value - at(0.5 * cycle as f64)).abs() < 1e-6, "{cycle}: {value}");
        }
    }

    #[test]
    fn runs_of_other_rates_are_thinned_to_the_coarsest() {
        let machine = config::load("paper").expect("a machine");
        let run = |cycles: usize| {
            let setpoints_m = (0..120).map(f64::from).collect();
            Run::of_setpoints(machine.cycle.period.as_s() * cycles as f64, [(AxisId::X, setpoints_m)])
        };
        let intake = Intake { runs: vec![run(1), run(2)], repaired: Vec::new() }.at_one_rate(&machine);
        assert_eq!(intake.repaired.len(), 1);
        let [fine, coarse] = [0, 1].map(|place| &intake.runs[place]);
        assert_eq!([fine, coarse].map(|run| cycles(run, &machine)), [2, 2]);
        assert_eq!(fine.axes[&AxisId::X].setpoint_m[..3], [0.0, 2.0, 4.0]);
        assert_eq!((fine.len(), coarse.len()), (60, 120));
    }
}
