//! Excitation: a sum of sines that is added to the velocity command of one axis at every tick, so that an
//! analysis can tell what the loop makes of each frequency.
//!
//! ```text
//!   u(t) = e(t) A Σ cos(2π h_k t / T + φ_k),   φ_k = φ_(k-1) - 2π (h_k - h_(k-1)) k / n
//!
//!   e(t)     ╭──────┬───────────────────╮
//!           ╱settles│evaluated: repeats ╲        rises and falls as a raised cosine over T
//!   ───────╯    T   │        · T         ╰──────
//! ```
//!
//! The `n` harmonics `h_k` are spread evenly over the logarithm of frequency. Their phases are Schroeder's (IEEE
//! Trans. IT 16, 1970, p. 85): one line after the other comes to its peak. `T` is a whole number of ticks, so
//! that each line is a whole number of turns in the evaluated part, and time is counted in nanoseconds, so that
//! nothing accumulates.
//! Invariant: a function of time alone; never more than `n A`.

use std::f64::consts::{PI, TAU};

use crate::base::axis::AxisId;
pub use crate::base::order::Excitation;
use crate::base::time::Span;
use crate::base::units::{Acceleration, Position, Velocity};

/// Most lines: each costs a cosine in every tick.
pub const LINES_MAX: usize = 32;
/// Longest period and most repeats: minutes, where seconds are enough.
const PERIOD_MAX: Span = Span::ms(60_000);
const REPEATS_MAX: u32 = 1_000;
/// Periods beside the evaluated ones: one to rise, one to settle, one to fall.
const PERIODS_BESIDE: i64 = 3;

impl Excitation {
    /// The harmonics, rising.
    pub fn harmonics(&self) -> impl Iterator<Item = u32> + use<> {
        let (low, high) = (f64::from(self.harmonic_min), f64::from(self.harmonic_max));
        let last = f64::from(self.lines.saturating_sub(1).max(1));
        let mut above = self.harmonic_min;
        (0..self.lines).map(move |line| {
            let even = libm::round(low * libm::pow(high / low, f64::from(line) / last)) as u32;
            let harmonic = even.max(above);
            above = harmonic.saturating_add(1);
            harmonic
        })
    }

    /// How often a harmonic swings in a second, Hz.
    pub fn frequency_hz(&self, harmonic: u32) -> f64 {
        f64::from(harmonic) / self.period.as_s()
    }

    /// All of it, rise and fall included.
    pub fn duration(&self) -> Span {
        self.period * (i64::from(self.repeats) + PERIODS_BESIDE)
    }

    /// Whether there is such a signal at this tick: lines that can be told apart below half of its rate, and a
    /// period of whole ticks.
    pub fn is_sound(&self, tick: Span) -> bool {
        let ticks = self.period / tick;
        let span = u64::from(self.harmonic_max).saturating_sub(u64::from(self.harmonic_min));
        tick * ticks == self.period
            && self.harmonic_min >= 1
            && i64::from(self.harmonic_max) * 2 < ticks
            && (1..=LINES_MAX).contains(&usize::from(self.lines))
            && u64::from(self.lines) <= span + 1
            && self.period <= PERIOD_MAX
            && (1..=REPEATS_MAX).contains(&self.repeats)
            && self.amplitude > Velocity::ZERO
            && self.amplitude.is_finite()
    }

    /// Sum over the lines of a value of their angular frequencies in rad/s.
    fn sum(&self, value: impl Fn(f64) -> f64) -> f64 {
        self.harmonics().map(|harmonic| value(TAU * self.frequency_hz(harmonic))).sum()
    }

