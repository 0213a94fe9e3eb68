//! Host, faulty memory bus and two moving boards, stepped one period at a time.

use quadrant::base::axis::{AxisId, PerAxis};
use quadrant::base::command::Command;
use quadrant::base::input::Inputs;
use quadrant::base::record::Refusal;
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Current, Position};
use quadrant::rt::bus::faulty::{Faults, Faulty};
use quadrant::rt::bus::{Bus, Frame, Received, SendError, memory};
use quadrant::rt::drive::commission::{CommissionError, CommissionSettings};
use quadrant::rt::drive::sheet::{CommandApplies, Sheet};
use quadrant::rt::drive::state::{DriveState, Target, control_word};
use quadrant::rt::drive::velocity::VelocityEstimate;
use quadrant::rt::drive::{DriveSettings, Drives, Observation, Operational};
use quadrant::rt::wire::command::{self};
use quadrant::rt::wire::scaling::{AxisScale, EncoderCounts, ScaleSettings, Sense, TravelCounts};
use quadrant::rt::wire::{Address, Layout, Node};
use quadrant::sim::board::{Board, Measured};

pub(crate) const X: AxisId = AxisId::X;
pub(crate) const Y: AxisId = AxisId::Y;
pub(crate) const PERIOD: Span = Span::us(500);
/// Way of the motor encoders per period: 0.1 m/s at 9.5 nm per count would be 5243 counts.
pub(crate) const COUNTS_PER_PERIOD: i64 = 5_243;

pub(crate) const SHEET: Sheet = Sheet {
    vendor: 0x5144,
    product: 0x0402,
    revision: 1,
    heartbeat_period_ms: 10,
    watchdog_us: 5_000,
    command_applies: CommandApplies::OnReceipt,
    motor_counts_per_rev: 1 << 20,
    table_counts_per_mm: 100_000,
    peak_current_ma: 25_000,
    rated_current_ma: 10_000,
};

pub(crate) fn node(axis: AxisId) -> Node {
    Node::new(axis.index() as u8 + 1).expect("a node number")
}

pub(crate) fn scale(axis: AxisId) -> AxisScale {
    AxisScale::new(&ScaleSettings {
        lead: Position::mm(10.0),
        motor_counts_per_rev: SHEET.motor_counts_per_rev,
        // One of the axes counts backwards: signs must cancel out.
        motor_sense: if axis == Y { Sense::Against } else { Sense::Along },
        table_counts_per_mm: Some(SHEET.table_counts_per_mm),
        table_sense: Sense::Along,
    })
}

/// Two boards that move steadily, behind a bus whose `receive` lets them answer.
pub(crate) struct Machine {
    pub end: memory::End,
    pub layout: Layout,
    pub boards: [Board; 2],
    pub cycle: u32,
}

impl Machine {
    /// Way of the motor encoder of `axis` since the boards had power.
    pub(crate) fn motor(&self, axis: AxisId) -> TravelCounts {
        TravelCounts::counts(i64::from(self.cycle) * COUNTS_PER_PERIOD * (1 - 2 * axis.index() as i64))
    }
    pub(crate) fn serve(&mut self, now: Moment) {
        while let Some(Received { frame, .. }) = self.end.receive(now) {
            if let Ok(cycle) = command::decode_sync(&frame) {
                self.cycle = cycle;
            }
            for axis in [X, Y] {
                let motor = self.motor(axis);
                let current = self.boards[axis.index()].current_to_apply();
                let measured = Measured { motor, table: motor, current };
                let board = &mut self.boards[axis.index()];
                match Address::of(frame.id()) {
                    Some(Address::Sync) => board.latch(self.cycle, measured, now),
                    _ => board.hear(&frame, now),
                }
            }
        }
        for board in &mut self.boards {
            board.advance(now);
            while let Some(frame) = board.speak() {
                // A host that does not listen loses frames, as on a real bus.
                let _lost_when_full = self.end.send(&frame);
            }
        }
    }
}

/// A bus with the machine at its other end.
pub(crate) struct Wired<B> {
    pub bus: B,
    pub machine: Machine,
}

impl<B: Bus> Bus for Wired<B> {
    fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        self.bus.send(frame)
    }
    fn receive(&mut self, until: Moment) -> Option<Received> {
        self.machine.serve(until);
        self.bus.receive(until)
    }
}

