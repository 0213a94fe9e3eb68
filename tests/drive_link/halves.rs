//! Feedback in two frames: whatever becomes of a half, only halves of this cycle's answer are joined, and
//! each trouble is counted once.

use std::collections::VecDeque;

use quadrant::base::axis::{AxisId, PerAxis};
use quadrant::base::input::{Inputs, What};
use quadrant::base::record::LinkCounts;
use quadrant::base::sample::{Freshness, RawFeedback};
use quadrant::base::time::{Moment, Span};
use quadrant::rt::bus::{Bus, Frame, Received, SendError};
use quadrant::rt::drive::{Drives, Observation, Operational};
use quadrant::rt::wire::classic::STATUS_WORDS;
use quadrant::rt::wire::state::{self, Heartbeat};
use quadrant::rt::wire::{Address, Layout};
use rstest::rstest;

use crate::rig::{SHEET, X, Y, node, settings};

/// Of classic CAN with two axes.
const PERIOD: Span = Span::ms(1);
/// Halves in the order in which a board sends them.
const MOTOR: usize = 0;
const TABLE: usize = 1;
/// Past the first 256, so that a number of another cycle is not 0.
const FIRST: u64 = 1_000;

/// Frames come as they are written down.
#[derive(Default)]
struct Script(VecDeque<Frame>);

impl Bus for Script {
    fn send(&mut self, _: &Frame) -> Result<(), SendError> {
        Ok(())
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        self.0.pop_front().map(|frame| Received { frame, at: until })
    }
}

/// What a board latches at the SYNC of a cycle: each value says in which. Each board has a clock of its own.
fn latched(axis: AxisId, cycle: u64) -> RawFeedback {
    RawFeedback {
        motor_counts: 5_243 * cycle as u32 + axis.index() as u32,
        table_counts: 10_000 * cycle as u32 + axis.index() as u32,
        current_ua: 1_000 * (cycle % 30_000) as i32,
        board_time_us: 1_000 * (cycle - FIRST) as u32 + 333 * axis.index() as u32,
        answers_cycle: cycle as u16,
        status_word: STATUS_WORDS[4],
        sequence: cycle as u8,
        board_flags: 0,
    }
}

fn halves(axis: AxisId, cycle: u64) -> [Frame; 2] {
    let mut frames = Layout::Classic.feedback(node(axis), &latched(axis, cycle));
    [frames.next().expect("a motor half"), frames.next().expect("a table half")]
}

/// The drives of two axes, told what comes in each cycle.
struct Host {
    drives: Drives<Operational>,
    cycle: u64,
    seen: PerAxis<Observation>,
    /// Frames that went to the inputs of the last cycle.
    aside: Vec<Frame>,
}

impl Host {
    /// After ten good cycles.
    fn new() -> Self {
        let drives = Drives::new(PERIOD, settings(Layout::Classic, SHEET)).expect("two nodes").resume([]);
        let seen = PerAxis::filled(2, Observation::default());
        let mut host = Self { drives, cycle: FIRST, seen, aside: Vec::new() };
        for _ in 0..10 {
            let cycle = host.cycle + 1;
            host.hear(&[halves(X, cycle), halves(Y, cycle)].concat());
        }
        assert_eq!(host.counts(), LinkCounts { fresh: 10, ..LinkCounts::default() });
        host
    }

