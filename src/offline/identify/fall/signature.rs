//! What a reversal or a ramp looks like, in a few numbers that say something of its falling part.
//!
//! ```text
//!   time:    sliding ──► creeping, the table chatters ──► it stands ──► it breaks away ──► sliding
//!   parts:   1            2 ...                                               ... 9
//! ```
//!
//! Of each part the mean force (where the force rises before the reversal, how long the table stands, how hard it
//! breaks away), and the logarithm of the mean square of the chatter, a difference of two running means. When exactly
//! the table sticks and slips hangs by a hair and is not looked at. Units: N.
//! Invariant: the same rows and the same numbers for what was measured and what is simulated.

/// The numbers: mean forces, then chatter.
pub(super) type Signature = Vec<f64>;

/// Parts of the rows of a reversal; the first and the last are only room for the running means.
pub(super) const REVERSAL_PARTS: usize = 11;
/// Those of a ramp.
pub(super) const RAMP_PARTS: usize = 6;
/// Parts of a reversal that count.
pub(super) const PARTS_SEEN: usize = REVERSAL_PARTS - 2;
/// Running means over so long a time, s: with less, counts of a coarse encoder would be louder than the chatter.
const FAST_S: f64 = 0.01;
const SLOW_S: f64 = 0.04;
/// Less chatter than this is none, N².
const CHATTER_MIN_N2: f64 = 1.0;

/// Of the force in even rows, cut into so many parts.
pub(super) fn signature(force_n: &[f64], period_s: f64, parts: usize) -> Signature {
    let [fast, slow] = [FAST_S, SLOW_S].map(|time_s| running_mean(force_n, (time_s / period_s) as usize));
    let part = |number: usize| number * force_n.len() / parts..(number + 1) * force_n.len() / parts;
    let mean = |number: usize, of: &dyn Fn(usize) -> f64| {
        let rows = part(number);
        let count = rows.len().max(1) as f64;
        rows.map(of).sum::<f64>() / count
    };
    let chatter_n2 = |row: usize| (fast[row] - slow[row]).powi(2);
    let means = (1..parts - 1).map(|number| mean(number, &|row| force_n[row]));
    let chatter = (1..parts - 1).map(|number| (mean(number, &chatter_n2) + CHATTER_MIN_N2).ln());
    means.chain(chatter).collect()
}

/// Mean over so many rows around each; fewer at the ends.
fn running_mean(column: &[f64], rows: usize) -> Vec<f64> {
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

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 0.5e-3;

    #[test]
    fn chatter_shows_where_it_is_and_in_no_mean() {
        // 1.1 s of a rising force; Three waves of 30 Hz in the fourth of eleven parts.
        let force = |chatter_n: f64| -> Vec<f64> {
            let row = |row: u32| {
                let time_s = f64::from(row) * PERIOD_S;
                let is_loud = (0.3..0.4).contains(&time_s);
                let chatter = if is_loud { (time_s * 30.0 * std::f64::consts::TAU).sin() } else { 0.0 };
                900.0 + 20.0 * time_s + chatter_n * chatter
            };
            (0..2_200).map(row).collect()
        };
        let [quiet, loud] =
            [0.0, 30.0].map(|chatter_n| signature(&force(chatter_n), PERIOD_S, REVERSAL_PARTS));
        assert_eq!(quiet.len(), 2 * PARTS_SEEN);
        for part in 0..PARTS_SEEN {
            let apart_n = loud[part] - quiet[part];
            assert!(apart_n.abs() < 0.1, "part {part}: the means differ by {apart_n} N");
            let louder = loud[PARTS_SEEN + part] - quiet[PARTS_SEEN + part];
            let is_there = part == 2;
            assert!(if is_there { louder > 4.0 } else { louder < 3.5 }, "part {part}: louder by {louder}");
        }
    }
}
