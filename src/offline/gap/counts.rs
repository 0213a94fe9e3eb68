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
/// What the rounding of numbers alone makes of a step, as a share of the largest value.
const DUST: f64 = 1e-12;

/// The step of a column, in its unit; zero where it has none.
pub(super) fn step(column: &[f64]) -> f64 {
    let largest = column.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
    let changes = column.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let changes: Vec<f64> = changes.filter(|change| *change > DUST * largest).collect();
    if changes.len() < CHANGES_MIN {
        return 0.0;
    }
    let least = changes.iter().copied().fold(f64::INFINITY, f64::min);
    // The mean of those that are one step: a single one has the rounding of its numbers.
    let ones: Vec<f64> = changes.iter().copied().filter(|change| *change < (1.0 + NEAR) * least).collect();
    let step = ones.iter().sum::<f64>() / ones.len() as f64;
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
        let smooth: Vec<f64> = (0..20_000).map(place_m).collect();
        assert_eq!(step(&smooth), 0.0);
        assert_eq!(step(&[0.3; 500]), 0.0, "it stands");
    }
}