    /// A cycle in which these frames come. Whatever is fresh must be all of this cycle.
    fn hear(&mut self, frames: &[Frame]) {
        self.cycle += 1;
        let until = Moment::ZERO + PERIOD * self.cycle as i64;
        let mut bus = Script(frames.iter().copied().collect());
        let mut inputs = Inputs::default();
        self.drives.collect(&mut bus, self.cycle, until, &mut inputs);
        self.seen = self.drives.observations().map(|_, seen| **seen);
        let frame = |what: &What| match what {
            What::Frame { received, .. } => Some(received.frame),
            What::Order(_) | What::Before(_) => None,
        };
        self.aside = inputs.iter().filter_map(|input| frame(&input.what)).collect();
        for (axis, Observation { sample, .. }) in self.seen.iter() {
            if sample.freshness == Freshness::Fresh {
                // The high half of the board time is the host's own count.
                let board_time_us = latched(axis, self.cycle).board_time_us;
                let expected = RawFeedback {
                    board_time_us: sample.raw.board_time_us & !0xFFFF | board_time_us & 0xFFFF,
                    ..latched(axis, self.cycle)
                };
                assert_eq!(sample.raw, expected, "axis {axis} in cycle {}", self.cycle);
            }
        }
        let used: usize = self.seen.as_slice().iter().map(|o| 2 * usize::from(is_fresh(o))).sum();
        assert_eq!(self.aside.len() + used + bus.0.len(), frames.len(), "each frame is used or kept aside");
    }

    /// A good cycle of Y behind these frames, which are read to the last.
    fn hear_x(&mut self, frames: &[Frame]) {
        let y = halves(Y, self.cycle + 1);
        self.hear(&[frames, &y].concat());
        assert!(is_fresh(&self.seen[Y]), "Y has nothing to do with it");
    }

    fn hear_good(&mut self, cycles: u64) {
        for _ in 0..cycles {
            self.hear_x(&halves(X, self.cycle + 1));
            assert!(is_fresh(&self.seen[X]), "cycle {}", self.cycle);
        }
    }

    fn counts(&self) -> LinkCounts {
        *self.drives.link_counts()[X]
    }
}

fn is_fresh(observation: &Observation) -> bool {
    observation.sample.freshness == Freshness::Fresh
}

#[rstest]
fn a_lost_half_costs_its_cycle_and_no_other(#[values(MOTOR, TABLE)] lost: usize) {
    let mut host = Host::new();
    let rest = halves(X, host.cycle + 1)[1 - lost];
    host.hear_x(&[rest]);
    assert_eq!((host.seen[X].sample.freshness, host.seen[X].sample.age_cycles), (Freshness::Stale, 1));
    assert_eq!(host.seen[X].sample.raw, latched(X, host.cycle - 1), "the last values stay");
    assert_eq!(host.aside, [rest], "a replay needs the half that came");
    host.hear_good(1);
    assert_eq!(host.counts(), LinkCounts { fresh: 11, missed: 1, ..LinkCounts::default() });
}

#[test]
fn halves_are_joined_in_either_order_and_between_those_of_other_axes() {
    let mut host = Host::new();
    for order in [[0, 2, 1, 3], [1, 0, 3, 2], [3, 1, 2, 0], [2, 0, 3, 1], [1, 3, 0, 2]] {
        let cycle = host.cycle + 1;
        let all = [halves(X, cycle), halves(Y, cycle)].concat();
        host.hear(&order.map(|place: usize| all[place]));
        assert!(host.seen.as_slice().iter().all(is_fresh), "in order {order:?}");
        assert!(host.aside.is_empty());
    }
    assert_eq!(host.counts(), LinkCounts { fresh: 15, ..LinkCounts::default() });
}

/// Where a third half can come, in either order of the others.
const PLACES: [(usize, bool); 6] = [(0, false), (1, false), (2, false), (0, true), (1, true), (2, true)];

fn with(pair: [Frame; 2], third: Frame, place: usize, is_table_first: bool) -> Vec<Frame> {
    let mut frames = pair.to_vec();
    if is_table_first {
        frames.reverse();
    }
    frames.insert(place, third);
    frames
}

/// A half comes `periods` late: before, between or behind the halves of the later answer.
#[rstest]
fn a_late_half_is_never_joined(
    #[values(MOTOR, TABLE)] late: usize,
    #[values(1, 2, 8, 255, 256, 257, 512)] periods: u64,
) {
    for (place, is_table_first) in PLACES {
        let mut host = Host::new();
        let old = halves(X, host.cycle + 1);
        host.hear_x(&[old[1 - late]]);
        host.hear_good(periods - 1);
        let frames = with(halves(X, host.cycle + 1), old[late], place, is_table_first);
        host.hear_x(&frames);
        assert!(is_fresh(&host.seen[X]), "the later answer is whole, at {place}, {is_table_first}");
        assert_eq!(host.aside, [old[late]]);
        host.hear_good(3);
        let expected = LinkCounts { fresh: 13 + periods as u32, missed: 1, late: 1, ..LinkCounts::default() };
        assert_eq!(host.counts(), expected, "at {place}, {is_table_first}");
    }
}

