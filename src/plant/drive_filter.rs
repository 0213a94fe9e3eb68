//! A filter of the drive before its current loop, a lag of first order.
//!
//! ```text
//!   c' = (u - c) / T        ∫ c dt over h  =  u h + (c_0 - u) T (1 - exp(-h / T))
//! ```
//!
//! The command that it makes of one that is held is no longer held. The current loop gets its mean over each part of a
//! tick: the same charge, and no more than the lag of the current loop smooths anyway.
//! Invariant: without a time constant a command is as it was, to the bit.

use super::params::Actuator;
use crate::base::time::Span;

/// The filter, with what it remembers.
#[derive(Clone, Copy, Debug)]
pub(super) struct DriveFilter {
    /// Time constant, s; zero is no filter.
    lag_s: f64,
    /// How long the two parts of a tick are, s.
    parts_s: [f64; 2],
    /// What comes out of it, N.
    out_n: f64,
}

impl DriveFilter {
    /// Of an actuator, where the first part of a tick is so long; what comes out is zero.
    pub(super) fn new(actuator: &Actuator, early_s: f64, tick: Span) -> Self {
        Self { lag_s: actuator.filter_s, parts_s: [early_s, tick.as_s() - early_s], out_n: 0.0 }
    }

    /// The same where this has come out of it for long.
    pub(super) const fn at(self, out_n: f64) -> Self {
        Self { out_n, ..self }
    }

    /// The same with what another remembers.
    pub(super) const fn taken_over(self, other: &Self) -> Self {
        self.at(other.out_n)
    }

    /// What it makes of the commands of the parts of a tick, N.
    #[inline(always)]
    pub(super) fn passed(&mut self, commands_n: [f64; 2]) -> [f64; 2] {
        if self.lag_s == 0.0 { commands_n } else { self.filtered(commands_n) }
    }

    #[cold]
    #[inline(never)]
    fn filtered(&mut self, commands_n: [f64; 2]) -> [f64; 2] {
        let mut passed_n = commands_n;
        for (passed_n, length_s) in passed_n.iter_mut().zip(self.parts_s).filter(|(_, length_s)| *length_s > 0.0)
        {
            let ticks = length_s / self.lag_s;
            let gone = -(-ticks).exp_m1();
            let off_n = self.out_n - *passed_n;
            self.out_n -= off_n * gone;
            *passed_n += off_n * gone / ticks;
        }
        passed_n
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::units::Current;

    fn filter(lag_s: f64) -> DriveFilter {
        let actuator = Actuator {
            torque_constant_nm_per_a: 1.0,
            current_loop_hz: 300.0,
            filter_s: lag_s,
            dead_time: Span::ZERO,
            peak_current: Current::a(10.0),
        };
        DriveFilter::new(&actuator, 2e-4, Span::us(500))
    }

    #[test]
    fn a_step_comes_out_as_its_mean_over_each_part() {
        let mut filter = filter(1e-3);
        let mut time_s = 0.0_f64;
        for _ in 0..6 {
            for (passed_n, length_s) in filter.passed([1.0, 1.0]).into_iter().zip([2e-4, 3e-4]) {
                let end_s = time_s + length_s;
                // ∫ 1 - exp(-t / T) dt.
                let mean = 1.0 - 1e-3 * ((-time_s / 1e-3).exp() - (-end_s / 1e-3).exp()) / length_s;
                assert!((passed_n - mean).abs() < 1e-12, "{passed_n} and not {mean}");
                time_s = end_s;
            }
        }
    }

    #[test]
    fn without_a_lag_nothing_changes() {
        assert_eq!(filter(0.0).passed([0.1, 0.7]), [0.1, 0.7]);
    }
}
