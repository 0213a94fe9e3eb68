//! Plays a script on the boards and plants of a rack, and at the rack's end of the bus.
//!
//! ```text
//!   host ──► lines ──► boards ──► lines ──► host          reports of the host's controller
//!             a fault of frames is one line each way ──► join behind them ─────────┘
//! ```
//!
//! Time passes for the boards whether or not a frame reaches them. A fault begins with the first step or
//! SYNC at or after its time.
//! Invariant: without a script it is invisible, and nothing is allocated.

use super::second_host::SecondHost;
use super::{Effect, Script, ScriptedFault, Timing};
use crate::base::record::BusState;
use crate::base::time::{Moment, Span};
use crate::rt::bus::faulty::{Faults, Line};
use crate::rt::bus::{Bus, Format, Frame};
use crate::rt::wire::controller;
use crate::sim::axis::Axis;

/// A script under way.
#[derive(Debug, Default)]
pub(in crate::sim) struct Player {
    acts: Vec<Act>,
    period: Span,
    /// Moment of the first SYNC.
    origin: Option<Moment>,
    /// Frames that the host gets beside those of the boards.
    to_host: Vec<Frame>,
    /// Faults that keep the host off the bus.
    host_off_bus: u32,
}

/// How far a fault has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    Coming,
    Present,
    Over,
}

#[derive(Debug)]
struct Act {
    fault: ScriptedFault,
    progress: Progress,
    /// From the host, and to it.
    incoming: Option<Line>,
    outgoing: Option<Line>,
    second_host: Option<SecondHost>,
}

impl Act {
    fn new(fault: &ScriptedFault, seed: u64) -> Self {
        let traffic = fault.effect.faults().map(|(traffic, _)| traffic);
        let line = |is_hit: bool, seed: u64| is_hit.then(|| Line::new(Faults::NONE, seed));
        Self {
            fault: *fault,
            progress: Progress::Coming,
            incoming: line(traffic.is_some_and(|traffic| traffic.is_to_boards()), seed),
            outgoing: line(traffic.is_some_and(|traffic| traffic.is_from_boards()), !seed),
            second_host: None,
        }
    }
}

impl Player {
    /// A script to be played on these axes; what is wrong from the start is wrong now.
    pub(in crate::sim) fn new(script: &Script, period: Span, axes: &mut [Axis]) -> Self {
        let seeds = (0..).map(|number: u64| script.seed.wrapping_add(number.wrapping_mul(0x9E37_79B9)));
        let mut acts: Vec<Act> =
            script.faults.iter().zip(seeds).map(|(fault, seed)| Act::new(fault, seed)).collect();
        for act in &mut acts {
            if act.fault.effect.kind().timing() == Timing::Start {
                for_each_axis(&act.fault, axes, |axis| axis.begin(&act.fault.effect, Moment::ZERO));
                act.progress = Progress::Over;
            }
        }
        Self { acts, period, ..Self::default() }
    }

    /// The first SYNC has come: the times of the script count from here.
    pub(in crate::sim) fn begin(&mut self, now: Moment) {
        self.origin.get_or_insert(now);
    }

    /// It is now: faults whose time has come begin, those whose time is over end.
    pub(in crate::sim) fn pass(&mut self, now: Moment, axes: &mut [Axis]) {
        let Some(origin) = self.origin else { return };
        let period = self.period;
        for act in &mut self.acts {
            let ScriptedFault { at, lasts, effect, .. } = act.fault;
            if act.progress == Progress::Coming && now >= origin + at {
                act.progress = Progress::Present;
                for_each_axis(&act.fault, axes, |axis| axis.begin(&effect, now));
                act.set_lines(axes);
                match effect {
                    Effect::SecondHost(sends) => act.second_host = Some(SecondHost::new(sends, period, now)),
                    Effect::ControllerBusOff => {
                        self.to_host.push(controller::encode(BusState::BusOff));
                        self.host_off_bus += 1;
                    }
                    Effect::ControllerErrorPassive => {
                        self.to_host.push(controller::encode(BusState::ErrorPassive));
                    }
                    _ => {}
                }
            }
            if act.progress == Progress::Present && now >= origin + at + lasts {
                act.progress = Progress::Over;
                for_each_axis(&act.fault, axes, |axis| axis.end(&effect));
                act.clear_lines();
                act.second_host = None;
                match effect {
                    Effect::ControllerBusOff => {
                        self.host_off_bus -= 1;
                        self.to_host.push(controller::encode(BusState::ErrorActive));
                    }
                    Effect::ControllerErrorPassive => {
                        self.to_host.push(controller::encode(BusState::ErrorActive));
                    }
                    _ => {}
                }
            }
        }
    }

