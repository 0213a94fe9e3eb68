//! A bus that goes wrong on purpose, for tests and the simulated machine: drops, delays, repeats,
//! reorders, corrupts or silences frames. [`Faulty`] wraps any [`Bus`], each direction by its own
//! [`Faults`]; a [`Line`] is one direction without a bus.
//!
//! Chances are per frame, times are on the clock of the cycle. The wrapper reads no clock: its time
//! is the `until` of the last `receive`.
//! Invariant: the same seed and the same calls give the same faults; with [`Faults::NONE`] the
//! wrapper is invisible. Nothing is allocated.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{Bus, Frame, Id, Received, SendError};
use crate::base::time::{Moment, Span};

/// Which identifiers: those that agree with one on the bits of a mask, as the acceptance filter of a CAN
/// controller has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter {
    bits: u16,
    mask: u16,
}

impl Filter {
    /// Every identifier.
    pub const ALL: Self = Self { bits: 0, mask: 0 };

    /// Identifiers that agree with `id` where `mask` has ones.
    pub const fn new(id: Id, mask: u16) -> Self {
        Self { bits: id.raw() & mask, mask }
    }
    /// Whether an identifier is one of these.
    pub const fn accepts(self, id: Id) -> bool {
        id.raw() & self.mask == self.bits
    }
}

/// What goes wrong in one direction. Chances run from 0 (never) to 1 (each frame).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Faults {
    /// Frames that it happens to: those that either filter accepts. The others pass.
    pub frames: [Filter; 2],
    /// Chance that a frame is lost.
    pub drop: f64,
    /// Chance that a frame comes late, and by how much.
    pub delay: (f64, Span),
    /// Chance that a frame comes twice.
    pub repeat: f64,
    /// Chance that a frame is overtaken by the next one, however long that takes.
    pub reorder: f64,
    /// Chance that one random bit of the payload is inverted. On a wire the checksum of CAN finds
    /// such a frame; here it stands for corruption behind that checksum.
    pub flip_bit: f64,
    /// From the first moment up to the second, nothing passes.
    pub silence: Option<(Moment, Moment)>,
}

impl Faults {
    /// A good line.
    pub const NONE: Self = Self {
        frames: [Filter::ALL; 2],
        drop: 0.0,
        delay: (0.0, Span::ZERO),
        repeat: 0.0,
        reorder: 0.0,
        flip_bit: 0.0,
        silence: None,
    };
}

/// What went wrong so far in one direction, in frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultCounts {
    /// Lost by chance.
    pub dropped: u64,
    /// Delayed.
    pub delayed: u64,
    /// Sent twice.
    pub repeated: u64,
    /// Overtaken.
    pub reordered: u64,
    /// With an inverted bit.
    pub flipped: u64,
    /// Swallowed by silence.
    pub silenced: u64,
    /// Lost because too many frames were held back, or because the inner bus refused them.
    pub overflowed: u64,
}

/// Wraps a bus in faults.
#[derive(Debug)]
pub struct Faulty<B> {
    inner: B,
    incoming: Line,
    outgoing: Line,
    now: Moment,
}

impl<B> Faulty<B> {
    /// Wraps `inner`; `seed` decides every chance.
    pub fn new(inner: B, seed: u64, incoming: Faults, outgoing: Faults) -> Self {
        Self {
            inner,
            // Two streams, so that traffic in one direction does not shift the faults of the other.
            incoming: Line::new(incoming, seed),
            outgoing: Line::new(outgoing, !seed),
            now: Moment::ZERO,
        }
    }
    /// Replaces the faults of both directions; frames already held back stay held.
    pub fn set(&mut self, incoming: Faults, outgoing: Faults) {
        self.incoming.set(incoming);
        self.outgoing.set(outgoing);
    }
    /// What went wrong with frames received, and with frames sent.
    pub const fn counts(&self) -> (FaultCounts, FaultCounts) {
        (self.incoming.counts, self.outgoing.counts)
    }
}

impl<B: Bus> Bus for Faulty<B> {
    /// Reports what the inner bus says to the frames now due; a frame that falls due later and is
    /// refused then is counted.
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.outgoing.admit(*frame, self.now);
        while let Some(due) = self.outgoing.release(self.now) {
            self.inner.send(&due)?;
        }
        Ok(())
    }

    fn receive(&mut self, until: Moment) -> Option<Received> {
        self.now = until;
        while let Some(due) = self.outgoing.release(until) {
            if self.inner.send(&due).is_err() {
                self.outgoing.counts.overflowed += 1;
            }
        }
        loop {
            if let Some(frame) = self.incoming.release(until) {
                return Some(Received { frame, at: until });
            }
            let received = self.inner.receive(until)?;
            self.incoming.admit(received.frame, until);
        }
    }

    /// By the inner bus; what is lost here on purpose is in [`Faulty::counts`].
    fn dropped(&self) -> u64 {
        self.inner.dropped()
    }
}

/// Most frames one direction holds back.
const HELD_MAX: usize = 32;

