//! A bus of two ends in one process: what one end sends, the other receives, in order.
//!
//! Simulation and tests run on it, in one thread or in two; a wait-free ring each way, since either
//! direction has one sender and one receiver. There is no bit rate, no arbitration
//! and no loss; dead times belong to the simulated boards, losses to [`super::faulty`].
//! Invariant: fixed capacity, allocated once; a frame is either delivered or counted as refused.

use super::{Bus, Frame, Received, SendError};
use crate::base::time::Moment;

/// One end of the bus.
#[derive(Debug)]
pub struct End {
    incoming: rtrb::Consumer<Frame>,
    outgoing: rtrb::Producer<Frame>,
    refused_frames: u64,
}

/// Both ends of a new bus that holds up to `capacity` frames in each direction.
///
/// # Panics
/// When `capacity` is 0.
pub fn pair(capacity: usize) -> (End, End) {
    assert!(capacity > 0, "a bus that can hold no frame");
    let (to_other, from_one) = rtrb::RingBuffer::new(capacity);
    let (to_one, from_other) = rtrb::RingBuffer::new(capacity);
    (
        End { incoming: from_other, outgoing: to_other, refused_frames: 0 },
        End { incoming: from_one, outgoing: to_one, refused_frames: 0 },
    )
}

impl End {
    /// Frames this end wanted to send and could not.
    pub const fn refused_frames(&self) -> u64 {
        self.refused_frames
    }
}

impl Bus for End {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.outgoing.push(*frame).map_err(|_refused| {
            self.refused_frames += 1;
            // Nobody holds the other end: a full ring will not empty again.
            if self.outgoing.is_abandoned() { SendError::Down } else { SendError::Full }
        })
    }

    /// Never waits. The ring keeps no times, so a frame is stamped with the latest moment at which
    /// it can have come: `until`.
    fn receive(&mut self, until: Moment) -> Option<Received> {
        self.incoming.pop().ok().map(|frame| Received { frame, at: until })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rt::bus::Id;

    fn numbered(number: u8) -> Frame {
        Frame::classic(Id::MAX, [number])
    }

    #[test]
    fn frames_cross_in_order_and_both_ways() {
        let (mut host, mut board) = pair(4);
        for number in 0..3 {
            host.send(&numbered(number)).expect("4 frames fit");
        }
        board.send(&numbered(9)).expect("directions do not share room");
        let came: Vec<_> = std::iter::from_fn(|| board.receive(Moment::ns(5))).collect();
        assert_eq!(came.iter().map(|r| r.frame.payload()[0]).collect::<Vec<_>>(), [0, 1, 2]);
        assert!(came.iter().all(|r| r.at == Moment::ns(5)));
        assert_eq!(host.receive(Moment::ZERO).map(|r| r.frame), Some(numbered(9)));
        assert_eq!(host.receive(Moment::ZERO), None);
    }

    #[test]
    fn a_full_bus_refuses_counts_and_keeps_what_it_has() {
        let (mut host, mut board) = pair(2);
        let outcomes: Vec<_> = (0..4).map(|number| host.send(&numbered(number))).collect();
        assert_eq!(outcomes, [Ok(()), Ok(()), Err(SendError::Full), Err(SendError::Full)]);
        assert_eq!(host.refused_frames(), 2);
        assert_eq!(board.receive(Moment::ZERO).map(|r| r.frame), Some(numbered(0)));
        drop(board);
        assert_eq!(host.send(&numbered(4)), Ok(()));
        assert_eq!(host.send(&numbered(5)), Err(SendError::Down));
    }

    #[test]
    fn two_threads_lose_nothing() {
        const FRAMES: u8 = 200;
        let (mut host, mut board) = pair(8);
        let sender = std::thread::spawn(move || {
            for number in 0..FRAMES {
                while host.send(&numbered(number)).is_err() {
                    std::thread::yield_now();
                }
            }
            host
        });
        let mut expected = 0;
        while expected < FRAMES {
            match board.receive(Moment::ZERO) {
                Some(received) => {
                    assert_eq!(received.frame, numbered(expected));
                    expected += 1;
                }
                None => std::thread::yield_now(),
            }
        }
        drop(sender.join().expect("the sender ends"));
    }
}