    /// What another host says up to a moment. The first one hears it as the boards do.
    pub(in crate::sim) fn second_hosts(&mut self, until: Moment, axes: &[Axis]) -> Vec<Frame> {
        let mut said = Vec::new();
        for host in self.acts.iter_mut().filter_map(|act| act.second_host.as_mut()) {
            host.speak(until, axes.iter().map(Axis::address), |frame| said.push(frame));
        }
        self.to_host.extend(&said);
        said
    }

    /// A frame of the host, or none, and what reaches the boards by now.
    pub(in crate::sim) fn hear(&mut self, frame: Option<&Frame>, now: Moment, mut reach: impl FnMut(&Frame)) {
        let frame = frame.filter(|_| self.host_off_bus == 0);
        let lines = self.acts.iter_mut().filter_map(|act| act.incoming.as_mut());
        pass_through(lines, frame.copied(), now, |frame| reach(&frame));
    }

    /// Puts on the bus what the boards and others have to say to the host.
    pub(in crate::sim) fn speak(&mut self, axes: &mut [Axis], now: Moment, bus: &mut impl Bus) {
        let is_off = self.host_off_bus > 0;
        // A full bus loses a frame, as a real one does; the host sees it missing.
        for frame in self.to_host.drain(..) {
            // A report does not come from the bus.
            if !is_off || frame.format() == Format::Report {
                let _lost = bus.send(&frame);
            }
        }
        let mut say = |frame: Frame| {
            if !is_off {
                let _lost = bus.send(&frame);
            }
        };
        for axis in axes {
            while let Some(answer) = axis.board.speak() {
                let lines = self.acts.iter_mut().filter_map(|act| act.outgoing.as_mut());
                pass_through(lines, Some(answer), now, &mut say);
            }
        }
        let lines = self.acts.iter_mut().filter_map(|act| act.outgoing.as_mut());
        pass_through(lines, None, now, &mut say);
    }
}

impl Act {
    fn set_lines(&mut self, axes: &[Axis]) {
        let Some((traffic, faults)) = self.fault.effect.faults() else { return };
        let node = self.fault.axis.and_then(|axis| axes.get(axis.index())).map(|axis| axis.address().0);
        let faults = Faults { frames: traffic.filters(node), ..faults };
        [&mut self.incoming, &mut self.outgoing].into_iter().flatten().for_each(|line| line.set(faults));
    }

    fn clear_lines(&mut self) {
        let lines = [&mut self.incoming, &mut self.outgoing];
        lines.into_iter().flatten().for_each(|line| line.set(Faults::NONE));
    }
}

/// Each axis that a fault happens to; none for a fault of the bus.
fn for_each_axis(fault: &ScriptedFault, axes: &mut [Axis], mut act: impl FnMut(&mut Axis)) {
    if fault.effect.kind().has_axis() {
        let is_hit = |index: usize| fault.axis.is_none_or(|axis| axis.index() == index);
        axes.iter_mut().enumerate().filter(|(index, _)| is_hit(*index)).for_each(|(_, axis)| act(axis));
    }
}

/// A frame, or none, through one line after the other; what comes out at the end by now.
fn pass_through<'a>(
    mut lines: impl Iterator<Item = &'a mut Line>,
    frame: Option<Frame>,
    now: Moment,
    mut out: impl FnMut(Frame),
) {
    let Some(first) = lines.next() else {
        return frame.into_iter().for_each(out);
    };
    if let Some(frame) = frame {
        first.admit(frame, now);
    }
    let mut last = first;
    for line in lines {
        while let Some(frame) = last.release(now) {
            line.admit(frame, now);
        }
        last = line;
    }
    while let Some(frame) = last.release(now) {
        out(frame);
    }
}
