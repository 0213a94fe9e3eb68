//! What a reversal or a ramp looks like, in a few numbers that say something of its falling part.
//!
//! ```text
//!   time:    sliding ──► creeping, the table chatters ──► it stands ──► it breaks away ──► sliding
//!   parts:   1            2 ...                                               ... 9
//! ```
//!
//! Of each part the mean force (where the force rises before the reversal, how long the table stands, how hard it
//! breaks away), and the logarithm of the mean square of the chatter, a difference of two running means; of all parts
//! together the spectrum in a few bands, as a logarithm. Of a ramp also how high and how low the force goes while the
//! table creeps, in quantiles: between the counts of a coarse encoder it breaks away again and again, and its mean alone
//! says little of `F_max`. When exactly the table sticks and slips hangs by a hair and is not looked at. Units: N.
//! Invariant: the same rows and the same numbers for what was measured and what is simulated.

use std::f64::consts::TAU;

use nalgebra::Complex;
use rustfft::FftPlanner;

use crate::offline::running_mean::running_mean;

/// The numbers: mean forces first.
pub(super) type Signature = Vec<f64>;

/// Parts of the rows of a reversal; the first and the last are only room for the running means.
const REVERSAL_PARTS: usize = 11;
/// Those of a ramp.
const RAMP_PARTS: usize = 6;
/// Parts of a reversal that count.
pub(super) const PARTS_SEEN: usize = REVERSAL_PARTS - 2;
/// Running means over so long a time, s: with less, counts of a coarse encoder would be louder than the chatter.
const FAST_S: f64 = 0.01;
const SLOW_S: f64 = 0.04;
/// Less chatter than this is none, N².
const CHATTER_MIN_N2: f64 = 1.0;
/// Ends of the bands of a spectrum, Hz: the table breaks away some times a second, and the screw rings at 60 to 120 Hz.
const BANDS_HZ: [f64; 6] = [4.0, 14.0, 32.0, 60.0, 120.0, 250.0];
/// Sixths of a ramp before the table creeps, and before it does so evenly.
const CREEPS: f64 = 2.4;
const EVENLY: f64 = 3.0;
/// Quantiles of the force while it creeps, of a running mean over so long a time, s.
const QUANTILES: [f64; 6] = [0.02, 0.1, 0.3, 0.7, 0.9, 0.98];
const QUANTILE_S: f64 = 0.006;

/// Of the force in even rows of a reversal.
pub(super) fn of_reversal(force_n: &[f64], period_s: f64) -> Signature {
    let mut signature = by_parts(force_n, period_s, REVERSAL_PARTS);
    let part = force_n.len() / REVERSAL_PARTS;
    signature.extend(bands(&force_n[part..force_n.len() - part], period_s));
    signature
}

/// Of the force in even rows of a ramp.
pub(super) fn of_ramp(force_n: &[f64], period_s: f64) -> Signature {
    let mut signature = by_parts(force_n, period_s, RAMP_PARTS);
    let from = |sixths: f64| (sixths / RAMP_PARTS as f64 * force_n.len() as f64) as usize;
    let mut creeping = running_mean(force_n, (QUANTILE_S / period_s) as usize).split_off(from(CREEPS));
    creeping.sort_by(f64::total_cmp);
    let last = creeping.len().saturating_sub(1) as f64;
    signature.extend(QUANTILES.iter().filter_map(|share| creeping.get((share * last).round() as usize)));
    signature.extend(bands(&force_n[from(EVENLY)..], period_s));
    signature
}

