//! The daemon's orders while nobody gives any: keep the axes without current, or hold them where they
//! stand; on the stop wish come to rest, take the current away, and be done.
//!
//! Invariant: it never moves an axis.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::seen::{Admission, is_everywhere};
use crate::base::record::{CycleRecord, ModeTag};
use crate::rt::door::{Order, Orders};

/// Waiting beside the cycle.
#[derive(Clone, Debug)]
pub struct Standby {
    wants_hold: bool,
    admission: Admission,
    stop_wish: Arc<AtomicBool>,
}

impl Standby {
    /// Hold position if `wants_hold`, until `stop_wish` is set.
    pub fn new(wants_hold: bool, stop_wish: Arc<AtomicBool>) -> Self {
        Self { wants_hold, admission: Admission::default(), stop_wish }
    }

    fn is_stopping(&self) -> bool {
        self.stop_wish.load(Ordering::Relaxed)
    }
}

impl Orders for Standby {
    fn next(&mut self, last: &CycleRecord) -> Option<Order> {
        if self.is_stopping() {
            return (!is_everywhere(last, &[ModeTag::Off, ModeTag::Faulted])).then_some(Order::Disable);
        }
        if self.wants_hold && self.admission.is_given(last) {
            // Once: after a fault the axes wait for a person.
            self.wants_hold = false;
            return Some(Order::Enable);
        }
        None
    }

    fn is_done(&self, last: &CycleRecord) -> bool {
        self.is_stopping() && is_everywhere(last, &[ModeTag::Off, ModeTag::Faulted])
    }
}
