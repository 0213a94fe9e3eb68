//! An encoder board with its drive, as the bus sees it: protocol only, no physics.
//!
//! The caller moves a plant and ties it in by plain values: at every SYNC it hands over what the
//! sensors show ([`Measured`]), and between them it applies [`Board::current_to_apply`]. Frames go
//! in through [`hear`](Board::hear) and [`latch`](Board::latch) and come out of
//! [`speak`](Board::speak). The board's clock is the `now` of the caller.
//!
//! The board has a watchdog of its own. While operation is enabled it wants a fresh command (one
//! with a new sequence) to act within the watchdog time of its sheet; otherwise it trips: the drive goes to
//! quick stop active, an emergency is sent and a flag stands in every feedback. A tripped watchdog
//! refuses to enable until it is told to disable voltage, or reset.
//!
//! Faults can be injected by plain methods (`injected.rs`): silence, a frozen, jumping or failed encoder, a
//! reset, a loss of power or of the bus, a drive fault, a weak drive, a false parameter.
//! Invariant: current flows in operation enabled and in no other state.

mod injected;

use std::collections::VecDeque;

use crate::base::sample::RawFeedback;
use crate::base::time::{Moment, Span};
use crate::rt::bus::Frame;
use crate::rt::drive::sheet::{CommandApplies, Sheet};
use crate::rt::drive::state::{DriveState, control_bit, status_bit};
use crate::rt::wire::command::{CYCLIC_SYNCHRONOUS_TORQUE, RawCommand};
use crate::rt::wire::feedback::BoardFlags;
use crate::rt::wire::parameter::{Abort, Access, Object, ObjectAddress};
use crate::rt::wire::scaling::{CurrentCounts, EncoderCounts, TravelCounts};
use crate::rt::wire::state::{Emergency, Heartbeat};
use crate::rt::wire::{Address, Layout, Node, parameter, state};

/// What the sensors of an axis show at a SYNC, in counts since the start of the simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Measured {
    /// Way of the motor encoder.
    pub motor: TravelCounts,
    /// Way of the table scale; ignored if the sheet has none.
    pub table: TravelCounts,
    /// Motor current.
    pub current: CurrentCounts,
}

/// Frames a board holds for the bus before it loses the next.
const OUTBOX_FRAMES: usize = 16;

/// A simulated board.
#[derive(Clone, Debug)]
pub struct Board {
    node: Node,
    layout: Layout,
    sheet: Sheet,
    serial: u32,
    /// What the encoders show where the simulation starts.
    motor_start: EncoderCounts,
    table_start: EncoderCounts,
    drive: DriveState,
    command: Commanded,
    watchdog: Watchdog,
    clock: BoardClock,
    feedback_sequence: u8,
    emergency_counter: u8,
    reset_count: u8,
    last_measured: Measured,
    injected: Injected,
    outbox: VecDeque<Frame>,
    lost_frames: u64,
}

/// Commands as they stand inside the board.
#[derive(Clone, Copy, Debug, Default)]
struct Commanded {
    /// Waits for the next SYNC, if the sheet says so.
    waiting: Option<RawCommand>,
    current: CurrentCounts,
    /// Cycle of the command that acts.
    cycle: Option<u8>,
    control_word: u16,
    is_saturated: bool,
    /// Of the last command heard.
    sequence: Option<u8>,
    /// Whether a fresh command came since the last SYNC.
    is_fresh: bool,
}

#[derive(Clone, Copy, Debug)]
struct Watchdog {
    fed: Moment,
    is_tripped: bool,
}

#[derive(Clone, Copy, Debug)]
struct BoardClock {
    booted: Moment,
    next_heartbeat: Moment,
}

/// Faults injected from outside.
#[derive(Clone, Copy, Debug, Default)]
struct Injected {
    is_silent: bool,
    is_encoder_frozen: bool,
    has_encoder_error: bool,
    has_drive_fault: bool,
    is_off_bus: bool,
    current_max: Option<CurrentCounts>,
    false_value: Option<(Object, u32)>,
}

impl Board {
    /// A board that gets power at `now`. It sends its boot-up message at once; its encoders start
    /// at the given counts, which is where they wrap from.
    pub fn new(
        node: Node,
        layout: Layout,
        sheet: Sheet,
        serial: u32,
        motor_start: EncoderCounts,
        table_start: EncoderCounts,
        now: Moment,
    ) -> Self {
        let mut board = Self {
            node,
            layout,
            sheet,
            serial,
            motor_start,
            table_start,
            drive: DriveState::NotReadyToSwitchOn,
            command: Commanded::default(),
            watchdog: Watchdog { fed: now, is_tripped: false },
            clock: BoardClock { booted: now, next_heartbeat: now },
            feedback_sequence: 0,
            emergency_counter: 0,
            reset_count: 0,
            last_measured: Measured::default(),
            injected: Injected::default(),
            outbox: VecDeque::with_capacity(OUTBOX_FRAMES),
            lost_frames: 0,
        };
        board.boot(now);
        board
    }

