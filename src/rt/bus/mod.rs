//! What moves CAN and CAN FD frames: the lowest step of the cycle's way in and its way out.
//!
//! A [`Bus`] is one participant's end. It knows neither what a frame means nor who sent it. What a
//! physical controller reports of itself (error passive, bus-off, restarted) comes in among the frames,
//! as one of [`Format::Report`]; an interface that is down shows as [`SendError::Down`].
//! Invariant: what was handed to a bus is on its way, or refused aloud; it is never dropped silently here.

pub mod faulty;
pub mod lockstep;
pub mod memory;
pub mod socketcan;

pub use crate::base::frame::{Format, Frame, Id, PAYLOAD_BYTES_MAX, Received};
use crate::base::time::Moment;

/// Why a frame was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SendError {
    /// No room to queue the frame; earlier frames still wait for the bus.
    #[error("the bus has no room for another frame")]
    Full,
    /// The bus carries nothing: interface down, bus-off, or the other end is gone.
    #[error("the bus is down")]
    Down,
}

/// One end of a bus.
pub trait Bus {
    /// Queues a frame. Never waits.
    fn send(&mut self, frame: &Frame) -> Result<(), SendError>;

    /// Queues several frames, in order. Never waits. A frame that is refused does not keep the others
    /// from being sent; `refused` is told its place among them, and why.
    fn send_each(&mut self, frames: &[Frame], refused: &mut dyn FnMut(usize, SendError)) {
        for (place, frame) in frames.iter().enumerate() {
            self.send(frame).unwrap_or_else(|why| refused(place, why));
        }
    }

    /// Queues several frames as [`Bus::send_each`]; the first refusal is reported.
    fn send_all(&mut self, frames: &[Frame]) -> Result<(), SendError> {
        let mut outcome = Ok(());
        self.send_each(frames, &mut |_, why| outcome = outcome.and(Err(why)));
        outcome
    }

    /// The next frame, oldest first. Waits for one until the moment `until` at the latest; a frame
    /// that is already there is handed out even after it. `None`: nothing came in time.
    fn receive(&mut self, until: Moment) -> Option<Received>;

    /// Frames that came and were dropped because nobody took them in time, since the bus was opened.
    fn dropped(&self) -> u64 {
        0
    }
}
