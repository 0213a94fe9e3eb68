//! How much louder than its neighbours each frequency of what is left is, second after second: a tool that cuts or a loop that
//! hunts keeps its frequency, whatever the axis does, and no phase.
//!
//! ```text
//!   what is left ──► windows of a second ──► power of each line ──► over the mean of the lines on its louder side
//! ```
//!
//! A loop that acts once in so many cycles moves the current in steps of its encoder: these lines, and what folds onto them, are
//! no tones.
//! Units: what is left is whitened, so that a line of noise has a mean of 2 in a window; what is more is a gain, as of a
//! shape.
//! Invariant: noise of any smooth spectrum has no gain on average, or a loss.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::Complex;
use rustfft::FftPlanner;

/// Lines on either side, from the nearest that a window keeps apart to the furthest, that are its neighbourhood.
const ABOUT: [usize; 2] = [3, 12];

/// Lines, in periods per window of so many rows, with the gain of each window of all runs; none of lines of a loop that acts every so
/// many rows.
pub(super) fn tones(runs: &[&[f64]], length: usize, loop_every: u32) -> Vec<(usize, Vec<f64>)> {
    let transform = FftPlanner::new().plan_fft_forward(length);
    let hann: Vec<f64> = (0..length).map(|row| 1.0 - (TAU * row as f64 / length as f64).cos()).collect();
    let of_loop = length as f64 / f64::from(loop_every);
    let is_of_loop = |line: usize| {
        let above = line as f64 % of_loop;
        above.min(of_loop - above) < ABOUT[0] as f64
    };
    let mut lines = vec![Vec::new(); (length / 2).saturating_sub(2 * ABOUT[1])];
    for window in runs.iter().flat_map(|left| left.chunks_exact(length)) {
        let mut spectrum: Vec<Complex<f64>> =
            window.iter().zip(&hann).map(|(left, weight)| Complex::from(left * weight)).collect();
        transform.process(&mut spectrum);
        let power: Vec<f64> = spectrum[..length / 2].iter().map(|line| line.norm_sqr()).collect();
        for (line, gains) in (ABOUT[1]..).zip(&mut lines).filter(|(line, _)| !is_of_loop(*line)) {
            gains.push(gain(&power, line, ABOUT));
        }
    }
    (ABOUT[1]..).zip(lines).collect()
}

/// How much louder a line is than those from the nearest to the furthest on either side.
pub(in crate::offline::gap) fn gain(power: &[f64], line: usize, [nearest, furthest]: [usize; 2]) -> f64 {
    let sides = [line - furthest..line - nearest + 1, line + nearest..line + furthest + 1];
    // Louder than either side: where a spectrum falls, its edge is louder than the mean of both.
    let mean = |side: Range<usize>| power[side.clone()].iter().sum::<f64>() / side.len() as f64;
    let about = sides.into_iter().map(mean).fold(0.0, f64::max);
    if about > 0.0 { 2.0 * (power[line] / about - 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const LENGTH: usize = 500;

    /// Mean gain of each line of noise with a tone in it that begins anew in each window.
    fn mean_gains(amplitude: f64, line: f64) -> Vec<f64> {
        let mut random = Pcg64Mcg::seed_from_u64(4);
        let window = |_| {
            let phase = TAU * random.random::<f64>();
            let mut noise = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            (0..LENGTH)
                .map(|row| amplitude * (TAU * line * row as f64 / LENGTH as f64 + phase).sin() + noise())
                .collect::<Vec<f64>>()
        };
        let left: Vec<f64> = (0..80).flat_map(window).collect();
        let gains = tones(&[&left], LENGTH, 4);
        gains
            .iter()
            .filter(|(_, gains)| !gains.is_empty())
            .map(|(_, gains)| gains.iter().sum::<f64>() / gains.len() as f64)
            .collect()
    }

    #[test]
    fn what_a_loop_does_each_time_it_acts_is_no_tone() {
        let left: Vec<f64> =
            (0..4 * LENGTH).map(|row| if row.is_multiple_of(4) { 1.0 } else { 0.0 }).collect();
        let [own, another] = [4, 3].map(|every| tones(&[&left], LENGTH, every));
        let [own, another] = [own, another].map(|lines| lines[LENGTH / 4 - ABOUT[1]].clone());
        assert_eq!(own, (LENGTH / 4, Vec::new()));
        assert!(another.1.iter().all(|gain| *gain > 100.0));
    }

    #[test]
    fn where_a_spectrum_falls_there_is_no_tone() {
        // Lines of one power up to an edge, and of a hundredth beyond.
        const EDGE: usize = 60;
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let mut window = || {
            let mut left = vec![0.0; LENGTH];
            for line in 1..LENGTH / 2 {
                let amplitude = if line <= EDGE { 1.0 } else { 0.1 };
                let phase = TAU * random.random::<f64>();
                left.iter_mut().enumerate().for_each(|(row, left)| {
                    *left += amplitude * (TAU * (line * row) as f64 / LENGTH as f64 + phase).sin();
                });
            }
            left
        };
        let left: Vec<f64> = (0..40).flat_map(|_| window()).collect();
        let mean = |gains: &[f64]| gains.iter().sum::<f64>() / gains.len() as f64;
        let lines = tones(&[&left], LENGTH, 4);
        let loudest = lines.iter().filter(|(_, gains)| !gains.is_empty()).map(|(_, gains)| mean(gains));
        let loudest = loudest.fold(f64::MIN, f64::max);
        assert!(loudest < 1.0, "{loudest}");
    }

    #[test]
    fn a_tone_without_a_phase_stands_out_where_it_is() {
        let of_noise = mean_gains(0.0, 80.0);
        assert!(of_noise.iter().all(|gain| gain.abs() < 1.2), "{of_noise:?}");
        // A fiftieth of the power of a row in one line: 250 amplitudes squared, of which its window keeps two thirds.
        let gains = mean_gains(0.2, 80.0);
        let loudest = (0..gains.len()).max_by(|a, b| gains[*a].total_cmp(&gains[*b])).expect("lines");
        assert_eq!(loudest + ABOUT[1], 80);
        assert!((5.0..9.0).contains(&gains[loudest]), "{}", gains[loudest]);
    }
}
