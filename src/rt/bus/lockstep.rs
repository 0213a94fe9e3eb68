//! Lock step: virtual time over a real bus, with a simulated machine in another process at its other end.
//!
//! In virtual time no deadline tells that nothing more will come, so the host asks. Behind all it had to say
//! it sends a marker, and the machine sends that back behind all it has to say to it:
//!
//! ```text
//!   host     command x   command y   SYNC k+1   marker n
//!   machine                                                feedback x   feedback y   marker n
//! ```
//!
//! With the marker the machine has fallen silent, and [`Bus::receive`] says so, as the bus in memory does.
//! Marker 0 begins a session: the machine is as at power-on. Only the patience is wall-clock time: a machine
//! that does not answer within it is lost, and from then on so is the bus.
//!
//! The identifier of the marker is one that CANopen leaves free (CiA 301 reserves 001h to 07Fh; CiA 302 uses
//! 071h to 076h and 07Fh of them). Real boards know no marker: a host that began by mistake in virtual time on
//! a machine gets no answer to marker 0, and has said nothing else.
//! Invariant: host and machine get the same frames in the same order as in memory, at any speed of either.

use super::socketcan::SocketCan;
use super::{Bus, Frame, Id, Received, SendError};
use crate::base::time::{Moment, Span};
use crate::rt::clock::monotonic_now;

/// Identifier of the marker: classic, 4 bytes, its number as u32, little endian.
pub const MARKER: Id = Id::from_low_bits(0x07E);

/// The number of the marker that begins a session.
pub const BEGIN: u32 = 0;

/// The marker with a number.
pub fn marker(number: u32) -> Frame {
    Frame::classic(MARKER, number.to_le_bytes())
}

/// The number of a marker; `None` for any other frame.
pub fn number_of(frame: &Frame) -> Option<u32> {
    let bytes = frame.payload_of().filter(|_| frame.id() == MARKER)?;
    Some(u32::from_le_bytes(*bytes))
}

/// The simulated machine did not answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no simulated machine answered within {} s", .patience.as_s())]
pub struct NoPeer {
    /// How long was waited.
    pub patience: Span,
}

/// Most frames that are held back to go out together.
const OUTBOX_FRAMES: usize = 16;

/// The host's end of a bus in lock step.
#[derive(Debug)]
pub struct Lockstep<B: Bus> {
    inner: B,
    patience: Span,
    /// What goes out with the next marker, in one call: in virtual time nobody acts on it before.
    outbox: [Frame; OUTBOX_FRAMES],
    outgoing: usize,
    /// Of the last marker sent.
    number: u32,
    /// Frames have been sent since then.
    has_spoken: bool,
    /// Until when that marker is waited for, on the monotonic clock; `None`: it has come back.
    waits_until: Option<Moment>,
    is_peer_lost: bool,
}

impl Lockstep<SocketCan> {
    /// Begins a session on an interface, whose moment zero becomes that of the monotonic clock.
    pub fn begin(mut bus: SocketCan, patience: Span) -> Result<Self, NoPeer> {
        bus.set_origin(Moment::ZERO);
        bus.leave_undated();
        Self::begin_on(bus, patience)
    }
}

impl<B: Bus> Lockstep<B> {
    /// Begins a session on any bus that waits until a moment of the monotonic clock, or not at all. What is
    /// still under way from an earlier session is dropped.
    pub fn begin_on(inner: B, patience: Span) -> Result<Self, NoPeer> {
        let mut bus = Self {
            inner,
            patience,
            outbox: [marker(BEGIN); OUTBOX_FRAMES],
            outgoing: 0,
            number: BEGIN,
            has_spoken: false,
            waits_until: None,
            is_peer_lost: false,
        };
        bus.ask(BEGIN);
        while bus.answer().is_some() {}
        if bus.is_peer_lost { Err(NoPeer { patience }) } else { Ok(bus) }
    }

    /// Whether the machine has not answered in time. It stays lost: what it knows of the session is gone.
    pub const fn is_peer_lost(&self) -> bool {
        self.is_peer_lost
    }

    fn put(&mut self, frame: &Frame) {
        if self.outgoing == OUTBOX_FRAMES {
            self.flush();
        }
        if let Some(room) = self.outbox.get_mut(self.outgoing) {
            *room = *frame;
            self.outgoing += 1;
        }
    }

    fn flush(&mut self) {
        let frames = self.outbox.get(..self.outgoing).unwrap_or_default();
        // The machine would wait for what the bus has refused.
        self.is_peer_lost |= self.inner.send_all(frames).is_err();
        self.outgoing = 0;
    }

    fn ask(&mut self, number: u32) {
        self.put(&marker(number));
        self.flush();
        self.number = number;
        self.has_spoken = false;
        self.waits_until = Some(monotonic_now() + self.patience);
    }

    /// The next frame before the marker; `None` at the marker, or when the patience is at its end.
    fn answer(&mut self) -> Option<Frame> {
        while let Some(deadline) = self.waits_until.filter(|_| !self.is_peer_lost) {
            match self.inner.receive(deadline) {
                Some(Received { frame, .. }) => match number_of(&frame) {
                    None => return Some(frame),
                    Some(number) if number == self.number => self.waits_until = None,
                    // Of the round before, whose answers were not all asked for.
                    Some(_) => {}
                },
                // A bus may return early; an interface that was down does.
                None => self.is_peer_lost = monotonic_now() >= deadline,
            }
        }
        None
    }
}