/// Mean force and chatter of each of so many parts, but for the first and the last.
fn by_parts(force_n: &[f64], period_s: f64, parts: usize) -> Signature {
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

/// Logarithm of the spectrum in each band: mean square of its lines, by the window of Hann.
fn bands(force_n: &[f64], period_s: f64) -> Signature {
    let count = force_n.len();
    let mean = force_n.iter().sum::<f64>() / count.max(1) as f64;
    let window = |row: usize| 0.5 - 0.5 * (TAU * (row as f64 + 0.5) / count as f64).cos();
    let windowed = |row: usize| Complex::new((force_n[row] - mean) * window(row), 0.0);
    // Zeros behind it, for a length that is quickly transformed.
    let length = count.next_power_of_two();
    let mut lines: Vec<Complex<f64>> = (0..count).map(windowed).collect();
    lines.resize(length, Complex::new(0.0, 0.0));
    FftPlanner::new().plan_fft_forward(length).process(&mut lines);
    let square = (0..count).map(|row| window(row).powi(2)).sum::<f64>().max(1.0);
    let line = |hz: f64| ((hz * period_s * length as f64) as usize).min(length / 2);
    let band = |ends: &[f64]| {
        let lines = &lines[line(ends[0])..line(ends[1]).max(line(ends[0]) + 1)];
        (lines.iter().map(Complex::norm_sqr).sum::<f64>() / (square * lines.len() as f64) + CHATTER_MIN_N2)
            .ln()
    };
    BANDS_HZ.windows(2).map(band).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 0.5e-3;

    #[test]
    fn chatter_shows_where_it_is_and_in_no_mean() {
        // 1.1 s of a rising force; three waves of 30 Hz in the fourth of eleven parts.
        let force = |chatter_n: f64| -> Vec<f64> {
            let row = |row: u32| {
                let time_s = f64::from(row) * PERIOD_S;
                let is_loud = (0.3..0.4).contains(&time_s);
                let chatter = if is_loud { (time_s * 30.0 * std::f64::consts::TAU).sin() } else { 0.0 };
                900.0 + 20.0 * time_s + chatter_n * chatter
            };
            (0..2_200).map(row).collect()
        };
        let [quiet, loud] = [0.0, 30.0].map(|chatter_n| of_reversal(&force(chatter_n), PERIOD_S));
        assert_eq!(quiet.len(), 2 * PARTS_SEEN + BANDS_HZ.len() - 1);
        for part in 0..PARTS_SEEN {
            let apart_n = loud[part] - quiet[part];
            assert!(apart_n.abs() < 0.1, "part {part}: the means differ by {apart_n} N");
            let louder = loud[PARTS_SEEN + part] - quiet[PARTS_SEEN + part];
            let is_there = part == 2;
            assert!(if is_there { louder > 4.0 } else { louder < 3.5 }, "part {part}: louder by {louder}");
        }
    }

    #[test]
    fn a_wave_is_in_the_band_of_its_frequency() {
        for (hz, its_band) in [(9.0, 0), (23.0, 1), (46.0, 2), (90.0, 3), (180.0, 4)] {
            let force = |row: u32| 900.0 + 10.0 * (f64::from(row) * PERIOD_S * hz * TAU).sin();
            let wave = of_reversal(&(0..2_200).map(force).collect::<Vec<f64>>(), PERIOD_S);
            for (band, loud) in wave[2 * PARTS_SEEN..].iter().enumerate() {
                assert!(
                    if band == its_band { *loud > 4.0 } else { *loud < 0.1 },
                    "{hz} Hz, band {band}: {loud}"
                );
            }
        }
    }

    #[test]
    fn quantiles_show_how_high_a_force_goes_and_not_when() {
        // 1.2 s: it rises, then falls and rises by 40 N, four times a second; once a twentieth of a second later.
        let force = |later_s: f64| -> Vec<f64> {
            let row = |row: u32| {
                let time_s = f64::from(row) * PERIOD_S;
                (2_500.0 * time_s).min(1_000.0)
                    + 20.0 * ((time_s - later_s) * 4.0 * std::f64::consts::TAU).sin()
            };
            (0..2_400).map(row).collect()
        };
        let [one, other] = [0.0, 0.05].map(|later_s| of_ramp(&force(later_s), PERIOD_S));
        let quantiles = |signature: &Signature| signature[8..14].to_vec();
        for (a, b) in quantiles(&one).iter().zip(quantiles(&other)) {
            assert!((a - b).abs() < 4.0, "{a} N and {b} N");
        }
        let [low, high] = [quantiles(&one)[1], quantiles(&one)[4]];
        assert!((36.0..40.0).contains(&(high - low)), "{low} N to {high} N");
    }
}
