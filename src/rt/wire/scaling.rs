//! Counts and quantities: the only file with scale factors of the wire.
//!
//! The board speaks in counts: encoder counts that wrap at 2^32, and micro-amperes. An
//! [`Odometer`] undoes the wrap by signed differences, an [`AxisScale`] turns counts into travel
//! and current of the axis and back:
//!
//! `position = counts * lead / counts per revolution`, `table position = counts / counts per metre`,
//! each times the sense in which the encoder counts along the axis. The current has the sense of
//! the motor encoder: positive current moves the motor towards higher counts.
//! Invariant: raw counts leave this file only as quantities.

use crate::base::units::{Current, Position};

/// An encoder reading as it came: it wraps at 2^32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderCounts(u32);

impl EncoderCounts {
    /// As received.
    pub const fn counts(value: u32) -> Self {
        Self(value)
    }
    /// As sent.
    pub const fn as_counts(self) -> u32 {
        self.0
    }
    /// The signed way from an earlier reading: right as long as it was less than 2^31 counts.
    pub const fn since(self, earlier: Self) -> TravelCounts {
        TravelCounts(self.0.wrapping_sub(earlier.0) as i32 as i64)
    }
    /// The reading after `travel` more.
    pub const fn after(self, travel: TravelCounts) -> Self {
        Self(self.0.wrapping_add(travel.0 as u32))
    }
}

/// A way in encoder counts, with the wrap undone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TravelCounts(i64);

impl TravelCounts {
    /// From a number of counts.
    pub const fn counts(value: i64) -> Self {
        Self(value)
    }
    /// The whole number at or below: without the call that a floor is on most processors.
    fn at_or_below(value: f64) -> Self {
        let toward_zero = value as i64;
        Self(toward_zero.saturating_sub(i64::from(toward_zero as f64 > value)))
    }
    /// As a number of counts.
    pub const fn as_counts(self) -> i64 {
        self.0
    }
}

/// A current as it travels: micro-amperes in the drive's own sense, ±2147 A.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct CurrentCounts(i32);

impl CurrentCounts {
    /// No current.
    pub const ZERO: Self = Self(0);
    /// From micro-amperes.
    pub const fn ua(value: i32) -> Self {
        Self(value)
    }
    /// In micro-amperes.
    pub const fn as_ua(self) -> i32 {
        self.0
    }
    /// From whole milli-amperes, held at the highest current that can travel.
    pub const fn ma(value: u32) -> Self {
        let value_ua = value as u64 * 1_000;
        Self(if value_ua > i32::MAX as u64 { i32::MAX } else { value_ua as i32 })
    }
    /// Held within `±bound`.
    pub fn clamp_abs(self, bound: Self) -> Self {
        Self(self.0.clamp(-bound.0.abs(), bound.0.abs()))
    }
}

/// How far an encoder has moved since it was first heard.
#[derive(Clone, Copy, Debug, Default)]
pub struct Odometer {
    last: Option<EncoderCounts>,
    total: TravelCounts,
}

impl Odometer {
    /// The way since the first reading, with this one.
    pub fn advance(&mut self, reading: EncoderCounts) -> TravelCounts {
        let step = self.last.map_or(TravelCounts(0), |last| reading.since(last));
        self.last = Some(reading);
        // An i64 of counts lasts for 2^32 wraps; wrapping keeps this free of a panic path.
        self.total = TravelCounts(self.total.0.wrapping_add(step.0));
        self.total
    }
}

/// In which sense an encoder counts along its axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sense {
    /// Counts grow with the position of the axis.
    #[default]
    Along,
    /// Counts fall as the position of the axis grows.
    Against,
}

impl Sense {
    const fn sign(self) -> f64 {
        match self {
            Self::Along => 1.0,
            Self::Against => -1.0,
        }
    }
}

