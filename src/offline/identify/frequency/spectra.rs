//! Lines of the excitation in each of its periods, from records as they come.
//!
//! Invariant: memory holds sums, no rows.

use std::f64::consts::TAU;

use nalgebra::Complex;

use crate::base::axis::AxisId;
use crate::base::input::{Input, What};
use crate::base::order::{Excitation, Order};
use crate::base::record::CycleRecord;
use crate::base::sample::Freshness;
use crate::base::time::Span;

/// One line in one period, or its mean over periods.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spectrum {
    /// Excited velocity command, m/s.
    pub reference: Complex<f64>,
    /// Velocity as the loop sees it, m/s.
    pub velocity: Complex<f64>,
    /// Current command, A.
    pub command: Complex<f64>,
    /// Measured current, A.
    pub current: Complex<f64>,
}

impl Spectrum {
    /// Open velocity loop.
    pub fn open(&self) -> Complex<f64> {
        self.velocity / (self.reference - self.velocity)
    }
    /// Velocity per current command, (m/s)/A.
    pub fn plant(&self) -> Complex<f64> {
        self.velocity / self.command
    }
    /// Measured current per current command.
    pub fn actuator(&self) -> Complex<f64> {
        self.current / self.command
    }

    fn add(&mut self, values: [f64; 4], turn: Complex<f64>) {
        let sums = [&mut self.reference, &mut self.velocity, &mut self.command, &mut self.current];
        for (sum, value) in sums.into_iter().zip(values) {
            *sum += turn * value;
        }
    }
}

/// What was seen of one axis under one excitation.
#[derive(Clone, Debug, PartialEq)]
pub struct Observed {
    /// Which axis.
    pub axis: AxisId,
    /// Gain set that acted.
    pub gain_set: u8,
    /// Harmonics of the period.
    pub harmonics: Vec<u32>,
    /// After which the excitation repeats, s.
    pub period_s: f64,
    /// Each period: its lines.
    pub periods: Vec<Vec<Spectrum>>,
}

impl Observed {
    /// Frequencies of the lines, Hz.
    pub fn frequencies_hz(&self) -> Vec<f64> {
        self.harmonics.iter().map(|harmonic| f64::from(*harmonic) / self.period_s).collect()
    }

    /// The lines, averaged over all periods.
    pub fn mean(&self) -> Vec<Spectrum> {
        self.mean_without(None)
    }

    /// The lines, averaged over all periods but one.
    pub fn mean_without(&self, left_out: Option<usize>) -> Vec<Spectrum> {
        let used = self.periods.iter().enumerate().filter(|(place, _)| Some(*place) != left_out);
        let mut mean = vec![Spectrum::default(); self.harmonics.len()];
        let mut count = 0.0;
        for (_, period) in used {
            count += 1.0;
            for (sum, line) in mean.iter_mut().zip(period) {
                sum.reference += line.reference;
                sum.velocity += line.velocity;
                sum.command += line.command;
                sum.current += line.current;
            }
        }
        for line in &mut mean {
            line.reference /= count;
            line.velocity /= count;
            line.command /= count;
            line.current /= count;
        }
        mean
    }

    /// Standard deviation of the mean of a response, by line: how the answers of the periods scatter, in both parts
    /// of a complex number together.
    pub fn scatter(&self, of: impl Fn(&Spectrum) -> Complex<f64>) -> Vec<f64> {
        let mean = self.mean();
        let count = self.periods.len() as f64;
        (0..self.harmonics.len())
            .map(|line| {
                let centre = of(&mean[line]);
                let square = |period: &Vec<Spectrum>| (of(&period[line]) - centre).norm_sqr();
                let sum: f64 = self.periods.iter().map(square).sum();
                (sum / (count - 1.0).max(1.0) / count).sqrt()
            })
            .collect()
    }

