//! A column smoothed by its neighbours.
//!
//! Invariant: a mean has as many rows on one side as on the other, but at the ends.

/// Mean over so many rows around each; fewer at the ends.
pub(super) fn running_mean(column: &[f64], rows: usize) -> Vec<f64> {
    let mut sums = Vec::with_capacity(column.len() + 1);
    sums.push(0.0);
    sums.extend(column.iter().scan(0.0, |sum, value| {
        *sum += value;
        Some(*sum)
    }));
    (0..column.len())
        .map(|row| {
            let (from, to) = (row.saturating_sub(rows / 2), (row + rows / 2 + 1).min(column.len()));
            (sums[to] - sums[from]) / (to - from) as f64
        })
        .collect()
}
