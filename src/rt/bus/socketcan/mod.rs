//! A CAN interface of Linux as a [`Bus`]: `can0` on a machine, `vcan0` on a desk.
//!
//! ```text
//!   send_all ──► sendmmsg ──► queue of the interface ──► bus
//!   receive  ◄── batch ◄── recvmmsg ◄── socket buffer ◄── filters of the kernel ◄── bus
//! ```
//!
//! A period of two axes takes at least 4 system calls: SYNC out, wait, both answers in, both commands out;
//! at most 2 more for each answer that comes by itself, as on a real bus they do. The clocks are read in
//! between, which is no call into the kernel.
//!
//! Frames are dated by the kernel when they come, and handed out in time of the run. Reports of the own
//! controller come among them. What the kernel dropped, because the socket buffer was full, is counted.
//!
//! An interface that goes down refuses frames as [`SendError::Down`] and serves again when it is up. One that
//! is removed is looked for every [`SEARCH_INTERVAL`], when frames are sent or received; a search is three
//! system calls, or five when it finds the interface. These may wait for the kernel's lock of its network
//! configuration: up to 0.6 s beside two loops of `ip link add` and `del`, where any other call took 0.2 ms (in a
//! guest with one processor, `tests/vcan/interface.rs`). The cycle is late by that, and nothing hangs on it: the
//! bus is away, fault 18 stands, and the boards' watchdogs have taken the current. A controller that has left the bus
//! (bus-off) is restarted by the kernel, see `docs/can.md`.
//! Invariant: after opening, nothing is allocated, and while the interface is there only `receive` waits, until its
//! deadline at the latest.

mod batch;
mod layout;
mod open;
mod stamps;

use std::os::fd::AsFd;

use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::time::TimeSpec;
use socketcan::CanSocket;

use self::batch::Slot;
use self::layout::Raw;
pub use self::open::{OpenError, Settings, is_virtual};
use self::stamps::Stamps;
use super::{Bus, Frame, Received, SendError};
use crate::base::time::{Moment, Span};
use crate::rt::clock::{Clocks, monotonic_now};

/// How often a removed interface is looked for.
pub const SEARCH_INTERVAL: Span = Span::ms(100);

/// An open CAN interface.
#[derive(Debug)]
pub struct SocketCan {
    socket: CanSocket,
    interface: String,
    filters: Box<[u8]>,
    /// When the interface is looked for again; `None` while the socket is bound to it.
    search_at: Option<Moment>,
    /// Moment zero of the run, on the monotonic clock.
    origin: Moment,
    stamps: Stamps,
    /// Whether somebody asks when frames came.
    is_dated: bool,
    inbox: Inbox,
    dropped: Dropped,
    /// Whether reports are sent.
    plays_controllers: bool,
}

/// Frames that were received and not yet handed out.
#[derive(Debug)]
struct Inbox {
    slots: [Slot; batch::FRAMES],
    /// When each came, on the monotonic clock.
    times: [Moment; batch::FRAMES],
    next: usize,
    count: usize,
}

impl Inbox {
    const fn new() -> Self {
        Self { slots: [Slot::EMPTY; batch::FRAMES], times: [Moment::ZERO; batch::FRAMES], next: 0, count: 0 }
    }

    /// The oldest frame; what is none of this bus is passed over.
    fn pop(&mut self) -> Option<Received> {
        while self.next < self.count {
            let at = self.next;
            self.next += 1;
            if let (Some(slot), Some(&at)) = (self.slots.get(at), self.times.get(at))
                && let Some(frame) = layout::decode(&slot.raw)
            {
                return Some(Received { frame, at });
            }
        }
        None
    }
}

/// Frames that the kernel dropped: its counter, which wraps, carried on.
#[derive(Clone, Copy, Debug, Default)]
struct Dropped {
    total: u64,
    last: u32,
}

impl Dropped {
    fn advance(&mut self, counter: u32) {
        self.total += u64::from(counter.wrapping_sub(self.last));
        self.last = counter;
    }
}

impl SocketCan {
    /// Opens an interface. Moment zero of the run is `origin` on the monotonic clock.
    pub fn open(settings: &Settings<'_>, origin: Moment) -> Result<Self, OpenError> {
        let filters = layout::filters(settings.identifiers);
        let socket = open::open(settings, &filters)?;
        Ok(Self {
            socket,
            interface: settings.interface.to_owned(),
            filters,
            search_at: None,
            origin,
            stamps: Stamps::since(monotonic_now()),
            is_dated: true,
            inbox: Inbox::new(),
            dropped: Dropped::default(),
            plays_controllers: false,
        })
    }

    /// The run begins at `origin` on the monotonic clock: moment zero from here on.
    pub fn set_origin(&mut self, origin: Moment) {
        self.origin = origin;
    }

    /// From here on a frame comes when it is waited for: in virtual time nobody asks when it really came, and
    /// where reading a clock is a call into the kernel, the dates are a large part of a cycle.
    pub fn leave_undated(&mut self) {
        self.is_dated = false;
    }

    /// From here on reports are sent too: everybody else on the interface takes them for those of their own
    /// controller. Virtual interfaces carry them, and have no controller that could report; for a simulated
    /// machine, never for a host.
    ///
    /// # Errors
    /// On an interface that may have a controller.
    pub fn play_controllers(&mut self) -> Result<(), OpenError> {
        let link = std::path::Path::new("/sys/class/net").join(&self.interface);
        if !is_virtual(&link, &self.interface) {
            return Err(OpenError::HasController { interface: self.interface.clone() });
        }
        self.plays_controllers = true;
        Ok(())
    }

