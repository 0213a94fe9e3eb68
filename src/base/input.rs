//! What a cycle was told from outside, beside the feedback that stands in its record: an order, and every
//! frame that was not this cycle's feedback (heartbeats, emergencies, late, repeated, unreadable and
//! foreign frames, reports of the own controller).
//!
//! Record and inputs together are all that a cycle read, so a replay needs nothing else.
//! Invariant: fixed capacity; what does not fit is counted, and the count says that a replay would lack it.

use super::frame::Received;
use super::order::Order;

/// One input of a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    /// Number of the cycle that took it.
    pub cycle: u64,
    /// What it was.
    pub what: What,
}

/// What a cycle can be told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum What {
    /// The order of this cycle.
    Order(Order),
    /// The last heartbeat of a board before the first cycle: what later ones are compared with.
    Before(Received),
    /// A frame.
    Frame {
        /// How many frames the cycle had received before it.
        place: u8,
        /// The frame, and when it came.
        received: Received,
    },
}

/// Most inputs that a cycle keeps: more frames than three axes read in one, and an order.
pub const INPUTS_MAX: usize = 104;

/// The inputs of one cycle.
#[derive(Clone, Debug)]
pub struct Inputs {
    kept: [Option<Input>; INPUTS_MAX],
    count: usize,
    lost: u64,
}

impl Default for Inputs {
    fn default() -> Self {
        Self { kept: [None; INPUTS_MAX], count: 0, lost: 0 }
    }
}

impl Inputs {
    /// A new cycle begins.
    pub fn clear(&mut self) {
        self.count = 0;
    }
    /// Keep one more.
    pub fn push(&mut self, input: Input) {
        match self.kept.get_mut(self.count) {
            Some(slot) => {
                *slot = Some(input);
                self.count += 1;
            }
            None => self.lost += 1,
        }
    }
    /// Those of this cycle, in order.
    pub fn iter(&self) -> impl Iterator<Item = &Input> {
        self.kept.iter().take(self.count).flatten()
    }
    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }
    /// How many did not fit since start.
    pub const fn lost(&self) -> u64 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_counted() {
        let mut inputs = Inputs::default();
        for cycle in 0..INPUTS_MAX as u64 + 3 {
            inputs.push(Input { cycle, what: What::Order(Order::Stop) });
        }
        assert_eq!((inputs.iter().count(), inputs.lost()), (INPUTS_MAX, 3));
        inputs.clear();
        assert!(inputs.is_empty() && inputs.iter().next().is_none() && inputs.lost() == 3);
    }
}
