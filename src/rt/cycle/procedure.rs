//! Procedures: orders given in sequence, each when the one before is carried out. They run beside the
//! cycle, see only its records, and so take the same course on a machine and in simulation.
//!
//! A [`Programme`] is a list of steps that is made before the start: enable, choose gains, then its steps one
//! after the other, each once all axes are ready, and disable. A fault, or the operator's stop, ends it with
//! the axes at rest and without current. The circular test is such a programme: for each circle move to its
//! start and run it.
//! Invariant: an order is given only from a state in which the cycle accepts it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::seen::{Admission, is_everywhere};
use crate::base::axis::{AXES_MAX, AxisId};
use crate::base::fault::Fault;
use crate::base::order::{Excitation, ExcitedMotion};
use crate::base::record::{CycleRecord, ModeTag};
use crate::base::units::{Acceleration, Position, Velocity};
use crate::rt::control::profile::{CircleMotion, LineMotion, line_duration_s};
use crate::rt::door::{Order, Orders};

/// Most circles of one test: one each way.
pub const CIRCLES_MAX: usize = 2;

/// A straight move of some axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// Where to, by axis; one without a target stays where it is wanted.
    pub target: [Option<Position>; AXES_MAX],
    /// Along the path.
    pub feed: Velocity,
    /// Along the path.
    pub acceleration: Acceleration,
}

impl Way {
    /// The line from where the axes are wanted.
    fn line(&self, last: &CycleRecord) -> LineMotion {
        let from = last.axes.map(|_, axis| axis.setpoint.position);
        let target = from.map(|axis, place| self.target[axis.index()].unwrap_or(*place));
        LineMotion { target, feed: self.feed, acceleration: self.acceleration }
    }
}

/// One step of a programme.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// Move straight.
    Line(Way),
    /// Move in a circle; the axes stand at its start.
    Circle(CircleMotion),
    /// Move straight, and excite an axis on the way.
    Excited {
        /// The move.
        way: Way,
        /// What is added to it.
        excitation: Excitation,
    },
    /// Hold position.
    Dwell {
        /// For so many periods.
        cycles: u64,
    },
}

impl Step {
    /// Whether it is a motion, which the cycle counts.
    pub const fn is_motion(&self) -> bool {
        match self {
            Self::Line(_) | Self::Circle(_) | Self::Excited { .. } => true,
            Self::Dwell { .. } => false,
        }
    }
}

/// What a procedure does.
#[derive(Clone, Debug, PartialEq)]
pub struct Programme {
    /// Gain set of every axis.
    pub gain_set: u8,
    /// In order. Made before the start; nothing is added to it.
    pub steps: Box<[Step]>,
}

impl Programme {
    /// Lowest and highest place that an axis is sent to; zero is where it stands at the start.
    pub fn reach(&self, axis: AxisId) -> (Position, Position) {
        let mut reach = (Position::ZERO, Position::ZERO);
        let mut see = |place: Position| {
            reach.0 = if place < reach.0 { place } else { reach.0 };
            reach.1 = if place > reach.1 { place } else { reach.1 };
        };
        for step in &self.steps {
            match step {
                Step::Line(way) | Step::Excited { way, .. } => {
                    way.target[axis.index()].into_iter().for_each(&mut see);
                }
                Step::Circle(motion) if axis.index() < 2 => {
                    let centre = [motion.circle.centre_x, motion.circle.centre_y][axis.index()];
                    see(centre - motion.circle.radius);
                    see(centre + motion.circle.radius);
                }
                Step::Circle(_) | Step::Dwell { .. } => {}
            }
        }
        reach
    }

    /// Fastest along a path, with all that is excited at its peak.
    pub fn velocity_max(&self) -> Velocity {
        self.steps.iter().fold(Velocity::ZERO, |fastest, step| {
            let velocity = match step {
                Step::Line(way) => way.feed,
                Step::Circle(motion) => motion.circle.feed,
                Step::Excited { way, excitation } => way.feed + excitation.velocity_max(),
                Step::Dwell { .. } => Velocity::ZERO,
            };
            if velocity > fastest { velocity } else { fastest }
        })
    }

    /// Steepest along a path, with all that is excited at its peak.
    pub fn acceleration_max(&self) -> Acceleration {
        self.steps.iter().fold(Acceleration::ZERO, |steepest, step| {
            let acceleration = match step {
                Step::Line(way) => way.acceleration,
                Step::Circle(motion) => motion.acceleration_max(),
                Step::Excited { way, excitation } => way.acceleration + excitation.acceleration_max(),
                Step::Dwell { .. } => Acceleration::ZERO,
            };
            if acceleration > steepest { acceleration } else { steepest }
        })
    }
}

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

