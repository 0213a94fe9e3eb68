//! What one axis told us in one cycle, raw and in units.
//!
//! Invariant: whoever reads a value can tell from `freshness` and `age_cycles` how old it is.

use super::units::{Current, Position, Velocity};

/// A feedback frame as it came: the input a replay starts from. Scaling and wrap-around are undone
/// once, in `rt/wire/scaling.rs` and `rt/drive`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawFeedback {
    /// Motor encoder, counts, wraps at 2^32.
    pub motor_counts: u32,
    /// Table scale, counts, wraps at 2^32; meaningless where the board has none.
    pub table_counts: u32,
    /// Motor current, in micro-amperes.
    pub current_ua: i32,
    /// The board's own clock when it latched the encoders, in microseconds, wraps at 2^32.
    pub board_time_us: u32,
    /// Low 16 bits of the number of the SYNC this frame answers.
    pub answers_cycle: u16,
    /// CiA 402 status word (object 6041h).
    pub status_word: u16,
    /// Counts the board's feedback frames, wraps at 256.
    pub sequence: u8,
    /// See `rt::wire::feedback::BoardFlags`.
    pub board_flags: u8,
}

/// How a sample stands to the cycle that uses it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Freshness {
    /// No feedback has ever come from this axis.
    #[default]
    Never = 0,
    /// Latched by this cycle's SYNC.
    Fresh = 1,
    /// The last one that came; control does not use it as new.
    Stale = 2,
}

/// One axis, measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// The frame behind it.
    pub raw: RawFeedback,
    /// Whether this cycle's SYNC made it.
    pub freshness: Freshness,
    /// Cycles since the last fresh sample; 0 when this one is fresh.
    pub age_cycles: u32,
    /// Motor encoder, in travel of the axis, zero where the axis stood when the host first heard it.
    pub position: Position,
    /// Velocity of the motor in travel of the axis, as the velocity loop sees it.
    pub velocity: Velocity,
    /// Table scale, same zero; NaN where the machine has none.
    pub table_position: Position,
    /// Motor current.
    pub current: Current,
}