/// What an [`AxisScale`] is made from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleSettings {
    /// Travel of the axis per motor revolution.
    pub lead: Position,
    /// Motor encoder counts per motor revolution.
    pub motor_counts_per_rev: u32,
    /// Sense of the motor encoder, and of the current.
    pub motor_sense: Sense,
    /// Table scale counts per millimetre; `None` without a table scale.
    pub table_counts_per_mm: Option<u32>,
    /// Sense of the table scale.
    pub table_sense: Sense,
}

/// Counts to quantities of one axis and back, with the divisions done beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisScale {
    travel_per_count_m: f64,
    counts_per_travel_m: f64,
    table_travel_per_count_m: Option<f64>,
    table_counts_per_travel_m: f64,
    ampere_per_count: f64,
    counts_per_ampere: f64,
}

impl AxisScale {
    /// From what the machine file and the board's sheet say, both checked there: lead and counts
    /// are above zero.
    pub fn new(settings: &ScaleSettings) -> Self {
        let motor_sign = settings.motor_sense.sign();
        let motor_counts_per_rev = f64::from(settings.motor_counts_per_rev);
        let lead_m = settings.lead.as_m();
        let table_counts_per_m = settings
            .table_counts_per_mm
            .map(|counts_per_mm| settings.table_sense.sign() * 1e3 * f64::from(counts_per_mm));
        Self {
            travel_per_count_m: motor_sign * lead_m / motor_counts_per_rev,
            counts_per_travel_m: motor_sign * motor_counts_per_rev / lead_m,
            table_travel_per_count_m: table_counts_per_m.map(f64::recip),
            table_counts_per_travel_m: table_counts_per_m.unwrap_or(0.0),
            ampere_per_count: motor_sign * 1e-6,
            counts_per_ampere: motor_sign * 1e6,
        }
    }

    /// Travel of the axis for a way of its motor encoder.
    pub const fn motor_position(&self, travel: TravelCounts) -> Position {
        Position::m(travel.0 as f64 * self.travel_per_count_m)
    }
    /// Travel of the axis for one count of its motor encoder.
    pub const fn motor_resolution(&self) -> Position {
        Position::m(self.travel_per_count_m.abs())
    }
    /// Travel of the table for a way of its scale; NaN without a table scale.
    pub const fn table_position(&self, travel: TravelCounts) -> Position {
        Position::m(match self.table_travel_per_count_m {
            Some(travel_per_count_m) => travel.0 as f64 * travel_per_count_m,
            None => f64::NAN,
        })
    }
    /// Current of the axis: positive drives it towards higher positions.
    pub const fn current(&self, counts: CurrentCounts) -> Current {
        Current::a(counts.0 as f64 * self.ampere_per_count)
    }

    /// What a motor encoder shows that was zero at position zero: the count at or below.
    pub fn motor_counts(&self, position: Position) -> TravelCounts {
        TravelCounts::at_or_below(position.as_m() * self.counts_per_travel_m)
    }
    /// What a table scale shows that was zero at position zero: the count at or below.
    pub fn table_counts(&self, position: Position) -> TravelCounts {
        TravelCounts::at_or_below(position.as_m() * self.table_counts_per_travel_m)
    }
    /// A current of the axis as it travels: to the nearest micro-ampere, held at the ends of the
    /// range. A NaN travels as zero; `rt/control` stops the axis for it.
    pub fn current_counts(&self, current: Current) -> CurrentCounts {
        CurrentCounts(nearest(current.as_a() * self.counts_per_ampere) as i32)
    }
}