impl From<CircleTest> for Programme {
    /// For each circle the way to its start, and the circle; a third axis stays where it is.
    #[cfg_attr(not(test), expect(clippy::disallowed_methods, reason = "made once, before the start"))]
    fn from(test: CircleTest) -> Self {
        let positioning = |circle: &CircleMotion| {
            let (x, y) = circle.start();
            let mut target = [None; AXES_MAX];
            target[AxisId::X.index()] = Some(x);
            target[AxisId::Y.index()] = Some(y);
            Step::Line(Way { target, feed: test.positioning_feed, acceleration: circle.acceleration })
        };
        let circles = test.circles.iter().flatten();
        let steps = circles.flat_map(|circle| [positioning(circle), Step::Circle(*circle)]).collect();
        Self { gain_set: test.gain_set, steps }
    }
}

/// How far it has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Enable,
    UseGains,
    Step { index: usize },
    Dwell { index: usize, since: u64 },
    Stop,
    Disable,
    Done,
}

/// How it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// All steps were taken.
    Complete,
    /// The operator stopped it.
    Interrupted,
    /// The cycle did not begin a motion that it was ordered.
    Refused,
    /// A fault stopped it: the first axis with one that is its own.
    Faulted(AxisId, Fault),
}

/// A programme under way.
#[derive(Clone, Debug)]
pub struct Procedure {
    programme: Programme,
    stage: Stage,
    ending: Ending,
    /// Motions ordered so far; the cycle counts those that it began.
    motions: u32,
    admission: Admission,
    stop_wish: Arc<AtomicBool>,
}

