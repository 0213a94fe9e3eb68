//! What an encoder, or who wrote a column down, resolves: the step of which all its changes are whole numbers.
//!
//! A machine file tells the counts of its encoders, and a file of columns may hold fewer digits. What is smaller than its step is
//! the same in each pass of a command, so that repeats do not show it.
//! Invariant: a column without steps resolves everything.

/// A change that is a whole number of steps is so near to it, in steps; and so many of all changes must be one.
const NEAR: f64 = 0.03;
const SHARE: f64 = 0.98;
/// Fewer changes tell no step.
const CHANGES_MIN: usize = 100;
/// By how much more are taken at a time to tell it.
const FASTER: f64 = 10.0;
/// What the rounding of numbers alone makes of a step, as a share of the largest value.
const DUST: f64 = 1e-12;

/// The step of a column, in its unit; zero where it has none.
pub(in crate::offline::gap) fn step(column: &[f64]) -> f64 {
    let largest = column.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
    let changes = column.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let changes: Vec<f64> = changes.filter(|change| *change > DUST * largest).collect();
    if changes.len() < CHANGES_MIN {
        return 0.0;
    }
    let least = changes.iter().copied().fold(f64::INFINITY, f64::min);
    let fastest = changes.iter().copied().fold(0.0, f64::max);
    // Those that are one step tell it by the rounding of their numbers, those of ten by a tenth of that, and so on.
    let mut step = least;
    let mut most = 1.0 + NEAR;
    while most * step < FASTER * fastest {
        let few = changes.iter().filter(|change| **change < most * step);
        let [product, square] = few.fold([0.0; 2], |[product, square], change| {
            let count = (change / step).round();
            [product + count * change, square + count * count]
        });
        step = product / square;
        most *= FASTER;
    }
    let is_whole = |change: &&f64| (*change / step - (*change / step).round()).abs() < NEAR;
    let whole = changes.iter().filter(is_whole).count();
    if whole as f64 >= SHARE * changes.len() as f64 { step } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_has_the_step_that_it_was_written_with_and_none_if_it_was_not() {
        let place_m = |row: usize| 0.02 * (row as f64 * 5e-4).sin();
        let of = |step_m: f64| -> Vec<f64> {
            (0..20_000).map(|row| (place_m(row) / step_m).floor() * step_m).collect()
        };
        for step_m in [1e-6, 1e-7, 2e-8] {
            let found_m = step(&of(step_m));
            assert!((found_m / step_m - 1.0).abs() < 1e-3, "{found_m} m, and not {step_m} m");
        }
        // Counts that were written down with few digits.
        let written: Vec<f64> =
            of(1.149_436e-8).iter().map(|place_m| (1e10 * place_m).round() * 1e-10).collect();
        let found_m = step(&written);
        assert!((found_m / 1.149_436e-8 - 1.0).abs() < 1e-4, "{found_m} m");
        let smooth: Vec<f64> = (0..20_000).map(place_m).collect();
        assert_eq!(step(&smooth), 0.0);
        assert_eq!(step(&[0.3; 500]), 0.0, "it stands");
    }
}
