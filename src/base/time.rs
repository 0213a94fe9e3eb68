//! Moments, spans and the control period. A moment is a point on the monotonic clock of one run,
//! a span is a length of time; both count whole nanoseconds, so a grid never drifts.
//!
//! Invariant: `Moment - Moment` is a [`Span`]; `Moment + Moment` does not exist. No clock is read here.

use std::ops::{Add, Div, Mul, Sub};

/// A point in time: nanoseconds on the clock that paces the cycle (zero at its first cycle in
/// virtual time, the monotonic clock on a machine).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Moment(i64);

/// A length of time in nanoseconds, signed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Span(i64);

impl Moment {
    /// The origin of the clock.
    pub const ZERO: Self = Self(0);
    /// From nanoseconds since the origin.
    pub const fn ns(value: i64) -> Self {
        Self(value)
    }
    /// Nanoseconds since the origin.
    pub const fn as_ns(self) -> i64 {
        self.0
    }
    /// Seconds since the origin.
    pub const fn as_s(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

impl Span {
    /// No time at all.
    pub const ZERO: Self = Self(0);
    /// From nanoseconds.
    pub const fn ns(value: i64) -> Self {
        Self(value)
    }
    /// From microseconds.
    pub const fn us(value: i64) -> Self {
        Self(value * 1_000)
    }
    /// From milliseconds.
    pub const fn ms(value: i64) -> Self {
        Self(value * 1_000_000)
    }
    /// From seconds, to the nearest nanosecond.
    pub fn s(value: f64) -> Self {
        Self((value * 1e9).round() as i64)
    }
    /// In nanoseconds.
    pub const fn as_ns(self) -> i64 {
        self.0
    }
    /// In microseconds.
    pub const fn as_us(self) -> f64 {
        self.0 as f64 * 1e-3
    }
    /// In seconds.
    pub const fn as_s(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

impl Sub for Moment {
    type Output = Span;
    fn sub(self, earlier: Self) -> Span {
        Span(self.0 - earlier.0)
    }
}
impl Add<Span> for Moment {
    type Output = Self;
    fn add(self, span: Span) -> Self {
        Self(self.0 + span.0)
    }
}
impl Sub<Span> for Moment {
    type Output = Self;
    fn sub(self, span: Span) -> Self {
        Self(self.0 - span.0)
    }
}
impl Add for Span {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}
impl Sub for Span {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}
impl Mul<i64> for Span {
    type Output = Self;
    fn mul(self, count: i64) -> Self {
        Self(self.0 * count)
    }
}
impl Div for Span {
    type Output = i64;
    /// How many whole times the other fits in.
    fn div(self, other: Self) -> i64 {
        self.0 / other.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_of_half_milliseconds_does_not_drift() {
        let period = Span::us(500);
        let after_an_hour = Moment::ZERO + period * (2 * 3_600_000);
        assert_eq!(after_an_hour - Moment::ZERO, Span::s(3600.0));
        assert_eq!((after_an_hour - Moment::ZERO) / period, 7_200_000);
    }
}