    /// The next frame the board wants to send.
    pub fn speak(&mut self) -> Option<Frame> {
        self.outbox.pop_front()
    }
    /// Current the drive makes now: zero unless operation is enabled.
    pub fn current_to_apply(&self) -> CurrentCounts {
        match self.drive {
            DriveState::OperationEnabled => self.command.current.clamp_abs(self.peak_current()),
            DriveState::NotReadyToSwitchOn
            | DriveState::SwitchOnDisabled
            | DriveState::ReadyToSwitchOn
            | DriveState::SwitchedOn
            | DriveState::QuickStopActive
            | DriveState::FaultReactionActive
            | DriveState::Fault => CurrentCounts::ZERO,
        }
    }
    /// Low byte of the cycle of the command that acts, which is what every layout carries; `None` before the
    /// first.
    pub const fn acting_command(&self) -> Option<u8> {
        self.command.cycle
    }
    /// State of the drive.
    pub const fn drive(&self) -> DriveState {
        self.drive
    }
    /// The board's number on the bus.
    pub const fn node(&self) -> Node {
        self.node
    }
    /// Frames lost because nobody took them from the board in time.
    pub const fn lost_frames(&self) -> u64 {
        self.lost_frames
    }

    /// Lets the board's time pass: heartbeat, watchdog, and what the drive does by itself. The
    /// other entries do this first, so calling it is only needed while no frame comes.
    pub fn advance(&mut self, now: Moment) {
        self.step_drive(self.command.control_word);
        if self.drive == DriveState::OperationEnabled && now - self.watchdog.fed > self.sheet.watchdog() {
            self.watchdog.is_tripped = true;
            self.drive = DriveState::QuickStopActive;
            self.report(Emergency::CODE_WATCHDOG, 0);
        }
        if now >= self.clock.next_heartbeat {
            self.beat(Heartbeat::OPERATIONAL, now);
            self.clock.next_heartbeat = now + self.sheet.heartbeat_period();
        }
    }

    /// Takes any frame of the bus but SYNC; what is not for this board is ignored.
    pub fn hear(&mut self, frame: &Frame, now: Moment) {
        self.advance(now);
        if self.injected.is_off_bus {
            return;
        }
        match Address::of(frame.id()) {
            Some(Address::Command(node)) if node == self.node => {
                if let Ok(raw) = self.layout.decode_command(frame) {
                    self.take_command(raw, now);
                }
            }
            Some(Address::ParameterRequest(node)) if node == self.node => {
                if let Ok((object, access)) = parameter::decode_request(frame) {
                    self.post(parameter::encode_reply(self.node, object, self.answer(object, access)));
                }
            }
            Some(_) | None => {}
        }
    }

    /// Takes the SYNC of `cycle`: latches what the sensors show and answers with feedback.
    pub fn latch(&mut self, cycle: u32, measured: Measured, now: Moment) {
        self.advance(now);
        if self.injected.is_off_bus {
            return;
        }
        if let Some(waiting) = self.command.waiting.take() {
            self.apply(waiting, now);
        }
        if !(self.injected.is_encoder_frozen || self.injected.has_encoder_error) {
            self.last_measured = measured;
        }
        let Measured { motor, table, current: _ } = self.last_measured;
        let has_table = self.sheet.table_counts_per_mm > 0;
        self.feedback_sequence = self.feedback_sequence.wrapping_add(1);
        let raw = RawFeedback {
            motor_counts: self.motor_start.after(motor).as_counts(),
            table_counts: if has_table { self.table_start.after(table).as_counts() } else { 0 },
            current_ua: measured.current.as_ua(),
            board_time_us: self.microseconds_since_boot(now),
            answers_cycle: cycle as u16,
            status_word: self.status_word(),
            sequence: self.feedback_sequence,
            board_flags: self.flags().bits(),
        };
        self.command.is_fresh = false;
        let frames = self.layout.feedback(self.node, &raw);
        frames.for_each(|frame| self.post(frame));
    }

    fn take_command(&mut self, raw: RawCommand, now: Moment) {
        let is_fresh = self.command.sequence != Some(raw.sequence);
        if !is_fresh || raw.mode_of_operation != CYCLIC_SYNCHRONOUS_TORQUE {
            return;
        }
        self.command.sequence = Some(raw.sequence);
        self.command.is_fresh = true;
        match self.sheet.command_applies {
            CommandApplies::OnReceipt => self.apply(raw, now),
            CommandApplies::OnNextSync => self.command.waiting = Some(raw),
        }
    }

    fn apply(&mut self, raw: RawCommand, now: Moment) {
        self.watchdog.fed = now;
        self.command.cycle = Some(raw.cycle as u8);
        self.command.current = raw.current.clamp_abs(self.peak_current());
        self.command.is_saturated = raw.current != self.command.current;
        self.step_drive(raw.control_word);
    }

