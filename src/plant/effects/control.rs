//! What the control that moved an axis did otherwise than the loops of the machine file say. Data of another control
//! show it; our own cycle is what the file says, so no bus and no daemon has any of it.
//!
//! ```text
//!   x_set ──► lag T ──► K_p (1 + p) ──► velocity loop (1 + v) ──► + A sign(v_set) exp(-(t / T_A)^n) ──► i_c
//! ```
//!
//! The lag is exact for straight lines between setpoints, or goes a share of the way to the setpoint in each row. The pulse begins in the row in which the command has turned
//! back, which is before the axis does. Units: m, s, A.
//! Invariant: [`Otherwise::NOTHING`] changes no bit.

use crate::base::setpoint::Setpoint;
use crate::base::time::Span;
use crate::base::units::{Acceleration, Current, Position, Velocity};

/// A command slower than this stands: its sign is that of rounding.
const STANDS_M_PER_S: f64 = 1e-6;

/// What a control does otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Otherwise {
    /// Factor of the gain of the position loop.
    pub position_gain: f64,
    /// Factor of the gains of the velocity loop.
    pub velocity_gain: f64,
    /// By which the loops get setpoints late.
    pub(super) lag_s: f64,
    /// Whether it goes a share of the way to the setpoint in each row, as a control computes it.
    pub(super) lags_by_rows: bool,
    pub(super) pulse_a: f64,
    pub(super) decay_s: f64,
    /// 1: it fades as an exponential; many: it is even, and ends with its time.
    pub(super) exponent: f64,
}

/// What it remembers from row to row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Remembered {
    /// Position, velocity and acceleration of the last setpoint, m and s, and of what was behind the lag.
    last: Option<([f64; 3], [f64; 3])>,
    /// The way of the command, 0 before its first.
    side: f64,
    /// Since it turned back.
    since_s: Option<f64>,
}

impl Otherwise {
    /// As the machine file says.
    pub const NOTHING: Self = Self {
        position_gain: 1.0,
        velocity_gain: 1.0,
        lag_s: 0.0,
        lags_by_rows: false,
        pulse_a: 0.0,
        decay_s: 1.0,
        exponent: 1.0,
    };

    /// The setpoint that the loops get in the next row, where it is another one.
    pub fn late(&self, remembered: &mut Remembered, setpoint: &Setpoint, row: Span) -> Option<Setpoint> {
        if self.lag_s == 0.0 {
            return None;
        }
        let now =
            [setpoint.position.as_m(), setpoint.velocity.as_m_per_s(), setpoint.acceleration.as_m_per_s2()];
        let keep = libm::exp(-row.as_s() / self.lag_s);
        // Of a straight line it is behind by so many rows.
        let rows = if self.lags_by_rows { keep / (1.0 - keep) } else { self.lag_s / row.as_s() };
        let late = match remembered.last {
            // As if it had come with this acceleration for ever.
            None => {
                let behind_s = rows * row.as_s();
                let velocity = now[1] - behind_s * now[2];
                let by_rows_s = if self.lags_by_rows { 0.5 * row.as_s() } else { 0.0 };
                [now[0] - behind_s * (velocity - by_rows_s * now[2]), velocity, now[2]]
            }
            Some((before, late)) => std::array::from_fn(|of| {
                let steady = rows * (now[of] - before[of]);
                now[of] - steady + (late[of] - before[of] + steady) * keep
            }),
        };
        remembered.last = Some((now, late));
        Some(Setpoint {
            position: Position::m(late[0]),
            velocity: Velocity::m_per_s(late[1]),
            acceleration: Acceleration::m_per_s2(late[2]),
        })
    }

