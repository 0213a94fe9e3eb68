//! A script: what goes wrong with the simulated machine, and when.
//!
//! A rack plays it at its end of the bus (`player`), so it is the same whether the host sits in the same
//! process or behind a real bus. Times count from the first SYNC.
//! Invariant: a script is data; with its seed and the same frames it plays the same to the bit.

mod effect;
pub(super) mod player;
pub(super) mod second_host;

pub use effect::{Effect, Frames, Kind, Sends, Timing, Traffic, Way};

use crate::base::axis::AxisId;
use crate::base::time::Span;

/// What goes wrong in a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Script {
    /// Decides every chance.
    pub seed: u64,
    /// In any order.
    pub faults: Vec<ScriptedFault>,
}

/// One thing that goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScriptedFault {
    /// When it begins, since the first SYNC.
    pub at: Span,
    /// How long it lasts; zero for what happens at once, or from the start on for good.
    pub lasts: Span,
    /// The axis it happens to; `None`: all, or the bus as such.
    pub axis: Option<AxisId>,
    /// What happens.
    pub effect: Effect,
}
