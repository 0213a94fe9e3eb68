//! Feedback that comes in two frames, put together: classic CAN.
//!
//! The halves of one answer name the same cycle; they may come in either order. A half of another cycle is
//! late; one that is here already is repeated. The table half names its cycle by the low byte only: if it is
//! a multiple of 256 cycles late, the board's clock in it does not fit, and it is doubtful. Either a fitting
//! one comes too, or the board has begun its time again.
//! Invariant: what is joined answers this cycle's SYNC; nothing is kept beyond the cycle.

use crate::base::input::{Input, Inputs, What};
use crate::base::record::{Arrival, Arrivals};
use crate::rt::bus::Received;
use crate::rt::wire::classic::{MotorHalf, TableHalf};

/// A piece, and how it came.
#[derive(Clone, Copy, Debug)]
struct Kept<T> {
    half: T,
    place: u8,
    received: Received,
}

impl<T> Kept<T> {
    const fn arrival(&self) -> Arrival {
        Arrival { place: self.place, at: self.received.at }
    }
}

/// A table half and the board time that it is short for.
#[derive(Clone, Copy, Debug)]
struct Timed {
    half: TableHalf,
    board_time_us: u32,
}

/// The halves of one cycle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Halves {
    motor: Option<Kept<MotorHalf>>,
    table: Option<Kept<Timed>>,
    doubtful: Option<Kept<()>>,
    /// The answer was used; what comes of it now was here already.
    is_used: bool,
}

/// What a half was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Piece {
    /// The other one is still to come.
    Held,
    /// The other one was there.
    Whole { motor: MotorHalf, table: TableHalf, board_time_us: u32, arrivals: Arrivals },
    /// Of another cycle.
    Late,
    /// Here already.
    Repeated,
}

/// What became of a doubtful half.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Doubt {
    /// There was none.
    None,
    /// It was of another cycle.
    Late,
    /// The rest of the answer was there and no other table half: the clock of the board began again.
    Restart,
}

impl Halves {
    pub(super) fn take_motor(
        &mut self,
        half: MotorHalf,
        received: &Received,
        place: u8,
        cycle: u64,
    ) -> Piece {
        if half.cycle != cycle as u16 {
            return Piece::Late;
        }
        if self.is_used || self.motor.is_some() {
            return Piece::Repeated;
        }
        self.motor = Some(Kept { half, place, received: *received });
        self.joined()
    }

    /// `board_time_us` is what the half is short for; `None` if that does not fit the board's clock.
    pub(super) fn take_table(
        &mut self,
        half: TableHalf,
        board_time_us: Option<u32>,
        received: &Received,
        place: u8,
        cycle: u64,
    ) -> Piece {
        if half.cycle != cycle as u8 {
            return Piece::Late;
        }
        let is_here = self.is_used || self.table.is_some();
        let received = *received;
        match board_time_us {
            None if self.doubtful.is_some() => Piece::Late,
            None => {
                self.doubtful = Some(Kept { half: (), place, received });
                Piece::Held
            }
            Some(_) if is_here => Piece::Repeated,
            Some(board_time_us) => {
                self.table = Some(Kept { half: Timed { half, board_time_us }, place, received });
                self.joined()
            }
        }
    }

    fn joined(&self) -> Piece {
        match (self.motor, self.table) {
            (Some(motor), Some(table)) => Piece::Whole {
                motor: motor.half,
                table: table.half.half,
                board_time_us: table.half.board_time_us,
                arrivals: Arrivals { motor: motor.arrival(), table: table.arrival() },
            },
            _ => Piece::Held,
        }
    }

    /// The answer was used.
    pub(super) fn clear(&mut self) {
        self.motor = None;
        self.table = None;
        self.is_used = true;
    }

    /// The cycle ends: what was not used goes to the inputs.
    pub(super) fn end(&mut self, cycle: u64, inputs: &mut Inputs) -> Doubt {
        self.is_used = false;
        if self.motor.is_none() && self.table.is_none() && self.doubtful.is_none() {
            // Nearly always: what was kept was used.
            return Doubt::None;
        }
        let motor = self.motor.take().map(|kept| (kept.place, kept.received));
        let table = self.table.take().map(|kept| (kept.place, kept.received));
        let doubtful = self.doubtful.take().map(|kept| (kept.place, kept.received));
        for (place, received) in [motor, table, doubtful].into_iter().flatten() {
            inputs.push(Input { cycle, what: What::Frame { place, received } });
        }
        match (doubtful, motor, table) {
            (None, _, _) => Doubt::None,
            (Some(_), Some(_), None) => Doubt::Restart,
            (Some(_), _, _) => Doubt::Late,
        }
    }
}
