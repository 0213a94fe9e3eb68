//! What a scenario is, and how frames, boards and commands are made to go wrong.

use quadrant::base::axis::AxisId;
use quadrant::base::fault::Fault;
use quadrant::rt::bus::Frame;
use quadrant::rt::wire::command::RawCommand;
use quadrant::rt::wire::{Address, Node};

use crate::common::{Fate, Rig, X};

/// What a scenario does to a rig that runs: breaks it, and mends it afterwards.
pub(crate) struct Scenario {
    pub(crate) fault: Fault,
    pub(crate) name: &'static str,
    pub(crate) edits: &'static [(&'static str, &'static str)],
    /// Whether it strikes while the axes move or before they are enabled.
    pub(crate) strikes: Strikes,
    pub(crate) break_it: fn(&mut Rig),
    pub(crate) mend_it: fn(&mut Rig),
    /// Periods from the break until the drive of X gives no current.
    pub(crate) cycles_max: u64,
    /// Way of the motor of X from the break until it stands, mm.
    pub(crate) way_mm_max: f64,
    /// What stands there once it is mended and cleared: the position may not be trusted any more.
    pub(crate) afterwards: Option<Fault>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Strikes {
    Moving,
    Creeping,
    Enabling,
}

pub(crate) fn node(axis: AxisId) -> Node {
    Node::new(axis.index() as u8 + 1).expect("a node number")
}

/// Change each command to X.
pub(crate) fn with_commands(rig: &mut Rig, mut change: impl FnMut(&mut RawCommand) -> Fate + 'static) {
    let layout = rig.machine.bus.layout;
    rig.line.outgoing = Box::new(move |frame: &mut Frame| {
        if Address::of(frame.id()) != Some(Address::Command(node(X))) {
            return Fate::Pass;
        }
        let mut raw = layout.decode_command(frame).expect("the host sends whole commands");
        let fate = change(&mut raw);
        *frame = layout.command(node(X), &raw);
        fate
    });
}

pub(crate) fn good_line(rig: &mut Rig) {
    rig.line.outgoing = Box::new(|_| Fate::Pass);
    rig.line.incoming = Box::new(|_| Fate::Pass);
}

pub(crate) fn lose(rig: &mut Rig, address: Address) {
    rig.line.incoming =
        Box::new(move |frame| if Address::of(frame.id()) == Some(address) { Fate::Lost } else { Fate::Pass });
}

/// Do this to each feedback frame; it is told how many there were, with this one.
pub(crate) fn on_feedback(rig: &mut Rig, mut change: impl FnMut(u32, &mut Frame) -> Fate + 'static) {
    let mut count = 0;
    rig.line.incoming = Box::new(move |frame| {
        if !matches!(Address::of(frame.id()), Some(Address::Feedback(_))) {
            return Fate::Pass;
        }
        count += 1;
        change(count, frame)
    });
}

pub(crate) fn board(rig: &mut Rig) -> &mut quadrant::sim::board::Board {
    rig.line.wired.rack_mut().board_mut(X)
}

pub(crate) const GENTLE: Scenario = Scenario {
    fault: Fault::FeedbackLost,
    name: "",
    edits: &[],
    strikes: Strikes::Moving,
    break_it: |_| (),
    mend_it: good_line,
    cycles_max: 8,
    way_mm_max: 20.0,
    afterwards: None,
};
/// Without current friction brakes 2.6 t with 0.95 kN: 14 mm from 100 mm/s.
pub(crate) const RAMP_WAY_MM_MAX: f64 = 30.0;
/// A ramp at 0.5 m/s^2 from 100 mm/s takes 0.31 s, and the lag of the position loop 0.6 s.
pub(crate) const RAMP_CYCLES_MAX: u64 = 3_000;
/// Where no command gets through, the board's watchdog acts: 40 periods by its sheet, and the way there
/// and back.
pub(crate) const WATCHDOG_CYCLES_MAX: u64 = 45;