/// The nearest whole number, of two as near the even one; beyond an `i32` only that it is beyond. Where numbers are so large they have no
/// fractions, and adding one rounds: without the call that rounding is on most processors.
fn nearest(value: f64) -> f64 {
    const LARGE: f64 = 1.5 * (1_u64 << 52) as f64;
    (value + LARGE) - LARGE
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lead 10 mm, 20 bit per revolution against the axis, table scale 10 nm.
    fn scale() -> AxisScale {
        AxisScale::new(&ScaleSettings {
            lead: Position::mm(10.0),
            motor_counts_per_rev: 1 << 20,
            motor_sense: Sense::Against,
            table_counts_per_mm: Some(100_000),
            table_sense: Sense::Along,
        })
    }

    #[test]
    fn one_revolution_is_one_lead() {
        let one_rev = scale().motor_position(TravelCounts::counts(1 << 20));
        assert!((one_rev.as_mm() + 10.0).abs() < 1e-12, "{one_rev}, expected -0.01 m within 1e-15 m");
        let one_mm = scale().table_position(TravelCounts::counts(100_000));
        assert!((one_mm.as_mm() - 1.0).abs() < 1e-12, "{one_mm}, expected 0.001 m within 1e-15 m");
    }

    #[test]
    fn without_a_table_scale_its_position_is_not_a_number() {
        let settings = ScaleSettings {
            lead: Position::mm(10.0),
            motor_counts_per_rev: 4096,
            motor_sense: Sense::Along,
            table_counts_per_mm: None,
            table_sense: Sense::Along,
        };
        let scale = AxisScale::new(&settings);
        assert!(!scale.table_position(TravelCounts::counts(5)).is_finite());
        assert_eq!(scale.table_counts(Position::mm(3.0)), TravelCounts::counts(0));
    }

    #[test]
    fn an_encoder_shows_the_count_at_or_below() {
        let scale = scale();
        for counts in [-3, -1, 0, 1, 1 << 33] {
            let inside = (counts as f64 + 0.5) * 1e-5;
            assert_eq!(scale.table_counts(Position::mm(inside)), TravelCounts::counts(counts));
        }
        let ends = [(f64::NAN, 0), (1e300, i64::MAX), (-1e300, i64::MIN)];
        for (value, below) in [(-2.0, -2), (-0.1, -1), (0.0, 0), (2.9, 2)].into_iter().chain(ends) {
            assert_eq!(TravelCounts::at_or_below(value), TravelCounts::counts(below), "{value}");
        }
        let back = scale.motor_position(scale.motor_counts(Position::um(123.0)));
        let resolution_um = 10_000.0 / f64::from(1 << 20);
        assert!((back.as_um() - 123.0).abs() <= resolution_um, "{} um", back.as_um());
    }

    #[test]
    fn current_has_the_sense_of_the_motor_encoder_and_an_end() {
        let scale = scale();
        assert_eq!(scale.current_counts(Current::a(1.5)), CurrentCounts::ua(-1_500_000));
        assert_eq!(scale.current(CurrentCounts::ua(-1_500_000)), Current::a(1.5));
        assert_eq!(scale.current_counts(Current::a(-1e9)), CurrentCounts::ua(i32::MAX));
        assert_eq!(scale.current_counts(Current::a(f64::NAN)), CurrentCounts::ZERO);
        assert_eq!(CurrentCounts::ma(u32::MAX), CurrentCounts::ua(i32::MAX));
    }

    #[test]
    fn of_two_whole_numbers_as_near_the_even_one_is_nearest() {
        let near = [0.0, 0.49, -0.49, 0.5, -0.5, 1.5, -1.5, 2.5, -2.5, 2.500_1, 1_234_567.5, -7.49];
        let ends =
            [f64::from(i32::MAX) + 0.4, f64::from(i32::MIN) - 0.6, 1e16, -1e300, f64::INFINITY, f64::NAN];
        for value in near.into_iter().chain(ends) {
            assert_eq!(nearest(value) as i32, value.round_ties_even() as i32, "{value}");
        }
    }

    #[test]
    fn an_odometer_goes_over_the_wrap_both_ways() {
        let mut odometer = Odometer::default();
        let mut show = |counts| odometer.advance(EncoderCounts::counts(counts)).as_counts();
        assert_eq!(show(u32::MAX - 9), 0);
        assert_eq!(show(10), 20);
        assert_eq!(show(u32::MAX - 9), 0);
        assert_eq!(show((u32::MAX - 9).wrapping_add(i32::MAX as u32)), i64::from(i32::MAX));
    }
}
