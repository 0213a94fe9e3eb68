//! Feedback that comes in two frames, put together: classic CAN.
//!
//! The halves of one answer name the same cycle; they may come in either order. A half of another cycle is
//! late; one that is here already is repeated.
//! Invariant: what is joined answers this cycle's SYNC; nothing is kept beyond the cycle.

use crate::base::input::{Input, Inputs, What};
use crate::rt::bus::Received;
use crate::rt::wire::classic::{MotorHalf, TableHalf};

/// A piece, and how it came.
#[derive(Clone, Copy, Debug)]
struct Kept<T> {
    half: T,
    place: u8,
    received: Received,
}

/// The halves of one cycle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Halves {
    motor: Option<Kept<MotorHalf>>,
    table: Option<Kept<TableHalf>>,
}

/// What a half was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Piece {
    /// The other one is still to come.
    Held,
    /// The other one was there.
    Whole {
        motor: MotorHalf,
        table: TableHalf,
        /// Place of the one that came first.
        first_place: u8,
    },
    /// Of another cycle.
    Late,
    /// Here already.
    Repeated,
}

impl Halves {
    pub(super) fn take_motor(
        &mut self,
        half: MotorHalf,
        received: &Received,
        place: u8,
        cycle: u64,
    ) -> Piece {
        let is_of_now = half.cycle == cycle as u16;
        keep(&mut self.motor, half, is_of_now, received, place).unwrap_or_else(|| self.joined())
    }

    pub(super) fn take_table(
        &mut self,
        half: TableHalf,
        received: &Received,
        place: u8,
        cycle: u64,
    ) -> Piece {
        let is_of_now = half.cycle == cycle as u8;
        keep(&mut self.table, half, is_of_now, received, place).unwrap_or_else(|| self.joined())
    }

    fn joined(&self) -> Piece {
        match (self.motor, self.table) {
            (Some(motor), Some(table)) => Piece::Whole {
                motor: motor.half,
                table: table.half,
                first_place: motor.place.min(table.place),
            },
            _ => Piece::Held,
        }
    }

    /// The answer was used.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// The cycle ends: what was not used goes to the inputs.
    pub(super) fn end(&mut self, cycle: u64, inputs: &mut Inputs) {
        let motor = self.motor.take().map(|kept| (kept.place, kept.received));
        let table = self.table.take().map(|kept| (kept.place, kept.received));
        for (place, received) in motor.into_iter().chain(table) {
            inputs.push(Input { cycle, what: What::Frame { place, received } });
        }
    }
}

fn keep<T>(
    slot: &mut Option<Kept<T>>,
    half: T,
    is_of_now: bool,
    received: &Received,
    place: u8,
) -> Option<Piece> {
    if !is_of_now {
        return Some(Piece::Late);
    }
    if slot.is_some() {
        return Some(Piece::Repeated);
    }
    *slot = Some(Kept { half, place, received: *received });
    None
}