/// A frame held back until its moment is due and its turn has come.
#[derive(Clone, Copy, Debug)]
struct Held {
    frame: Frame,
    due: Moment,
    /// It comes behind those that are on time.
    is_late: bool,
    /// Twice its number; an overtaken frame stands right behind the next one.
    turn: u64,
}

/// One direction of a bus.
#[derive(Debug)]
pub struct Line {
    faults: Faults,
    chance: Pcg64Mcg,
    held: [Option<Held>; HELD_MAX],
    admissions: u64,
    counts: FaultCounts,
}

impl Line {
    /// A line with faults; `seed` decides every chance.
    pub fn new(faults: Faults, seed: u64) -> Self {
        Self {
            faults,
            chance: Pcg64Mcg::seed_from_u64(seed),
            held: [None; HELD_MAX],
            admissions: 0,
            counts: FaultCounts::default(),
        }
    }

    /// Replaces the faults; frames already held back stay held.
    pub const fn set(&mut self, faults: Faults) {
        self.faults = faults;
    }
    /// What went wrong.
    pub const fn counts(&self) -> FaultCounts {
        self.counts
    }

    /// Decides the fate of one frame. Every chance is drawn for every frame that the faults are about, so
    /// changing one chance leaves the other faults where they were.
    pub fn admit(&mut self, frame: Frame, now: Moment) {
        let Faults { frames, drop, delay: (late, delay), repeat, reorder, flip_bit, silence } = self.faults;
        if !frames.iter().any(|filter| filter.accepts(frame.id())) {
            self.admissions += 1;
            self.hold(Held { frame, due: now, is_late: false, turn: 2 * self.admissions });
            return;
        }
        let [is_dropped, is_late, is_repeated, is_overtaken, is_flipped] =
            [drop, late, repeat, reorder, flip_bit].map(|chance| self.chance.random::<f64>() < chance);
        let bit = self.chance.random_range(0..(8 * frame.length()).max(1));
        if silence.is_some_and(|(from, to)| from <= now && now < to) {
            self.counts.silenced += 1;
            return;
        }
        if is_dropped {
            self.counts.dropped += 1;
            return;
        }
        self.counts.delayed += u64::from(is_late);
        self.counts.repeated += u64::from(is_repeated);
        self.counts.reordered += u64::from(is_overtaken);
        self.counts.flipped += u64::from(is_flipped);
        self.admissions += 1;
        let held = Held {
            frame: if is_flipped { frame.with_flipped_bit(bit) } else { frame },
            due: if is_late { now + delay } else { now },
            is_late,
            turn: 2 * self.admissions + if is_overtaken { 3 } else { 0 },
        };
        self.hold(held);
        if is_repeated {
            self.hold(held);
        }
    }

    fn hold(&mut self, held: Held) {
        match self.held.iter_mut().find(|slot| slot.is_none()) {
            Some(slot) => *slot = Some(held),
            None => self.counts.overflowed += 1,
        }
    }