    /// Attaches to an interface that was removed, if it is there again and it is time to look.
    fn search(&mut self, now: Moment) {
        if self.search_at.is_some_and(|due| now >= due) {
            let is_attached = open::attach(&self.socket, &self.interface, &self.filters).is_ok();
            self.search_at = if is_attached { None } else { Some(now + SEARCH_INTERVAL) };
        }
    }

    /// The interface has been removed if the system says so; the socket is bound to nothing then.
    fn note(&mut self, errno: Errno) {
        if matches!(errno, Errno::ENODEV | Errno::ENXIO) {
            // At once: if it is back already, no frame more is lost.
            self.search_at.get_or_insert(Moment::ZERO);
        }
    }

    /// Waits until a frame is there, or an error, or the deadline; whether it is worth looking.
    fn wait(&self, remaining: Span) -> bool {
        let timeout = TimeSpec::new(remaining.as_ns() / 1_000_000_000, remaining.as_ns() % 1_000_000_000);
        let mut sockets = [PollFd::new(self.socket.as_fd(), PollFlags::POLLIN)];
        match ppoll(&mut sockets, Some(timeout), None) {
            Ok(ready) => ready > 0,
            // The caller reads the clock again and waits for the rest.
            Err(Errno::EINTR) => true,
            Err(_) => false,
        }
    }

    /// Takes what waits in the socket. `before` was read before; whether the socket is well.
    fn fill(&mut self, before: Moment) -> bool {
        self.inbox.next = 0;
        self.inbox.count = match batch::receive(self.socket.as_fd(), &mut self.inbox.slots) {
            Ok(count) => count,
            Err(Errno::EAGAIN | Errno::EINTR) => 0,
            Err(errno) => {
                self.inbox.count = 0;
                self.note(errno);
                return false;
            }
        };
        if self.inbox.count > 0 {
            let now = self.is_dated.then(Clocks::now);
            let slots = self.inbox.slots.iter().zip(&mut self.inbox.times);
            for (slot, time) in slots.take(self.inbox.count) {
                *time = now.map_or(before, |now| self.stamps.place(slot.stamp, now));
                if let Some(counter) = slot.dropped {
                    self.dropped.advance(counter);
                }
            }
        }
        if self.inbox.count < batch::FRAMES {
            self.stamps.nothing_before(before);
        }
        true
    }

    /// Queues frames in the kernel's layout; how many it took, or why it refused the first.
    fn push(&mut self, raws: &[Raw]) -> Result<usize, SendError> {
        loop {
            return match batch::send(self.socket.as_fd(), raws) {
                Err(Errno::EINTR) => continue,
                Err(Errno::EAGAIN | Errno::ENOBUFS) => Err(SendError::Full),
                Err(errno) => {
                    self.note(errno);
                    Err(SendError::Down)
                }
                Ok(count) => Ok(count),
            };
        }
    }

    /// Queues up to a batch of frames, all that can be.
    fn send_batch(&mut self, frames: &[Frame], refused: &mut dyn FnMut(usize, SendError)) {
        let mut raws = [Raw::EMPTY; batch::FRAMES];
        let mut places = [0; batch::FRAMES];
        let mut count = 0;
        for (place, frame) in frames.iter().enumerate() {
            let report = || layout::encode_report(frame).filter(|_| self.plays_controllers);
            match (layout::encode(frame).or_else(report), raws.get_mut(count), places.get_mut(count)) {
                (Some(raw), Some(room), Some(of_raw)) => {
                    (*room, *of_raw) = (raw, place);
                    count += 1;
                }
                // A report of a controller: no real bus carries it.
                _ => refused(place, SendError::Down),
            }
        }
        let mut next = 0;
        while let Some(rest) = raws.get(next..count).filter(|rest| !rest.is_empty()) {
            let taken = self.push(rest).unwrap_or_else(|refusal| {
                refused(places.get(next).copied().unwrap_or(next), refusal);
                // The one that was refused does not keep the others from being sent.
                1
            });
            next += taken.max(1);
        }
    }
}

impl Bus for SocketCan {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.send_all(std::slice::from_ref(frame))
    }

    fn send_each(&mut self, frames: &[Frame], refused: &mut dyn FnMut(usize, SendError)) {
        if self.search_at.is_some() {
            self.search(monotonic_now());
        }
        for (number, batch) in frames.chunks(batch::FRAMES).enumerate() {
            self.send_batch(batch, &mut |place, why| refused(number * batch::FRAMES + place, why));
        }
    }

    /// The next frame. An interface that goes down, or is removed, ends the wait before its deadline.
    fn receive(&mut self, until: Moment) -> Option<Received> {
        let deadline = self.origin + (until - Moment::ZERO);
        loop {
            if let Some(Received { frame, at }) = self.inbox.pop() {
                return Some(Received { frame, at: Moment::ZERO + (at - self.origin) });
            }
            let now = monotonic_now();
            self.search(now);
            let is_over = now >= deadline;
            if !is_over && !self.wait(deadline - now) {
                return None;
            }
            if !self.fill(now) || (is_over && self.inbox.count == 0) {
                return None;
            }
        }
    }

    fn dropped(&self) -> u64 {
        self.dropped.total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bus_can_go_to_its_thread() {
        fn goes<T: Send>() {}
        goes::<SocketCan>();
    }

    #[test]
    fn the_count_of_dropped_frames_goes_over_the_wrap() {
        let mut dropped = Dropped::default();
        for counter in [0, 7, 7, u32::MAX, 3] {
            dropped.advance(counter);
        }
        assert_eq!(dropped.total, (1 << 32) + 3);
    }
}