    fn peak_current(&self) -> CurrentCounts {
        self.injected.current_max.unwrap_or(self.sheet.peak_current())
    }

    /// Gives the state machine a control word, seen through the watchdog's latch.
    fn step_drive(&mut self, control_word: u16) {
        let previous = std::mem::replace(&mut self.command.control_word, control_word);
        let is_disabled = control_word & control_bit::ENABLE_VOLTAGE == 0;
        let is_reset = control_word & !previous & control_bit::FAULT_RESET != 0;
        if self.watchdog.is_tripped && (is_disabled || is_reset) {
            self.watchdog.is_tripped = false;
            self.report(Emergency::CODE_NONE, 0);
        }
        let seen = if self.watchdog.is_tripped {
            control_word & !control_bit::ENABLE_OPERATION
        } else {
            control_word
        };
        let was_fault = self.drive == DriveState::Fault;
        // A drive forgets its own fault when it is reset; an encoder's stays while it lasts.
        if was_fault && is_reset {
            self.injected.has_drive_fault = false;
        }
        self.drive = self.drive.next(previous, seen, self.injected.has_drive_fault);
        if was_fault && self.drive != DriveState::Fault {
            self.report(Emergency::CODE_NONE, 0);
        }
    }

    fn status_word(&self) -> u16 {
        let limit = if self.command.is_saturated { status_bit::INTERNAL_LIMIT } else { 0 };
        self.drive.status_word() | limit
    }

    fn flags(&self) -> BoardFlags {
        let is_stale = self.command.sequence.is_some() && !self.command.is_fresh;
        BoardFlags::when(self.watchdog.is_tripped, BoardFlags::WATCHDOG_TRIPPED)
            .with(BoardFlags::when(is_stale, BoardFlags::COMMAND_STALE))
            .with(BoardFlags::when(self.command.is_saturated, BoardFlags::CURRENT_SATURATED))
            .with(BoardFlags::when(self.injected.has_encoder_error, BoardFlags::ENCODER_ERROR))
            .with(BoardFlags::when(self.sheet.table_counts_per_mm > 0, BoardFlags::TABLE_SCALE))
    }

    fn answer(&self, address: ObjectAddress, access: Access) -> Result<u32, Abort> {
        let Some(object) = Object::at(address) else {
            let has_index = Object::ALL.into_iter().any(|object| object.address().index == address.index);
            return Err(if has_index { Abort::NO_SUB_INDEX } else { Abort::NO_OBJECT });
        };
        match access {
            Access::Read => Ok(self.value(object)),
            Access::Write(_) => Err(Abort::READ_ONLY),
            Access::Other(_) => Err(Abort::UNKNOWN_SPECIFIER),
        }
    }

    fn value(&self, object: Object) -> u32 {
        match self.injected.false_value {
            Some((false_object, value)) if false_object == object => value,
            Some(_) | None => match object {
                Object::Serial => self.serial,
                Object::FirmwareConfigHash => self.sheet.firmware_config_hash(),
                stated => self.sheet.value(stated).unwrap_or(0),
            },
        }
    }

    fn boot(&mut self, now: Moment) {
        self.drive = DriveState::NotReadyToSwitchOn;
        self.command = Commanded::default();
        self.watchdog = Watchdog { fed: now, is_tripped: false };
        self.feedback_sequence = 0;
        self.emergency_counter = 0;
        self.clock = BoardClock { booted: now, next_heartbeat: now + self.sheet.heartbeat_period() };
        self.beat(Heartbeat::BOOT_UP, now);
    }

    fn beat(&mut self, state: u8, now: Moment) {
        let uptime_s = u16::try_from((now - self.clock.booted) / Span::ms(1_000)).unwrap_or(u16::MAX);
        let heartbeat = Heartbeat { state, reset_count: self.reset_count, uptime_s };
        self.post(state::encode_heartbeat(self.node, &heartbeat));
    }

    fn report(&mut self, code: u16, detail: u16) {
        self.emergency_counter = self.emergency_counter.wrapping_add(1);
        let register = if code == Emergency::CODE_NONE { 0 } else { Emergency::REGISTER_GENERIC };
        let emergency = Emergency { code, register, detail, counter: self.emergency_counter };
        self.post(state::encode_emergency(self.node, &emergency));
    }

    fn microseconds_since_boot(&self, now: Moment) -> u32 {
        ((now - self.clock.booted) / Span::us(1)) as u32
    }

    fn post(&mut self, frame: Frame) {
        if self.injected.is_silent || self.injected.is_off_bus {
            return;
        }
        if self.outbox.len() < OUTBOX_FRAMES {
            self.outbox.push_back(frame);
        } else {
            self.lost_frames += 1;
        }
    }
}