pub(crate) fn settings(layout: Layout, sheet: Sheet) -> PerAxis<DriveSettings> {
    PerAxis::from_fn(2, |axis| DriveSettings {
        node: node(axis),
        layout,
        sheet,
        serial: Some(100 + axis.index() as u32),
        scale: scale(axis),
        velocity_estimate: VelocityEstimate::Difference,
    })
}

/// Host, bus and machine, stepped one period at a time.
pub(crate) struct Rig {
    pub drives: Drives<Operational>,
    pub wired: Wired<Faulty<memory::End>>,
    pub cycle: u64,
    pub sent_control_word: [u16; 2],
    pub seen: PerAxis<Observation>,
    /// What the last cycle was told.
    pub(crate) inputs: Inputs,
}

pub(crate) fn wired(layout: Layout, sheet: Sheet, capacity: usize, seed: u64) -> Wired<Faulty<memory::End>> {
    let (host, end) = memory::pair(capacity);
    // Encoders start just before their wrap.
    let boards = [X, Y].map(|axis| {
        let start = EncoderCounts::counts(if axis == X { u32::MAX - 9_000 } else { 9_000 });
        Board::new(node(axis), layout, sheet, 100 + axis.index() as u32, start, start, Moment::ZERO)
    });
    let machine = Machine { end, layout, boards, cycle: 0 };
    Wired { bus: Faulty::new(host, seed, Faults::NONE, Faults::NONE), machine }
}

pub(crate) fn commission<B: Bus>(
    wired: &mut Wired<B>,
    expected: Sheet,
) -> Result<Drives<Operational>, CommissionError> {
    let mut now = Moment::ZERO;
    let clock = || {
        now = now + Span::us(100);
        now
    };
    let settings = settings(wired.machine.layout, expected);
    let patience = CommissionSettings { reply_timeout: Span::ms(5), tries: 2 };
    Drives::new(PERIOD, settings).expect("two nodes").commission(wired, patience, clock)
}

impl Rig {
    pub(crate) fn new(layout: Layout, sheet: Sheet) -> Self {
        let mut wired = wired(layout, sheet, 64, 7);
        let drives = commission(&mut wired, sheet).unwrap_or_else(|error| panic!("{error}"));
        // Cycles start after commissioning, on the same clock.
        Self {
            drives,
            wired,
            cycle: 1_000,
            sent_control_word: [0; 2],
            seen: PerAxis::filled(2, Observation::default()),
            inputs: Inputs::default(),
        }
    }
    pub(crate) fn until(&self) -> Moment {
        Moment::ZERO + PERIOD * self.cycle as i64
    }
    pub(crate) fn collect(&mut self) -> PerAxis<Observation> {
        self.cycle += 1;
        self.inputs.clear();
        let until = self.until();
        self.drives.collect(&mut self.wired, self.cycle, until, &mut self.inputs);
        self.seen = self.drives.observations().map(|_, seen| **seen);
        self.seen
    }
    pub(crate) fn dispatch(&mut self, current: Current, target: Target) {
        let seen = self.seen;
        let commands = PerAxis::from_fn(2, |axis| Command {
            current,
            control_word: control_word(seen[axis].drive, target, self.sent_control_word[axis.index()]),
            ..Command::default()
        });
        self.sent_control_word = [X, Y].map(|axis| commands[axis].control_word);
        let refusals = self.drives.dispatch(&mut self.wired, &commands, self.cycle);
        assert_eq!(refusals.as_slice(), [Refusal::None; 2], "room for two frames");
    }
    /// Whole periods towards `target`.
    pub(crate) fn run(&mut self, periods: usize, current: Current, target: Target) -> PerAxis<Observation> {
        for _ in 0..periods {
            self.collect();
            self.dispatch(current, target);
        }
        self.collect()
    }
    pub(crate) fn board(&mut self, axis: AxisId) -> &mut Board {
        &mut self.wired.machine.boards[axis.index()]
    }
    pub(crate) fn state(&mut self, axis: AxisId) -> DriveState {
        self.board(axis).drive()
    }
    pub(crate) fn applied(&mut self, axis: AxisId) -> Current {
        scale(axis).current(self.board(axis).current_to_apply())
    }
}

pub(crate) const AMPERE: Current = Current::a(1.0);
