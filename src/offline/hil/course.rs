//! The orders of a scenario's motion, and how the run ended by them.
//!
//! A circle takes the course of `quadrant circle`; a hold enables the axes, lets them stand for its time,
//! and disables them.
//! Invariant: it sees records only, so it is the same over any bus.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::witness::Ending;
use crate::base::fault::Fault;
use crate::base::record::{CycleRecord, ModeTag};
use crate::base::time::{Moment, Span};
use crate::config::scenario::Motion;
use crate::rt::cycle::procedure::{self, Procedure};
use crate::rt::cycle::standby::Standby;
use crate::rt::door::{Order, Orders};

/// Cycles that a machine has to come to rest in, once the orders are done.
pub const CYCLES_AFTER_MAX: u64 = 20_000;
/// For enabling, settling, and stops that take their time.
const SLACK: Span = Span::ms(20_000);

/// Orders under way.
#[derive(Clone, Debug)]
pub struct Course {
    orders: Ordered,
    duration: Span,
}

#[derive(Clone, Debug)]
enum Ordered {
    Circle(Procedure),
    Hold { standby: Standby, is_over: Arc<AtomicBool>, until: Moment, was_held: bool },
}

impl Course {
    /// The orders of a motion.
    pub fn new(motion: &Motion) -> Self {
        let orders = match motion {
            Motion::Circle { test, .. } => Ordered::Circle(Procedure::new(**test, Arc::default())),
            Motion::Hold(lasts) => {
                let is_over = Arc::<AtomicBool>::default();
                let standby = Standby::new(true, Arc::clone(&is_over));
                Ordered::Hold { standby, is_over, until: Moment::ZERO + *lasts, was_held: false }
            }
        };
        Self { orders, duration: motion.duration() }
    }

    /// More cycles than the orders can take.
    pub fn cycles_max(&self, period: Span) -> u64 {
        ((self.duration + SLACK) / period) as u64 + CYCLES_AFTER_MAX
    }

    /// How it ended, once it is done with `last`.
    pub fn ending(&self, last: &CycleRecord) -> Ending {
        match &self.orders {
            Ordered::Circle(procedure) => match procedure.ending(last) {
                procedure::Ending::Complete => Ending::Complete,
                procedure::Ending::Faulted(..) => Ending::Faulted,
                procedure::Ending::Interrupted => Ending::Unfinished,
                procedure::Ending::Refused => Ending::Refused("the cycle did not begin a motion".to_owned()),
            },
            Ordered::Hold { was_held, .. } => {
                let is_faulted = |fault: Option<Fault>| fault.is_some();
                if last.axes.as_slice().iter().any(|axis| is_faulted(axis.fault)) {
                    Ending::Faulted
                } else if *was_held {
                    Ending::Complete
                } else {
                    Ending::Unfinished
                }
            }
        }
    }
}

impl Orders for Course {
    fn next(&mut self, last: &CycleRecord) -> Option<Order> {
        match &mut self.orders {
            Ordered::Circle(procedure) => procedure.next(last),
            Ordered::Hold { standby, is_over, until, was_held } => {
                *was_held |= last.axes.as_slice().iter().all(|axis| axis.mode == ModeTag::Ready);
                if last.timing.scheduled >= *until {
                    is_over.store(true, Ordering::Relaxed);
                }
                standby.next(last)
            }
        }
    }

    fn is_done(&self, last: &CycleRecord) -> bool {
        match &self.orders {
            Ordered::Circle(procedure) => procedure.is_done(last),
            Ordered::Hold { standby, .. } => standby.is_done(last),
        }
    }
}
