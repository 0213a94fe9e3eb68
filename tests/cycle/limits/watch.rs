//! What must hold of one axis in every cycle.

use proptest::prelude::*;
use proptest::test_runner::TestCaseError;
use quadrant::base::axis::AxisId;
use quadrant::base::command::Limits;
use quadrant::base::record::{AxisRecord, ModeTag};
use quadrant::base::sample::Freshness;
use quadrant::base::units::{Acceleration, Position, Velocity};

use crate::common::Rig;

/// Whether the mode lets current flow.
fn is_energised(row: &AxisRecord) -> bool {
    matches!(row.mode, ModeTag::Ready | ModeTag::Moving | ModeTag::Stopping)
}

/// Follows one axis from cycle to cycle.
#[derive(Clone, Copy)]
pub(crate) struct Watch {
    pub(crate) before: AxisRecord,
    /// Where it was when it last had no current.
    pub(crate) place: Position,
    ticks_since_change: u32,
}

impl Watch {
    pub(crate) fn new() -> Self {
        Self { before: AxisRecord::default(), place: Position::ZERO, ticks_since_change: 4 }
    }

    /// Every promise about one axis in one cycle.
    pub(crate) fn check(
        &mut self,
        rig: &Rig,
        axis: AxisId,
        row: &AxisRecord,
        periods: u64,
    ) -> Result<(), TestCaseError> {
        let settings = &rig.machine.axes[axis].control;
        let (limits, command) = (&settings.limits, &row.command);
        let terms = &command.terms;
        let numbers = [
            command.current.as_a(),
            terms.following_error.as_m(),
            terms.velocity_command.as_m_per_s(),
            terms.proportional.as_nm(),
            terms.integral.as_nm(),
            row.setpoint.position.as_m(),
            row.sample.velocity.as_m_per_s(),
        ];
        prop_assert!(numbers.into_iter().all(f64::is_finite), "not a number: {row:?}");
        prop_assert!(command.current.abs() <= limits.current, "{} above its limit", command.current);
        for speed in [terms.velocity_command.abs(), (terms.velocity_command + terms.excitation).abs()] {
            let most = limits.velocity + Velocity::m_per_s(1e-12);
            prop_assert!(speed <= most, "velocity command {speed} above {}", limits.velocity);
        }
        prop_assert!(is_energised(row) || terms.excitation == Velocity::ZERO, "excited without current");
        if !is_energised(row) {
            prop_assert_eq!(command.current.as_a(), 0.0, "current in {}", row.mode.name());
            self.place = row.sample.position;
        } else if row.sample.freshness == Freshness::Fresh {
            self.check_clamps(rig, axis, row)?;
        }
        self.check_change(limits.acceleration, rig.machine.cycle.period.as_s(), row, periods)?;
        self.before = *row;
        Ok(())
    }

    /// A clamp acted where its bit says so, and nowhere else.
    fn check_clamps(&self, rig: &Rig, axis: AxisId, row: &AxisRecord) -> Result<(), TestCaseError> {
        let settings = &rig.machine.axes[axis].control;
        let (limits, terms) = (&settings.limits, &row.command.terms);
        let (low, high) = limits.reach_from(self.place);
        let held_m = (terms.following_error + row.sample.position).as_m();
        let slack_m = 1e-12;
        prop_assert!(
            held_m >= low.as_m() - slack_m && held_m <= high.as_m() + slack_m,
            "setpoint held at {held_m} m, outside {low} to {high}"
        );
        let is_outside = row.setpoint.position < low || row.setpoint.position > high;
        prop_assert_eq!(row.command.limits.contains(Limits::TRAVEL), is_outside, "travel bit: {:?}", row);
        let torque = terms.proportional + terms.integral + (terms.friction + terms.inertia);
        let wanted = settings.axis.actuator.current(torque);
        let is_above = wanted.abs() > limits.current;
        prop_assert_eq!(row.command.limits.contains(Limits::CURRENT), is_above, "current bit: {:?}", row);
        if !is_above {
            prop_assert_eq!(row.command.current, wanted);
        }
        if terms.velocity_command.abs() == limits.velocity && self.before.mode == row.mode {
            let bits = row.command.limits.with(self.before.command.limits);
            prop_assert!(bits.contains(Limits::VELOCITY), "velocity bit missing: {:?}", row);
        }
        Ok(())
    }

    fn check_change(
        &mut self,
        limit: Acceleration,
        period_s: f64,
        row: &AxisRecord,
        periods: u64,
    ) -> Result<(), TestCaseError> {
        self.ticks_since_change = self.ticks_since_change.saturating_add(periods as u32);
        if !is_energised(row) {
            self.ticks_since_change = 4;
            return Ok(());
        }
        // An axis that gets current starts from the velocity it has, within the limit.
        let from = if is_energised(&self.before) {
            self.before.command.terms.velocity_command
        } else {
            self.before.sample.velocity.clamp_abs(Velocity::mm_per_s(60.0))
        };
        let change = (row.command.terms.velocity_command - from).as_m_per_s().abs();
        let bound = limit.as_m_per_s2() * period_s * f64::from(self.ticks_since_change.max(4));
        prop_assert!(change <= bound + 1e-12, "velocity command stepped by {change} m/s, bound {bound} m/s");
        if change > 0.0 {
            self.ticks_since_change = 0;
        }
        Ok(())
    }
}