/// A half comes late, and that of the later answer does not come at all.
#[rstest]
fn a_late_half_is_not_taken_for_a_lost_one(
    #[values(MOTOR, TABLE)] late: usize,
    #[values(1, 2, 8, 255, 257)] periods: u64,
) {
    for comes_first in [false, true] {
        let mut host = Host::new();
        let old = halves(X, host.cycle + 1);
        host.hear_x(&[old[1 - late]]);
        host.hear_good(periods - 1);
        let rest = halves(X, host.cycle + 1)[1 - late];
        host.hear_x(&if comes_first { [old[late], rest] } else { [rest, old[late]] });
        assert_eq!(host.seen[X].sample.freshness, Freshness::Stale);
        host.hear_good(3);
        let expected = LinkCounts { fresh: 12 + periods as u32, missed: 2, late: 1, ..LinkCounts::default() };
        assert_eq!(host.counts(), expected, "late half first: {comes_first}");
    }
}

/// Its number cannot tell a table half that is 256 cycles late. If the right one does not come, the clock says
/// that the board restarted: the machine stops, and nothing is joined.
#[test]
fn a_table_half_256_late_in_place_of_a_lost_one_stops_the_machine() {
    let mut host = Host::new();
    let old = halves(X, host.cycle + 1);
    host.hear_x(&[old[MOTOR]]);
    host.hear_good(255);
    let motor = halves(X, host.cycle + 1)[MOTOR];
    host.hear_x(&[motor, old[TABLE]]);
    assert_eq!(host.seen[X].sample.freshness, Freshness::Stale);
    assert!(host.seen[X].events.is_board_reset);
    host.hear_good(3);
    let expected = LinkCounts { fresh: 268, missed: 2, resets: 1, ..LinkCounts::default() };
    assert_eq!(host.counts(), expected);
}

#[test]
fn after_a_silence_of_256_cycles_the_next_answer_is_new() {
    let mut host = Host::new();
    (0..255).for_each(|_| host.hear_x(&[]));
    host.hear_good(1);
    assert_eq!(host.counts(), LinkCounts { fresh: 11, missed: 255, ..LinkCounts::default() });
}

#[test]
fn two_table_halves_256_and_512_late_are_late_both() {
    let mut host = Host::new();
    let old = halves(X, host.cycle + 1);
    host.hear_x(&[old[MOTOR]]);
    host.hear_good(255);
    let older = old[TABLE];
    let old = halves(X, host.cycle + 1);
    host.hear_x(&[old[MOTOR]]);
    host.hear_good(255);
    let [motor, table] = halves(X, host.cycle + 1);
    host.hear_x(&[old[TABLE], older, motor, table]);
    assert!(is_fresh(&host.seen[X]));
    assert_eq!(host.aside.len(), 2);
    let expected = LinkCounts { fresh: 521, missed: 2, late: 2, ..LinkCounts::default() };
    assert_eq!(host.counts(), expected);
}

/// A motor half that is 256 cycles late is no answer, and without one there is nothing to doubt.
#[test]
fn halves_256_late_together_are_late_both() {
    let mut host = Host::new();
    let old = halves(X, host.cycle + 1);
    host.hear_x(&[]);
    host.hear_good(255);
    host.hear_x(&old);
    assert_eq!(host.seen[X].sample.freshness, Freshness::Stale);
    host.hear_good(1);
    let expected = LinkCounts { fresh: 266, missed: 2, late: 2, ..LinkCounts::default() };
    assert_eq!(host.counts(), expected);
}

