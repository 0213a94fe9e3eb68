//! On the wall clock, which here is a number that host and boards share: the host wakes late by chance, answers
//! take their time, and some are too late for their cycle.

use std::collections::VecDeque;

use quadrant::base::axis::PerAxis;
use quadrant::base::record::{ModeTag, Timing as Clock};
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Acceleration, Position, Velocity};
use quadrant::config::Machine;
use quadrant::offline::playback::Timing;
use quadrant::rt::bus::{Bus, Frame, Received, SendError};
use quadrant::rt::control::profile::LineMotion;
use quadrant::rt::cycle::Cycle;
use quadrant::rt::cycle::pace::Slot;
use quadrant::rt::door::Order;
use quadrant::rt::drive::{Drives, Operational};
use quadrant::sim::closed_loop::{Wired, commission};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rstest::rstest;

use crate::common::{X, machine};
use crate::eventful::Kept;
use crate::{Cycles, Given, Way, playback};
use quadrant::offline::playback::Playback;

/// A bus on which time passes.
trait Timed: Bus {
    fn set_now(&mut self, now: Moment);
    fn now(&self) -> Moment;
}

/// Boards whose answers are under way for a while; one of 400 comes behind the window.
struct Slow {
    wired: Wired,
    random: Pcg64Mcg,
    /// Of the reply window.
    thousandth: Span,
    under_way: VecDeque<Received>,
    now: Moment,
}

impl Bus for Slow {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.wired.send(frame)
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        while let Some(Received { frame, .. }) = self.wired.receive(until) {
            let thousandths = if self.random.random_bool(1.0 / 400.0) { 1_200..1_400 } else { 200..750 };
            let at = self.now + self.thousandth * self.random.random_range(thousandths);
            self.under_way.push_back(Received { frame, at });
        }
        self.under_way.make_contiguous().sort_by_key(|received| received.at);
        let received = self.under_way.front().copied().filter(|received| received.at <= until)?;
        self.now = self.now.max(received.at);
        self.under_way.pop_front()
    }
}

impl Timed for Slow {
    fn set_now(&mut self, now: Moment) {
        self.now = now;
    }
    fn now(&self) -> Moment {
        self.now
    }
}

/// A playback on the same clock.
struct Played<'a, 'b> {
    playback: &'a mut Playback<Cycles<'b>>,
    way: Way,
    now: Moment,
}

impl Bus for Played<'_, '_> {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        let received = Received { frame: *frame, at: self.now };
        self.playback.hear(&received, &mut self.way).expect("there is no board");
        Ok(())
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        if self.way.0.is_empty()
            && let Some(due) = self.playback.due().filter(|due| *due <= until)
        {
            self.now = self.now.max(due);
            self.playback.speak(due, &mut self.way);
        }
        self.way.receive(self.now)
    }
}

impl Timed for Played<'_, '_> {
    fn set_now(&mut self, now: Moment) {
        self.now = now;
    }
    fn now(&self) -> Moment {
        self.now
    }
}

/// Two seconds of a host that wakes late by up to so much.
fn run(
    machine: &Machine,
    bus: &mut impl Timed,
    drives: Drives<Operational>,
    late_us_max: i64,
    seed: u64,
) -> Kept {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut cycle = Cycle::new(machine.cycle_settings(), drives, &machine.control_settings());
    let mut kept = Kept::new();
    let line = LineMotion {
        target: PerAxis::filled(machine.axes.count(), Position::mm(30.0)),
        feed: Velocity::mm_per_s(60.0),
        acceleration: Acceleration::m_per_s2(0.5),
    };
    for number in 0..(Span::ms(2_000) / machine.cycle.period) as u64 {
        let scheduled = Moment::ZERO + machine.cycle.period * number as i64;
        let woke = scheduled + Span::us(random.random_range(0..=late_us_max));
        bus.set_now(woke);
        let mut orders = Given(match number {
            0 => Some(Order::Enable),
            400 => Some(Order::Line(line)),
            _ => None,
        });
        let slot = Slot { number, timing: Clock { scheduled, ..Clock::at(woke) }, overruns: 0 };
        let mut at = woke;
        let (record, inputs) = cycle.run(bus, &mut orders, &slot, &mut || {
            at = at + Span::us(1);
            at
        });
        kept.push((*record, inputs.iter().copied().collect()));
        assert!(bus.now() < scheduled + machine.cycle.period, "within its period");
    }
    kept
}

#[rstest]
fn a_log_of_the_wall_clock_draws_the_recorded_commands(#[values("reference", "classic")] name: &str) {
    let machine = machine(name);
    let mut wired = Wired::new(machine.rack(5));
    let drives = || machine.drives().expect("each axis has its board");
    let commissioned = wired.commission(drives()).expect("boards like their sheets");
    let random = Pcg64Mcg::seed_from_u64(17);
    let thousandth = Span::ns(machine.cycle.reply_window.as_ns() / 1_000);
    let mut boards = Slow { wired, random, thousandth, under_way: VecDeque::new(), now: Moment::ZERO };
    let kept = run(&machine, &mut boards, commissioned, 40, 1);
    let last = kept[kept.len() - 1].0.axes[X];
    let moved = kept.iter().filter(|(record, _)| record.axes[X].mode == ModeTag::Moving).count();
    assert!(
        last.link.late > 5 && moved > 500 && last.fault.is_none(),
        "{} late, {moved} moved",
        last.link.late
    );

    // Another host, that wakes at other moments.
    let mut boards = playback(&machine, &kept, Timing::AsRecorded);
    let mut bus = Played { playback: &mut boards, way: Way::default(), now: Moment::ZERO };
    let commissioned = commission(&mut bus, drives()).expect("boards like their sheets");
    let again = run(&machine, &mut bus, commissioned, 25, 2);
    let played = boards.into_played();
    assert_eq!((played.difference, played.ended_early), (None, None));
    assert_eq!(played.cycles, kept.len() as u64);
    for ((again, _), (was, _)) in again.iter().zip(&kept) {
        assert_eq!(
            (again.axes[X].link, again.axes[X].sample.raw),
            (was.axes[X].link, was.axes[X].sample.raw)
        );
    }
    assert_ne!(again[9].0.timing.woke, kept[9].0.timing.woke);
}
