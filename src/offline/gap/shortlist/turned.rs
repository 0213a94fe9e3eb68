//! Columns of an effect that has a phase, from trials a third of a turn apart.
//!
//! ```text
//!   s(φ) = m + c cos φ + s sin φ,   φ = 0, 120, 240 deg ──► c and s, as far as there is no m about a row
//! ```
//!
//! An effect that is small has no mean `m` over all its phases. Stick and slip that come at another moment in each trial have: in
//! them the columns are as large as chance, and an amplitude that is told by such rows comes out as nothing (an eccentricity of 7 um as 0.05 um).
//! Units: those of the columns. Invariant: what is linear in the amplitude keeps its columns.

use crate::offline::gap::model::problem::Residual;
use crate::offline::running_mean::running_mean;

/// Phases of the trials, deg.
pub(super) const PHASES_DEG: [f64; 3] = [0.0, 120.0, 240.0];
/// Power of both columns where all three trials are chance, for one of their mean.
const OF_CHANCE: f64 = 4.0;

/// The columns of phases 0 and 90 deg, from what each trial changes; `about` rows say how much of it is chance.
pub(in crate::offline::gap) fn columns(trials: [&Residual; 3], about: usize) -> [Residual; 2] {
    let mut columns = [Residual::new(), Residual::new()];
    for ((a, b), c) in trials[0].iter().zip(trials[1]).zip(trials[2]) {
        let [cosine, sine] = of_signal([a, b, c], about);
        columns[0].push(cosine);
        columns[1].push(sine);
    }
    columns
}

fn of_signal([a, b, c]: [&[f64]; 3], about: usize) -> [Vec<f64>; 2] {
    let rows = || a.iter().zip(b).zip(c).map(|((a, b), c)| [*a, *b, *c]);
    let mut cosine: Vec<f64> = rows().map(|[a, b, c]| (2.0 * a - b - c) / 3.0).collect();
    let mut sine: Vec<f64> = rows().map(|[_, b, c]| (b - c) / 3.0_f64.sqrt()).collect();
    let means: Vec<f64> = rows().map(|[a, b, c]| ((a + b + c) / 3.0).powi(2)).collect();
    let both: Vec<f64> =
        cosine.iter().zip(&sine).map(|(cosine, sine)| cosine * cosine + sine * sine).collect();
    let [means, both] = [means, both].map(|squares| running_mean(&squares, about));
    for ((mean, both), (cosine, sine)) in means.iter().zip(both).zip(cosine.iter_mut().zip(&mut sine)) {
        let told = if both > 0.0 { (1.0 - OF_CHANCE * mean / both).max(0.0) } else { 0.0 };
        *cosine *= told;
        *sine *= told;
    }
    [cosine, sine]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const ROWS: usize = 4_000;
    const ABOUT: usize = 80;

    /// What three trials change: a swing that is linear, and in the second half events that are chance.
    fn trials(events: f64) -> [Residual; 3] {
        let mut random = Pcg64Mcg::seed_from_u64(6);
        PHASES_DEG.map(|phase_deg| {
            let mut value = |row: usize| {
                let swing = (TAU * (row as f64 / 97.0 + phase_deg / 360.0)).cos();
                let drawn = random.random_range(-1.0..1.0);
                if row < ROWS / 2 { swing } else { events * drawn }
            };
            vec![(0..ROWS).map(&mut value).collect()]
        })
    }

    #[test]
    fn what_is_linear_keeps_its_columns_and_what_is_chance_tells_nothing() {
        let trials = trials(50.0);
        let [cosine, sine] = columns(trials.each_ref(), ABOUT);
        for row in ABOUT..ROWS / 2 - ABOUT {
            let angle = TAU * row as f64 / 97.0;
            assert!((cosine[0][row] - angle.cos()).abs() < 1e-9 && (sine[0][row] + angle.sin()).abs() < 1e-9);
        }
        let power = |column: &[f64]| column.iter().map(|value| value * value).sum::<f64>();
        let (told, all) = (power(&cosine[0][ROWS / 2..]), power(&trials[0][0][ROWS / 2..]));
        assert!(told < 0.1 * all, "{told} of {all}");
    }
}