impl Procedure {
    /// A programme to be run; setting `stop_wish` ends it early.
    pub fn new(programme: impl Into<Programme>, stop_wish: Arc<AtomicBool>) -> Self {
        Self {
            programme: programme.into(),
            stage: Stage::Enable,
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

    /// What comes at a place of the list, or behind its end.
    fn at(&self, index: usize) -> Stage {
        if index < self.programme.steps.len() { Stage::Step { index } } else { Stage::Disable }
    }

    fn watch(&mut self, last: &CycleRecord) {
        if let Some((axis, fault)) = Self::fault(last) {
            if self.ending == Ending::Complete {
                self.ending = Ending::Faulted(axis, fault);
            }
            self.stage = Stage::Done;
        } else if self.stop_wish.load(Ordering::Relaxed) && self.ending == Ending::Complete {
            self.ending = Ending::Interrupted;
            self.stage = Stage::Stop;
        } else if last.stage.motion < self.motions && self.ending == Ending::Complete {
            self.ending = Ending::Refused;
            self.stage = Stage::Stop;
        }
    }

    /// A step of the list: its order, if it has one, and what comes after it.
    fn take(&self, index: usize, last: &CycleRecord) -> (Option<Order>, Stage) {
        let next = self.at(index + 1);
        match self.programme.steps.get(index) {
            None => (None, Stage::Disable),
            Some(Step::Line(way)) => (Some(Order::Line(way.line(last))), next),
            Some(Step::Circle(circle)) => (Some(Order::Circle(*circle)), next),
            Some(Step::Excited { way, excitation }) => {
                let motion = ExcitedMotion { line: way.line(last), excitation: *excitation };
                (Some(Order::Excited(motion)), next)
            }
            Some(Step::Dwell { .. }) => (None, Stage::Dwell { index, since: last.cycle }),
        }
    }

    /// Whether a dwell that began in a cycle is over.
    fn has_dwelt(&self, index: usize, since: u64, last: &CycleRecord) -> bool {
        match self.programme.steps.get(index) {
            Some(Step::Dwell { cycles }) => last.cycle.saturating_sub(since) >= *cycles,
            Some(Step::Line(_) | Step::Circle(_) | Step::Excited { .. }) | None => true,
        }
    }
}

impl Orders for Procedure {
    fn next(&mut self, last: &CycleRecord) -> Option<Order> {
        self.watch(last);
        let is_ready = is_everywhere(last, &[ModeTag::Ready]);
        let is_off = is_everywhere(last, &[ModeTag::Off]);
        let (order, stage) = match self.stage {
            Stage::Enable if self.admission.is_given(last) => (Some(Order::Enable), Stage::UseGains),
            Stage::UseGains if is_ready => (Some(Order::UseGains(self.programme.gain_set)), self.at(0)),
            Stage::Step { index } if is_ready => {
                let (order, stage) = self.take(index, last);
                self.motions += u32::from(order.is_some());
                (order, stage)
            }
            Stage::Dwell { index, since } if is_ready && self.has_dwelt(index, since, last) => {
                (None, self.at(index + 1))
            }
            // From any state: the axes come to rest along their path and lose their current there.
            Stage::Stop => (Some(Order::Disable), Stage::Done),
            Stage::Disable if is_ready => (Some(Order::Disable), Stage::Done),
            Stage::Done => {
                // An axis that was still being enabled when the others were told.
                let is_left = is_everywhere(last, &[ModeTag::Off, ModeTag::Ready]) && !is_off;
                return is_left.then_some(Order::Disable);
            }
            Stage::Enable | Stage::UseGains | Stage::Step { .. } | Stage::Dwell { .. } | Stage::Disable => {
                return None;
            }
        };
        self.stage = stage;
        order
    }

    fn is_done(&self, last: &CycleRecord) -> bool {
        self.stage == Stage::Done && is_everywhere(last, &[ModeTag::Off, ModeTag::Faulted])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nothing() -> Programme {
        Programme { gain_set: 0, steps: Box::new([]) }
    }

    #[test]
    fn a_stop_before_the_axes_have_current_ends_the_test() {
        let mut procedure = Procedure::new(nothing(), Arc::new(AtomicBool::new(true)));
        let off = CycleRecord::empty(2);
        assert_eq!(procedure.next(&off), Some(Order::Disable));
        assert_eq!(procedure.next(&off), None);
        assert!(procedure.is_done(&off), "it waits for axes that nobody will enable");
        assert_eq!(procedure.ending(&off), Ending::Interrupted);
    }

    #[test]
    fn an_axis_that_was_enabled_late_is_disabled_too() {
        let mut procedure = Procedure::new(nothing(), Arc::new(AtomicBool::new(true)));
        let mut last = CycleRecord::empty(2);
        last.axes[AxisId::X].mode = ModeTag::Ready;
        procedure.next(&last);
        assert_eq!(procedure.next(&last), Some(Order::Disable), "x is ready, y is off");
        assert!(!procedure.is_done(&last));
    }

    #[test]
    fn a_motion_that_was_not_begun_ends_the_test() {
        let mut procedure = Procedure::new(nothing(), Arc::default());
        procedure.motions = 1;
        let last = CycleRecord::empty(2);
        assert_eq!(procedure.next(&last), Some(Order::Disable));
        assert_eq!(procedure.ending(&last), Ending::Refused);
    }

    #[test]
    fn a_fault_in_the_last_cycle_is_how_it_ended() {
        let procedure = Procedure::new(nothing(), Arc::default());
        let mut last = CycleRecord::empty(2);
        last.axes[AxisId::Y].fault = Some(Fault::FeedbackLost);
        assert_eq!(procedure.ending(&last), Ending::Faulted(AxisId::Y, Fault::FeedbackLost));
    }

    /// All axes in a mode, in a cycle, with so many motions begun.
    fn at(mode: ModeTag, cycle: u64, motion: u32) -> CycleRecord {
        let mut last = CycleRecord { cycle, ..CycleRecord::empty(2) };
        last.stage.motion = motion;
        last.axes.as_mut_slice().iter_mut().for_each(|axis| axis.mode = mode);
        last
    }

    #[test]
    fn steps_are_taken_in_order_and_a_dwell_waits() {
        let target = [Some(Position::mm(5.0)), None, None];
        let way = Way { target, feed: Velocity::mm_per_s(1.0), acceleration: Acceleration::m_per_s2(0.5) };
        let steps = Box::new([Step::Dwell { cycles: 40 }, Step::Line(way)]);
        let mut procedure = Procedure::new(Programme { gain_set: 1, steps }, Arc::default());
        procedure.stage = Stage::UseGains;
        assert_eq!(procedure.next(&at(ModeTag::Ready, 100, 0)), Some(Order::UseGains(1)));
        assert_eq!(procedure.next(&at(ModeTag::Ready, 104, 0)), None, "the dwell begins");
        assert_eq!(procedure.next(&at(ModeTag::Ready, 140, 0)), None);
        assert_eq!(procedure.next(&at(ModeTag::Ready, 144, 0)), None, "it is over");
        let mut ready = at(ModeTag::Ready, 148, 0);
        ready.axes[AxisId::Y].setpoint.position = Position::mm(7.0);
        let Some(Order::Line(line)) = procedure.next(&ready) else { panic!("{procedure:?}") };
        assert_eq!(line.target.as_slice(), [Position::mm(5.0), Position::mm(7.0)], "y stays");
        assert_eq!(procedure.next(&at(ModeTag::Moving, 152, 1)), None);
        assert_eq!(procedure.next(&at(ModeTag::Ready, 900, 1)), Some(Order::Disable));
        assert_eq!(procedure.ending(&at(ModeTag::Off, 904, 1)), Ending::Complete);
    }
}
