//! Procedures: orders given in sequence, each when the one before is carried out. They run beside the
//! cycle, see only its records, and so take the same course on a machine and in simulation.
//!
//! The circular test: enable, choose gains, then for each circle move to its start and run it, and
//! disable. A fault, or the operator's stop, ends it with the axes at rest and without current.
//! Invariant: an order is given only from a state in which the cycle accepts it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::seen::{Admission, is_everywhere};
use crate::base::axis::AxisId;
use crate::base::fault::Fault;
use crate::base::record::{CycleRecord, ModeTag};
use crate::base::units::{Position, Velocity};
use crate::rt::control::profile::{CircleMotion, LineMotion, line_duration_s};
use crate::rt::door::{Order, Orders};

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
    /// The cycle did not begin a motion that it was ordered.
    Refused,
    /// A fault stopped it: the first axis with one that is its own.
    Faulted(AxisId, Fault),
}

/// A circular test under way.
#[derive(Clone, Debug)]
pub struct CircleProcedure {
    test: CircleTest,
    step: Step,
    ending: Ending,
    /// Motions ordered so far; the cycle counts those that it began.
    motions: u32,
    admission: Admission,
    stop_wish: Arc<AtomicBool>,
}

impl CircleProcedure {
    /// A test to be run; setting `stop_wish` ends it early.
    pub fn new(test: CircleTest, stop_wish: Arc<AtomicBool>) -> Self {
        Self {
            test,
            step: Step::Enable,
            ending: Ending::Complete,
            motions: 0,
            admission: Admission::default(),
            stop_wish,
        }
    }

    /// How it ended, once it is done with `last`. A fault in the very last cycles counts.
    pub fn ending(&self, last: &CycleRecord) -> Ending {
        match (self.ending, Self::fault(last)) {
            (Ending::Complete, Some((axis, fault))) => Ending::Faulted(axis, fault),
            (ending, _) => ending,
        }
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
        } else if last.stage.motion < self.motions && self.ending == Ending::Complete {
            self.ending = Ending::Refused;
            self.step = Step::Stop;
        }
    }
}

impl Orders for CircleProcedure {
    fn next(&mut self, last: &CycleRecord) -> Option<Order> {
        self.watch(last);
        let is_ready = is_everywhere(last, &[ModeTag::Ready]);
        let is_off = is_everywhere(last, &[ModeTag::Off]);
        let circle = |index: usize| self.test.circles.get(index).copied().flatten();
        let (order, step) = match self.step {
            Step::Enable if self.admission.is_given(last) => (Order::Enable, Step::UseGains),
            Step::UseGains if is_ready => (Order::UseGains(self.test.gain_set), self.after(None)),
            Step::Position { circle: index } if is_ready => {
                (self.positioning(&circle(index)?, last), Step::Circle { circle: index })
            }
            Step::Circle { circle: index } if is_ready => {
                (Order::Circle(circle(index)?), self.after(Some(index)))
            }
            // From any state: the axes come to rest along their path and lose their current there.
            Step::Stop => (Order::Disable, Step::Done),
            Step::Disable if is_ready => (Order::Disable, Step::Done),
            Step::Done => {
                // An axis that was still being enabled when the others were told.
                let is_left = is_everywhere(last, &[ModeTag::Off, ModeTag::Ready]) && !is_off;
                return is_left.then_some(Order::Disable);
            }
            Step::Enable | Step::UseGains | Step::Position { .. } | Step::Circle { .. } | Step::Disable => {
                return None;
            }
        };
        self.motions += u32::from(matches!(order, Order::Line(_) | Order::Circle(_)));
        self.step = step;
        Some(order)
    }

    fn is_done(&self, last: &CycleRecord) -> bool {
        self.step == Step::Done && is_everywhere(last, &[ModeTag::Off, ModeTag::Faulted])
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
        assert_eq!(procedure.next(&off), Some(Order::Disable));
        assert_eq!(procedure.next(&off), None);
        assert!(procedure.is_done(&off), "it waits for axes that nobody will enable");
        assert_eq!(procedure.ending(&off), Ending::Interrupted);
    }

    #[test]
    fn an_axis_that_was_enabled_late_is_disabled_too() {
        let test = CircleTest { gain_set: 0, circles: [None; 2], positioning_feed: Velocity::mm_per_s(10.0) };
        let mut procedure = CircleProcedure::new(test, Arc::new(AtomicBool::new(true)));
        let mut last = CycleRecord::empty(2);
        last.axes[AxisId::X].mode = ModeTag::Ready;
        procedure.next(&last);
        assert_eq!(procedure.next(&last), Some(Order::Disable), "x is ready, y is off");
        assert!(!procedure.is_done(&last));
    }

    #[test]
    fn a_motion_that_was_not_begun_ends_the_test() {
        let test = CircleTest { gain_set: 0, circles: [None; 2], positioning_feed: Velocity::mm_per_s(10.0) };
        let mut procedure = CircleProcedure::new(test, Arc::default());
        procedure.motions = 1;
        let last = CycleRecord::empty(2);
        assert_eq!(procedure.next(&last), Some(Order::Disable));
        assert_eq!(procedure.ending(&last), Ending::Refused);
    }

    #[test]
    fn a_fault_in_the_last_cycle_is_how_it_ended() {
        let test = CircleTest { gain_set: 0, circles: [None; 2], positioning_feed: Velocity::mm_per_s(10.0) };
        let procedure = CircleProcedure::new(test, Arc::default());
        let mut last = CycleRecord::empty(2);
        last.axes[AxisId::Y].fault = Some(Fault::FeedbackLost);
        assert_eq!(procedure.ending(&last), Ending::Faulted(AxisId::Y, Fault::FeedbackLost));
    }
}