    /// The next frame that may pass at `now`; late ones behind those that are on time.
    pub fn release(&mut self, now: Moment) -> Option<Frame> {
        let turn_now = 2 * self.admissions + 1;
        let next = self
            .held
            .iter_mut()
            .filter(|slot| slot.is_some_and(|held| held.due <= now && held.turn <= turn_now))
            .min_by_key(|slot| slot.map(|held| (held.is_late, held.turn)))?;
        next.take().map(|held| held.frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rt::bus::{Id, memory};

    const PERIOD: Span = Span::us(500);

    fn numbered(number: u16) -> Frame {
        Frame::classic(Id::MAX, number.to_le_bytes())
    }

    /// Sends `frames` frames, one each period, through `faults`; what came out, and in which period.
    fn pass(frames: u16, seed: u64, faults: Faults) -> (Vec<(i64, Frame)>, FaultCounts) {
        let (mut board, host) = memory::pair(64);
        let mut host = Faulty::new(host, seed, faults, Faults::NONE);
        let mut came = Vec::new();
        for period in 0..i64::from(frames) {
            board.send(&numbered(period as u16)).expect("the host keeps up");
            let until = Moment::ZERO + PERIOD * period;
            came.extend(std::iter::from_fn(|| host.receive(until)).map(|r| (period, r.frame)));
        }
        (came, host.counts().0)
    }

    fn numbers(came: &[(i64, Frame)]) -> Vec<u16> {
        came.iter().filter_map(|(_, f)| f.payload_of().map(|bytes| u16::from_le_bytes(*bytes))).collect()
    }

    #[test]
    fn without_faults_it_is_invisible() {
        let (came, counts) = pass(50, 1, Faults::NONE);
        assert_eq!(numbers(&came), (0..50).collect::<Vec<_>>());
        assert_eq!(counts, FaultCounts::default());
    }

    #[test]
    fn the_same_seed_gives_the_same_faults() {
        let faults = Faults {
            drop: 0.2,
            repeat: 0.2,
            reorder: 0.2,
            flip_bit: 0.2,
            delay: (0.2, PERIOD),
            ..Faults::NONE
        };
        assert_eq!(pass(300, 7, faults), pass(300, 7, faults));
        assert_ne!(pass(300, 7, faults), pass(300, 8, faults));
    }

    #[test]
    fn dropped_and_repeated_frames_are_as_many_as_counted() {
        let (came, counts) = pass(1000, 3, Faults { drop: 0.3, ..Faults::NONE });
        assert!(
            (250..350).contains(&counts.dropped),
            "{} of 1000 frames dropped, chance 0.3",
            counts.dropped
        );
        assert_eq!(came.len() as u64, 1000 - counts.dropped);
        let (came, counts) = pass(1000, 3, Faults { repeat: 0.3, ..Faults::NONE });
        assert_eq!(came.len() as u64, 1000 + counts.repeated);
    }

    #[test]
    fn a_delayed_frame_comes_whole_and_later_by_the_delay() {
        let (came, counts) = pass(100, 5, Faults { delay: (0.5, PERIOD * 3), ..Faults::NONE });
        let late = came
            .iter()
            .zip(numbers(&came))
            .map(|((period, _), number)| period - i64::from(number))
            .inspect(|periods| assert!(matches!(periods, 0 | 3), "{periods} periods late, delay is 0 or 3"))
            .filter(|periods| *periods == 3)
            .count();
        assert!(late > 30 && late as u64 <= counts.delayed, "{late} late of {} delayed", counts.delayed);
    }

    #[test]
    fn a_reordered_frame_comes_right_after_the_next() {
        let (came, counts) = pass(100, 2, Faults { reorder: 0.1, ..Faults::NONE });
        let overtaken = numbers(&came).windows(2).filter(|pair| pair[0] > pair[1]).count();
        assert!(overtaken > 0 && overtaken as u64 <= counts.reordered, "{overtaken} of {}", counts.reordered);
        let swaps_too_far = numbers(&came).windows(2).filter(|pair| pair[0] > pair[1] + 2).count();
        assert_eq!(swaps_too_far, 0);
    }

    #[test]
    fn a_flipped_frame_differs_in_one_bit() {
        let (came, counts) = pass(200, 4, Faults { flip_bit: 0.5, ..Faults::NONE });
        let flipped_bits: u32 =
            numbers(&came).iter().zip(0..).map(|(got, sent): (&u16, u16)| (got ^ sent).count_ones()).sum();
        assert_eq!(u64::from(flipped_bits), counts.flipped);
        assert!(counts.flipped > 50);
    }

    #[test]
    fn only_frames_that_a_filter_accepts_are_hit() {
        let id = Id::from_low_bits;
        let of_node_2 = [Filter::new(id(0x182), 0x7FF), Filter::new(id(0x702), 0x7FF)];
        let mut line = Line::new(Faults { frames: of_node_2, drop: 1.0, ..Faults::NONE }, 1);
        for raw in [0x181, 0x182, 0x702, 0x082, 0x080] {
            line.admit(Frame::classic(id(raw), [0]), Moment::ZERO);
        }
        let came: Vec<u16> =
            std::iter::from_fn(|| line.release(Moment::ZERO)).map(|frame| frame.id().raw()).collect();
        assert_eq!(came, [0x181, 0x082, 0x080]);
        assert_eq!(line.counts().dropped, 2);
        assert!(Filter::ALL.accepts(Id::MAX) && Filter::new(id(2), 0x7F).accepts(id(0x582)));
    }

    #[test]
    fn a_late_frame_comes_behind_those_on_time() {
        let mut line = Line::new(Faults { delay: (1.0, PERIOD), ..Faults::NONE }, 1);
        line.admit(numbered(1), Moment::ZERO);
        line.set(Faults::NONE);
        assert_eq!(line.release(Moment::ZERO), None);
        let due = Moment::ZERO + PERIOD;
        line.admit(numbered(2), due);
        assert_eq!([line.release(due), line.release(due)], [Some(numbered(2)), Some(numbered(1))]);
    }

    #[test]
    fn silence_lasts_from_and_up_to_its_moments() {
        let silence = Some((Moment::ZERO + PERIOD * 10, Moment::ZERO + PERIOD * 20));
        let (came, counts) = pass(30, 1, Faults { silence, ..Faults::NONE });
        assert_eq!(numbers(&came), (0..10).chain(20..30).collect::<Vec<_>>());
        assert_eq!(counts.silenced, 10);
    }

    #[test]
    fn a_delayed_frame_is_sent_once_it_is_due() {
        let (mut board, host) = memory::pair(8);
        let mut host = Faulty::new(host, 1, Faults::NONE, Faults { delay: (1.0, PERIOD), ..Faults::NONE });
        host.send(&numbered(1)).expect("room for 8 frames");
        assert_eq!(board.receive(Moment::ZERO), None);
        host.receive(Moment::ZERO + PERIOD);
        assert_eq!(board.receive(Moment::ZERO).map(|r| r.frame), Some(numbered(1)));
    }
}