    /// Share of the velocity that repeats from period to period, by line.
    pub fn coherence(&self) -> Vec<f64> {
        let mean = self.mean();
        let share = |(line, mean): (usize, &Spectrum)| {
            let power: f64 = self.periods.iter().map(|period| period[line].velocity.norm_sqr()).sum();
            mean.velocity.norm_sqr() * self.periods.len() as f64 / power
        };
        mean.iter().enumerate().map(share).collect()
    }
}

/// A period under way.
#[derive(Clone, Debug)]
struct Period {
    lines: Vec<Spectrum>,
    /// Its number, and how many rows of it were used.
    number: u64,
    rows: u64,
}

/// A motion under way.
#[derive(Clone, Debug)]
struct Motion {
    excitation: Excitation,
    /// Its number in the log, and its first evaluated cycle.
    number: u32,
    first: Option<u64>,
    period: Option<Period>,
}

/// Collects lines from records in order.
#[derive(Clone, Debug)]
pub struct Collector {
    tick: Span,
    motion: Option<Motion>,
    observed: Vec<Observed>,
}

impl Collector {
    /// For cycles of this length.
    pub const fn new(tick: Span) -> Self {
        Self { tick, motion: None, observed: Vec::new() }
    }

    /// One cycle, and what it was told.
    pub fn see<'i>(&mut self, record: &CycleRecord, inputs: impl Iterator<Item = &'i Input>) {
        for input in inputs {
            if let What::Order(Order::Excited(motion)) = &input.what {
                let number = record.stage.motion;
                let excitation = motion.excitation;
                self.motion = Some(Motion { excitation, number, first: None, period: None });
            }
        }
        let Some(motion) = &mut self.motion else { return };
        if record.stage.motion != motion.number || motion.excitation.axis.index() >= record.axes.count() {
            self.motion = None;
            return;
        }
        let row = &record.axes[motion.excitation.axis];
        if !record.stage.is_measured || row.sample.freshness != Freshness::Fresh {
            return;
        }
        let ticks = (motion.excitation.period / self.tick).max(1) as u64;
        let into = record.cycle - *motion.first.get_or_insert(record.cycle);
        let number = into / ticks;
        let harmonics: Vec<u32> = motion.excitation.harmonics().collect();
        let fresh = || Period { lines: vec![Spectrum::default(); harmonics.len()], number, rows: 0 };
        let period = match &mut motion.period {
            Some(period) if period.number == number => period,
            other => other.insert(fresh()),
        };
        let terms = &row.command.terms;
        let values = [
            (terms.velocity_command + terms.excitation).as_m_per_s(),
            row.sample.velocity.as_m_per_s(),
            row.command.current.as_a(),
            row.sample.current.as_a(),
        ];
        for (line, harmonic) in period.lines.iter_mut().zip(&harmonics) {
            let part = (into % ticks) * u64::from(*harmonic) % ticks;
            let turn = Complex::from_polar(2.0 / ticks as f64, -TAU * part as f64 / ticks as f64);
            line.add(values, turn);
        }
        period.rows += 1;
        // Whole only with every row of it.
        if period.rows == ticks {
            let (excitation, gain_set) = (motion.excitation, row.gain_set);
            if let Some(period) = motion.period.take() {
                self.keep(&excitation, gain_set, period.lines);
            }
        }
    }

    fn keep(&mut self, excitation: &Excitation, gain_set: u8, lines: Vec<Spectrum>) {
        let (axis, period_s) = (excitation.axis, excitation.period.as_s());
        let harmonics: Vec<u32> = excitation.harmonics().collect();
        let is_same = |other: &&mut Observed| {
            other.axis == axis
                && other.gain_set == gain_set
                && other.period_s == period_s
                && other.harmonics == harmonics
        };
        match self.observed.iter_mut().find(is_same) {
            Some(observed) => observed.periods.push(lines),
            None => {
                self.observed.push(Observed { axis, gain_set, harmonics, period_s, periods: vec![lines] })
            }
        }
    }

    /// What was seen.
    pub fn finish(self) -> Vec<Observed> {
        self.observed
    }
}