    /// Current that is added in the next row to what the loops ask for.
    pub fn current(&self, remembered: &mut Remembered, setpoint: &Setpoint, row: Span) -> Current {
        if self.pulse_a == 0.0 {
            return Current::ZERO;
        }
        let velocity_m_per_s = setpoint.velocity.as_m_per_s();
        let side = velocity_m_per_s.signum();
        if velocity_m_per_s.abs() > STANDS_M_PER_S && side != remembered.side {
            let is_reversal = remembered.side != 0.0;
            remembered.since_s = is_reversal.then_some(0.0);
            remembered.side = side;
        }
        let Some(since_s) = remembered.since_s else { return Current::ZERO };
        remembered.since_s = Some(since_s + row.as_s());
        Current::a(
            self.pulse_a * remembered.side * libm::exp(-libm::pow(since_s / self.decay_s, self.exponent)),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Action, CATALOGUE, Values, entry};
    use super::*;
    use crate::plant::tests::paper_axis;

    const ROW: Span = Span::us(500);

    fn with(name: &str, values: Values) -> Otherwise {
        paper_axis().with_effect(entry(name).unwrap(), values).otherwise()
    }

    fn ramp(row: i32) -> Setpoint {
        Setpoint {
            position: Position::mm(0.01 * f64::from(row)),
            velocity: Velocity::mm_per_s(20.0),
            acceleration: Acceleration::ZERO,
        }
    }

    #[test]
    fn a_lag_is_late_by_its_time_and_keeps_the_velocity() {
        let filter = with("command-filter", [8.0, 0.0, 0.0]);
        let mut remembered = Remembered::default();
        for row in 0..200 {
            let late = filter.late(&mut remembered, &ramp(row), ROW).expect("a filter");
            let behind_mm = (ramp(row).position - late.position).as_mm();
            assert!((behind_mm - 20.0 * 8e-3).abs() < 1e-9, "row {row}: {behind_mm} mm");
            assert!((late.velocity.as_mm_per_s() - 20.0).abs() < 1e-6, "row {row}: {:?}", late.velocity);
        }
        // The command stops: what is left fades with the time constant.
        let stop = Setpoint::at_rest(ramp(199).position);
        let mut late = stop;
        for _ in 0..16 {
            late = filter.late(&mut remembered, &stop, ROW).expect("a filter");
        }
        let left = (stop.position - late.position).as_mm() / (20.0 * 8e-3);
        assert!((left - (-1.0_f64).exp()).abs() < 1e-9, "{left} of the lag after a time constant");
    }

    #[test]
    fn a_lag_by_rows_goes_a_share_of_the_way_in_each_and_is_half_a_row_less_behind() {
        let filter = with("command-filter-by-rows", [8.0, 0.0, 0.0]);
        let keep = (-0.5_f64 / 8.0).exp();
        let mut remembered = Remembered::default();
        // As if it had come with this acceleration for ever: no row knows which is the first.
        let parabola = |row: i32| {
            let (t, mm_per_s2) = (f64::from(row) * ROW.as_s(), 4_000.0);
            Setpoint {
                position: Position::mm(0.5 * mm_per_s2 * t * t),
                velocity: Velocity::mm_per_s(mm_per_s2 * t),
                acceleration: Acceleration::m_per_s2(1e-3 * mm_per_s2),
            }
        };
        let late: Vec<Setpoint> = (100..200)
            .map(|row| filter.late(&mut remembered, &parabola(row), ROW).expect("a filter"))
            .collect();
        for (row, late) in (101..200).zip(late.windows(2)) {
            let wanted = keep * late[0].position.as_mm() + (1.0 - keep) * parabola(row).position.as_mm();
            assert!((late[1].position.as_mm() - wanted).abs() < 1e-9, "row {row}: {late:?}");
        }
        let third = |of: &dyn Fn(usize) -> f64| of(3) - 3.0 * of(2) + 3.0 * of(1) - of(0);
        assert!(third(&|row| late[row].position.as_mm()).abs() < 1e-12, "it begins as it goes on");

        let mut remembered = Remembered::default();
        let behind_mm: Vec<f64> = (0..50)
            .map(|row| {
                let late = filter.late(&mut remembered, &ramp(row), ROW).expect("a filter");
                (ramp(row).position - late.position).as_mm()
            })
            .collect();
        // To second order in the row; the next term is a twelfth of it over the time.
        let wanted_mm = 20.0 * (8.0 - 0.25 + 0.5 * 0.5 / 12.0 / 8.0) * 1e-3;
        assert!(behind_mm.iter().all(|behind| (behind - wanted_mm).abs() < 1e-5), "{behind_mm:?}");
    }

    #[test]
    fn a_lag_that_is_short_beside_a_row_delays_the_velocity_by_no_more() {
        let filter = with("command-filter", [0.02, 0.0, 0.0]);
        let mut remembered = Remembered::default();
        for row in 0..50 {
            let (t, mm_per_s2) = (f64::from(row) * ROW.as_s(), 4_000.0);
            let setpoint = Setpoint {
                position: Position::mm(0.5 * mm_per_s2 * t * t),
                velocity: Velocity::mm_per_s(mm_per_s2 * t),
                acceleration: Acceleration::m_per_s2(1e-3 * mm_per_s2),
            };
            let late = filter.late(&mut remembered, &setpoint, ROW).expect("a filter");
            let behind = (setpoint.velocity - late.velocity).as_mm_per_s();
            assert!((behind - 0.02e-3 * mm_per_s2).abs() < 1e-9, "row {row}: {behind} mm/s");
        }
    }

    #[test]
    fn a_pulse_begins_as_the_command_turns_back_and_fades() {
        let pulse = with("reversal-compensation", [0.5, 20.0, 1.0]);
        let mut remembered = Remembered::default();
        let mut at = |mm_per_s: f64| {
            let setpoint = Setpoint { velocity: Velocity::mm_per_s(mm_per_s), ..Setpoint::default() };
            pulse.current(&mut remembered, &setpoint, ROW).as_a()
        };
        let first: Vec<f64> = [1.0, 0.5, 0.0].map(&mut at).to_vec();
        assert_eq!(first, [0.0; 3], "nothing before the first reversal");
        assert_eq!(at(-0.1), -0.5);
        let after: Vec<f64> = (0..40).map(|_| at(-1.0)).collect();
        assert!((after[39] + 0.5 * (-1.0_f64).exp()).abs() < 1e-9, "{} A after 20 ms", after[39]);
        assert_eq!(at(0.1), 0.5, "the other way");

        let even = with("reversal-compensation", [0.5, 20.0, 20.0]);
        let mut remembered = Remembered::default();
        let mut at = |mm_per_s: f64| {
            let setpoint = Setpoint { velocity: Velocity::mm_per_s(mm_per_s), ..Setpoint::default() };
            even.current(&mut remembered, &setpoint, ROW).as_a()
        };
        let after: Vec<f64> = [1.0].into_iter().chain([-1.0; 60]).map(&mut at).collect();
        assert!(after[1..30].iter().all(|a| (a + 0.5).abs() < 2e-3), "{after:?}");
        assert!(after[50..].iter().all(|a| a.abs() < 2e-3), "{after:?}");
    }

    #[test]
    fn what_a_control_does_is_no_matter_of_the_plant() {
        for entry in CATALOGUE.iter().filter(|entry| matches!(entry.action, Action::Control(_))) {
            let axis = paper_axis().with_effect(entry, entry.nominal());
            assert_ne!(axis.otherwise(), Otherwise::NOTHING, "{}", entry.name);
            assert!(super::super::acting::Acting::new(&axis).is_none(), "{}", entry.name);
        }
    }
}
