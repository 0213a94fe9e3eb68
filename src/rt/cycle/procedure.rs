//! Procedures: orders given in sequence, each when the one before is carried out. They run beside the
//! cycle, see only its records, and so take the same course on a machine and in simulation.
//!
//! The circular test: enable, choose gains, then for each circle move to its start and run it, and
//! disable. A fault, or the operator's stop, ends it with the axes at rest and without current.
//! Invariant: an order is given only from a state in which the cycle accepts it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::base::axis::AxisId;
use crate::base::fault::Fault;
use crate::base::record::{AxisRecord, CycleRecord, ModeTag};
use crate::base::sample::Freshness;
use crate::base::units::{Position, Velocity};
use crate::rt::control::profile::{CircleMotion, LineMotion, line_duration_s};
use crate::rt::door::{Order, Orders};
use crate::rt::drive::state::DriveState;

/// Ticks of the position loop that a drive has to let go of the current, once it is told to.
const RELEASE_TICKS_MAX: u32 = 50;

/// Most circles of one test: one each way.
pub const CIRCLES_MAX: usize = 2;

/// What a circular test does.
#[derive(Clone, Copy, Debug)]
pub struct CircleTest {
    /// Gain set of every axis.
    pub gain_set: u8,
    /// The circles, in order.
    pub circles: [Option<CircleMotion>; CIRCLES_MAX],
    /// On the way to the start of a circle.
    pub positioning_feed: Velocity,
}

impl CircleTest {
    /// How long the motions take from both axes at zero, s; enabling and settling come on top.
    pub fn duration_s(&self) -> f64 {
        let mut place = (Position::ZERO, Position::ZERO);
        let mut sum_s = 0.0;
        for circle in self.circles.iter().flatten() {
            let start = circle.start();
            let way = Position::m((start.0 - place.0).as_m().hypot((start.1 - place.1).as_m()));
            sum_s += line_duration_s(way, self.positioning_feed, circle.acceleration) + circle.duration_s();
            place = circle.end();
        }
        sum_s
    }
}

/// How far it has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Enable,
    UseGains,
    Position { circle: usize },
    Circle { circle: usize },
    Stop,
    Disable,
    Done,
}

/// How it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// All circles were run.
    Complete,
    /// The operator stopped it.
    Interrupted,
    /// A fault stopped it: the first axis with one that is its own.
    Faulted(AxisId, Fault),
}

/// A circular test under way.
#[derive(Clone, Debug)]
pub struct CircleProcedure {
    test: CircleTest,
    step: Step,
    ending: Ending,
    /// Ticks since the last step.
    release_ticks: u32,
    stop_wish: Arc<AtomicBool>,
}

impl CircleProcedure {
    /// A test to be run; setting `stop_wish` ends it early.
    pub fn new(test: CircleTest, stop_wish: Arc<AtomicBool>) -> Self {
        Self { test, step: Step::Enable, ending: Ending::Complete, release_ticks: 0, stop_wish }
    }

    /// How it ended, once it is done.
    pub fn ending(&self) -> Ending {
        self.ending
    }

    fn is_everywhere(last: &CycleRecord, mode: ModeTag) -> bool {
        last.axes.as_slice().iter().all(|axis| axis.mode == mode)
    }

    /// The fault that started it all; axes stopped along with it come last.
    fn fault(last: &CycleRecord) -> Option<(AxisId, Fault)> {
        let faults = || last.axes.iter().filter_map(|(id, axis)| Some((id, axis.fault?)));
        faults().find(|(_, fault)| *fault != Fault::OtherAxis).or_else(|| faults().next())
    }

    fn positioning(&self, circle: &CircleMotion, last: &CycleRecord) -> Order {
        let (x, y) = circle.start();
        let mut target = last.axes.map(|_, axis| axis.setpoint.position);
        target[AxisId::X] = x;
        target[AxisId::Y] = y;
        Order::Line(LineMotion {
            target,
            feed: self.test.positioning_feed,
            acceleration: circle.acceleration,
        })
    }

    /// The step after `circle`, or the first.
    fn after(&self, circle: Option<usize>) -> Step {
        let next = circle.map_or(0, |done| done + 1);
        match self.test.circles.get(next) {
            Some(Some(_)) => Step::Position { circle: next },
            Some(None) | None => Step::Disable,
        }
    }