impl<B: Bus> Drop for Lockstep<B> {
    /// The last commands of a run are still to go out.
    fn drop(&mut self) {
        self.flush();
    }
}

impl<B: Bus> Bus for Lockstep<B> {
    /// Holds the frame back until the next `receive`. A bus that refuses it then is lost.
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        if self.is_peer_lost {
            return Err(SendError::Down);
        }
        self.has_spoken = true;
        self.put(frame);
        Ok(())
    }

    /// Waits until the machine has answered all that was sent; a frame came at `until`, as in memory.
    fn receive(&mut self, until: Moment) -> Option<Received> {
        if self.has_spoken && !self.is_peer_lost {
            self.ask(self.number.wrapping_add(1).max(BEGIN + 1));
        }
        self.answer().map(|frame| Received { frame, at: until })
    }

    fn dropped(&self) -> u64 {
        self.inner.dropped()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;

    /// The other end in the same thread: answers as soon as it is spoken to, or no more.
    #[derive(Debug, Default)]
    struct Peer {
        to_host: VecDeque<Frame>,
        heard: Vec<Frame>,
        is_dead: bool,
    }

    impl Bus for Peer {
        fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
            self.heard.push(*frame);
            if !self.is_dead {
                self.to_host.push_back(*frame);
            }
            Ok(())
        }
        fn receive(&mut self, until: Moment) -> Option<Received> {
            Some(Received { frame: self.to_host.pop_front()?, at: until })
        }
    }

    fn numbered(number: u8) -> Frame {
        Frame::classic(Id::MAX, [number])
    }

    fn begun() -> Lockstep<Peer> {
        Lockstep::begin_on(Peer::default(), Span::ms(10_000)).unwrap()
    }

    fn received(bus: &mut Lockstep<Peer>, until: Moment) -> Vec<Received> {
        std::iter::from_fn(|| bus.receive(until)).collect()
    }

    #[test]
    fn what_was_sent_is_answered_up_to_the_marker_and_then_there_is_silence() {
        let mut bus = begun();
        assert_eq!(bus.receive(Moment::ZERO), None, "nothing was said, so nothing is asked");
        for round in 0..3 {
            let until = Moment::ns(i64::from(round) * 500);
            bus.send_all(&[numbered(round), numbered(100)]).unwrap();
            let expected = [round, 100].map(|number| Received { frame: numbered(number), at: until });
            assert_eq!(received(&mut bus, until), expected);
            assert_eq!(bus.receive(until), None);
        }
        let markers: Vec<u32> = bus.inner.heard.iter().filter_map(number_of).collect();
        assert_eq!(markers, [0, 1, 2, 3]);
    }

    #[test]
    fn frames_left_from_the_round_before_come_first_and_its_marker_is_passed_over() {
        let mut bus = begun();
        bus.send_all(&[numbered(1), numbered(2)]).unwrap();
        assert_eq!(bus.receive(Moment::ZERO).map(|r| r.frame), Some(numbered(1)));
        bus.send(&numbered(3)).unwrap();
        let rest: Vec<Frame> = received(&mut bus, Moment::ZERO).iter().map(|r| r.frame).collect();
        assert_eq!(rest, [numbered(2), numbered(3)]);
    }

    #[test]
    fn a_session_begins_behind_what_an_earlier_one_left() {
        let mut peer = Peer::default();
        peer.to_host.extend([numbered(9), marker(7), numbered(8)]);
        let mut bus = Lockstep::begin_on(peer, Span::ms(10_000)).unwrap();
        assert_eq!(bus.receive(Moment::ZERO), None);
    }

    #[test]
    fn the_numbers_go_around_without_beginning_again() {
        let mut bus = begun();
        bus.number = u32::MAX;
        bus.send(&numbered(1)).unwrap();
        assert_eq!(received(&mut bus, Moment::ZERO).len(), 1);
        assert_eq!(bus.inner.heard.iter().filter_map(number_of).collect::<Vec<_>>(), [0, 1]);
    }

    #[test]
    fn a_machine_that_falls_silent_is_lost_for_good() {
        let patience = Span::ms(20);
        let mut bus = begun();
        (bus.patience, bus.inner.is_dead) = (patience, true);
        bus.send(&numbered(1)).unwrap();
        let began = monotonic_now();
        assert_eq!(bus.receive(Moment::ZERO), None);
        assert!(monotonic_now() - began >= patience, "it is waited for");
        assert!(bus.is_peer_lost());
        assert_eq!(bus.send(&numbered(1)), Err(SendError::Down));
        bus.inner.is_dead = false;
        bus.inner.to_host.push_back(numbered(2));
        assert_eq!(bus.receive(Moment::ZERO), None, "its session is over");

        let dead = Peer { is_dead: true, ..Peer::default() };
        let refusal = Lockstep::begin_on(dead, patience).map(drop);
        assert_eq!(refusal, Err(NoPeer { patience }));
        assert_eq!(NoPeer { patience }.to_string(), "no simulated machine answered within 0.02 s");
    }
}