#[rstest]
fn a_repeated_half_is_counted_once_wherever_it_comes(#[values(MOTOR, TABLE)] again: usize) {
    for (place, is_table_first) in PLACES {
        let mut host = Host::new();
        let pair = halves(X, host.cycle + 1);
        host.hear_x(&with(pair, pair[again], place, is_table_first));
        assert!(is_fresh(&host.seen[X]));
        assert_eq!(host.aside, [pair[again]]);
        host.hear_good(1);
        let expected = LinkCounts { fresh: 12, repeated: 1, ..LinkCounts::default() };
        assert_eq!(host.counts(), expected, "at {place}, {is_table_first}");
    }
}

#[rstest]
fn a_half_repeated_a_cycle_later_is_late(#[values(MOTOR, TABLE)] again: usize) {
    let mut host = Host::new();
    let twice = halves(X, host.cycle)[again];
    let [motor, table] = halves(X, host.cycle + 1);
    host.hear_x(&[twice, motor, table]);
    assert!(is_fresh(&host.seen[X]));
    let expected = LinkCounts { fresh: 11, late: 1, ..LinkCounts::default() };
    assert_eq!(host.counts(), expected);
}

#[rstest]
fn an_unreadable_half_is_malformed_and_its_cycle_missed(#[values(MOTOR, TABLE)] broken: usize) {
    let mut host = Host::new();
    let mut frames = halves(X, host.cycle + 1);
    frames[broken] = Frame::classic(frames[broken].id(), [0; 7]);
    host.hear_x(&frames);
    assert_eq!(host.seen[X].sample.freshness, Freshness::Stale);
    host.hear_good(1);
    let expected = LinkCounts { fresh: 11, missed: 1, malformed: 1, ..LinkCounts::default() };
    assert_eq!(host.counts(), expected);
}

/// The answer of a board whose clock begins anew.
fn halves_restarted(axis: AxisId, cycle: u64, board_time_us: u32) -> [Frame; 2] {
    let raw = RawFeedback { board_time_us, ..latched(axis, cycle) };
    let mut frames = Layout::Classic.feedback(node(axis), &raw);
    [frames.next().expect("a motor half"), frames.next().expect("a table half")]
}

#[rstest]
fn a_restart_is_told_once_by_clock_or_boot_up_message(
    #[values(false, true)] is_message_lost: bool,
    #[values(false, true)] is_message_last: bool,
) {
    let mut host = Host::new();
    let boot_up = Heartbeat { state: Heartbeat::BOOT_UP, reset_count: 1, uptime_s: 0 };
    let message = state::encode_heartbeat(node(X), &boot_up);
    let mut told = 0;
    for cycles in 0..5 {
        let mut frames = halves_restarted(X, host.cycle + 1, 20 + 1_000 * cycles).to_vec();
        if cycles == 0 && !is_message_lost {
            frames.insert(if is_message_last { 2 } else { 0 }, message);
        }
        let y = halves(Y, host.cycle + 1);
        host.cycle += 1;
        let until = Moment::ZERO + PERIOD * host.cycle as i64;
        let mut bus = Script(frames.into_iter().chain(y).collect());
        host.drives.collect(&mut bus, host.cycle, until, &mut Inputs::default());
        host.seen = host.drives.observations().map(|_, seen| **seen);
        told += u32::from(host.seen[X].events.is_board_reset);
        assert!(is_fresh(&host.seen[X]) || cycles == 0, "after {cycles} cycles");
    }
    assert_eq!((told, host.counts().resets), (1, 1));
}

#[test]
fn halves_of_a_stranger_are_foreign() {
    let mut host = Host::new();
    let stranger = quadrant::rt::wire::Node::new(9).expect("a node number");
    let foreign = [Address::Feedback(stranger), Address::FeedbackTable(stranger)];
    let [motor, table] = halves(X, host.cycle + 1);
    let frames = foreign.map(|address| Frame::classic(address.id(), [0; 8]));
    host.hear_x(&[motor, frames[0], frames[1], table]);
    assert!(is_fresh(&host.seen[X]));
    assert_eq!(host.drives.bus().foreign, 2);
}