    /// More than it ever is: all lines at their peaks at once.
    pub fn velocity_max(&self) -> Velocity {
        self.amplitude * f64::from(self.lines)
    }
    /// More than its rate of change ever is.
    pub fn acceleration_max(&self) -> Acceleration {
        Acceleration::m_per_s2(self.amplitude.as_m_per_s() * self.sum(|omega| omega))
    }
    /// More than it ever moves the axis to one side.
    pub fn displacement_max(&self) -> Position {
        Position::m(self.amplitude.as_m_per_s() * self.sum(f64::recip))
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Line {
    harmonic: u32,
    phase_rad: f64,
}

/// An excitation with its phases.
#[derive(Clone, Copy, Debug)]
pub struct Signal {
    excitation: Excitation,
    lines: [Line; LINES_MAX],
}

impl Signal {
    /// Of an excitation that is sound.
    pub fn new(excitation: &Excitation) -> Self {
        let mut lines = [Line::default(); LINES_MAX];
        let mut before = Line { harmonic: excitation.harmonic_min, phase_rad: 0.0 };
        for (number, (line, harmonic)) in lines.iter_mut().zip(excitation.harmonics()).enumerate() {
            let further = f64::from(harmonic.saturating_sub(before.harmonic));
            let turn = further * number as f64 / f64::from(excitation.lines);
            *line = Line { harmonic, phase_rad: before.phase_rad - TAU * turn };
            before = *line;
        }
        Self { excitation: *excitation, lines }
    }

    /// The axis that is excited.
    pub const fn axis(&self) -> AxisId {
        self.excitation.axis
    }

    /// At full strength, so long after the begin of its phase.
    pub fn at(&self, time: Span) -> Velocity {
        let period_ns = self.excitation.period.as_ns().max(1);
        let into_ns = time.as_ns().rem_euclid(period_ns);
        let lines = self.lines.iter().take(usize::from(self.excitation.lines));
        let sum: f64 = lines
            .map(|line| {
                // Whole turns are left out while they are whole.
                let turned_ns = into_ns * i64::from(line.harmonic) % period_ns;
                libm::cos(TAU * (turned_ns as f64 / period_ns as f64) + line.phase_rad)
            })
            .sum();
        self.excitation.amplitude * sum
    }

    /// Strength, 0 to 1, so long after the begin of its rise.
    pub fn share(&self, time: Span) -> f64 {
        let period_s = self.excitation.period.as_s();
        let left_s = (self.excitation.duration() - time).as_s();
        let from_edge = (time.as_s().min(left_s) / period_s).clamp(0.0, 1.0);
        0.5 * (1.0 - libm::cos(PI * from_edge))
    }

    /// Whether the evaluated part is under way, so long after the begin of its rise.
    pub fn is_measured(&self, time: Span) -> bool {
        let period = self.excitation.period;
        let from = period * (PERIODS_BESIDE - 1);
        time >= from && time < from + period * i64::from(self.excitation.repeats)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: Span = Span::us(500);

    fn excitation() -> Excitation {
        Excitation {
            axis: AxisId::X,
            amplitude: Velocity::mm_per_s(0.5),
            period: Span::ms(1_000),
            harmonic_min: 3,
            harmonic_max: 400,
            lines: 24,
            repeats: 8,
        }
    }

    fn ticks(excitation: &Excitation) -> impl Iterator<Item = f64> + use<> {
        let signal = Signal::new(excitation);
        (0..2_000).map(move |tick| signal.at(TICK * tick).as_mm_per_s())
    }

    #[test]
    fn harmonics_rise_from_the_lowest_to_the_highest() {
        for (low, high, lines) in [(3, 400, 24), (1, 5, 5), (7, 9, 3), (2, 60, 32), (5, 5, 1)] {
            let some = Excitation { harmonic_min: low, harmonic_max: high, lines, ..excitation() };
            let harmonics: Vec<u32> = some.harmonics().collect();
            assert_eq!((harmonics.len(), harmonics[0]), (usize::from(lines), low));
            assert_eq!(harmonics.last(), Some(&high), "{harmonics:?}");
            assert!(harmonics.is_sorted_by(|a, b| a < b), "{harmonics:?}");
        }
    }

    #[test]
    fn each_line_has_its_amplitude_and_nothing_else_is_there() {
        let some = excitation();
        let harmonics: Vec<u32> = some.harmonics().collect();
        for harmonic in 0..1_000_u32 {
            let (mut real, mut imaginary) = (0.0, 0.0);
            for (tick, value) in ticks(&some).enumerate() {
                let turn = TAU * f64::from(harmonic) * tick as f64 / 2_000.0;
                real += value * turn.cos();
                imaginary += value * turn.sin();
            }
            let amplitude = f64::hypot(real, imaginary) / 1_000.0;
            let known = if harmonics.contains(&harmonic) { 0.5 } else { 0.0 };
            assert!((amplitude - known).abs() < 1e-9, "harmonic {harmonic}: {amplitude} mm/s");
        }
    }

    #[test]
    fn the_peak_is_far_below_the_sum_and_the_bounds_hold() {
        let some = excitation();
        let values: Vec<f64> = ticks(&some).collect();
        // Of equal phase they would come to n A. Schroeder's phases give neighbours a crest factor of 1.7; lines
        // an octave or less above rest cannot be kept apart in one period, so that of spread ones is 3.2.
        let crest = |some: &Excitation| {
            let peak = ticks(some).fold(0.0_f64, |peak, value| peak.max(value.abs()));
            peak / (some.amplitude.as_mm_per_s() * (0.5 * f64::from(some.lines)).sqrt())
        };
        let neighbours = Excitation { harmonic_min: 1, harmonic_max: 24, ..some };
        assert!(crest(&neighbours) < 1.8, "crest factor {}", crest(&neighbours));
        assert!(crest(&some) < 3.3, "crest factor {}", crest(&some));
        let slope = values.windows(2).fold(0.0_f64, |most, pair| most.max((pair[1] - pair[0]).abs()));
        let bound = some.acceleration_max().as_m_per_s2();
        assert!(slope * 1e-3 / TICK.as_s() < bound, "{slope} mm/s in a tick, bound {bound} m/s^2");
        let mean = values.iter().sum::<f64>() / 2_000.0;
        let mut place = 0.0_f64;
        let (mut least, mut most) = (0.0_f64, 0.0_f64);
        for value in &values {
            place += (value - mean) * TICK.as_s();
            (least, most) = (least.min(place), most.max(place));
        }
        assert!(most - least < 2.0 * some.displacement_max().as_mm(), "{least} to {most} mm");
    }

    #[test]
    fn it_rises_settles_is_evaluated_and_falls() {
        let signal = Signal::new(&excitation());
        let at = |ms| (signal.share(Span::ms(ms)), signal.is_measured(Span::ms(ms)));
        assert_eq!(at(-5), (0.0, false));
        assert_eq!(at(0), (0.0, false));
        assert!((at(500).0 - 0.5).abs() < 1e-12);
        assert_eq!(at(1_000), (1.0, false));
        assert_eq!((at(1_999), at(2_000)), ((1.0, false), (1.0, true)));
        assert_eq!((at(9_999), at(10_000)), ((1.0, true), (1.0, false)));
        assert_eq!((at(11_000).0, at(12_000).0), (0.0, 0.0));
        assert_eq!(excitation().duration(), Span::ms(11_000));
        let measured = (0..30_000).filter(|tick| signal.is_measured(TICK * *tick)).count();
        assert_eq!(measured, 16_000, "eight periods of 2000 ticks");
    }

    #[test]
    fn what_cannot_be_told_apart_is_not_sound() {
        assert!(excitation().is_sound(TICK));
        let spoilt: [fn(&mut Excitation); 11] = [
            |e| e.period = Span::us(999_900),
            |e| e.period = Span::ZERO,
            |e| e.harmonic_min = 0,
            |e| e.harmonic_max = 1_000,
            |e| e.harmonic_max = 20,
            |e| e.lines = 0,
            |e| e.lines = 33,
            |e| e.repeats = 0,
            |e| e.repeats = u32::MAX,
            |e| e.period = Span::ns(i64::MAX / 500_000 * 500_000),
            |e| e.amplitude = Velocity::m_per_s(f64::NAN),
        ];
        for (number, spoil) in spoilt.into_iter().enumerate() {
            let mut other = excitation();
            spoil(&mut other);
            assert!(!other.is_sound(TICK), "{number}: {other:?}");
        }
    }
}