    fn watch(&mut self, last: &CycleRecord) {
        if let Some((axis, fault)) = Self::fault(last) {
            if self.ending == Ending::Complete {
                self.ending = Ending::Faulted(axis, fault);
            }
            self.step = Step::Done;
        } else if self.stop_wish.load(Ordering::Relaxed) && self.ending == Ending::Complete {
            self.ending = Ending::Interrupted;
            self.step = Step::Stop;
        }
    }
}

impl Orders for CircleProcedure {
    fn next(&mut self, last: &CycleRecord) -> Option<Order> {
        self.watch(last);
        self.release_ticks += u32::from(self.step == Step::Done);
        let is_ready = Self::is_everywhere(last, ModeTag::Ready);
        let circle = |index: usize| self.test.circles.get(index).copied().flatten();
        let (order, step) = match self.step {
            Step::Enable if Self::is_everywhere(last, ModeTag::Off) => (Order::Enable, Step::UseGains),
            Step::UseGains if is_ready => (Order::UseGains(self.test.gain_set), self.after(None)),
            Step::Position { circle: index } if is_ready => {
                (self.positioning(&circle(index)?, last), Step::Circle { circle: index })
            }
            Step::Circle { circle: index } if is_ready => {
                (Order::Circle(circle(index)?), self.after(Some(index)))
            }
            Step::Stop => (Order::Stop, Step::Disable),
            Step::Disable if is_ready => (Order::Disable, Step::Done),
            // Stopped before anything had current: there is nothing to disable.
            Step::Disable if Self::is_everywhere(last, ModeTag::Off) => {
                self.step = Step::Done;
                return None;
            }
            Step::Enable
            | Step::UseGains
            | Step::Position { .. }
            | Step::Circle { .. }
            | Step::Disable
            | Step::Done => return None,
        };
        self.step = step;
        Some(order)
    }

    fn is_done(&self, last: &CycleRecord) -> bool {
        let is_at_rest = |axis: &AxisRecord| matches!(axis.mode, ModeTag::Off | ModeTag::Faulted);
        // The order to let go acts at a later SYNC: ending before would leave it to the boards' watchdogs.
        // A board that is not heard, or does not obey, is left to its watchdog after all.
        let is_released = |axis: &AxisRecord| {
            axis.sample.freshness != Freshness::Fresh
                || DriveState::decode(axis.sample.raw.status_word) != Some(DriveState::OperationEnabled)
        };
        let axes = last.axes.as_slice();
        self.step == Step::Done
            && axes.iter().all(is_at_rest)
            && (axes.iter().all(is_released) || self.release_ticks > RELEASE_TICKS_MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_before_the_axes_have_current_ends_the_test() {
        let test = CircleTest { gain_set: 0, circles: [None; 2], positioning_feed: Velocity::mm_per_s(10.0) };
        let mut procedure = CircleProcedure::new(test, Arc::new(AtomicBool::new(true)));
        let off = CycleRecord::empty(2);
        assert_eq!(procedure.next(&off), Some(Order::Stop));
        assert_eq!(procedure.next(&off), None);
        assert!(procedure.is_done(&off), "it waits for axes that nobody will enable");
        assert_eq!(procedure.ending(), Ending::Interrupted);
    }

    #[test]
    fn a_run_ends_when_the_drives_have_let_go_or_would_not() {
        let test = CircleTest { gain_set: 0, circles: [None; 2], positioning_feed: Velocity::mm_per_s(10.0) };
        let mut procedure = CircleProcedure::new(test, Arc::default());
        procedure.step = Step::Done;
        let mut last = CycleRecord::empty(2);
        let sample = &mut last.axes[AxisId::Y].sample;
        sample.freshness = Freshness::Fresh;
        sample.raw.status_word = DriveState::OperationEnabled.status_word();
        assert!(!procedure.is_done(&last), "the drive of y still gives current");
        let mut obeys = last;
        obeys.axes[AxisId::Y].sample.raw.status_word = DriveState::SwitchOnDisabled.status_word();
        assert!(procedure.is_done(&obeys));
        let ticks =
            (0..1_000).take_while(|_| procedure.next(&last).is_none() && !procedure.is_done(&last)).count();
        assert_eq!(ticks, RELEASE_TICKS_MAX as usize, "ticks of the position loop until it gives up");
    }
}
